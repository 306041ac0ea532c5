"""Single passes through the data of a problem: residuals, predictions, normal equations."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cartpend_dae.errors import SolverError
from cartpend_dae.problem import Problem
from cartpend_dae.transcribe import stack_data
from cartpend_dae.unknowns import Free


@dataclass(frozen=True, slots=True)
class Linearisation:
    """Normal equations by segment at `values` (scaled): `grams` (n_segments, n, n), `gradients` (n_segments, n)."""

    variables: tuple[Free, ...]
    values: np.ndarray
    grams: np.ndarray
    gradients: np.ndarray


@dataclass(frozen=True, slots=True)
class Sensitivities:
    """Weighted residuals (n, n_y) of all segments and their derivatives (n, n_y, n_all) in the scaled variables."""

    residuals: np.ndarray
    slopes: np.ndarray


def start_states(problem: Problem, values: np.ndarray) -> list[np.ndarray]:
    """Return the start state of each run, shape (n_state,) each, for scaled variables (n_all,)."""
    return [
        np.asarray(begin(values[theta], values[free])).ravel()
        for begin, theta, free in zip(problem.begins, problem.layout.owners, problem.start_places, strict=True)
    ]


def start_slopes(problem: Problem, values: np.ndarray) -> list[np.ndarray]:
    """Return d(start state)/d(scaled variables) of each run, shape (n_state, n_all)."""
    found = []
    for begin, theta, free in zip(problem.begins, problem.layout.owners, problem.start_places, strict=True):
        slope = np.zeros((begin.numel_out(0), values.size))
        parts = begin.jacobian()(values[theta], values[free], np.zeros(begin.numel_out(0)))
        for columns, part in zip((theta, free), parts, strict=True):
            slope[:, columns] = np.asarray(part)
        found.append(slope)
    return found


def carried_on(problem: Problem, values: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return what each segment carries, theta and w, shape (n_slots + n_y, n_segments)."""
    theta = values[problem.layout.owners][problem.layout.runs]
    return np.vstack([theta.T, np.tile(w[:, None], problem.layout.n_segments)])


