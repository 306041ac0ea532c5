"""The last steps on the exact form: the optimum of the exact model, and a sentence where it cannot be had."""

from dataclasses import replace
from functools import cache

import independent
import numpy as np
import pytest
from linear_runs import Dry, pushed, stuck_pendulum
from scipy.optimize import least_squares
from test_estimation_problem import Brushed
from test_identify import experiment_of

from cartpend_dae import Component, SolverError, Statements, assemble, connect, initial, simulate
from cartpend_dae import exact_form as module
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.exact_form import farthest, finished, refined
from cartpend_dae.identify import estimate
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.rotational_parts import ElastoBacklash2
from cartpend_dae.likelihood import profile
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.session import identify_study, open_study
from cartpend_dae.transcribe import stack_data
from cartpend_dae.unknowns import Prior, tie

NOISE = 1e-4


class Cart(Component):
    """A cart with dry and viscous friction between two springs, both stretched by 0.095 m."""

    def __post_init__(self) -> None:
        self.left, self.right = translational.Fixed(s0=-0.205), translational.Fixed(s0=0.22)
        self.spring_1 = translational.Spring(c=1197.3, s_rel0=0.11)
        self.spring_2 = translational.Spring(c=1320.1, s_rel0=0.125)
        self.cart = translational.Mass(m=11.409)
        self.ground, self.rail = translational.Fixed(), translational.RailFriction(d=20.0, f_c=10.0)

    def equations(self) -> Statements:
        yield connect(self.left.flange, self.spring_1.flange_a)
        yield connect(self.spring_1.flange_b, self.cart.flange_a, self.rail.flange_b)
        yield connect(self.cart.flange_b, self.spring_2.flange_a)
        yield connect(self.spring_2.flange_b, self.right.flange)
        yield connect(self.ground.flange, self.rail.flange_a)
        yield initial(self.cart.s == 0.1146)
        yield initial(self.cart.v == 0)


def stick_slip(theta, step=5e-4):
    """Return 3 s of the cart by the independent simulator: it slips six times, and sticks from 1.5 s on."""
    viscous, coulomb, mass, position = theta
    return independent.cart_between_springs(
        duration=3.0, position=position, viscous=viscous, coulomb=coulomb, mass=mass, step=step
    )


@cache
def cart_problem():
    time, clean = stick_slip([20.0, 10.0, 11.409, 0.1146], step=1e-4)
    measured = clean + NOISE * np.random.default_rng(0).standard_normal(time.size)
    start = {"cart.s": Start(0.11, True), "cart.v": Start(0.0, False)}
    channel = {"cart.s": Channel(measured, "zoh", NOISE, "m", 0.0)}
    run = Experiment("run", "train", time, {}, channel, start, "free", None)
    system = assemble(Cart())
    free = tuple(free_parameter(system, name, guess=guess) for name, guess in
                 (("rail.d", 30.0), ("rail.f_c", 7.0), ("cart.m", 10.0)))  # fmt: skip
    return make_problem(system, free, (run,))


@cache
def cart_fit():
    return estimate(cart_problem())


def test_stick_slip_ends_at_the_optimum_of_the_exact_model():
    """That of scipy, which fits the independent simulator, whose stops are located by bisection."""
    problem, before = cart_problem(), cart_fit()
    fit = refined(problem, before)
    measured = problem.experiments[0].outputs["cart.s"].values
    ends = [*fit.parameters, *fit.starts]
    value, sd = np.array([e.value for e in ends]), np.array([e.sd for e in ends])

    def residual(z):
        return (stick_slip(value + sd * z)[1] - measured) / NOISE

    # differences over a fifth of a standard deviation: rounding and bisection leave 1e-9 m, a millionth of it
    peer = least_squares(residual, np.zeros(4), diff_step=0.2, x_scale=1.0, xtol=1e-6)
    assert 2 * peer.cost == pytest.approx(fit.chi2, abs=0.01)
    np.testing.assert_allclose(peer.x, 0.0, atol=0.02)  # sds; the last step leaves a second order of 0.1
    moved = [abs(e.value - b.value) / e.sd for e, b in zip(ends, (*before.parameters, *before.starts), strict=True)]
    assert 0.01 < max(moved) < 1
    assert farthest(fit)[1] == pytest.approx(max(moved))
    # the derivatives are those of scipy's differences
    slopes = np.sqrt(np.diag(np.linalg.inv(peer.jac.T @ peer.jac)))
    np.testing.assert_allclose(slopes * np.sqrt(fit.noise.covariance[0, 0]), 1.0, rtol=0.02)


