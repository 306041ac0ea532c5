"""Every model of `models/`: it assembles, prints and runs; and its motion against another way to get it."""

from pathlib import Path

import casadi as ca
import independent
import numpy as np
import pytest
import scipy.io
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import ellipj, ellipk

from cartpend_dae import Component, Statements, assemble, connect, simulate
from cartpend_dae.library.rotational import BearingFriction
from cartpend_dae.library.translational import ConstantLoad, RailFriction
from cartpend_dae.study import load_model
from cartpend_dae.study_schema import ModelReference

MODELS = Path(__file__).resolve().parent.parent / "models"
FILES = sorted(path.stem for path in MODELS.glob("*.py"))
FIXED_NAMES = {
    "rota_damp": {"bearing.d": "N.m.s/rad", "bearing.phi": "rad"},
    "linear_damp_mod": {"rail.d": "N.s/m", "inertial.m": "kg", "encoder.s": "m"},
    "linear_damp": {"rail.d": "N.s/m", "encoder.s": "m"},
    "drive_train": {"J_motor": "kg.m2", "J_brake": "kg.m2", "chain.s": "m", "motor.i": "A", "brake_motor.i": "A"},
    "cart_pendulum": {"rail.d": "N.s/m", "bearing.d": "N.m.s/rad", "encoder.s": "m", "bearing.phi": "rad"},
    "emps": {"axis.m": "kg", "guide.d": "N.s/m", "drive.u": "V", "encoder.s": "m"},
    "driven_cart": {
        "rail.d": "N.s/m",
        "bearing.d": "N.m.s/rad",
        "inertial.m": "kg",
        "amplifier.u": "V",
        "encoder.s": "m",
        "bearing.phi": "rad",
        "motor.i": "A",
    },
    "dfki_pendulum": {
        "arm.J": "kg.m2",
        "weight.tau_g": "N.m",
        "bearing.d": "N.m.s/rad",
        "motor.tau": "N.m",
        "bearing.phi": "rad",
    },
    "silverbox": {"mass.m": "kg", "spring.c": "N/m", "spring.d": "N.s/m", "force.f": "N", "sensor.s": "m"},
    "gear_motor": {"motor.k": "N.m/A", "motor.J": "kg.m2", "amplifier.u": "V", "tachometer.w": "rad/s"},
    "oscillator": {"spring.c": "N/m", "track.d": "N.s/m", "camera.s": "m"},
    "pendulum": {"weight.tau_g": "N.m", "bearing.d": "N.m.s/rad", "bearing.phi": "rad"},
    "motor": {"motor.R": "Ohm", "motor.L": "H", "bearing.tau_c": "N.m", "motor.i": "A", "tachometer.w": "rad/s"},
}
"""Free parameters, inputs and outputs that studies name, with their units."""
STATES = {
    "rota_damp": ("bearing.phi", "bearing.w"),
    "linear_damp_mod": ("encoder.s", "inertial.v"),
    "emps": ("encoder.s", "axis.v"),
    "driven_cart": ("encoder.s", "inertial.v", "bearing.phi", "bearing.w"),
    "linear_damp": ("encoder.s", "cart.v"),
    "drive_train": ("chain.s", "gears.gear_2.w"),
    "cart_pendulum": ("encoder.s", "rail.v", "bearing.phi", "bearing.w"),
}
"""Variables that are the states, each up to a factor and an offset."""


def load(name: str, **arguments) -> Component:
    return load_model(ModelReference(path=MODELS / f"{name}.py", arguments=arguments))


@pytest.mark.parametrize("name", FILES)
def test_model_assembles_prints_and_runs_from_its_own_start(name):
    system = assemble(load(name))
    assert f"states ({len(system.states)})" in str(system)
    assert all(state in str(system) for state in system.states)
    run = simulate(system, 0.5, inputs=dict.fromkeys(system.inputs, 0.0), points=11)
    assert np.isfinite(run.values).all()


@pytest.mark.parametrize("name", STATES)
def test_fixed_and_adaptive_steps_agree(name):
    system = assemble(load(name))
    inputs = dict.fromkeys(system.inputs, 1.0)
    adaptive = simulate(system, 0.5, inputs=inputs, points=501, rtol=1e-10, atol=1e-12)
    fixed = simulate(system, 0.5, inputs=inputs, method="rk4", step=0.001)
    for state in system.states:
        # Steps of 1 ms against a tolerance of 1e-10, for rates of some tens of rad/s.
        np.testing.assert_allclose(adaptive[state], fixed[state], rtol=0, atol=1e-6, err_msg=state)


@pytest.mark.parametrize("name", FIXED_NAMES)
def test_fixed_names_have_their_units(name):
    system = assemble(load(name))
    declared = {v.name: v.declaration.unit for v in (*system.variables, *system.parameters)}
    assert {n: declared.get(n) for n in FIXED_NAMES[name]} == FIXED_NAMES[name]


@pytest.mark.parametrize("name", FIXED_NAMES)
def test_free_parameters_are_independent(name):
    system = assemble(load(name))
    mechanical = [n for n, unit in FIXED_NAMES[name].items() if unit in ("N.s/m", "N.m.s/rad", "kg")]
    assert set(mechanical) <= {parameter.name for parameter in system.parameters}
    assert not [p.name for p in system.parameters if p.value is None]


