"""Shapes that are found along one simulation are those that a linearisation at each of them would find."""

from dataclasses import replace

import numpy as np
import pytest

from cartpend_dae import simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover.records import FreeSpec, Setup
from cartpend_dae.discover.scan import TURNS, UNPASSED, WOUND
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.slopes import basis_of
from cartpend_dae.discover.sweep import sweep
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import insert, insertion_at
from models.driven_cart import DrivenCart
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp

CASES = {
    "wave of a rail": (
        LinearDampMod(), "encoder.s", "m", {}, ("rail.d",),
        ("rail_unevenness", "rail", {"k": 8.0}, {"f_sin": 0.3, "f_cos": -0.2, "k": 71.0}, "k", 0.08),
    ),
    "error of an encoder": (
        LinearDampMod(), "encoder.s", "m", {}, ("rail.d",),
        ("sensor_nonlinearity", "encoder.s", {"k": 1.0}, {"a_1_sin": 1e-4, "a_2_cos": 6e-5, "k": 61.0}, "k", 0.08),
    ),
    "place of a stop": (
        RotaDamp(), "bearing.phi", "rad", {"bearing.phi": 1.0, "bearing.w": 0.0}, ("bearing.d",),
        ("end_stop", "bearing", {"phi_m": 0.1, "side": 1.0}, {"c": 0.02, "phi_m": 0.6}, "phi_m", 0.3),
    ),
}  # fmt: skip


def bench_of(name):
    model, output, unit, start, free, (effect, at, first, hidden, *_) = CASES[name]
    run = simulate(insert(model, effect, at, **hidden), 6.0, points=601, start=start)
    read = f"{output}.{effect}.y" if effect.startswith("sensor") else output
    noisy = run[read] + 1e-5 * np.random.default_rng(0).standard_normal(run.time.size)
    channels = {output: Channel(noisy, "zoh", 1e-5, unit, 0.0)}
    begin = {key: Start(value, False) for key, value in start.items()}
    experiment = Experiment("run", "train", run.time, {}, channels, begin, "free", None)
    setup = Setup(model, tuple(FreeSpec(q) for q in free), (experiment,), (), ())
    return Workbench(setup, lambda *_: None), insertion_at(model, effect, at, first)


def released(hidden, angle, sd):
    """Return a workbench for the pendulum with a run of another one that is let go at an angle, and that run."""
    run = simulate(hidden, 6.0, points=601, start={"bearing.phi": angle})
    noisy = run["bearing.phi"] + sd * np.random.default_rng(0).standard_normal(run.time.size)
    begin = {"bearing.phi": Start(angle, False), "bearing.w": Start(0.0, False)}
    channels = {"bearing.phi": Channel(noisy, "zoh", sd, "rad", 0.0)}
    experiment = Experiment("run", "train", run.time, {}, channels, begin, "free", None)
    return Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), (experiment,), (), ()), lambda *_: None), run


def explained(found, option):
    """Squares of the residual that the sizes of an effect explain, by a projection without products of columns."""
    columns = np.column_stack([found.sizes[name] for name in option.size_names])
    known = basis_of(found.base)
    whole = basis_of(np.column_stack([found.base, columns]))
    return np.sum((whole.T @ found.residual) ** 2) - np.sum((known.T @ found.residual) ** 2)


@pytest.mark.parametrize("name", list(CASES))
def test_the_shape_found_is_the_hidden_one_and_better_than_its_neighbours(name):
    bench, option = bench_of(name)
    *_, (_, _, _, hidden, shape, near) = CASES[name]
    sd = bench.problem(()).prior_sd
    again, *_ = sweep(bench, (), (option,), {}, 20.0, sd, with_shapes=True).again
    best = again.values[shape]
    assert best == pytest.approx(hidden[shape], rel=near)

    def at(value):
        one = replace(option, values={**option.values, shape: value})
        return explained(sweep(bench, (), (one,), {}, 20.0, sd), one)

    assert at(best) > max(at(0.8 * best), at(1.25 * best), at(option.values[shape]))