def run_through(
    problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray, segments: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Run through all data from the start states; return weighted residuals (n_y, n) and states (n_state, n).

    With `segments` only so many of the first ones are run through.
    """
    layout = problem.layout
    carried = carried_on(problem, values, w)
    errors, states = [], []
    begin = dict(zip(layout.first, start_states(problem, values), strict=True))
    x = np.zeros(layout.n_state)
    for k in range(layout.n_segments if segments is None else segments):
        x = begin.get(k, x)
        block = data[:, k * layout.length : (k + 1) * layout.length]
        after, error, state = problem.functions.evaluated("series", np.concatenate([carried[:, k], x])[:, None], block)
        x = after[len(carried) :, -1]
        errors.append(error)
        states.append(state)
    return np.hstack(errors), np.hstack(states)


def run_from(
    problem: Problem, values: np.ndarray, nodes: np.ndarray, w: np.ndarray, data: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Run through each segment from its own start in `nodes` (n_state, n_segments); returns as `run_through`."""
    packed = np.vstack([carried_on(problem, values, w), nodes])
    _, errors, states = problem.functions.evaluated("series", packed, data)
    return errors, states


def filtered_nodes(
    problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray, segments: int | None = None
) -> np.ndarray:
    """Filter the start state of each segment, or of so many of the first ones, from the data (n_state, n_segments)."""
    layout = problem.layout
    _, states = run_through(problem, values, w, data, segments)
    nodes = states[:, :: layout.length]
    if not np.all(np.isfinite(nodes)):
        raise SolverError(_diverging(problem, values))
    return nodes


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def sensitivities(
    problem: Problem, values: np.ndarray, nodes: np.ndarray, w: np.ndarray, data: np.ndarray
) -> Sensitivities:
    """Return the residuals of each sample and their derivatives in all variables, segments joined.

    With the nodes of the first segments only, these are all that is evaluated.

    Parameters
    ----------
    problem
        The problem.
    values
        Scaled variables (n_all,).
    nodes
        Start of each segment (n_state, n_segments).
    w
        Bandwidth of the output injection of each output [rad/s].
    data
        The samples, see `stack_data`.

    Raises
    ------
    SolverError
        If the simulation, or its derivatives, diverge.
    """
    layout = problem.layout
    n_x, n_p, n_y, m = layout.n_state, len(layout.slots), len(layout.outputs), nodes.shape[1]
    size = n_x + n_p
    seeds = np.hstack([np.eye(n_x), np.zeros((n_x, n_p))]).ravel(order="F")
    packed = np.vstack([carried_on(problem, values, w)[:, :m], nodes, np.tile(seeds[:, None], m)])
    after, rows = problem.functions.evaluated("rows", packed, data[:, : m * layout.length])
    if not (np.all(np.isfinite(after)) and np.all(np.isfinite(rows))):
        raise SolverError(_diverging(problem, values))
    ends = after[-n_x * size :, layout.length - 1 :: layout.length]
    begin = dict(zip(layout.first, start_slopes(problem, values), strict=True))
    slope = np.zeros((n_x, values.size))
    residuals = rows[:n_y].T
    local = rows[n_y:].T.reshape(-1, size, n_y).transpose(0, 2, 1)
    found = np.zeros((residuals.shape[0], n_y, values.size))
    for k in range(m):
        slope = begin.get(k, slope)
        to_local = np.vstack([slope, np.eye(values.size)[layout.owners[layout.runs[k]]]])
        part = slice(k * layout.length, (k + 1) * layout.length)
        found[part] = local[part] @ to_local
        slope = ends[:, k].reshape(n_x, size, order="F") @ to_local
    if not np.all(np.isfinite(found)):
        raise SolverError(_diverging(problem, values))
    return Sensitivities(residuals, found)


def _diverging(problem: Problem, values: np.ndarray) -> str:
    """Say where the simulation diverges in steps of fixed length, and what helps."""
    found = [(item.name, float(item.value(value))) for item, value in zip(problem.variables, values, strict=True)]
    places = ", ".join(f"`{name}` = {value:.3g}" for name, value in found[:12])
    step = max(float(np.diff(run.time).max()) for run in problem.experiments) / problem.layout.substeps
    return (
        f"{problem.system.name} diverges in steps of {step:.3g} s at {places}: narrow the `min` and `max` of what has "
        f"gone astray, begin nearer, or set a shorter `step` under [identify]."
    )


def predict(
    problem: Problem, point: Mapping[str, float], bandwidth: float, *, restarts: tuple[int, ...] = ()
) -> np.ndarray:
    """Predict the outputs of a problem with one run, whole or in pieces, shape (n, n_outputs).

    Parameters
    ----------
    problem
        A problem with a single run.
    point
        Parameters and free starts by name, SI; what is missing keeps its guess.
    bandwidth
        Bandwidth of the output injection [rad/s]; 0 simulates freely.
    restarts
        Samples at which a free simulation of a whole run starts again from the state that the injection has
        filtered; without any, the prediction itself is filtered.
    """
    values = scaled_values(problem, point)
    data = stack_data(problem.layout, problem.experiments, np.ones(len(problem.outputs)))
    w = np.full(len(problem.outputs), float(bandwidth))
    layout, n_u = problem.layout, problem.system.u.numel()
    samples = np.concatenate(
        [first * layout.length + np.arange(n) for first, n in zip(layout.first, layout.run_lengths, strict=True)]
    )
    n = samples.size
    # a sample that was not measured has no residual; its prediction comes from the states
    states, data = run_through(problem, values, w, data)[1][:, samples], data[:, samples]
    if restarts:
        states = _free_pieces(problem, values, data, states, restarts)
    p = parameters_of_run(problem, values, 0)
    outputs = problem.functions.step.measure.map(n)
    result = outputs(data[:1], data[1:2], states, data[2 : 2 + n_u], np.tile(p[:, None], n))
    return np.asarray(result)[list(layout.outputs)].T


def weighted_residuals(problem: Problem, point: Mapping[str, float], bandwidth: float, sd: np.ndarray) -> np.ndarray:
    """Return the weighted residuals (n_y, n) of a problem at parameters and free starts by name, SI; else the guesses.

    Parameters
    ----------
    problem
        The problem.
    point
        Values by name.
    bandwidth
        Of the output injection of all outputs [rad/s].
    sd
        Noise used as weight, shape (n_y,).
    """
    w = np.full(len(problem.outputs), float(bandwidth))
    data = stack_data(problem.layout, problem.experiments, 1.0 / sd)
    return run_through(problem, scaled_values(problem, point), w, data)[0]


def scaled_values(problem: Problem, point: Mapping[str, float]) -> np.ndarray:
    """Return the scaled variables (n_all,) of parameters and free starts by name, SI; else the guesses."""
    return np.array([item.scaled(point.get(item.name, item.guess)) for item in problem.variables])


def parameters_of_run(problem: Problem, values: np.ndarray, run: int) -> np.ndarray:
    """Return all parameters of the system in a run, shape (n_p,), SI."""
    return np.asarray(problem.functions.parameters(values[problem.layout.owners[run]])).ravel()


def _free_pieces(
    problem: Problem, values: np.ndarray, data: np.ndarray, states: np.ndarray, restarts: tuple[int, ...]
) -> np.ndarray:
    """Simulate freely between restarts, each from the state given there."""
    step = problem.functions.step.function
    p = parameters_of_run(problem, values, 0)
    n, n_u = states.shape[1], problem.system.u.numel()
    free = states.copy()
    edges = [*restarts, n]
    for first, last in itertools.pairwise(edges):
        if last - first < 2:
            continue
        part = data[:, first : last - 1]
        run = step.mapaccum("piece", last - first - 1, ["x"], ["x_next"])
        out = run(
            t=part[:1],
            h=part[1:2],
            x=states[:, first],
            u_a=part[2 : 2 + n_u],
            u_b=part[2 + n_u : 2 + 2 * n_u],
            p=np.tile(p[:, None], last - first - 1),
        )
        free[:, first + 1 : last] = np.asarray(out["x_next"])
    return free


def normal_equations(
    problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return Gram matrices (n_segments, n, n) and gradients (n_segments, n) of the weighted residuals.

    They are over parameters and free starts (scaled). The segments are run through one after the other,
    so that their sums are those of single shooting.

    Raises
    ------
    SolverError
        If the simulation, or its derivatives, diverge.
    """
    layout = problem.layout
    n_x, n_p = layout.n_state, len(layout.slots)
    size, n_all = n_x + n_p, values.size
    carried = carried_on(problem, values, w)
    n_c = len(carried)
    seeds = np.hstack([np.eye(n_x), np.zeros((n_x, n_p))])
    grams, gradients = np.zeros((layout.n_segments, n_all, n_all)), np.zeros((layout.n_segments, n_all))
    begin = dict(
        zip(
            layout.first,
            zip(start_states(problem, values), start_slopes(problem, values), strict=True),
            strict=True,
        )
    )
    x, slope = np.zeros(n_x), np.zeros((n_x, n_all))
    for k in range(layout.n_segments):
        x, slope = begin.get(k, (x, slope))
        block = data[:, k * layout.length : (k + 1) * layout.length]
        packed = np.concatenate([carried[:, k], x, seeds.ravel(order="F"), np.zeros(size * size + size)])
        out = problem.functions.evaluated("slope", packed[:, None], block)[0].ravel()[n_c:]
        x = out[:n_x]
        step = out[n_x : n_x + n_x * size].reshape(n_x, size, order="F")
        local = out[n_x + n_x * size :][: size * size].reshape(size, size, order="F")
        to_local = np.vstack([slope, np.eye(n_all)[layout.owners[layout.runs[k]]]])
        grams[k] = to_local.T @ local @ to_local
        gradients[k] = to_local.T @ out[-size:]
        slope = step @ to_local
    if not (np.all(np.isfinite(grams)) and np.all(np.isfinite(gradients))):
        raise SolverError(_diverging(problem, values))
    return grams, gradients


def linearised(problem: Problem, point: Mapping[str, float], bandwidth: float, sd: np.ndarray) -> Linearisation:
    """Return the normal equations of a problem at a point, without solving it.

    Parameters
    ----------
    problem
        The problem.
    point
        Parameters and free starts by name, SI; what is missing keeps its guess.
    bandwidth
        Bandwidth of the output injection [rad/s].
    sd
        Noise used as weight, shape (n_y,).
    """
    values = scaled_values(problem, point)
    data = stack_data(problem.layout, problem.experiments, 1.0 / sd)
    w = np.full(len(problem.outputs), float(bandwidth))
    grams, gradients = normal_equations(problem, values, w, data)
    return Linearisation(problem.variables, values, grams, gradients)
