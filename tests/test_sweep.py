"""All effects linearised in one model are what each is in a model of its own."""

from dataclasses import replace

import numpy as np
import pytest

from cartpend_dae import simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover.records import FreeSpec, Setup
from cartpend_dae.discover.screen import candidates, screen
from cartpend_dae.discover.sweep import alone_with, batches, one_by_one, sweep
from cartpend_dae.discover.weigh import loads_at, weigh
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import catalogue, insert, insertion_at, places
from cartpend_dae.errors import SolverError
from models.driven_cart import DrivenCart
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp

CASES = {
    "pendulum": (RotaDamp(), "bearing.phi", "rad", {"bearing.phi": 1.0, "bearing.w": 0.0}, ("bearing.d",)),
    "cart": (LinearDampMod(), "encoder.s", "m", {}, ("rail.d", "inertial.m")),
}


def bench_of(name):
    model, output, unit, start, free = CASES[name]
    run = simulate(model, 4.0, points=401, start=start)
    noisy = run[output] + 1e-3 * np.random.default_rng(0).standard_normal(run.time.size)
    channels = {output: Channel(noisy, "zoh", 1e-3, unit, 0.0)}
    begin = {key: Start(value, False) for key, value in start.items()}
    experiment = Experiment("run", "train", run.time, {}, channels, begin, "free", None)
    setup = Setup(model, tuple(FreeSpec(q) for q in free), (experiment,), (), ())
    return Workbench(setup, lambda *_: None), candidates(catalogue(), places(model, (output,)), ())


@pytest.mark.parametrize("bandwidth", [0.0, 8.0])
@pytest.mark.parametrize("name", list(CASES))
def test_a_sweep_has_the_sensitivities_of_single_models(name, bandwidth):
    bench, options = bench_of(name)
    firsts = list({option.prefix: option for option in reversed(options)}.values())
    sd = bench.problem(()).prior_sd
    found = sweep(bench, (), tuple(firsts), {}, bandwidth, sd)
    n_compared = 0
    for option in firsts[::3]:
        try:
            alone = one_by_one(alone_with(bench, (), option), option, {}, bandwidth, sd)
        except SolverError:  # the play of a chain whose flanks are too stiff for these steps
            continue
        # in standard deviations of the noise: the sweep steps as coarsely as its own states allow
        np.testing.assert_allclose(found.residual, alone.residual, atol=0.02)
        for size in option.size_names:
            one = alone.sizes[size]
            if size not in found.sizes or np.linalg.norm(one) < 1e-6:
                continue
            both = found.sizes[size]
            # the mean of both ends of a step is right to second order; friction changes its sign within one
            assert one @ both > 0.98 * np.linalg.norm(one) * np.linalg.norm(both), size
            assert np.linalg.norm(both) == pytest.approx(np.linalg.norm(one), rel=0.05), size
            n_compared += 1
    assert n_compared > 10


def test_a_delay_of_a_sensor_that_is_none_has_the_slope_of_its_speed():
    """On steps of 10 ms it is ten times that, so that the delay begins at a tenth of what the data say."""
    bench, options = bench_of("pendulum")
    late = next(option for option in options if option.card.id == "sensor_delay")
    (size,) = late.size_names
    found = one_by_one(alone_with(bench, (), late), late, {}, 0.0, bench.problem(()).prior_sd)
    run = simulate(RotaDamp(), 4.0, points=401, start={"bearing.phi": 1.0, "bearing.w": 0.0})
    assert np.linalg.norm(found.sizes[size]) == pytest.approx(np.linalg.norm(run["bearing.w"]) / 1e-3, rel=0.1)


def test_the_model_of_an_effect_alone_is_made_once_whatever_sizes_come_to_be_known():
    bench, _ = bench_of("pendulum")
    option = insertion_at(RotaDamp(), "quadratic_drag", "bearing")
    one = alone_with(bench, (), option)
    bench.expect({name: 7.0 for name in option.starts})
    again, other = alone_with(bench, (), option), Workbench(bench.setup)
    other.expect({name: 7.0 for name in option.starts})
    assert again is one
    assert [item.scale for item in alone_with(other, (), option).variables] == [item.scale for item in one.variables]


