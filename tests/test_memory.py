"""Friction and springs with memory against closed forms, at speeds and steps at which a memory is hard to follow."""

import numpy as np
import pytest
from library_bench import joined, run

from cartpend_dae import simulate
from cartpend_dae.data import Channel, Experiment
from cartpend_dae.discover.records import Setup
from cartpend_dae.discover.workbench import COARSE, FINEST, ROUGH, Workbench, assembled
from cartpend_dae.effects import Insertion, catalogue
from cartpend_dae.effects.card import R
from cartpend_dae.effects.places import place_at
from cartpend_dae.library import rotational as r
from cartpend_dae.library import rotational_loads, rotational_losses, translational_loads, translational_losses
from cartpend_dae.library import rotational_sources as rs
from cartpend_dae.library import signals as s
from cartpend_dae.library import translational as t
from cartpend_dae.library import translational_sources as ts
from cartpend_dae.problem import make_problem
from cartpend_dae.stepping import shortest_times
from models.driven_cart import DrivenCart
from models.rota_damp import RotaDamp

# modules of ends, sources, losses and loads; names of speed, force, level, length and speed of the peak
KINDS = {
    "rotation": (r, rs, rotational_losses, rotational_loads, "w", "phi", "tau", "tau_c", "phi_s", "w_s"),
    "translation": (t, ts, translational_losses, translational_loads, "v", "s", "f", "f_c", "s_s", "v_s"),
}
both = pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
FAST, LEVEL, LENGTH = 5.0, 0.3, 0.02
CLOSE = 1e-6  # of 200 steps at a relative tolerance of 1e-9


def moved(kind, element, signal, way="speed"):
    """An element between the ground and what moves it."""
    domain, sources, *_, v, x, _f, _c, _l, _p = kind
    source = sources.Speed(exact=True) if way == "speed" else sources.Position(exact=True)
    entry = getattr(source, f"{v}_ref" if way == "speed" else f"{x}_ref")
    ground = domain.Fixed()
    ends = [(ground.flange, element.flange_a), (element.flange_b, source.flange), (signal.y, entry)]
    return joined(*ends, ground=ground, element=element, source=source, signal=signal)


def force_at(kind, element, speed, duration=0.05, **options):
    result = run(moved(kind, element, s.Constant(k=speed)), duration, **options)
    return result.time * speed, result[f"element.{kind[6]}"]


@both
@pytest.mark.parametrize("speed", [0.01, FAST, -FAST])
@pytest.mark.parametrize(("a", "curve"), [(1.0, lambda z: -np.expm1(-z)), (2.0, lambda z: z / (1 + z))])
def test_dahl_friction_depends_on_the_way_alone_however_fast(kind, speed, a, curve):
    element = kind[2].DahlFriction(**{kind[7]: LEVEL, kind[8]: LENGTH}, a=a)
    way, force = force_at(kind, element, speed)
    assert force == pytest.approx(np.sign(speed) * LEVEL * curve(np.abs(way) / LENGTH), abs=CLOSE)


@both
@pytest.mark.parametrize(("n", "curve"), [(1.0, lambda z: -np.expm1(-z)), (2.0, np.tanh)])
def test_bouc_wen_hysteresis_yields_as_its_exponent_says(kind, n, curve):
    element = kind[3].Hysteresis(c_h=LEVEL / LENGTH, z_h=LENGTH, beta=0.7, n=n)
    way, force = force_at(kind, element, FAST)
    assert force == pytest.approx(LEVEL * curve(way / LENGTH), abs=CLOSE)


@both
@pytest.mark.parametrize("speed", [0.05, 0.2, FAST])
def test_lugre_friction_slides_on_the_curve_of_stribeck_and_begins_with_one_stiffness(kind, speed):
    ratio, fall, d_1, d = 1.8, 0.2, 0.01, 0.02
    lengths = {kind[7]: LEVEL, kind[8]: LENGTH, kind[9]: fall}
    element = kind[2].LuGreFriction(r_s=ratio, d_1=d_1, d=d, **lengths)
    level = LEVEL * (1 + (ratio - 1) * np.exp(-((speed / fall) ** 2)))
    way, force = force_at(kind, element, speed, 40 * LENGTH / speed)
    gone = np.exp(-way * LEVEL / LENGTH / level)  # d_1 der(z) of the paper is d_1 v gone
    assert force == pytest.approx(level * (1 - gone) + d_1 * speed * gone + d * speed, abs=CLOSE)


@both
@pytest.mark.parametrize("p", [0.0, 1.0])
def test_springs_that_slip_go_along_straight_lines_and_turn_at_half_the_scale(kind, p):
    element = kind[2].MaxwellSlipFriction(p=p, **{kind[7]: LEVEL, kind[8]: LENGTH})
    amplitude, f = 1.5 * LENGTH, 0.1
    result = run(moved(kind, element, s.Sine(amplitude=amplitude, f=f), "position"), 7.5, points=301)
    way, force = result[f"source.flange.{kind[5]}"], result[f"element.{kind[6]}"]

    def first(x):
        return LEVEL * np.mean([np.minimum(x / LENGTH * (4 / k) ** (1 + p), 1) for k in (1, 2, 3, 4)], axis=0)

    rising, back = result.time <= 2.5, result.time > 2.5
    # as far beyond as the motion goes in T_0, which matters at corners alone
    close = 4 ** (1 + p) * LEVEL / LENGTH * 2 * np.pi * f * amplitude * 0.0005
    assert force[rising] == pytest.approx(first(way[rising]), abs=close)
    assert force[back] == pytest.approx(LEVEL - 2 * first((amplitude - way[back]) / 2), abs=close)


