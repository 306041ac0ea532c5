"""How sure a fitted model's outputs are along a run, from the covariance of what was estimated."""

import numpy as np

from cartpend_dae.data import Experiment
from cartpend_dae.identify import Fit
from cartpend_dae.problem import Problem, make_problem
from cartpend_dae.shooting import filtered_nodes, scaled_values, sensitivities
from cartpend_dae.transcribe import stack_data


def prediction_sd(problem: Problem, fit: Fit, experiment: Experiment) -> np.ndarray:
    """Return the standard deviation of the model's outputs, without the noise of the sensors, shape (n, n_y) [SI].

    By the delta method, cov(y) = S cov(theta) S' with the sensitivities S of the free simulation. What stands on its
    bound is held; start states that the fit does not know count as known.

    Parameters
    ----------
    problem
        The problem that was solved.
    fit
        Its solution.
    experiment
        A run, whether or not it was fitted.

    Returns
    -------
    ndarray
        NaN where the outputs depend on what the data leave open.
    """
    alone = make_problem(problem.system, problem.free, (experiment,), step=problem.step, ties=problem.ties)
    own = fit.values_in(experiment.name)
    point = own | {f"{experiment.name}:{name}": value for name, value in own.items()} | fit.point
    values = scaled_values(alone, point)
    data = stack_data(alone.layout, alone.experiments, np.ones(len(alone.outputs)))
    w = np.zeros(len(alone.outputs))
    nodes = filtered_nodes(alone, values, w, data)
    slopes = sensitivities(alone, values, nodes, w, data).slopes
    names = [e.name for e in (*fit.parameters, *fit.starts)]
    held = {e.name for e in (*fit.parameters, *fit.starts) if e.status == "at-bound"}
    known = [i for i, item in enumerate(alone.variables) if item.name in names and item.name not in held]
    places = [names.index(alone.variables[i].name) for i in known]
    scale = np.array([alone.variables[i].slope(values[i]) for i in known])
    sensitivity = slopes[:, :, known] / scale
    covariance = fit.covariance[np.ix_(places, places)]
    with np.errstate(invalid="ignore"):
        variance = np.einsum("nyi,ij,nyj->ny", sensitivity, covariance, sensitivity)
        samples = _samples(alone)
        return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.nan))[samples]


def _samples(problem: Problem) -> np.ndarray:
    """Return where the samples of the run stand in the data, piece by piece."""
    layout = problem.layout
    return np.concatenate(
        [first * layout.length + np.arange(n) for first, n in zip(layout.first, layout.run_lengths, strict=True)]
    )