@pytest.mark.parametrize("name", STATES)
def test_states_are_positions_and_speeds_of_the_bodies(name):
    system = assemble(load(name))
    assert sorted(system.state_relations[n].state for n in STATES[name]) == list(range(len(system.states)))
    assert not system.algebraics


# Rod pendulum on a held cart


def with_friction(name: str, part: str, friction: Component) -> Component:
    model = load(name)
    setattr(model, part, friction)
    return model


@pytest.mark.parametrize("phi_0", [0.351, 1.5, 3.0])
def test_rota_damp_without_friction_follows_the_elliptic_functions(phi_0):
    run = simulate(
        load("rota_damp"),
        5.0,
        start={"bearing.phi": phi_0},
        parameters={"bearing.d": 0.0},
        rtol=1e-11,
        atol=1e-13,
    )
    k, omega = np.sin(phi_0 / 2), np.sqrt(1.5 * 9.81 / 0.86)
    expected = 2 * np.arcsin(k * ellipj(ellipk(k**2) - omega * run.time, k**2)[0])
    # A local tolerance of 1e-11; near upright, at 3 rad, an error grows tenfold in each half a second.
    np.testing.assert_allclose(run["bearing.phi"], expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("viscous", "coulomb"), [(0.0375, 0.0), (0.0, 0.02), (0.01, 0.015)])
def test_rota_damp_moves_as_the_independent_pendulum(viscous, coulomb):
    model = with_friction("rota_damp", "bearing", BearingFriction(d=viscous, tau_c=coulomb))
    times, expected = independent.pendulum(duration=5.0, angle=-0.351, viscous=viscous, coulomb=coulomb)
    np.testing.assert_allclose(
        simulate(model, times=times)["bearing.phi"], expected, rtol=0, atol=1e-6, err_msg="adaptive"
    )
    # Fixed steps meet a reversal with second order only: 1 ms, 1e-5 rad.
    stepped = simulate(model, times=times, method="rk4", step=1e-3)["bearing.phi"]
    np.testing.assert_allclose(stepped, expected, rtol=0, atol=1e-5 if coulomb else 1e-8, err_msg="rk4")


# Cart between two springs


def test_linear_damp_mod_is_the_damped_oscillation_about_the_balance_of_its_springs():
    run = simulate(load("linear_damp_mod"), 1.08, points=109)
    m, d, k = 4.609 + 6.8, 48.0, 1197.3 + 1320.1
    rest = 0.095 * (1320.1 - 1197.3) / k
    delta = d / (2 * m)
    w = np.sqrt(k / m - delta**2)
    swing = np.exp(-delta * run.time) * (np.cos(w * run.time) + delta / w * np.sin(w * run.time))
    np.testing.assert_allclose(run["encoder.s"], rest + (0.1146 - rest) * swing, rtol=0, atol=1e-7)


def test_linear_damp_mod_stretches_both_springs_by_a_at_zero():
    run = simulate(load("linear_damp_mod"), 0.01, points=2, start={"encoder.s": 0.0})
    assert run["spring_1.f"][0] == pytest.approx(1197.3 * 0.095)
    assert run["spring_2.f"][0] == pytest.approx(1320.1 * 0.095)


@pytest.mark.parametrize("coulomb", [0.0, 10.0, 40.0])
def test_linear_damp_mod_moves_as_the_independent_cart(coulomb):
    model = with_friction("linear_damp_mod", "rail", RailFriction(d=20.0, f_c=coulomb))
    times, expected = independent.cart_between_springs(duration=2.0, position=0.1146, viscous=20.0, coulomb=coulomb)
    np.testing.assert_allclose(simulate(model, times=times)["encoder.s"], expected, rtol=0, atol=1e-6)
    stepped = simulate(model, times=times, method="rk4", step=1e-3)["encoder.s"]
    np.testing.assert_allclose(stepped, expected, rtol=0, atol=1e-5)


# Servo axis


def test_emps_under_constant_voltage_approaches_the_speed_that_friction_allows():
    run = simulate(load("emps"), 2.0, inputs={"drive.u": 1.5})
    top, rate = 35.15065 * 1.5 / 200.0, 200.0 / 95.0
    np.testing.assert_allclose(run["axis.v"], -top * np.expm1(-rate * run.time), rtol=0, atol=1e-7)


def test_emps_within_its_limits_is_the_linear_loop():
    run = simulate(load("emps", controlled=True), 0.2, inputs={"reference.u": 2e-4, "pulses.u": 0.5}, points=201)
    kp, kv, k, m, d = 160.18, 243.45, 35.15065, 95.0, 200.0
    rate = np.array([[0.0, 1.0, 0.0], [-k * kv * kp / m, -(k * kv + d) / m, k * (kv * kp * 2e-4 + 0.5) / m], [0, 0, 0]])
    expected = np.array([expm(rate * t) @ [0.0, 0.0, 1.0] for t in run.time])
    assert np.abs(run["limiter.u"]).max() < 10
    np.testing.assert_allclose(run["encoder.s"], expected[:, 0], rtol=0, atol=1e-8)