@both
@pytest.mark.parametrize("make", ["DahlFriction", "MaxwellSlipFriction", "LuGreFriction", "Hysteresis"])
@pytest.mark.parametrize("step", [0.01, 0.003, 0.0007])
def test_fixed_steps_of_any_length_stay_on_the_level(kind, make, step):
    if make == "Hysteresis":
        element = kind[3].Hysteresis(c_h=LEVEL / LENGTH, z_h=LENGTH, n=2.0)
    else:
        element = getattr(kind[2], make)(**{kind[7]: LEVEL, kind[8]: LENGTH})
    model = moved(kind, element, s.Constant(k=20 * FAST))
    force = simulate(model, 1.0, method="rk4", step=step)[f"element.{kind[6]}"]
    assert np.abs(force).max() < 1.1 * LEVEL  # the method may go beyond by its own error
    assert force[-1] == pytest.approx(LEVEL, rel=1e-6)


def estimation(effect, width=0.01):
    """The bench of a swing of the rod pendulum that is sampled every `width`, and the effect at its bearing."""
    time = np.arange(0.0, 1.0, width)
    channel = Channel(0.1 * np.cos(7 * time), "zoh", 1e-3, "rad", 0.0)
    experiment = Experiment("swing", "train", time, {}, {"bearing.phi": channel}, {}, "free", None)
    bench = Workbench(Setup(RotaDamp(), (), (experiment,), (), ()))
    (card,) = (card for card in catalogue() if card.id == effect)
    return bench, Insertion(card, place_at(RotaDamp(), card, "bearing"), card.starts(R)[0])


@pytest.mark.parametrize("effect", ["dahl_friction", "hysteresis", "maxwell_slip_friction"])
@pytest.mark.parametrize("width", [0.01, 0.004])
def test_an_estimation_chooses_steps_that_follow_a_memory_and_a_search_begins_with_long_ones(effect, width):
    bench, insertion = estimation(effect, width)
    system = assembled(bench.setup.model, (insertion,), bench.setup.train)
    T_0 = 0.0005
    assert system.parameter_values[list(shortest_times(system))] == pytest.approx([T_0])
    problem = make_problem(system, (), bench.setup.train)
    # none of the eigenvalues at the start, where nothing moves, asks for it
    assert problem.layout.substeps == np.ceil(width / (2 * T_0))
    assert make_problem(system, (), bench.setup.train, step=width).layout.substeps == 1
    assert bench.problem((insertion,)).layout.substeps < problem.layout.substeps
    assert bench.problem((insertion,), "fine").layout.substeps == FINEST
    assert not bench.problem(()).has_memory


@pytest.mark.parametrize("stride", [None, ROUGH, "fine"])
def test_a_signal_is_late_on_fine_steps_in_every_fit(stride):
    # half a step of two per sample is 2.5 ms, of which a delay of 0.2 ms of a current would be told in vain
    model = RotaDamp()
    bench, _ = estimation("dahl_friction")
    (card,) = (card for card in catalogue() if card.id == "sensor_delay")
    late = Insertion(card, place_at(model, card, "bearing.phi"), card.starts(R)[0])
    assert bench.problem((late,), stride).layout.substeps == FINEST
    assert bench.problem((late,), COARSE).layout.substeps < FINEST


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_a_command_that_is_held_is_late_by_less_than_a_step_and_what_is_measured_says_by_how_much(hold):
    model, time, late = DrivenCart(), 0.01 * np.arange(151), 2e-4
    (card,) = (card for card in catalogue() if card.id == "input_delay")
    delay = Insertion(card, place_at(model, card, "amplifier.u"), card.starts(R)[0])
    system = assembled(model, (delay,), ())
    u = 4.0 * np.sign(np.sin(7.0 * time)) if hold == "zoh" else 4.0 * np.sin(7.0 * time)
    true = {f"{delay.prefix}.T_d": late}
    made = simulate(system, 1.5, points=time.size, inputs={f"{delay.prefix}.u": (time, u, hold)}, parameters=true)
    outputs = {"motor.i": Channel(made["motor.i"], "zoh", 0.005, "A", 0.0)}
    run = Experiment("run", "train", time, {"amplifier.u": Channel(u, hold, None, "V", 0.0)}, outputs, {}, "free", None)
    bench = Workbench(Setup(model, (), (run,), (), ()))
    problem = bench.problem((delay,), ROUGH)
    assert problem.layout.substeps == FINEST
    # nothing of a jump passes a delay at once, however short it is; what is smooth is late as by the lag of the steps
    assert [least > late for _, least in problem.layout.floors] == [True] * (hold == "foh")
    fit = bench.fit((delay,), {f"{delay.prefix}.T_d": 1e-4}, (0.0,), np.array([0.005]), stride=ROUGH)
    assert fit.parameters[0].value == pytest.approx(late, rel=0.05)


def test_a_fit_to_the_free_simulation_follows_a_memory_on_fine_steps():
    bench, insertion = estimation("dahl_friction")
    bench.fit((insertion,), {}, (5.0, 0.0), np.array([1e-3]), iterations=1)
    assert ["fine" in key for key in bench.problems] == [False, True]
