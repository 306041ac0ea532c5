"""Single passes through the data of a problem: residuals, predictions, normal equations."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.dae import parameter_vector
from cartpend_dae.errors import SolverError
from cartpend_dae.problem import Problem
from cartpend_dae.stepping import runge_kutta
from cartpend_dae.transcribe import Free, stack_data


@dataclass(frozen=True, slots=True)
class Linearisation:
    """Normal equations by segment at `values` (scaled): `grams` (n_segments, n, n), `gradients` (n_segments, n)."""

    variables: tuple[Free, ...]
    values: np.ndarray
    grams: np.ndarray
    gradients: np.ndarray


def start_states(problem: Problem, values: np.ndarray) -> list[np.ndarray]:
    """Return the start state of each run, shape (n_x,) each, for scaled variables (n,)."""
    position, found = len(problem.layout.free), []
    for start in problem.starts:
        x = start.x.copy()
        for state, factor, offset, free in start.free:
            x[state] = (values[position] * free.scale - offset) / factor
            position += 1
        found.append(x)
    return found


def _start_slopes(problem: Problem, n_all: int) -> list[np.ndarray]:
    """Return d(start state)/d(scaled variables) of each run, shape (n_x, n_all)."""
    position, found = len(problem.layout.free), []
    for start in problem.starts:
        slope = np.zeros((start.x.size, n_all))
        for state, factor, _, free in start.free:
            slope[state, position] = free.scale / factor
            position += 1
        found.append(slope)
    return found


def run_through(problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Run through all data from the start states; return weighted residuals (n_y, n) and states (n_x, n)."""
    layout = problem.layout
    n_c, n_x = len(layout.free) + w.size, layout.system.x.numel()
    carried = np.concatenate([values[: len(layout.free)], w])
    errors, states = [], []
    begin = dict(zip(layout.first, start_states(problem, values), strict=True))
    x = np.zeros(n_x)
    for k in range(layout.n_segments):
        x = begin.get(k, x)
        block = data[:, k * layout.length : (k + 1) * layout.length]
        after, error, state = problem.functions.series(np.concatenate([carried, x]), block)
        x = np.asarray(after)[n_c:, -1]
        errors.append(np.asarray(error))
        states.append(np.asarray(state))
    return np.hstack(errors), np.hstack(states)


def filtered_nodes(problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray) -> np.ndarray:
    """Filter the start state of each segment from the data, shape (n_x, n_segments)."""
    layout = problem.layout
    _, states = run_through(problem, values, w, data)
    nodes = states[:, :: layout.length]
    if not np.all(np.isfinite(nodes)):
        raise SolverError(
            f"{problem.system.name} cannot be simulated with the start values of the parameters: it diverges."
        )
    return nodes


def predict(
    problem: Problem, point: Mapping[str, float], bandwidth: float, *, restarts: tuple[int, ...] = ()
) -> np.ndarray:
    """Predict the outputs of a problem with one run, shape (n, n_outputs).

    Parameters
    ----------
    problem
        A problem with a single run.
    point
        Parameters and free starts by name, SI; what is missing keeps its guess.
    bandwidth
        Bandwidth of the output injection [rad/s]; 0 simulates freely.
    restarts
        Samples at which a free simulation starts again from the state that the injection has filtered;
        without any, the prediction itself is filtered.
    """
    values = np.array([point.get(item.name, item.guess) / item.scale for item in problem.variables])
    data = stack_data(problem.layout, problem.experiments, np.ones(len(problem.outputs)))
    w = np.full(len(problem.outputs), float(bandwidth))
    n = problem.experiments[0].time.size
    measured = np.column_stack([problem.experiments[0].outputs[name].values for name in problem.outputs])
    # a sample that was not measured has no residual; its prediction comes from the states
    states = run_through(problem, values, w, data)[1][:, :n]
    if restarts:
        states = _free_pieces(problem, values, data, states, restarts)
    system, layout = problem.system, problem.layout
    p = parameter_vector(system, {item.name: values[i] * item.scale for i, item in enumerate(layout.free)})
    outputs = ca.Function(
        "measured",
        [system.time, system.x, system.u, system.p, system.frictions.force],
        [system.outputs[list(layout.outputs)]],
    ).map(n)
    n_u = system.u.numel()
    forces = np.zeros((system.frictions.force.numel(), n))
    result = outputs(data[:1, :n], states, data[2 : 2 + n_u, :n], np.tile(p[:, None], n), forces)
    return np.asarray(result).T.reshape(measured.shape)


def _free_pieces(
    problem: Problem, values: np.ndarray, data: np.ndarray, states: np.ndarray, restarts: tuple[int, ...]
) -> np.ndarray:
    """Simulate freely between restarts, each from the state given there."""
    step = runge_kutta(problem.system, substeps=problem.layout.substeps).function
    p = parameter_vector(
        problem.system, {item.name: values[i] * item.scale for i, item in enumerate(problem.layout.free)}
    )
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
    """
    layout = problem.layout
    n_x, n_p = layout.system.x.numel(), len(layout.free)
    size, n_all = n_x + n_p, values.size
    n_c = n_p + w.size
    carried = np.concatenate([values[:n_p], w])
    seeds = np.hstack([np.eye(n_x), np.zeros((n_x, n_p))])
    grams, gradients = np.zeros((layout.n_segments, n_all, n_all)), np.zeros((layout.n_segments, n_all))
    begin = dict(
        zip(
            layout.first,
            zip(start_states(problem, values), _start_slopes(problem, n_all), strict=True),
            strict=True,
        )
    )
    x, slope = np.zeros(n_x), np.zeros((n_x, n_all))
    theta_rows = np.eye(n_p, n_all)
    for k in range(layout.n_segments):
        x, slope = begin.get(k, (x, slope))
        block = data[:, k * layout.length : (k + 1) * layout.length]
        packed = np.concatenate([carried, x, seeds.ravel(order="F"), np.zeros(size * size + size)])
        out = np.asarray(problem.functions.slope(packed, block)).ravel()[n_c:]
        x = out[:n_x]
        step = out[n_x : n_x + n_x * size].reshape(n_x, size, order="F")
        local = out[n_x + n_x * size :][: size * size].reshape(size, size, order="F")
        to_local = np.vstack([slope, theta_rows])
        grams[k] = to_local.T @ local @ to_local
        gradients[k] = to_local.T @ out[-size:]
        slope = step @ to_local
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
    everything = problem.variables
    values = np.array([point.get(item.name, item.guess) / item.scale for item in everything])
    data = stack_data(problem.layout, problem.experiments, 1.0 / sd)
    w = np.full(len(problem.outputs), float(bandwidth))
    grams, gradients = normal_equations(problem, values, w, data)
    return Linearisation(everything, values, grams, gradients)
