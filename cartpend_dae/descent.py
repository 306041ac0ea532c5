"""Estimation by single shooting: fast from a good start where the motion is stable, as under output injection."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit, fit_at
from cartpend_dae.problem import Problem
from cartpend_dae.shooting import run_through, scaled_values, sensitivities
from cartpend_dae.transcribe import stack_data

# what a residual counts as where the simulation diverges, in standard deviations; the next step is shorter then
FAR = 1e6


def descend(
    problem: Problem,
    *,
    bandwidth: float = 0.0,
    guess: Mapping[str, float] | None = None,
    sd: np.ndarray | None = None,
    max_steps: int = 60,
) -> Fit:
    """Solve the estimation problem over parameters and free starts alone, by SciPy's trust-region method.

    Parameters
    ----------
    problem
        The problem, without robust loss.
    bandwidth
        Bandwidth of the output injection [rad/s]; 0 fits the free simulation.
    guess
        Other start values of parameters and free starts by name, SI.
    sd
        Noise of each output used as weight, shape (n_y,); from the raw data if None.
    max_steps
        Largest number of simulations.

    Raises
    ------
    SolverError
        If the simulation diverges from the start values on.

    References
    ----------
    M. A. Branch, T. F. Coleman, Y. Li, SIAM J. Sci. Comput. 21 (1999), 1-23, doi:10.1137/S1064827595289108.
    """
    weights_sd = problem.prior_sd if sd is None else sd
    data = stack_data(problem.layout, problem.experiments, 1.0 / weights_sd)
    w = np.full(len(problem.outputs), float(bandwidth))
    lower = np.array([item.scaled(item.lower) for item in problem.variables])
    upper = np.array([item.scaled(item.upper) for item in problem.variables])
    inside = 1e-9 * np.clip(upper - lower, 0, 1)
    begin = np.clip(scaled_values(problem, guess or {}), lower + inside, upper - inside)
    known = [(i, item) for i, item in enumerate(problem.variables) if item.prior is not None]

    def residuals(values: np.ndarray) -> np.ndarray:
        errors, _ = run_through(problem, values, w, data)
        prior = [(item.value(values[i]) - item.prior.value) / item.prior.sd for i, item in known if item.prior]
        return np.concatenate([np.nan_to_num(errors.T.ravel(), nan=FAR, posinf=FAR, neginf=-FAR), prior])

    def slopes(values: np.ndarray) -> np.ndarray:
        nodes = run_through(problem, values, w, data)[1][:, :: problem.layout.length]
        found = sensitivities(problem, values, nodes, w, data).slopes.reshape(-1, values.size)
        prior = np.zeros((len(known), values.size))
        for row, (i, item) in enumerate(known):
            assert item.prior is not None
            prior[row, i] = item.slope(values[i]) / item.prior.sd
        return np.nan_to_num(np.vstack([found, prior]))

    if not np.all(np.isfinite(run_through(problem, begin, w, data)[0])):
        raise SolverError(f"{problem.system.name} diverges with the start values of the parameters.")
    if begin.size == 0:
        values, success, message, steps = begin, True, "nothing is free", 0
    else:
        solve: Callable[..., Any] = least_squares
        found = solve(
            residuals,
            begin,
            jac=slopes,
            bounds=(lower, upper),
            x_scale="jac",
            ftol=1e-9,
            xtol=1e-9,
            gtol=1e-9,
            max_nfev=max_steps,
        )
        values, success, message, steps = found.x, bool(found.success), str(found.message), int(found.nfev)
        at_low, at_high = values - lower < 1e-7 * (1 + np.abs(lower)), upper - values < 1e-7 * (1 + np.abs(upper))
        values = np.where(at_low, lower, np.where(at_high, upper, values))
    nodes = run_through(problem, values, w, data)[1][:, :: problem.layout.length]
    return fit_at(problem, values, nodes, w, data, weights_sd, success=success, message=message, iterations=steps)
