"""The estimation: exact derivatives, the right optimum, honest uncertainty."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from cartpend_dae import Component, ModelError, SolverError, Statements, assemble, connect, identify, initial, simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.effects import insert
from cartpend_dae.gauss_newton import Solution
from cartpend_dae.identify import estimate
from cartpend_dae.library import rotational, translational
from cartpend_dae.pieces import load_experiments
from cartpend_dae.problem import dominant_frequency, free_parameter, make_problem
from cartpend_dae.shooting import filtered_nodes, linearised, predict
from cartpend_dae.study import load_study
from cartpend_dae.transcribe import stack_data
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp

STUDIES = Path(__file__).resolve().parent.parent / "models" / "studies"


def experiment_of(run, outputs, start, *, noise=0.0, seed=0, inputs=None, name="run"):
    """Make an experiment of a simulated run with white noise on the outputs."""
    generator = np.random.default_rng(seed)
    channels = {
        variable: Channel(
            run[variable] + noise * generator.standard_normal(run.time.size), "zoh", noise or None, unit, 0.0
        )
        for variable, unit in outputs.items()
    }
    return Experiment(name, "train", run.time, inputs or {}, channels, start, "free", None)


def pendulum_problem(noise=1e-3, seed=0, free_start=True, **changes):
    model = RotaDamp()
    run = simulate(model, 5.0, points=501, start={"bearing.phi": 0.5, "bearing.w": 0.0}, parameters=changes)
    start = {"bearing.phi": Start(None if free_start else 0.5, free_start), "bearing.w": Start(0.0, False)}
    experiment = experiment_of(run, {"bearing.phi": "rad"}, start, noise=noise, seed=seed)
    system = assemble(model)
    return make_problem(system, (free_parameter(system, "bearing.d", guess=0.01, lower=0.0, upper=1.0),), (experiment,))


def cost(problem, point, bandwidth, sd):
    """Half the sum of squared residuals by prediction alone, without any derivative code."""
    experiment = problem.experiments[0]
    error = experiment.outputs[problem.outputs[0]].values - predict(problem, point, bandwidth)[:, 0]
    return 0.5 * np.nansum((error / sd) ** 2)


@pytest.mark.parametrize("bandwidth", [0.0, 7.0])
def test_gradients_are_those_of_finite_differences(bandwidth):
    problem = pendulum_problem()
    point = {"bearing.d": 0.02, "run:bearing.phi": 0.45}
    linear = linearised(problem, point, bandwidth, problem.prior_sd)
    # the residual of a prediction is taken before the correction; `predict` returns that prediction
    for position, item in enumerate(linear.variables):
        step = 1e-6 * item.scale
        up, down = dict(point), dict(point)
        up[item.name] += step
        down[item.name] -= step
        difference = (
            cost(problem, up, bandwidth, problem.prior_sd[0]) - cost(problem, down, bandwidth, problem.prior_sd[0])
        ) / (2e-6)
        # central differences of a cost of 1e5 with step 1e-6: rounding 1e-16 * 1e5 / 1e-6 = 1e-5 absolute
        assert linear.gradients.sum(axis=0)[position] == pytest.approx(difference, rel=1e-5, abs=1e-3)


def test_the_programme_has_the_constraint_jacobian_that_it_states():
    problem = pendulum_problem()
    solver = problem.programme
    n = solver.size1_in("x0")
    generator = np.random.default_rng(3)
    data = stack_data(problem.layout, problem.experiments, 1 / problem.prior_sd)
    parameter = np.concatenate([[0.0], data.ravel(order="F")])
    point = generator.uniform(0.1, 0.3, n)
    function = solver.get_function("nlp_jac_g")
    _, jacobian = function(point, parameter)
    columns = []
    for i in range(n):
        shift = np.zeros(n)
        shift[i] = 1e-6
        above, below = function(point + shift, parameter)[0], function(point - shift, parameter)[0]
        columns.append((np.asarray(above) - np.asarray(below)).ravel() / 2e-6)
    # second differences of a segment of 1 s: about 1e-12 * 10 / 1e-6
    np.testing.assert_allclose(jacobian.full(), np.array(columns).T, atol=1e-6)


def test_the_optimum_is_that_of_scipy_on_an_independent_simulation():
    problem = pendulum_problem(free_start=False)
    fit = estimate(problem)
    measured = problem.experiments[0].outputs["bearing.phi"].values

    def residual(d):
        run = simulate(
            RotaDamp(),
            5.0,
            points=501,
            start={"bearing.phi": 0.5, "bearing.w": 0.0},
            parameters={"bearing.d": d[0]},
            rtol=1e-11,
            atol=1e-13,
        )
        return (run["bearing.phi"] - measured) / 1e-3

    # start not too far: this peer is plain single shooting with finite differences
    peer = least_squares(residual, [0.03], xtol=1e-12, ftol=1e-12)
    sd = np.sqrt(1.0 / (peer.jac.T @ peer.jac)[0, 0] * 2 * peer.cost / (measured.size - 1))
    # RK4 with the step that the problem chooses is good to 1e-6 rad, a thousandth of the noise
    assert fit.parameters[0].value == pytest.approx(peer.x[0], abs=0.01 * sd)
    assert fit.parameters[0].sd == pytest.approx(sd, rel=0.01)


@pytest.mark.parametrize("guess", [0.01, 0.2])
def test_the_published_pendulum_ends_at_the_minimum_of_the_swept_curve(guess):
    study = load_study(STUDIES / "published_pendulum.toml")
    system = assemble(RotaDamp())
    (experiment,) = load_experiments(study.experiments[0], {v.name: v.declaration.unit for v in system.variables})
    measured = experiment.outputs["bearing.phi"].values

    def sse(d):
        run = simulate(system, times=experiment.time, method="rk4", step=0.01, parameters={"bearing.d": d},
                       start={"bearing.phi": -0.351, "bearing.w": 0.0})  # fmt: skip
        return np.sum((run["bearing.phi"] - measured) ** 2)

    sweep = np.arange(0.0360, 0.0390, 0.00002)
    minimum = sweep[np.argmin([sse(d) for d in sweep])]
    free = (free_parameter(system, "bearing.d", guess=guess, lower=0.0, upper=1.0),)
    fit = estimate(make_problem(system, free, (experiment,), step=0.01))
    assert fit.success
    assert abs(fit.parameters[0].value - minimum) < 1e-4


def test_two_parameters_of_the_cart_between_springs():
    model = LinearDampMod()
    truth = {"rail.d": 50.0, "inertial.m": 6.763}
    run = simulate(model, 1.08, points=109, parameters=truth)
    experiment = experiment_of(run, {"encoder.s": "m"}, {}, noise=2.5e-4, seed=4)
    system = assemble(model)
    free = (free_parameter(system, "rail.d", guess=20.0), free_parameter(system, "inertial.m", guess=2.0, lower=0.1))
    fit = estimate(make_problem(system, free, (experiment,)))
    for item in fit.parameters:
        assert item.status == "ok"
        assert abs(item.value - truth[item.name]) < 4 * item.sd


def test_missing_samples_are_left_out():
    full = pendulum_problem()
    experiment = full.experiments[0]
    values = experiment.outputs["bearing.phi"].values.copy()
    values[100:160] = np.nan
    gap = Experiment("run", "train", experiment.time, {}, {"bearing.phi": Channel(values, "zoh", 1e-3, "rad", 0.0)},
                     experiment.start, "free", None)  # fmt: skip
    fit = estimate(make_problem(full.system, full.free, (gap,)))
    assert fit.n_residuals == 501 - 60
    assert np.isnan(fit.runs[0].residual[100:160]).all()
    assert abs(fit.parameters[0].value - 0.0375) < 4 * fit.parameters[0].sd


def test_where_fixed_steps_do_not_follow_the_last_point_that_they_did_follow_stands(monkeypatch):
    problem = pendulum_problem(free_start=False)
    problem = replace(problem, free=(free_parameter(problem.system, "bearing.d", guess=0.01, upper=1e4),))
    step = problem.experiments[0].time[1] / problem.layout.substeps
    lost = 50 * 0.1719 * 0.86**2 / 3 / step  # a rate of 50 in a step; the method of Runge and Kutta takes 2.8

    def astray(problem, values, nodes, w, data):
        return Solution(np.array([problem.free[0].scaled(lost)]), nodes, 0.0, False, "Restoration_Failed", 3)

    monkeypatch.setattr(identify, "interior_point", astray)
    fit = estimate(problem, iterations=1)
    assert not fit.success and fit.message == "Maximum_Iterations_Exceeded"
    assert 0.01 < fit.values["bearing.d"] < 0.1  # it was made with 0.0375
    with pytest.raises(
        SolverError, match=rf"RotaDamp diverges in steps of {step:.3g} s at `bearing.d` = {lost:.3g}: na"
    ):
        estimate(problem, guess={"bearing.d": lost}, patient=False)


def test_an_estimate_never_lies_beyond_its_bound():
    # IPOPT relaxes bounds by 1e-8; the damping is 0.0375, and 0.05 the least that is allowed
    problem = pendulum_problem(free_start=False)
    free = (free_parameter(problem.system, "bearing.d", guess=0.2, lower=0.05, upper=1.0),)
    (found,) = estimate(replace(problem, free=free), hessian="exact").parameters
    assert 0.05 <= found.value < 0.05001 and found.status == "at-bound"


class Inverted(Component):
    """A rod that starts near the top: unstable, so that plain simulation of the data diverges."""

    def __post_init__(self) -> None:
        self.ground, self.bearing = rotational.Fixed(), rotational.BearingFriction(d=0.02)
        self.rod = rotational.SlenderRod(m=0.1719, l=0.86)

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.flange)
        yield initial(self.bearing.phi == 3.1)


def test_an_unstable_run_is_fitted_by_multiple_shooting():
    system = assemble(Inverted())
    run = simulate(system, 4.0, points=401)
    start = {"bearing.phi": Start(None, True), "bearing.w": Start(None, True)}
    experiment = experiment_of(run, {"bearing.phi": "rad"}, start, noise=1e-3, seed=1)
    free = (free_parameter(system, "bearing.d", guess=0.1), free_parameter(system, "rod.l", guess=0.5, lower=0.1))
    fit = estimate(make_problem(system, free, (experiment,)))
    assert fit.values["bearing.d"] == pytest.approx(0.02, abs=4 * fit.parameters[0].sd)
    assert fit.values["rod.l"] == pytest.approx(0.86, abs=4 * fit.parameters[1].sd)


def test_parameters_that_only_their_ratio_reaches_the_data_are_called_unidentifiable():
    problem = pendulum_problem()
    system = problem.system
    free = (free_parameter(system, "bearing.d", guess=0.03), free_parameter(system, "rod.m", guess=0.17, lower=0.01))
    fit = estimate(make_problem(system, free, problem.experiments))
    # without an input the equation can be divided by the mass
    assert [item.status for item in fit.parameters] == ["unidentifiable", "unidentifiable"]


def test_a_parameter_on_its_bound_is_said_to_be_there():
    problem = pendulum_problem()
    free = (free_parameter(problem.system, "bearing.d", guess=0.1, lower=0.05, upper=1.0),)
    fit = estimate(make_problem(problem.system, free, problem.experiments))
    assert fit.parameters[0].status == "at-bound"
    assert fit.parameters[0].value == pytest.approx(0.05, abs=1e-6)


class Slide(Component):
    """A mass pushed over a rough floor."""

    def __post_init__(self) -> None:
        self.force, self.mass = translational.Force(), translational.Mass(m=2.0)
        self.rail, self.ground = translational.RailFriction(d=0.5, f_c=3.0), translational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.force.flange, self.mass.flange_a, self.rail.flange_b)
        yield connect(self.ground.flange, self.rail.flange_a)


def test_friction_that_sticks_is_estimated_without_bias():
    """The push is below break-away for 40 % of the time, and the mass stands still for an eighth of it."""
    system = assemble(Slide())
    times = np.linspace(0.0, 10.0, 1001)
    push = 5.0 * np.sin(2 * np.pi * 0.4 * times)
    run = simulate(system, times=times, inputs={"force.f": (times, push, "zoh")}, rtol=1e-10, atol=1e-12)
    stuck = np.mean(np.abs(run["mass.v"]) < 1e-9)
    # 0.1249 by explicit Euler steps of 10 us with the exact law
    assert stuck == pytest.approx(0.125, abs=0.002)
    assert np.abs(run["mass.v"]).max() == pytest.approx(0.4436, abs=1e-3)
    inputs = {"force.f": Channel(push, "zoh", None, "N", 0.0)}
    experiment = experiment_of(run, {"mass.s": "m"}, {}, noise=1e-4, seed=2, inputs=inputs)
    truth = {"mass.m": 2.0, "rail.d": 0.5, "rail.f_c": 3.0}
    free = tuple(free_parameter(system, name, guess=2 * value, lower=0.0) for name, value in truth.items())
    fit = estimate(make_problem(system, free, (experiment,)), bandwidth=10.0)
    problem = make_problem(system, free, (experiment,))
    fit = estimate(problem, guess=fit.point)
    for item in fit.parameters:
        # the time stepping is of second order: its own error is far below the noise, but not zero
        assert abs(item.value - truth[item.name]) < 4 * item.sd + 1e-3 * truth[item.name]
    assert fit.noise_sd[0] == pytest.approx(1e-4, rel=0.1)


def test_what_is_wrong_is_said_before_the_solve():
    problem = pendulum_problem()
    system, experiment = problem.system, problem.experiments[0]
    with pytest.raises(ModelError, match=r"no parameter `bearing\.e`; did you mean"):
        free_parameter(system, "bearing.e")
    with pytest.raises(ModelError, match="no run to fit"):
        make_problem(system, problem.free, ())
    driven = assemble(Slide())
    silent = Experiment(
        "push", "train", experiment.time, {}, {"mass.s": experiment.outputs["bearing.phi"]}, {}, "free", None
    )
    with pytest.raises(ModelError, match=r"Run `push` gives no input `force\.f`"):
        make_problem(driven, (free_parameter(driven, "mass.m"),), (silent,))


BREAKAWAY = {"f_c": 2.2, "f_s": 6.0, "v_s": 1e-3}


def breakaway_problem(step=None, seed=0):
    """A cart between springs that swings out and stays where the springs no longer break it away."""
    model = insert(LinearDampMod(), "breakaway_friction", "rail", **BREAKAWAY)
    start = {"encoder.s": 0.1, "cart.v": 0.0}
    parameters = {"rail.d": 10.0, "inertial.m": 6.4}
    run = simulate(model, 8.0, points=801, start=start, parameters=parameters)
    fixed = {name: Start(value, False) for name, value in start.items()}
    experiment = experiment_of(run, {"encoder.s": "m"}, fixed, noise=5e-5, seed=seed)
    system = assemble(model)
    names = ("rail.d", "inertial.m", "rail.breakaway_friction.f_c", "rail.breakaway_friction.f_s")
    free = tuple(free_parameter(system, name, guess=1.0, lower=0.0, upper=100.0) for name in names)
    truth = dict(zip(names, (10.0, 6.4, 2.2, 6.0), strict=True))
    return make_problem(system, free, (experiment,), step=step), truth, run


def test_steps_much_longer_than_the_band_of_break_away_end_where_events_do():
    """In a step that began in the band of 1 mm/s friction had its peak throughout; from outside there was none."""
    problem, truth, run = breakaway_problem(step=0.01)
    assert np.abs(run["cart.v"][-100:]).max() < 1e-9 and np.abs(run["encoder.s"][-1]) > 1e-3
    assert np.abs(predict(problem, truth, 0.0)[:, 0] - run["encoder.s"]).max() < 1e-4
    coulomb = truth | {"rail.breakaway_friction.f_s": truth["rail.breakaway_friction.f_c"]}
    assert np.abs(predict(problem, coulomb, 0.0)[:, 0] - run["encoder.s"]).max() > 1e-3


def test_a_fit_stays_at_a_point_that_is_right_where_friction_holds_for_good():
    """What was filtered from the data moved on, and the first step left for good: 391,000 of 1,602."""
    problem, truth, _ = breakaway_problem()
    fit = estimate(problem, guess=truth)
    assert fit.chi2 < 1.1 * fit.n_residuals
    assert fit.values["rail.breakaway_friction.f_c"] == pytest.approx(2.2, rel=2e-3)


def test_a_slower_correction_leads_a_model_that_a_fast_one_makes_unstable(monkeypatch):
    """A sensor that lags by 50 ms: fits had no start on the driven cart, whose angle is corrected by what lags."""
    problem, tried = pendulum_problem(), []

    def unstable(problem, values, w, data):
        tried.append(float(w[0]))
        if w[0] > 2 * dominant_frequency(problem.experiments):
            raise SolverError("It diverges.")
        return filtered_nodes(problem, values, w, data)

    monkeypatch.setattr("cartpend_dae.identify.filtered_nodes", unstable)
    assert estimate(problem).success
    fast = 5 * dominant_frequency(problem.experiments)
    assert tried == pytest.approx([fast, fast / 3])
    with pytest.raises(SolverError, match="diverges"):
        estimate(problem, observer=fast)
    with pytest.raises(SolverError, match="diverges"):  # the fit itself wants it as fast
        estimate(problem, bandwidth=fast)
