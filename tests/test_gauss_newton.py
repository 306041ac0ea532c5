"""The estimation's own solver: the optimum is that of IPOPT, also with dry friction and on bounds."""

from dataclasses import replace

import numpy as np
import pytest
from linear_runs import stuck_pendulum

from cartpend_dae.gauss_newton import bounded_step, gauss_newton, interior_point
from cartpend_dae.shooting import filtered_nodes, scaled_values
from cartpend_dae.transcribe import stack_data


def both(problem, bandwidth=0.0):
    """Solve by both methods from the guesses."""
    data = stack_data(problem.layout, problem.experiments, 1 / problem.prior_sd)
    values, w = scaled_values(problem, {}), np.full(1, bandwidth)
    nodes = filtered_nodes(problem, values, np.full(1, 20.0), data)
    return [solve(problem, values, nodes, w, data) for solve in (gauss_newton, interior_point)]


@pytest.mark.parametrize("bandwidth", [0.0, 5.0])
def test_the_optimum_is_that_of_ipopt(bandwidth):
    own, other = both(stuck_pendulum(), bandwidth)
    assert own.success and other.success
    # IPOPT stops at 1e-7 of a gradient in standard deviations, and keeps 1e-8 off its bounds
    np.testing.assert_allclose(own.values, other.values, rtol=1e-5)
    assert own.cost == pytest.approx(other.cost, abs=1e-5)


def test_a_parameter_that_would_leave_its_bounds_ends_on_them():
    problem = stuck_pendulum()
    free = replace(problem.free[0], lower=0.012, guess=0.02)
    own, other = both(replace(problem, free=(free, *problem.free[1:])))
    assert own.success
    assert own.values[0] == free.scaled(0.012)
    np.testing.assert_allclose(own.values, other.values, rtol=1e-4)


def test_a_parameter_without_any_effect_stays_where_it_is():
    hessian = np.zeros((3, 3))
    hessian[:2, :2] = [[2.0, 0.5], [0.5, 1.0]]
    hessian[2, 2] = 1e-290  # what rounding leaves of a sensitivity
    pull, none = np.array([-4.0, 1.0, 1e-145]), np.full(3, np.inf)
    for lower, upper in ((-none, none), (np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, np.inf]))):
        step = bounded_step(hessian, pull, lower, upper)
        assert step[2] == 0.0
        assert np.all(np.abs(step) < 10)
