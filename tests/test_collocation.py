"""Collocation: derivatives of the programme by differences, and the optimum of multiple shooting."""

from dataclasses import replace

import numpy as np
import pytest
from linear_runs import stuck_pendulum
from test_estimation_problem import Brushed, TwoSprings, release, springs_run
from test_identify import experiment_of, pendulum_problem

from cartpend_dae import assemble, collocation, simulate
from cartpend_dae.collocation_programme import collocation_programme, interval_of
from cartpend_dae.data import Channel, Start
from cartpend_dae.identify import estimate
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.transcribe import stack_data
from cartpend_dae.unknowns import Prior, tie
from models.rota_damp import RotaDamp


def several(n=120):
    """Two short runs with a parameter of their own, a logarithm, a prior, a tie, free starts, robust loss."""
    system = assemble(TwoSprings())
    whole = springs_run(noise=1e-3)
    channel = whole.outputs["mass.s"]

    def part(name, n, start):
        return replace(
            whole, name=name, time=whole.time[:n], outputs={"mass.s": replace(channel, values=channel.values[:n])},
            start=start,
        )  # fmt: skip

    runs = (part("a", n, {"mass.s": Start(0.1, True)}), part("b", 2 * n // 3, {"mass.s": Start(0.09, True, 0.02)}))
    free = (
        free_parameter(system, "left.c", guess=40.0, is_log=True, prior=Prior(45.0, 2.0)),
        free_parameter(system, "rail.d", guess=0.4, is_per_run=True),
    )
    return make_problem(system, free, runs, ties=(tie(system, "right.c", "2 * left.c"),), huber=1.5)


def brushed(n=301):
    """A motor whose brushes are an algebraic loop, on a voltage that runs from sample to sample."""
    system = assemble(Brushed())
    times = np.arange(n) / 100
    voltage = 6.0 * np.sin(2 * np.pi * 0.7 * times)
    run = simulate(system, times=times, inputs={"source.u": (times, voltage, "foh")}, rtol=1e-9, atol=1e-11)
    inputs = {"source.u": Channel(voltage, "foh", None, "V", 0.0)}
    experiment = experiment_of(run, {"rotor.w": "rad/s", "resistor.i": "A"}, {}, noise=1e-3, inputs=inputs)
    truth = {"resistor.R": 2.0, "brush.V": 1.0, "rotor.J": 1e-3}
    free = tuple(free_parameter(system, name, guess=1.2 * value, lower=value / 50) for name, value in truth.items())
    return make_problem(system, free, (experiment,), step=0.0025)  # a current this fast costs Runge-Kutta its accuracy


@pytest.mark.parametrize("problem", [several(30), brushed(30)], ids=["several runs", "algebraic"])
def test_the_programme_has_the_derivatives_that_it_states(problem):
    interval = interval_of(problem.layout, "exact")
    solver = collocation_programme(problem, interval, "exact")
    n = solver.size1_in("x0")
    generator = np.random.default_rng(0)
    x = np.concatenate([[item.scaled(item.guess) for item in problem.variables],
                        0.1 + 0.02 * generator.standard_normal(n - len(problem.variables))])  # fmt: skip
    data = stack_data(problem.layout, problem.experiments, 1 / problem.prior_sd)
    layout = problem.layout
    runs = zip(layout.first, layout.run_lengths, strict=True)
    samples = np.concatenate([first * layout.length + np.arange(k) for first, k in runs])
    w = np.full(len(problem.outputs), 3.0)
    p = np.vstack([data[:, samples], np.tile(np.append(w, 0.0)[:, None], samples.size)]).ravel(order="F")
    grad_f, jac_g, hess = (solver.get_function(f"nlp_{name}") for name in ("grad_f", "jac_g", "hess_l"))
    lam = generator.standard_normal(jac_g.size1_out(0))
    lam_f = 0.7
    triangle = hess(x, p, lam_f, lam).full()
    curvature = triangle + np.triu(triangle, 1).T

    def at(x):
        f, gradient = grad_f(x, p)
        g, jacobian = jac_g(x, p)
        return float(f), gradient.full().ravel(), g.full().ravel(), jacobian.full()

    _, gradient, _, jacobian = at(x)
    picks = np.concatenate([np.arange(len(problem.variables)), generator.integers(len(problem.variables), n, 12)])
    for i in picks:
        step = np.zeros(n)
        step[i] = 1e-5
        (f_1, d_1, g_1, j_1), (f_0, d_0, g_0, j_0) = at(x + step), at(x - step)
        # central differences of numbers up to 1e5 (costs) and 1e2 (equations): rounding 1e-16 / 1e-5 of them
        np.testing.assert_allclose((f_1 - f_0) / 2e-5, gradient[i], rtol=1e-5, atol=1e-3)
        np.testing.assert_allclose((g_1 - g_0) / 2e-5, jacobian[:, i], rtol=1e-6, atol=1e-6)
        bent = (lam_f * (d_1 - d_0) + (j_1 - j_0).T @ lam) / 2e-5
        np.testing.assert_allclose(bent, curvature[:, i], rtol=1e-5, atol=1e-5 * np.abs(curvature).max())


@pytest.mark.parametrize("hessian", ["gauss-newton", "exact"])
@pytest.mark.parametrize("method", ["shooting", "collocation"])
@pytest.mark.parametrize("make", [pendulum_problem, several, brushed])
def test_the_optimum_is_that_of_shooting(make, method, hessian):
    problem = make()
    known = estimate(problem, guess=estimate(problem, bandwidth=20.0).point)
    fit = estimate(problem, method=method, hessian=hessian)
    assert known.success and fit.success
    for one, other in zip((*fit.parameters, *fit.starts), (*known.parameters, *known.starts), strict=True):
        # Runge-Kutta and Radau err differently, by at most 1e-5 a step
        assert one.value == pytest.approx(other.value, abs=0.02 * other.sd)
        assert one.sd == pytest.approx(other.sd, rel=1e-3)
    assert fit.cost == pytest.approx(known.cost, abs=1e-2)


def test_predictions_have_the_same_optimum():
    problem = pendulum_problem()
    one, two = (estimate(problem, bandwidth=7.0, method=method) for method in ("shooting", "collocation"))
    assert two.success
    assert two.parameters[0].value == pytest.approx(one.parameters[0].value, abs=0.01 * one.parameters[0].sd)


def test_friction_is_less_and_less_regular_and_ends_where_shooting_does():
    problem = stuck_pendulum()
    known = estimate(problem)
    fit = estimate(problem, method="collocation")
    assert fit.success and fit.form == "time-stepping"
    for one, other in zip(fit.parameters, known.parameters, strict=True):
        assert one.value == pytest.approx(other.value, abs=0.01 * other.sd)


def test_guesses_may_be_far_off():
    """With so much damping the rod hardly moves; the polynomials follow the data nevertheless."""
    problem = pendulum_problem()
    fit = estimate(problem, guess={"bearing.d": 0.9}, method="collocation")
    assert fit.success
    assert fit.parameters[0].value == pytest.approx(0.0375, abs=4 * fit.parameters[0].sd)


def test_the_programme_is_made_once_for_other_data_of_the_same_samples(monkeypatch):
    system = assemble(RotaDamp())
    problem = make_problem(system, (free_parameter(system, "bearing.d", guess=0.02),), (release(0.5, duration=1.0),))
    made = []
    kept = collocation.collocation_programme
    monkeypatch.setattr(collocation, "collocation_programme", lambda *given: made.append(1) or kept(*given))
    first = estimate(problem, method="collocation")
    again = estimate(problem.with_measured((release(0.5, duration=1.0, seed=1),)), method="collocation")
    assert made == [1]
    assert first.values != again.values