def test_the_result_says_on_which_form_it_rests():
    problem, before = cart_problem(), cart_fit()
    assert before.form == "time-stepping"
    fit = finished(problem, before)
    assert fit.form == "exact" and fit.stepped is before
    assert any("rest on the exact form" in note for note in fit.notes)
    assert finished(problem, before, exact=False) is before
    smooth, _ = pushed(np.zeros(50))
    direct = estimate(smooth)
    assert direct.form == "smooth" and finished(smooth, direct) is direct


def finite_differences(problem, point_of, values):
    columns = []
    for i in range(values.size):
        shift = np.zeros(values.size)
        shift[i] = 1e-5
        columns.append((point_of(values + shift) - point_of(values - shift)) / 2e-5)
    return np.stack(columns, axis=-1)


def test_derivatives_go_through_ties_logarithms_starts_and_priors():
    base = cart_problem()
    system = base.system
    run = base.experiments[0]
    runs = tuple(replace(run, name=name, start={"cart.s": start, "cart.v": Start(0.01, True)})
                 for name, start in (("a", Start(0.11, True)), ("b", Start(0.1146, False))))  # fmt: skip
    free = (
        free_parameter(system, "rail.d", guess=18.0, is_per_run=True),
        free_parameter(system, "rail.f_c", guess=9.0, is_log=True, prior=Prior(10.0, 0.5)),
        free_parameter(system, "spring_1.c", guess=1200.0),
    )
    problem = make_problem(system, free, runs, ties=(tie(system, "spring_2.c", "1.1 * spring_1.c"),), huber=2.0)
    fit = replace(cart_fit(), weights_sd=np.array([NOISE]))
    work = module._work(problem, fit)
    values = np.array([item.scaled(item.guess) for item in problem.variables])
    point, slopes = module._differentiated(work, values)
    expected = finite_differences(problem, lambda v: module._evaluated(work, v).residuals, values)
    scale = np.abs(expected).max(axis=(0, 1))
    # tolerance 1e-8 of the integrator over a shift of 1e-5, in residuals of a thousand standard deviations
    np.testing.assert_allclose(slopes / scale, expected / scale, atol=2e-3)
    # and the gradient is that of the whole cost, robust loss and prior included
    _, pull = module._normal_equations(problem, point, slopes)
    cost = finite_differences(problem, lambda v: np.array(module._evaluated(work, v).cost), values)
    np.testing.assert_allclose(pull, cost, rtol=5e-3, atol=1e-3 * np.abs(cost).max())


def test_predictions_and_long_fits_keep_their_steps_and_say_why(monkeypatch):
    problem = stuck_pendulum()
    followed = finished(problem, estimate(problem, bandwidth=5.0), exact=True)
    assert followed.form == "time-stepping"
    assert any("not on its exact form: the fit is of predictions" in note for note in followed.notes)
    monkeypatch.setattr(module, "BEARABLE", 10)
    fit = estimate(problem)
    long = finished(problem, fit)
    assert long.form == "time-stepping" and any("901 samples of 2 steps in 4 directions" in n for n in long.notes)
    assert finished(problem, fit, exact=True).form == "exact"


class Two(Component):
    """Two carts alike, on rails of their own: their stops meet, each with an instant of its own."""

    def __post_init__(self) -> None:
        self.one, self.two = Cart(), Cart()


def test_events_that_meet_keep_the_steps_and_are_named(monkeypatch):
    run = cart_problem().experiments[0]
    channel = run.outputs["cart.s"]
    run = replace(run, outputs={"one.cart.s": channel, "two.cart.s": channel}, start={})
    system = assemble(Two())
    free = tuple(free_parameter(system, f"{which}.rail.d", guess=20.0) for which in ("one", "two"))
    problem = make_problem(system, free, (run,))
    # both are at the same value by the same data, so that both stop at once
    stepped = estimate(problem)
    assert finished(problem, stepped).form == "exact"  # the derivatives of the steps lead there
    monkeypatch.setattr(module, "CHORDS", 0)
    fit = finished(problem, stepped)
    assert fit.form == "time-stepping"
    assert any("events of `one.rail` and `two.rail` meet" in note for note in fit.notes)