def test_an_effect_at_another_start_of_its_shape_is_not_scanned_again():
    bench, option = bench_of("wave of a rail")
    other = replace(option, values={"k": 30.0})
    assert sweep(bench, (), (other,), {}, 20.0, bench.problem(()).prior_sd, with_shapes=True).again == ()


def test_two_waves_are_found_each_beside_the_other():
    model, hidden = (
        LinearDampMod(),
        {"f_sin": 0.3, "f_cos": -0.2, "k": 71.0, "f_2_sin": 0.1, "f_2_cos": 0.15, "k_2": 125.0},
    )
    run = simulate(insert(model, "rail_unevenness", "rail", **hidden), 6.0, points=601)
    noisy = run["encoder.s"] + 1e-5 * np.random.default_rng(0).standard_normal(run.time.size)
    channels = {"encoder.s": Channel(noisy, "zoh", 1e-5, "m", 0.0)}
    experiment = Experiment("run", "train", run.time, {}, channels, {}, "free", None)
    bench = Workbench(Setup(model, (FreeSpec("rail.d"),), (experiment,), (), ()), lambda *_: None)
    option = insertion_at(model, "rail_unevenness", "rail", {"k": 8.0})
    again, *_ = sweep(bench, (), (option,), {}, 20.0, bench.problem(()).prior_sd, with_shapes=True).again
    found = sorted((again.values["k"], again.values["k_2"]))
    assert found == [pytest.approx(71.0, rel=0.03), pytest.approx(125.0, rel=0.03)]


def test_waves_that_explain_about_as_much_are_both_found_the_better_one_first():
    bench, option = bench_of("error of an encoder")
    sd = bench.problem(()).prior_sd
    found = sweep(bench, (), (option,), {}, 20.0, sd, with_shapes=True).again
    # the law has a second harmonic, so that half of the hidden number does nearly as well
    assert [one.values["k"] for one in found] == [pytest.approx(61.0, rel=0.01), pytest.approx(30.5, rel=0.01)]
    better, worse = (explained(sweep(bench, (), (one,), {}, 20.0, sd), one) for one in found)
    assert better > worse > 0.7 * better


def test_a_wave_number_is_found_by_the_screen():
    bench, option = bench_of("wave of a rail")
    (candidate,) = screen(bench, (), {}, [option], 20.0, bench.problem(()).prior_sd)
    assert candidate.insertion.values["k"] == pytest.approx(71.0, rel=0.08)
    size = np.hypot(*(candidate.parameters[f"rail.rail_unevenness.{name}"] for name in ("f_sin", "f_cos")))
    assert size == pytest.approx(np.hypot(0.3, 0.2), rel=0.3)


def test_the_number_of_teeth_is_found_whatever_it_is():
    model, hidden = RotaDamp(), {"tau_k_sin": 0.004, "tau_k_cos": 0.003, "n": 11.0}
    bench, _ = released(insert(model, "cogging", "bearing", **hidden), 1.0, 1e-5)
    option = insertion_at(model, "cogging", "bearing", {"n": 2.0})
    first, second = sweep(bench, (), (option,), {}, 20.0, bench.problem(()).prior_sd, with_shapes=True).again
    assert first.values["n"] == 11.0
    assert second.values["n"] != 11.0
    (candidate,) = screen(bench, (), {}, [option], 20.0, bench.problem(()).prior_sd)
    assert candidate.insertion.values["n"] == 11.0
    amplitudes = [candidate.parameters[f"bearing.cogging.tau_k_{name}"] for name in ("sin", "cos")]
    assert amplitudes == pytest.approx([0.004, 0.003], rel=0.1)  # to first order of the effect


def test_where_nothing_may_be_added_nothing_is_found():
    bench, _ = bench_of("wave of a rail")
    assert screen(bench, (), {}, [], 20.0, bench.problem(()).prior_sd) == []


