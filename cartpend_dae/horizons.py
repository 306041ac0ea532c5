"""How the error of a model grows with how far it looks ahead."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.data import Experiment
from cartpend_dae.problem import Problem, dominant_frequency, make_problem
from cartpend_dae.shooting import parameters_of_run, run_through, scaled_values, stack_data
from cartpend_dae.system import System

BEGINNINGS = 60
"""Most instants of a run from which a prediction begins."""
STEPS = 200_000
"""Most steps over all predictions of a run."""
LEADS = 14
SETTLED = 0.1
"""Share of a run after which the observer counts as settled."""


@dataclass(frozen=True, slots=True, eq=False)
class Ahead:
    """The rms `error` (n_leads, n_outputs) of predictions that look `seconds` (n_leads,) ahead, SI; NaN: diverged."""

    seconds: np.ndarray
    error: np.ndarray


def error_ahead(system: System, experiment: Experiment, *, bandwidth: float = 0.0, step: float | None = None) -> Ahead:
    """Measure the error of predictions by how far they look ahead.

    From instants along the run the model is simulated freely for half of it, each time from the state that an
    observer has filtered until then. The error over a lead time is the rms over all these predictions between the
    lead time before and this one.

    Parameters
    ----------
    system
        The model with its parameters.
    experiment
        The run; at least 20 samples.
    bandwidth
        Bandwidth of the observer [rad/s]; five times the dominant frequency if 0.
    step
        Longest step of the integration [s].
    """
    experiment = replace(experiment, piece=None)
    problem = make_problem(system, (), (experiment,), step=step)
    observer = bandwidth or 5 * dominant_frequency((experiment,))
    values = scaled_values(problem, {})
    states, data = _filtered(problem, values, observer)
    n = states.shape[1]
    longest = n // 2
    count = min(BEGINNINGS, max(2, STEPS // longest))
    firsts = np.unique(np.linspace(SETTLED * n, n - 1 - longest, count).astype(int))
    truth = np.column_stack([experiment.outputs[name].values for name in problem.outputs])
    predicted = _predictor(problem, values, states, data, longest)
    square = np.zeros((longest, len(problem.outputs)))
    known = np.zeros(square.shape, dtype=int)
    for first in firsts:
        error = truth[first + 1 : first + 1 + longest] - predicted(first)
        is_known = np.isfinite(truth[first + 1 : first + 1 + longest])
        square += np.where(is_known, error**2, 0.0)
        known += is_known
    edges = np.unique(np.geomspace(1, longest, LEADS).round().astype(int))
    seconds = np.array([np.mean(experiment.time[firsts + edge] - experiment.time[firsts]) for edge in edges])
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        parts = [slice(a, b) for a, b in zip([0, *edges[:-1]], edges, strict=True)]
        error = np.sqrt([square[part].sum(axis=0) / known[part].sum(axis=0) for part in parts])
    return Ahead(seconds, np.where(np.isfinite(error), error, np.nan))


def _filtered(problem: Problem, values: np.ndarray, observer: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the states of the observer (n_x, n) and the data of the samples."""
    layout = problem.layout
    data = stack_data(layout, problem.experiments, np.ones(len(problem.outputs)))
    states = run_through(problem, values, np.full(len(problem.outputs), observer), data)[1]
    samples = layout.first[0] * layout.length + np.arange(layout.run_lengths[0])
    return states[:, samples], data[:, samples]


def _predictor(
    problem: Problem, values: np.ndarray, states: np.ndarray, data: np.ndarray, longest: int
) -> Callable[[int], np.ndarray]:
    """Return what gives the outputs (longest, n_outputs) after a sample, simulated from the state there."""
    step, n_u = problem.functions.step, problem.system.u.numel()
    p = np.tile(parameters_of_run(problem, values, 0)[:, None], longest)
    run = step.function.mapaccum("ahead", longest, ["x"], ["x_next"])
    measure = step.measure.map(longest)

    def predicted(first: int) -> np.ndarray:
        part, after = data[:, first : first + longest], data[:, first + 1 : first + 1 + longest]
        u_a, u_b = part[2 : 2 + n_u], part[2 + n_u : 2 + 2 * n_u]
        x = np.asarray(run(t=part[:1], h=part[1:2], x=states[:, first], u_a=u_a, u_b=u_b, p=p)["x_next"])
        return np.asarray(measure(after[:1], after[1:2], x, after[2 : 2 + n_u], p))[list(problem.layout.outputs)].T

    return predicted