def test_emps_limits_the_voltage():
    run = simulate(load("emps", controlled=True), 0.01, inputs={"reference.u": 0.2, "pulses.u": 0.0})
    assert run["limiter.u"][0] == pytest.approx(243.45 * 160.18 * 0.2)
    np.testing.assert_allclose(run["drive.u"], 10.0)


@pytest.mark.parametrize(("file", "worst"), [("DATA_EMPS", 0.013752e-2), ("DATA_EMPS_PULSES", 0.0080248e-2)])
def test_emps_in_its_position_loop_tracks_the_measured_position(data_dir, file, worst):
    """With the published parameters, at least as well as the published simulation (its relative errors)."""
    emps = type(load("emps"))

    class Loaded(emps):
        def __post_init__(self) -> None:
            super().__post_init__()
            self.load = ConstantLoad(f_0=-3.1648)

        def equations(self) -> Statements:
            yield from super().equations()
            yield connect(self.ground.flange, self.load.flange_a)
            yield connect(self.load.flange_b, self.axis.flange_b)

    data = {
        name: value.ravel()
        for name, value in scipy.io.loadmat(data_dir / "emps" / f"{file}.mat").items()
        if not name.startswith("__")
    }
    time = data["t"] - data["t"][0]
    pulses = (time, data["pulses_N"], "zoh") if "pulses_N" in data else 0.0
    run = simulate(
        Loaded(controlled=True, f_c=20.3935),
        times=time,
        inputs={"reference.u": (time, data["qg"]), "pulses.u": pulses},
        parameters={"axis.m": 95.1089, "guide.d": 203.5034},
        start={"encoder.s": data["qm"][0], "axis.v": np.polyfit(time[:20], data["qm"][:20], 2)[1]},
        method="rk4",
        step=1e-3,
    )
    assert np.linalg.norm(run["encoder.s"] - data["qm"]) < worst * np.linalg.norm(data["qm"])


# Driven cart


def driven_by_hand(t, x, u, d_rail=12.0, d_bearing=0.0375):
    """Motor, gears, cart and rod with everything eliminated by hand; x = s, v, phi, w."""
    R, k, ratio, m, l, g = 0.739, 0.170, 84.9, 0.1719, 0.86, 9.81  # noqa: E741
    _, v, phi, w = x
    total, S, J = 6.763 + 4.609 + m, m * l / 2, m * l**2 / 3
    force = k * ratio * (u(t) - k * ratio * v) / R - d_rail * v + S * np.sin(phi) * w**2
    torque = -d_bearing * w - S * g * np.sin(phi)
    determinant = total * J - (S * np.cos(phi)) ** 2
    a = (J * force - S * np.cos(phi) * torque) / determinant
    alpha = (total * torque - S * np.cos(phi) * force) / determinant
    return [v, a, w, alpha]


def test_driven_cart_moves_as_the_equations_derived_by_hand():
    run = simulate(
        load("driven_cart"),
        6.0,
        inputs={"amplifier.u": lambda t: 12 * ca.sin(4.0 * t)},
        points=601,
        rtol=1e-10,
    )
    exact = solve_ivp(
        lambda t, x: driven_by_hand(t, x, lambda t: 12 * np.sin(4.0 * t)),
        (0, 6),
        np.zeros(4),
        method="DOP853",
        t_eval=run.time,
        rtol=1e-12,
        atol=1e-13,
    )
    assert np.ptp(run["bearing.phi"]) > 2  # near resonance: the coupling is far from linear
    np.testing.assert_allclose(run["encoder.s"], exact.y[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(run["bearing.phi"], exact.y[2], rtol=0, atol=1e-6)
    current = (12 * np.sin(4.0 * run.time) - 0.170 * 84.9 * exact.y[1]) / 0.739
    np.testing.assert_allclose(run["motor.i"], current, rtol=0, atol=1e-5)


def test_driven_cart_under_constant_voltage_reaches_the_speed_that_the_circuit_allows():
    """The closed circuit brakes like a damper of (k ratio)^2/R = 281.9 N.s/m."""
    run = simulate(load("driven_cart"), 60.0, inputs={"amplifier.u": 2.0}, points=61)
    k = 0.170 * 84.9
    assert k**2 / 0.739 == pytest.approx(281.9, abs=0.05)
    assert run["inertial.v"][-1] == pytest.approx(k * 2.0 / 0.739 / (k**2 / 0.739 + 12.0), rel=1e-6)
    # The slowest mode is the swinging rod, exp(-0.44 t): e-11 of a radian is left.
    assert run["bearing.phi"][-1] == pytest.approx(0.0, abs=1e-7)


def test_driven_cart_sign_of_voltage_position_and_angle():
    run = simulate(load("driven_cart"), 0.1, inputs={"amplifier.u": 5.0}, points=11)
    assert (run["encoder.s"][1:] > 0).all()
    assert (run["motor.i"] > 0).all()
    assert (run["bearing.phi"][1:] < 0).all()  # the tip stays behind
