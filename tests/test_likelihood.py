"""Profile likelihood, bootstrap and bands against the closed forms of a model that is linear in its parameters."""

import numpy as np
import pytest
from linear_runs import SD, pushed, stuck_pendulum
from scipy.signal import lfilter

from cartpend_dae import ModelError
from cartpend_dae.bands import prediction_sd
from cartpend_dae.bootstrap import Kind, bootstrap
from cartpend_dae.identify import estimate
from cartpend_dae.likelihood import profile

N, FITS, NAME = 400, 300, "push.f_constant"


def white(seed=0):
    return SD * np.random.default_rng(seed).standard_normal(N)


def coloured(a=0.8, seed=0):
    return (
        SD * np.sqrt(1 - a**2) * lfilter([1.0], [1.0, -a], np.random.default_rng(seed).standard_normal(N + 200))[200:]
    )


def formula(regressors, correlation):
    """Return the covariance of ordinary least squares under noise of SD with correlation[k] k samples apart."""
    inverse = np.linalg.inv(regressors.T @ regressors)
    lags = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    return SD**2 * inverse @ regressors.T @ correlation(lags) @ regressors @ inverse


@pytest.mark.parametrize("noise", [white(), coloured()], ids=["white", "coloured"])
def test_the_profile_of_a_linear_model_is_the_normal_interval(noise):
    problem, _ = pushed(noise)
    fit = estimate(problem)
    found, item = profile(problem, fit, NAME), fit.parameters[0]
    # the cost is a parabola, known to 1e-9 of itself, so that z is a straight line
    np.testing.assert_allclose(found.z, (found.values - item.value) / item.sd, atol=1e-4)
    np.testing.assert_allclose(found.interval, item.interval, rtol=1e-5)
    assert found.values.size > 8


def test_the_profile_does_not_depend_on_the_number_of_processes_and_ends_on_bounds():
    problem, _ = pushed(white())
    fit = estimate(problem)
    one, two = (profile(problem, fit, NAME, jobs=jobs) for jobs in (1, 2))
    np.testing.assert_array_equal(one.z, two.z)
    bounded, _ = pushed(white(), upper=fit.values[NAME] + fit.parameters[0].sd)
    assert profile(bounded, estimate(bounded), NAME).interval[1] == pytest.approx(bounded.free[0].upper)
    with pytest.raises(ModelError, match=r"no estimated parameter `mass\.m`.*`push\.f_constant`"):
        profile(problem, fit, "mass.m")


def test_the_profile_of_friction_agrees_with_its_interval_within_its_curvature():
    problem = stuck_pendulum()
    fit = estimate(problem)
    found, item = profile(problem, fit, "bearing.tau_c"), fit.parameters[1]
    # 1,000 samples of low noise: the model is nearly linear over two standard deviations
    np.testing.assert_allclose(np.array(found.interval) - item.value, np.array(item.interval) - item.value, rtol=0.05)


@pytest.mark.parametrize(("kind", "is_white"), [(Kind.parametric, True), (Kind.parametric, False), (Kind.block, True)])
def test_the_bootstrap_has_the_standard_deviation_of_the_formula(kind, is_white):
    problem, regressors = pushed(white() if is_white else coloured())
    fit = estimate(problem)
    found = bootstrap(problem, fit, FITS, kind=kind, seed=1)
    factor = (fit.noise.sd[0]) ** 2
    expected = formula(regressors, lambda lag: lag == 0 if is_white else -(fit.noise.filters[0][1] ** lag))
    if not is_white:
        assert len(fit.noise.filters[0]) == 2
        expected = formula(regressors, lambda lag: (-fit.noise.filters[0][1]) ** lag)
    sd = np.sqrt(np.diag(expected) * factor)
    # the sd of 300 fits is known to 1/sqrt(600) = 4 %; blocks see the noise that was, not its model: 10 % more
    np.testing.assert_allclose(found.sd, sd, rtol=0.12 if kind is Kind.parametric else 0.2)
    assert found.failed == 0 and len(found.values) == FITS
    low, high = found.intervals[0]
    assert high - low == pytest.approx(2 * 1.96 * sd[0], rel=0.25)


def test_the_bootstrap_follows_from_its_seed_alone():
    problem, _ = pushed(white())
    fit = estimate(problem)
    one, two = (bootstrap(problem, fit, 8, seed=5, jobs=jobs) for jobs in (1, 2))
    np.testing.assert_array_equal(one.values, two.values)
    assert not np.array_equal(one.values, bootstrap(problem, fit, 8, seed=6).values)


def test_what_the_bootstrap_cannot_do_is_refused():
    problem, _ = pushed(white())
    with pytest.raises(ModelError, match="this fit is of predictions"):
        bootstrap(problem, estimate(problem, bandwidth=2.0), 5)
    with pytest.raises(ModelError, match="A block of 1000 samples does not fit into the shortest run of 400"):
        bootstrap(problem, estimate(problem), 5, kind=Kind.block, block=1000)


def test_the_band_of_a_linear_model_is_that_of_regression():
    problem, regressors = pushed(white())
    fit = estimate(problem)
    found = prediction_sd(problem, fit, problem.experiments[0])[:, 0]
    expected = np.sqrt(np.einsum("ni,ij,nj->n", regressors, fit.covariance, regressors))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