def test_teeth_of_which_no_run_passes_one_are_not_looked_for():
    model, hidden = RotaDamp(), {"c3": 0.04}
    bench, run = released(insert(model, "cubic_stiffness", "bearing", **hidden), 1.3, 1e-4)
    option, sd = insertion_at(model, "cogging", "bearing", {"n": 2.0}), bench.problem(()).prior_sd
    found = sweep(bench, (), (option,), {}, 20.0, sd, with_shapes=True)
    assert found.refused == {option.prefix: UNPASSED}
    fewest = 2 * np.pi / np.ptp(run["bearing.phi"])
    assert fewest > 2.0
    assert all(one.values["n"] >= fewest for one in found.again)
    ranked = screen(bench, (), {}, [option], 20.0, sd)
    assert [c.insertion.values["n"] >= fewest for c in ranked] == [True]


def test_a_wave_of_which_a_run_passes_a_small_part_is_not_tried_from_there():
    bench, option = bench_of("error of an encoder")  # 0.23 m of a wave of 6.3 m pass for any polynomial
    sd = bench.problem(()).prior_sd
    assert sweep(bench, (), (option,), {}, 20.0, sd, with_shapes=True).refused == {option.prefix: UNPASSED}
    longer = replace(option, values={"k": 10.0})
    assert not sweep(bench, (), (longer,), {}, 20.0, sd, with_shapes=True).refused
    (found,) = screen(bench, (), {}, [option], 20.0, sd)
    assert found.insertion.values["k"] == pytest.approx(61.0, rel=0.08)


@pytest.mark.parametrize("turns", [9.0, 11.0])
def test_a_shaft_that_turns_on_and_on_winds_up_no_spring(turns):
    duration, speed = 2.0, turns * 2 * np.pi / 2.0
    time = np.linspace(0.0, duration, 401)
    angle = speed * time + 1e-3 * np.random.default_rng(0).standard_normal(time.size)
    begin = {"bearing.phi": Start(0.0, False), "bearing.w": Start(speed, False)}
    channels = {"bearing.phi": Channel(angle, "zoh", 1e-3, "rad", 0.0)}
    experiment = Experiment("run", "train", time, {}, channels, begin, "free", None)
    bench = Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), (experiment,), (), ()), lambda *_: None)
    options = [insertion_at(RotaDamp(), effect, "bearing") for effect in ("linear_stiffness", "constant_load")]
    spring, load = screen(bench, (), {"bearing.d": 0.0}, options, 200.0, bench.problem(()).prior_sd)
    if spring.insertion.card.id == "constant_load":
        spring, load = load, spring
    assert (spring.why_not == TURNS) is (turns * 2 * np.pi > WOUND)
    assert load.why_not != TURNS


def test_teeth_of_a_sprocket_are_found_that_are_finer_than_the_first_waves_tried():
    """Over a long way the first 180 waves ended at 6.6 teeth a turn, below all from which a polygon begins."""
    model, times = DrivenCart(), 0.01 * np.arange(601)
    u = 6.0 * np.sign(np.sin(2.1 * times)) + 2.0 * np.sin(5.0 * times)
    hidden = insert(model, "chain_polygon", "gears.flange_R", e=0.2, N=9.0, psi=0.1)
    run = simulate(hidden, 6.0, points=601, inputs={"amplifier.u": (times, u, "zoh")})
    channels = {"encoder.s": Channel(run["encoder.s"], "zoh", 5e-5, "m", 0.0)}
    inputs = {"amplifier.u": Channel(u, "zoh", None, "V", 0.0)}
    experiment = Experiment("run", "train", run.time, inputs, channels, {}, "free", None)
    bench = Workbench(Setup(model, (FreeSpec("rail.d"),), (experiment,), (), ()), lambda *_: None)
    option = insertion_at(model, "chain_polygon", "gears.flange_R", {"N": 12.0, "psi": 0.0})
    again, *_ = sweep(bench, (), (option,), {}, 75.0, bench.problem(()).prior_sd, with_shapes=True).again
    assert 84.9 * np.ptp(run["encoder.s"]) > 362 / 9
    assert again.values["N"] == pytest.approx(9.0, rel=0.02)