STUDY = """
[model]
path = "dry.py"
[parameters."bearing.d"]
guess = 0.02
[parameters."bearing.tau_c"]
guess = 0.008
[[experiment]]
name = "run"
file = "run.csv"
time = { column = "t", unit = "s" }
outputs = { "bearing.phi" = { column = "phi", unit = "rad", sd = 1e-3 } }
start = { "bearing.phi" = { guess = -0.7 }, "bearing.w" = { value = 0.0 } }
"""


def test_a_study_ends_on_the_exact_form_unless_it_says_no(tmp_path):
    run = stuck_pendulum().experiments[0]
    rows = zip(run.time.tolist(), run.outputs["bearing.phi"].values.tolist(), strict=True)
    (tmp_path / "run.csv").write_text("t,phi\n" + "".join(f"{t!r},{y!r}\n" for t, y in rows))
    source = 'from linear_runs import Dry as Base\n\n\nclass Dry(Base):\n    """As there."""\n'
    (tmp_path / "dry.py").write_text(source)
    forms = {}
    for word in ("", "exact = false"):
        (tmp_path / "study.toml").write_text(f"[identify]\n{word}\n{STUDY}")
        forms[word] = identify_study(open_study(tmp_path / "study.toml")).form
    assert forms == {"": "exact", "exact = false": "time-stepping"}


def test_the_profile_lies_around_the_exact_estimate():
    problem = stuck_pendulum()
    before = estimate(problem)
    fit = finished(problem, before)
    one, two = (profile(problem, which, "bearing.tau_c") for which in (before, fit))
    shift = fit.values["bearing.tau_c"] - before.values["bearing.tau_c"]
    assert shift != 0
    np.testing.assert_array_equal(one.z, two.z)
    np.testing.assert_allclose(two.values - one.values, shift, rtol=1e-6)
    np.testing.assert_allclose(np.array(two.interval) - one.interval, shift, rtol=1e-6)


def test_residuals_stand_at_their_samples():
    """The exact residuals are those of the measured samples, in the order of the runs."""
    problem, fit = cart_problem(), finished(cart_problem(), cart_fit())
    data = stack_data(problem.layout, problem.experiments, 1 / fit.weights_sd)
    measured = data[-2][: problem.layout.run_lengths[0]]
    predicted = measured - fit.runs[0].residual[:, 0]
    np.testing.assert_allclose(predicted, fit.runs[0].states[:, 0], atol=1e-12)
    assert fit.chi2 == pytest.approx(np.sum((fit.runs[0].residual / NOISE) ** 2))


class Driven(Component):
    """A motor whose current is an algebraic loop (brushes), with a dry bearing."""

    def __post_init__(self) -> None:
        self.motor, self.bearing = Brushed(), rotational.BearingFriction(d=1e-4, tau_c=0.05)
        self.ground = rotational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.motor.rotor.flange_a, self.bearing.flange_b)
        yield connect(self.ground.flange, self.bearing.flange_a)


def test_algebraic_variables_and_sampled_inputs_are_gone_through():
    """The same answer from the data of an exact simulation as was put in, where steps of fixed length are off."""
    system = assemble(Driven())
    assert system.algebraics
    times = np.linspace(0.0, 3.0, 301)
    voltage = 6.0 * np.sin(2 * np.pi * 0.7 * times)
    run = simulate(system, times=times, inputs={"motor.source.u": (times, voltage, "zoh")}, rtol=1e-9, atol=1e-11)
    inputs = {"motor.source.u": Channel(voltage, "zoh", None, "V", 0.0)}
    experiment = experiment_of(run, {"motor.rotor.w": "rad/s"}, {}, inputs=inputs)
    truth = {"bearing.tau_c": 0.05, "motor.rotor.J": 1e-3}
    free = tuple(free_parameter(system, name, guess=1.1 * value, lower=0.1 * value) for name, value in truth.items())
    problem = make_problem(system, free, (experiment,))
    sd = np.array([0.01])
    before = estimate(problem, guess=truth, sd=sd)
    fit = refined(problem, before)
    for one, other in zip(fit.parameters, before.parameters, strict=True):
        # what was simulated with 1e-9 is found again with 1e-8; in steps of fixed length it is not
        assert one.value == pytest.approx(truth[one.name], rel=2e-6)
        assert abs(other.value / truth[one.name] - 1) > 8e-6


