"""For every effect of the catalogue a rig that excites it: where it stands, how large it is, how the rig moves."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from cartpend_dae import assemble, connect, simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover.workbench import renamed
from cartpend_dae.effects import Insertion, catalogue, insert
from cartpend_dae.effects.card import E, R, T
from cartpend_dae.effects.places import place_at
from cartpend_dae.library.electrical import DCMotor
from cartpend_dae.library.planar import HangingRod
from cartpend_dae.library.rotational import Spring
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.shooting import linearised
from models.driven_cart import DrivenCart
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp


def called(card):
    """Name a card; some effects have several: by the force in a bearing, of all signals, by what they stand beside."""
    if card.load:
        return f"{card.id} at a bearing"
    if card.insertion == "clock" or (card.id == "base_compliance" and card.is_elsewhere):
        return f"{card.id} of all"
    if card.is_massless:
        return f"{card.id} beside no mass"
    return f"{card.id} under a body" if HangingRod in card.hosts else card.id


CARDS = {called(card): card for card in catalogue()}
# with those that discovery tries in their place
EVERY = CARDS | {f"{name}-creeping": card.creeping for name, card in CARDS.items() if card.creeping}
STEP, DURATION = 0.004, 2.0
TIME = np.arange(0.0, DURATION + STEP / 2, STEP)


def drive(time):
    """A voltage with reversals, rests, jumps and both signs."""
    wave = 5 * np.sin(2 * np.pi * 0.8 * time) + 3 * np.sin(2 * np.pi * 2.3 * time)
    return np.where((time > 0.9) & (time < 1.1), 0.0, wave)


@dataclass(frozen=True)
class Rig:
    model: type
    outputs: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    start: tuple[tuple[str, float], ...] = ()
    pace: float = 1.0

    def drive(self, time):
        return drive(self.pace * time)


class SprungPendulum(RotaDamp):
    """The pendulum with a spring to ground."""

    def __post_init__(self):
        super().__post_init__()
        self.spring = Spring(c=0.4, phi_rel0=-0.1)

    def equations(self):
        yield from super().equations()
        yield connect(self.ground.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.bearing.flange_b)


class HeavyRotor(DrivenCart):
    """The driven cart with a rotor that has inertia."""

    def __post_init__(self):
        super().__post_init__()
        self.motor = DCMotor(R=0.739, k=0.170, J=2e-4)


SPRUNG = Rig(SprungPendulum, ("bearing.phi",), (), (("bearing.phi", 1.2), ("bearing.w", 0.0)))
PENDULUM = Rig(RotaDamp, ("bearing.phi",), (), (("bearing.phi", 1.2), ("bearing.w", 0.0)))
SPRINGS = Rig(LinearDampMod, ("encoder.s",))
DRIVEN = Rig(DrivenCart, ("encoder.s", "bearing.phi", "motor.i"), ("amplifier.u",))
HEAVY = Rig(HeavyRotor, DRIVEN.outputs, DRIVEN.inputs)

# where each manner of insertion is shown, by kind of port
SHOWN = {
    ("parallel", R): (PENDULUM, "bearing"),
    ("parallel", T): (SPRINGS, "rail"),
    ("series", R): (DRIVEN, "gears.flange_R"),
    ("series", T): (DRIVEN, "inertial.flange_b"),
    ("series", E): (DRIVEN, "amplifier.pin_p"),
    ("input", None): (DRIVEN, "amplifier.u"),
    ("sensor", None): (PENDULUM, "bearing.phi"),
    ("clock", None): (PENDULUM, "time"),
}
ELSEWHERE = {
    ("compliance", R): (HEAVY, "gears.flange_R"),
    ("compliance beside no mass", T): (DRIVEN, "gears.flange_T"),
    ("one_sided_spring", R): (SPRUNG, "spring"),
    ("one_sided_spring", T): (SPRINGS, "spring_1"),
    ("base_compliance", R): (PENDULUM, "ground.flange"),
    ("base_compliance", T): (SPRINGS, "left.flange"),
    ("base_compliance under a body", T): (DRIVEN, "rod.pivot"),
    ("torque_ripple", None): (DRIVEN, "motor.emf.k"),
    ("magnetic_saturation", None): (DRIVEN, "motor.emf.k"),
    ("winding_heating", None): (DRIVEN, "motor.resistor.R"),
    ("current_sensor_error", None): (DRIVEN, "motor.i"),
}
# sizes that move the rig by some percent; by name, and where this does not fit by effect
SIZES = {
    "tau_c": 0.02, "f_c": 6.0, "tau_s": 0.04, "f_s": 12.0, "tau_c_sin": 0.01, "f_c_sin": 2.0, "tau_c_cos": 0.005,
    "f_c_cos": 1.0, "tau_c_pos": 0.03, "tau_c_neg": 0.01, "f_c_pos": 8.0, "f_c_neg": 3.0, "d_pos": 0.004,
    "d_neg": 0.002, "d_1": 0.01, "d": 0.005, "c": 0.05, "c3": 0.1, "c5": 0.05, "c_1": 0.1, "c_h": 0.3, "d2": 0.005,
    "mu": 0.1, "tau_0": 0.02, "f_0": 5.0, "J": 0.004, "m": 1.0, "J_1": 0.004, "tau_sin": 0.02, "tau_cos": 0.02,
    "tau_k_sin": 0.02, "tau_k_cos": 0.01, "tau_k_2_sin": 0.01, "tau_k_2_cos": 0.02, "f_sin": 5.0, "f_cos": 4.0,
    "f_2_sin": 3.0, "f_2_cos": 2.0, "R_s": 0.1, "V_b": 0.8, "e_sin": 0.03, "e_cos": 0.02, "a_sin": 0.1, "a_cos": 0.05,
    "R_i": 0.05, "tau_e": 0.005,
    "y_0": 0.05, "a_1_sin": 0.02, "a_1_cos": 0.01, "a_2_sin": 0.01, "a_2_cos": 0.01, "T_d": 0.02, "t_0": -0.01,
    "u_0": 0.5, "u_pos": 0.6, "u_neg": 0.4, "e": 0.1, "b": 0.01, "m_r": 1.0, "y_l": -0.03, "h": 1e-4, "r_f": 0.005,
    "r_2": 0.002,
}  # fmt: skip
OTHER_SIZES = {
    ("linear_stiffness", T): {"c": 200.0, "k": 30.0},
    ("one_sided_spring", R): {"e": 0.8, "phi_0": 0.2},
    ("one_sided_spring", T): {"e": 0.8, "s_0": 0.02},
    ("end_stop", T): {"c": 1e4, "s_m": 0.05},
    ("end_stop", R): {"c": 0.5, "phi_m": 0.4},
    ("cable_drag", T): {"c": 100.0},
    ("cubic_stiffness", T): {"c3": 2e4, "c5": 1e6},
    ("hysteresis", T): {"c_h": 300.0, "z_h": 0.02},
    ("hysteresis", R): {"c_h": 0.2, "z_h": 0.2},
    ("viscous_friction", T): {"d": 8.0},
    ("quadratic_drag", T): {"d2": 20.0},
    ("asymmetric_friction", T): {"d_pos": 4.0, "d_neg": 2.0},
    ("stribeck_friction", T): {"d": 2.0},
    ("lugre_friction", T): {"d_1": 10.0, "d": 2.0},
    ("load_dependent_friction", R): {"tau_c": 0.05},
    ("compliance", R): {"h": 0.05, "n": 1.0},
    ("compliance", T): {"h": 1e-4, "n": 0.02},
    ("compliance beside no mass", R): {"h": 0.3},
    ("compliance beside no mass", T): {"h": 4e-5},
    ("base_compliance", R): {"h": 2.0},
    ("base_compliance of all", T): {"w_c": 17.0, "n": 400.0},
    ("base_compliance under a body", T): {"h": 0.05, "m": 5.0, "w_c": 17.0, "n": 400.0},
    ("backlash", R): {"b": 0.05, "tau_r": 0.2, "r": 0.2, "D": 0.6},
    ("backlash", T): {"r": 0.2, "D": 0.6},
    ("flexible_rod", R): {"n": 300.0},
    ("chain_polygon", R): {"e": 2.0},
    ("sensor_quantization", None): {"e": 1.0, "q": 0.01, "t_l": 1.0},
    ("saturation", None): {"e": 0.8, "u_max": 4.0},
    ("rate_limit", None): {"e": 0.8, "r": 40.0},
    ("magnetic_saturation", None): {"e": 0.01},
    ("winding_heating", None): {"e": 0.05, "T_th": 5.0},
    ("clock_drift", None): {"e": 0.01},
    ("clock_drift of all", None): {"e": 0.01},
}


@dataclass(frozen=True)
class Scene:
    """An effect at a place of a rig, with sizes at which it is felt."""

    rig: Rig
    insertion: Insertion
    sizes: tuple[tuple[str, float], ...]

    def model(self, **values):
        return insert(self.rig.model(), self.insertion.card, self.insertion.place, **values)

    def felt(self):
        return self.model(**dict(self.sizes))

    def run(self, model):
        names = self.insertion.driven
        inputs = {names.get(name, name): (TIME, self.rig.drive(TIME)) for name in self.rig.inputs}
        start = dict(self.rig.start)
        return simulate(model, DURATION, points=TIME.size, inputs=inputs, method="rk4", step=STEP, start=start)

    def outputs(self, model):
        found = self.run(model)
        return np.array([found[self.insertion.measured.get(name, name)] for name in self.rig.outputs])


def scenes():
    return [(effect, kind) for effect, card in EVERY.items() for kind in card.components]


def name_of(effect_and_kind):
    effect, kind = effect_and_kind
    return f"{effect}-{kind.__module__.rpartition('.')[2]}" if kind else effect


def scene(effect, kind, at=None, rig=None):
    card = EVERY[effect]
    shown_rig, shown_at = ELSEWHERE.get((effect, kind)) or SHOWN[card.insertion, kind]
    rig, at = rig or shown_rig, at or shown_at
    place = place_at(rig.model(), card, at)
    other = OTHER_SIZES.get((effect, kind), {})
    named = {item.names[kind]: item for item in card.parameters}
    sizes = {name: SIZES[name] for name, item in named.items() if item.role == "size"} | other
    shapes = {name: value for name, value in other.items() if named[name].role != "size"}
    return Scene(rig, Insertion(card, place, shapes), tuple(sizes.items()))


@cache
def plain(rig):
    names = {name: (TIME, rig.drive(TIME)) for name in rig.inputs}
    run = simulate(
        rig.model(), DURATION, points=TIME.size, inputs=names, method="rk4", step=STEP, start=dict(rig.start)
    )
    return np.array([run[name] for name in rig.outputs])


def columns(rig, insertions, model, names, free=(), start_free=(), outputs=None):
    """Return the inner products of the sensitivities of the outputs to parameters and free starts, and their names.

    Parameters
    ----------
    rig, insertions, model
        The rig, what stands in it, and the model with it.
    names, free
        Parameters.
    start_free
        Variables whose start is free.
    outputs
        Those that are measured, all of the rig by default.
    """
    system = assemble(model)
    chosen = outputs or rig.outputs
    series = plain(rig)
    channels = {name: Channel(series[rig.outputs.index(name)], "zoh", 1.0, "1", 0.0) for name in chosen}
    inputs = {name: Channel(rig.drive(TIME), "foh", 1.0, "V", 0.0) for name in rig.inputs}
    start = {name: Start(value, False) for name, value in rig.start}
    start |= {name: Start(None, True) for name in start_free}
    experiment = Experiment("run", "train", TIME, inputs, channels, start, "free", None)
    parameters = tuple(free_parameter(system, name, scale=1.0) for name in (*names, *free))
    problem = make_problem(system, parameters, renamed((experiment,), insertions), step=STEP)
    linear = linearised(problem, {}, 0.0, np.ones(len(chosen)))
    return linear.grams.sum(axis=0), [item.name for item in linear.variables]
