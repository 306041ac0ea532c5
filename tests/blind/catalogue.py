"""What can be hidden: each effect with its laws by shape, its places on each rig, and how its numbers are drawn.

Numbers are drawn for the size 1, the largest that makes sense; `grows` are multiplied by the size that a data set
has, `shrinks` are divided by it. A shape `same` is the law of the catalogue of effects, `other` a different one.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from blind.laws import drive, elastic, friction, loads, sensors
from blind.laws.law import Law
from blind.rigs import Scale

Draw = Callable[[np.random.Generator, Scale], dict[str, float]]
RAIL = {"linear_damp_mod": ("rail",), "driven_cart": ("rail",)}
BEARING = {"rota_damp": ("bearing",), "driven_cart": ("bearing",)}
BOTH = {"rota_damp": ("bearing",), "linear_damp_mod": ("rail",), "driven_cart": ("rail", "bearing")}
SPRINGS = {"linear_damp_mod": ("spring_1", "spring_2")}
CHAIN = {"linear_damp_mod": ("chain",), "driven_cart": ("chain", "motor")}
DRIVEN = {name: {"driven_cart": (name,)} for name in ("input", "motor", "gears")}
SIZES = tuple(2.0**-k for k in range(9))


@dataclass(frozen=True, slots=True)
class Effect:
    """An effect that can be hidden."""

    same: type[Law]
    other: type[Law] | None
    places: dict[str, tuple[str, ...]]
    draw: Draw
    grows: tuple[str, ...] = ()
    shrinks: tuple[str, ...] = ()
    sizes: tuple[float, ...] = SIZES

    def sized(self, full: dict[str, float], size: float) -> dict[str, float]:
        """Return the numbers for a size."""
        return {
            name: value * size if name in self.grows else value / size if name in self.shrinks else value
            for name, value in full.items()
        }


def _side(g: np.random.Generator) -> float:
    return float(g.choice((-1.0, 1.0)))


def _phase(g: np.random.Generator) -> float:
    return float(g.uniform(0, 2 * np.pi))


def _stribeck(g: np.random.Generator, s: Scale) -> dict[str, float]:
    f_c = 0.2 * s.force
    return {"f_c": f_c, "f_s": f_c * g.uniform(1.6, 2.5), "v_s": s.speed * g.uniform(0.05, 0.2)}


def _loaded(g: np.random.Generator, s: Scale) -> dict[str, float]:
    share = 0.3 * s.force / (0.1719 * 9.81) if s.force < 1 else 0.3
    return {"mu0": 0.03 * s.force * g.uniform(), "mu1": share, "f_n": s.force}


def _asymmetric(g: np.random.Generator, s: Scale) -> dict[str, float]:
    strong, weak = 0.3 * g.uniform(0.7, 1.0), 0.3 * g.uniform(0.1, 0.4)
    drag, less = 0.15 * g.uniform(0.7, 1.0), 0.15 * g.uniform(0.0, 0.3)
    way, back = ("pos", "neg") if g.random() < 0.5 else ("neg", "pos")
    d = s.force / s.speed
    return {f"f_c_{way}": strong * s.force, f"f_c_{back}": weak * s.force} | {
        f"d_{way}": drag * d, f"d_{back}": less * d, "v_n": s.speed,
    }  # fmt: skip


def _placed(g: np.random.Generator, s: Scale) -> dict[str, float]:
    wave = {"period": s.length * g.uniform(0.4, 1.2), "phase": _phase(g)}
    spot = {"x_spot": s.length * g.uniform(-0.4, 0.4), "width": s.length * g.uniform(0.1, 0.25)}
    return {"f_c": 0.25 * s.force, "a": g.uniform(0.5, 0.9)} | wave | spot


def _dahl(g: np.random.Generator, s: Scale) -> dict[str, float]:
    f_c = 0.25 * s.force
    return {"f_c": f_c, "c": f_c / (s.length * g.uniform(0.03, 0.12))}


def _lugre(g: np.random.Generator, s: Scale) -> dict[str, float]:
    p = _stribeck(g, s)
    c = p["f_c"] / (s.length * g.uniform(0.02, 0.08))
    return p | {"c": c, "d1": 0.7 * float(np.sqrt(c * s.mass))}


def _breakaway(g: np.random.Generator, s: Scale) -> dict[str, float]:
    return {"f_c": 0.15 * s.force, "f_s": 0.15 * s.force * g.uniform(1.6, 2.5)}


def _backlash(g: np.random.Generator, s: Scale) -> dict[str, float]:
    if s.force < 1:
        return {"b": 0.15, "c": 4.0, "d": 0.005}
    # stiff in contact, so that what shows is the play: 2 and 0.5 mm under the typical force
    c = s.force / ((0.02 if s.force > 100 else 0.002) * s.length)
    return {"b": 0.05 * s.length, "c": c, "d": 0.15 * float(np.sqrt(c * s.mass))}


def _compliance(g: np.random.Generator, s: Scale) -> dict[str, float]:
    # the released cart hides a stiff chain in its free mass, so the softest there is softer
    c = s.force / ((0.3 if s.force > 100 else 0.08) * s.length)
    return {"c": c, "d": g.uniform(0.02, 0.06) * float(np.sqrt(c * s.mass)), "z_n": 0.04 * s.length}


def _stop(g: np.random.Generator, s: Scale) -> dict[str, float]:
    x_m = s.length * g.uniform(0.2, 0.5)
    return {"x_m": x_m, "c": 4 * s.force / s.length, "x_n": 0.1 * s.length, "v_n": s.speed}


def _cable(g: np.random.Generator, s: Scale) -> dict[str, float]:
    c = 0.3 * s.force / s.length
    slip = {"f_h": 0.2 * s.force, "x_slip": s.length * g.uniform(0.08, 0.2)}
    return {"c": c, "x_0": s.length * g.uniform(-0.5, 0.5)} | slip


def _bouc_wen(g: np.random.Generator, s: Scale) -> dict[str, float]:
    z_h = s.length * g.uniform(0.15, 0.5)
    return {"c_h": 0.35 * s.force / z_h, "z_h": z_h}


def _base(g: np.random.Generator, s: Scale) -> dict[str, float]:
    m_b = 0.25 if s.force < 1 else 12.0
    carried = 0.17 if s.force < 1 else s.mass
    w = 2 * np.pi * g.uniform(1.5, 4.0)
    stiffness = {"c_b": (m_b + carried) * w * w, "d_b": 2 * g.uniform(0.03, 0.1) * w * (m_b + carried)}
    return {"m_b": m_b} | stiffness | {"x_n": 0.02 * s.length}


def _bending(g: np.random.Generator, s: Scale) -> dict[str, float]:
    return {"frequency": g.uniform(2.0, 5.0), "zeta": g.uniform(0.02, 0.05), "gamma": 0.12, "q_n": 2e-3}


def _imbalance(g: np.random.Generator, s: Scale) -> dict[str, float]:
    return {"tau_s": _side(g) * 0.3 * s.force, "tau_k": _side(g) * 0.2 * s.force * g.uniform(0.3, 1.0)}


def _uneven(g: np.random.Generator, s: Scale) -> dict[str, float]:
    period = s.length * g.uniform(0.4, 1.0)
    return {"slope": 0.25, "period": period, "phase": _phase(g), "x_dip": s.length * g.uniform(-0.3, 0.3)}


def _teeth(name: str, value: float, low: int, high: int) -> Draw:
    return lambda g, s: {name: value, "n_teeth": float(g.integers(low, high)), "phase": _phase(g)}


def _steps(g: np.random.Generator, s: Scale) -> dict[str, float]:
    lost = _side(g) * float(g.integers(1, 5))
    return {"q": 0.1 * s.length, "n_lost": lost, "t_lost": g.uniform(0.5, 4.0)}


def _encoder(g: np.random.Generator, s: Scale) -> dict[str, float]:
    a, turns = (0.05, 1.0) if s.force < 1 else (0.004, 1 / 0.0164)
    return {"a": a, "turns": turns, "phase": _phase(g)}


_PLAY = {"rota_damp": ("bearing",), "linear_damp_mod": ("chain",), "driven_cart": ("chain",)}
EVERY = {"rota_damp": ("bearing.phi",), "linear_damp_mod": ("encoder.s",), "driven_cart": ("encoder.s", "bearing.phi")}
ALL_THREE = EVERY | {"driven_cart": ("encoder.s", "bearing.phi", "motor.i")}
NOT_ZEROED = EVERY | {"driven_cart": ("bearing.phi",)}

EFFECTS: dict[str, Effect] = {
    "coulomb_friction": Effect(
        friction.Coulomb, friction.Creep, BOTH,
        lambda g, s: {"f_c": 0.3 * s.force, "v_creep": 0.03 * s.speed}, ("f_c",)),
    "stribeck_friction": Effect(friction.Stribeck, friction.StribeckHess, BOTH, _stribeck, ("f_c", "f_s")),
    "load_dependent_friction": Effect(
        friction.Loaded, friction.LoadedQuadratic, {"rota_damp": ("bearing",), "driven_cart": ("bearing", "gears")},
        _loaded, ("mu0", "mu1")),
    "asymmetric_friction": Effect(
        friction.Asymmetric, friction.AsymmetricPower, BOTH, _asymmetric, ("f_c_pos", "f_c_neg", "d_pos", "d_neg")),
    "position_dependent_friction": Effect(friction.Placed, friction.PlacedSpot, BOTH, _placed, ("f_c",)),
    "dahl_friction": Effect(friction.Dahl, friction.DahlSquare, BOTH, _dahl, ("f_c", "c")),
    "lugre_friction": Effect(friction.LuGre, friction.LuGreHess, BOTH, _lugre, ("f_c", "f_s", "c", "d1")),
    "maxwell_slip_friction": Effect(
        friction.MaxwellSlip, friction.MaxwellSlipMany, BOTH,
        lambda g, s: {"f_c": 0.25 * s.force, "x_slip": s.length * g.uniform(0.04, 0.15)}, ("f_c",)),
    "breakaway_friction": Effect(friction.Breakaway, friction.BreakawayDwell, BOTH, _breakaway, ("f_c", "f_s")),
    "backlash": Effect(
        elastic.Backlash, elastic.BacklashRounded, _PLAY, _backlash, ("b",), sizes=SIZES[:5]),
    "compliance": Effect(
        elastic.Series, elastic.SeriesHardening, CHAIN, _compliance, shrinks=("c", "d"), sizes=SIZES[:6]),
    "cubic_stiffness": Effect(
        elastic.Cubic, elastic.Hardening, {**BOTH, "linear_damp_mod": ("rail", "spring_1", "spring_2")},
        lambda g, s: {"c3": 0.4 * s.force / s.length**3, "x_n": s.length}, ("c3",)),
    "end_stop": Effect(elastic.Stop, elastic.StopLinear, BOTH, _stop, ("c",)),
    "cable_drag": Effect(elastic.Cable, elastic.CableLayers, RAIL, _cable, ("c", "f_h")),
    "quadratic_drag": Effect(
        loads.Drag, loads.DragPower, BOTH,
        lambda g, s: {"d2": 0.4 * s.force / s.speed**2, "v_n": s.speed}, ("d2",)),
    "added_inertia": Effect(loads.Inertia, None, BEARING, lambda g, s: {"J": 0.4 * s.mass}, ("J",)),
    "hysteresis": Effect(elastic.BoucWen, elastic.Prandtl, BOTH, _bouc_wen, ("c_h",)),
    "cogging": Effect(drive.Cogging, drive.CoggingSharp, DRIVEN["motor"], _teeth("tau_k", 0.25, 2, 7), ("tau_k",)),
    "torque_ripple": Effect(drive.Ripple, drive.RippleSharp, DRIVEN["motor"], _teeth("a", 0.25, 2, 7), ("a",)),
    "magnetic_saturation": Effect(
        drive.Saturated, drive.SaturatedTanh, DRIVEN["motor"], lambda g, s: {"i_s": 8.0}, shrinks=("i_s",)),
    "brush_drop": Effect(
        drive.Brush, drive.BrushRoot, DRIVEN["motor"],
        lambda g, s: {"V_b": 2.0, "i_b": g.uniform(0.15, 0.5)}, ("V_b",)),
    "iron_loss": Effect(
        friction.IronLoss, friction.IronLossPower, DRIVEN["motor"],
        lambda g, s: {"tau_c": 0.25 * s.force / 84.9, "d": 3e-4 * g.uniform()}, ("tau_c", "d")),
    "winding_heating": Effect(
        drive.Heating, drive.HeatingMagnet, DRIVEN["motor"],
        lambda g, s: {"alpha": 0.0039, "R_th": g.uniform(1.5, 4.0), "C_th": 0.8}, shrinks=("C_th",)),
    "dead_zone": Effect(
        drive.DeadZone, drive.DeadZoneRounded, DRIVEN["input"],
        lambda g, s: {"u_pos": 2.0 * g.uniform(0.5, 1), "u_neg": 2.0 * g.uniform(0.5, 1)}, ("u_pos", "u_neg")),
    "saturation": Effect(
        drive.Saturation, drive.SaturationSoft, DRIVEN["input"], lambda g, s: {"u_max": 3.0}, shrinks=("u_max",)),
    "supply_sag": Effect(drive.Sag, drive.SagBent, DRIVEN["input"], lambda g, s: {"R_s": 0.5}, ("R_s",)),
    "input_delay": Effect(drive.Delay, drive.DelayLag, DRIVEN["input"], lambda g, s: {"T_d": 0.05}, ("T_d",)),
    "gear_loss": Effect(
        friction.GearLoss, friction.GearLossPreload, DRIVEN["gears"],
        lambda g, s: {"loss": 0.35, "f_n": s.force}, ("loss",)),
    "eccentricity": Effect(
        drive.Eccentric, drive.EccentricOval, DRIVEN["gears"],
        lambda g, s: {"e": 0.15, "turns": 0.718, "phase": _phase(g)}, ("e",)),
    "chain_polygon": Effect(
        drive.Polygon, None, DRIVEN["gears"],
        lambda g, s: {"n_teeth": float(g.integers(6, 13)), "radius": 0.0164, "phase": _phase(g)}, sizes=(1.0,)),
    "chain_tension_friction": Effect(
        friction.ChainTension, friction.ChainTensionPower, RAIL,
        lambda g, s: {"f_c": 0.03 * s.force * g.uniform(), "mu": 0.4, "f_n": s.force}, ("f_c", "mu")),
    "constant_load": Effect(
        loads.Constant, None, BOTH, lambda g, s: {"f_0": _side(g) * 0.25 * s.force}, ("f_0",)),
    "rail_unevenness": Effect(loads.Uneven, loads.UnevenDip, RAIL, _uneven, ("slope",)),
    "imbalance": Effect(loads.Imbalance, None, BEARING, _imbalance, ("tau_s", "tau_k")),
    "base_compliance": Effect(
        loads.Base, loads.BaseSoft,
        {"rota_damp": ("base",), "linear_damp_mod": ("base",), "driven_cart": ("base",)}, _base,
        shrinks=("m_b", "c_b", "d_b")),
    "bearing_torsion": Effect(
        elastic.Torsion, elastic.TorsionSlip, BEARING,
        lambda g, s: {"c": 0.3 * s.force / s.length, "c_m": 0.3 * s.force / s.length, "T": g.uniform(0.15, 0.8)},
        ("c", "c_m")),
    "flexible_rod": Effect(
        loads.Bending, loads.BendingHard, {"rota_damp": ("rod",), "driven_cart": ("rod",)}, _bending, ("gamma",)),
    "sensor_offset": Effect(
        sensors.Bias, None, NOT_ZEROED, lambda g, s: {"y_0": _side(g) * 0.15 * s.length}, ("y_0",)),
    "sensor_gain": Effect(
        sensors.Scale, sensors.ScaleBent, EVERY,
        lambda g, s: {"e": _side(g) * 0.2, "y_n": s.length}, ("e",)),
    "sensor_nonlinearity": Effect(sensors.Wave, sensors.WaveTriangle, EVERY, _encoder, ("a",)),
    "sensor_delay": Effect(
        sensors.LowPass, sensors.DeadTime, ALL_THREE, lambda g, s: {"T_d": 0.05}, ("T_d",), sizes=SIZES[:6]),
    "sensor_quantization": Effect(sensors.Steps, sensors.StepsDown, EVERY, _steps, ("q",)),
    "clock_drift": Effect(
        sensors.Clock, None, {"rota_damp": ("clock",), "driven_cart": ("clock",)},
        lambda g, s: {"e": _side(g) * 0.03}, ("e",)),
    "current_sensor_error": Effect(
        sensors.BiasAndScale, sensors.BiasAndSides, {"driven_cart": ("motor.i",)},
        lambda g, s: {"y_0": _side(g) * 0.3 * g.uniform(), "e": _side(g) * 0.15}, ("y_0", "e")),
    "linear_stiffness": Effect(
        elastic.Linear, elastic.LinearRounded, BOTH,
        lambda g, s: {"c": 0.5 * s.force / s.length, "x_0": s.length * g.uniform(-0.3, 0.3), "x_n": s.length}, ("c",)),
    "one_sided_spring": Effect(
        elastic.Slack, elastic.SlackRounded, SPRINGS, lambda g, s: {"x_0": 0.03 * g.uniform(0.2, 1.0)}, ("x_0",)),
    "input_offset": Effect(drive.Offset, None, DRIVEN["input"], lambda g, s: {"u_0": _side(g) * 1.0}, ("u_0",)),
    "input_gain": Effect(
        drive.Gain, drive.GainBend, DRIVEN["input"], lambda g, s: {"e": _side(g) * 0.2}, ("e",)),
    "rate_limit": Effect(drive.Rate, drive.RateSoft, DRIVEN["input"], lambda g, s: {"r": 15.0}, shrinks=("r",)),
}  # fmt: skip

NOT_SHOWN = {
    "viscous_friction": "a free damping of every rig takes it up wholly, at each place where the rig has one",
    "added_inertia at rail": "the free inertial mass takes it up wholly",
    "sensor_offset at encoder.s of driven_cart": "the encoder is set to zero at the start, and no place is special",
    "backlash at motor of driven_cart": "the model's rotor has no mass, so it has no motion of its own inside the play",
    "clock_drift of linear_damp_mod": "free mass and damping take it up wholly",
}


def scale_of(scales: dict[str, Scale], place: str) -> Scale:
    """Return the scale along which an effect at a place acts."""
    turns = place in ("bearing", "bearing.phi", "rod")
    return scales["bearing"] if "rail" not in scales or turns else scales["rail"]


def hidden_on(rig: str) -> list[tuple[str, str]]:
    """Return all (effect, place) of a rig."""
    return [(name, at) for name, effect in EFFECTS.items() for at in effect.places.get(rig, ())]