def test_a_run_that_falls_over_keeps_its_steps_or_ends_exactly():
    """Upright, any error grows by e in a quarter of a second: 3 s make of 1e-8 some millirads."""
    time, angle = independent.pendulum(duration=3.0, angle=3.1, viscous=0.02, coulomb=0.01, step=1e-3)
    measured = angle + 1e-3 * np.random.default_rng(0).standard_normal(time.size)
    start = {"bearing.phi": Start(3.1, True), "bearing.w": Start(0.0, False)}
    run = Experiment("run", "train", time, {}, {"bearing.phi": Channel(measured, "zoh", 1e-3, "rad", 0.0)}, start,
                     "free", None)  # fmt: skip
    system = assemble(Dry())
    free = (free_parameter(system, "bearing.d", guess=0.03), free_parameter(system, "bearing.tau_c", guess=0.02))
    problem = make_problem(system, free, (run,))
    fit = finished(problem, estimate(problem))
    assert fit.form == "exact"
    for item, truth in zip(fit.parameters, (0.02, 0.01), strict=True):
        assert item.value == pytest.approx(truth, abs=4 * item.sd)


def test_what_cannot_be_simulated_keeps_its_steps(monkeypatch):
    def breaks(*given, **more):
        raise SolverError("It breaks down at 1 s.")

    monkeypatch.setattr(module, "simulate", breaks)
    monkeypatch.setattr(module, "sensitivities", breaks)
    fit = finished(cart_problem(), cart_fit())
    assert fit.form == "time-stepping"
    assert fit.notes[-1].endswith("not on its exact form: It breaks down at 1 s.")


class Rattling(Component):
    """Two inertias with play between them: the torque jumps at each contact."""

    def __post_init__(self) -> None:
        self.drive, self.gap = rotational.Torque(), ElastoBacklash2(c=20.0, d=0.02, b=0.1)
        self.a, self.b = rotational.Inertia(J=1e-3), rotational.Inertia(J=2e-3)

    def equations(self) -> Statements:
        yield connect(self.drive.flange, self.a.flange_a)
        yield connect(self.a.flange_b, self.gap.flange_a)
        yield connect(self.gap.flange_b, self.b.flange_a)


def test_contacts_in_a_gap_are_found_exactly_where_steps_are_far_off():
    system, times = assemble(Rattling()), np.linspace(0.0, 2.0, 401)
    torque = 0.2 * np.sin(2 * np.pi * 1.3 * times)
    run = simulate(system, times=times, inputs={"drive.tau": (times, torque, "foh")}, rtol=1e-9, atol=1e-11)
    inputs = {"drive.tau": Channel(torque, "foh", None, "N.m", 0.0)}
    experiment = experiment_of(run, {"a.w": "rad/s", "b.w": "rad/s"}, {}, noise=1e-3, inputs=inputs)
    truth = {"gap.c": 20.0, "gap.b": 0.1, "b.J": 2e-3}
    free = tuple(free_parameter(system, name, guess=1.05 * value, lower=0.1 * value) for name, value in truth.items())
    problem = make_problem(system, free, (experiment,), step=5e-4)
    before = estimate(problem, guess=estimate(problem, bandwidth=30.0).point)
    fit = finished(problem, before)
    assert before.chi2 > 10 * before.n_residuals  # even ten steps from sample to sample miss the contacts
    # the noise is all that is left: chi2 of 802 residuals scatters by 40
    assert fit.form == "exact" and fit.chi2 == pytest.approx(fit.n_residuals, abs=120)
    for item in fit.parameters:
        assert item.value == pytest.approx(truth[item.name], abs=4 * item.sd)
        assert item.sd < 1e-4 * item.value