def test_effects_whose_own_states_are_too_fast_are_left_out_of_the_sweep():
    bench, options = bench_of("cart")
    firsts = list({option.prefix: option for option in reversed(options)}.values())
    found = sweep(bench, (), tuple(firsts), {}, 0.0, bench.problem(()).prior_sd)
    names = {name for option in firsts for name in option.size_names}
    missing = names - set(found.sizes)
    assert any(".compliance." in name for name in missing)
    assert not any(".coulomb_friction." in name for name in missing)


def test_a_state_of_the_model_that_is_named_after_an_effect_stays_the_model_s():
    """The speed behind a chain with friction has the name of the chain's: it is no state inside the effect."""
    model = DrivenCart()
    times = 0.01 * np.arange(201)
    u = 5.0 * np.sign(np.sin(7.0 * times))
    run = simulate(model, 2.0, points=201, inputs={"amplifier.u": (times, u, "zoh")})
    channels = {"encoder.s": Channel(run["encoder.s"], "zoh", 1e-4, "m", 0.0)}
    inputs = {"amplifier.u": Channel(u, "zoh", None, "V", 0.0)}
    experiment = Experiment("run", "train", run.time, inputs, channels, {}, "free", None)
    bench = Workbench(Setup(model, (FreeSpec("rail.d"),), (experiment,), (), ()), lambda *_: None)
    sd = bench.problem(()).prior_sd
    for place in ("inertial.flange_a", "inertial.flange_b"):
        inertia = insertion_at(model, "added_inertia", "rail")
        chain = insertion_at(model, "chain_tension_friction", place)
        alone = sweep(bench, (), (inertia,), {}, 0.0, sd).sizes["rail.added_inertia.m"]
        beside = sweep(bench, (), (inertia, chain), {}, 0.0, sd).sizes["rail.added_inertia.m"]
        np.testing.assert_allclose(beside, alone, atol=1e-3 * np.abs(alone).max())


@pytest.mark.parametrize("bandwidth", [0.0, 30.0])
def test_no_effect_is_felt_in_a_run_that_begins_under_load(bandwidth):
    """A start that an effect leaves open once let a base move from the start of a run on, with sizes of 0."""
    model = DrivenCart()
    times = 0.01 * np.arange(201)
    u = 5.0 * np.sign(np.cos(7.0 * times))
    run = simulate(model, 2.0, points=201, inputs={"amplifier.u": (times, u, "zoh")})
    values = run["encoder.s"] + 1e-4 * np.random.default_rng(0).standard_normal(times.size)
    channels = {"encoder.s": Channel(values, "zoh", 1e-4, "m", 0.0)}
    inputs = {"amplifier.u": Channel(u, "zoh", None, "V", 0.0)}
    experiment = Experiment("run", "train", run.time, inputs, channels, {}, "free", None)
    bench = Workbench(Setup(model, (FreeSpec("rail.d"),), (experiment,), (), ()), lambda *_: None)
    sd, point = bench.problem(()).prior_sd, {"rail.d": 24.0}
    options = candidates(catalogue(), places(model, ("encoder.s",)), ())
    firsts = {option.prefix: option for option in reversed(options)}
    assert "rod.pivot.base_compliance" in firsts
    none = sweep(bench, (), (), point, bandwidth, sd).residual
    # all together, but for what gives way behind a rotor without inertia: dry friction of the rotor cannot be beside it
    most, apart = batches(list(firsts.values()))
    assert [option.prefix for option in apart] == ["gears.flange_R.compliance"] and len(most) == len(firsts) - 1
    for batch in (most, apart):
        felt = sweep(bench, (), batch, point, bandwidth, sd).residual
        np.testing.assert_allclose(felt, none, atol=0.02 * np.abs(none).max())


def test_an_effect_that_is_free_already_promises_nothing():
    """The damping of the bearing is free, so that viscous friction there would be the same again.

    The sweep follows sizes by the trapezoidal rule and parameters exactly; their difference is no effect.
    """
    bench, options = bench_of("pendulum")
    run = bench.setup.train[0]
    # something that the model does not know: dry friction, half as strong as in the rig's own bearing
    moved = simulate(RotaDamp(tau_c=0.01), 4.0, points=401, start={"bearing.phi": 1.0})
    channel = replace(run.outputs["bearing.phi"], values=moved["bearing.phi"])
    setup = replace(bench.setup, train=(replace(run, outputs={"bearing.phi": channel}),))
    bench, sd = Workbench(setup), np.array([1e-3])
    fit = bench.fit((), {}, (8.0,), sd)
    found = {c.insertion.prefix: c for c in screen(bench, (), fit.point, options, 8.0, sd)}
    assert "no sensor sees it" in found["bearing.viscous_friction"].why_not
    assert found["bearing.coulomb_friction"].predicted > 0.5 * fit.chi2
    # damping forward and backward is, in sum, that of the bearing: only their difference is something new
    asymmetric = found["bearing.asymmetric_friction"]
    assert all(abs(value) < 0.1 for value in asymmetric.parameters.values())
    assert asymmetric.predicted >= 0.99 * found["bearing.coulomb_friction"].predicted


def test_what_is_fitted_already_is_nothing_new_in_a_damped_rig():
    """The trapezoidal rule is off by 2 % there; that difference once promised damping seventy times too large."""
    model = LinearDampMod()
    hidden = insert(model, "asymmetric_friction", "rail", f_c_pos=4.5, f_c_neg=21.0, d_pos=4.0, d_neg=13.0)
    run = simulate(hidden, 8.0, points=801)
    noisy = run["encoder.s"] + 1e-4 * np.random.default_rng(0).standard_normal(run.time.size)
    channels = {"encoder.s": Channel(noisy, "zoh", 1e-4, "m", 0.0)}
    experiment = Experiment("run", "train", run.time, {}, channels, {}, "free", None)
    bench = Workbench(Setup(model, (FreeSpec("rail.d"), FreeSpec("inertial.m")), (experiment,), (), ()))
    option = insertion_at(model, "viscous_friction", "rail")
    point = {"rail.d": 47.0, "inertial.m": 7.4}
    (candidate,) = screen(bench, (), point, [option], 30.0, bench.problem(()).prior_sd)
    assert candidate.why_not.startswith("no sensor sees it")


def test_what_knocks_in_a_gap_leaves_its_noise_on_fine_steps_only():
    """On the steps of a screening the flanks are softer than they are, which would pass for another effect."""
    model, gap, sd = LinearDampMod(), {"b": 0.004, "f_r": 20.0, "w_c": 200.0}, np.array([1e-4])
    option = insertion_at(model, "backlash", "inertial.flange_b", {"w_c": gap["w_c"], "f_r": gap["f_r"]})
    point = {f"{option.prefix}.b": gap["b"], f"{option.prefix}.f_r": gap["f_r"]}

    def bench_with(truth):
        run = simulate(truth, 4.0, points=401)
        noisy = run["encoder.s"] + sd * np.random.default_rng(0).standard_normal(run.time.size)
        channels = {"encoder.s": Channel(noisy, "zoh", 1e-4, "m", 0.0)}
        experiment = Experiment("run", "train", run.time, {}, channels, {}, "free", None)
        return Workbench(Setup(model, (FreeSpec("rail.d"), FreeSpec("inertial.m")), (experiment,), (), ()))

    def squares(found):
        return float(np.sum(found.residual**2))

    noise = squares(sweep(bench_with(model), (), (), {}, 30.0, sd))  # the same noise, corrected in the same way
    bench = bench_with(insert(model, "backlash", "inertial.flange_b", **gap))
    loads = loads_at(places(model, ("encoder.s",)))
    assert squares(sweep(bench, (option,), (), point, 30.0, sd)) > 2 * noise
    assert squares(weigh(bench, (option,), loads, point, 30.0, sd).found) > 2 * noise
    assert squares(weigh(bench.on("weighed"), (option,), loads, point, 30.0, sd).found) < 1.1 * noise
