"""The estimation problem as a nonlinear programme: multiple shooting with exact Gauss-Newton derivatives.

Each run is cut into segments with their own start states, joined by equality constraints. Inside a
segment a Runge-Kutta step is folded over the samples together with its sensitivities, so that cost,
gradient and Hessian come from one pass and the build time does not grow with the number of samples.

At each sample the state may be corrected by the innovation with the gains of a critically damped
second-order observer of bandwidth w (output injection). With w = 0 the residual is the error of the
free simulation; with w > 0 it is the error of prediction, in which small disturbances do not pile up.

References
----------
H. G. Bock, K. J. Plitt, "A multiple shooting algorithm for direct solution of optimal control problems",
IFAC Proc. 17 (1984), 1603-1608, doi:10.1016/S1474-6670(17)61205-9.
E. Brookner, "Tracking and Kalman Filtering Made Easy" (1998), section 1.2.6 (critically damped g-h filter).
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.data import Experiment
from cartpend_dae.stepping import runge_kutta
from cartpend_dae.system import System

SEGMENT = 100


@dataclass(frozen=True, slots=True)
class Free:
    """A quantity to be estimated: bounds and guess in SI, and the size by which it is scaled."""

    name: str
    guess: float
    lower: float
    upper: float
    scale: float
    unit: str


@dataclass(frozen=True, slots=True)
class RunStart:
    """How a run starts: states `x` (n_x,) where nothing is estimated, and (state, factor, offset, Free) where it is."""

    x: np.ndarray
    free: tuple[tuple[int, float, float, Free], ...]


@dataclass(frozen=True, slots=True)
class Layout:
    """The structure of an estimation problem: what is free, what is measured, how samples are grouped.

    `outputs` are indices of system variables. Segments (n_segments of `length` samples) of all runs
    stand one after the other; `first` are the segments with which runs begin.
    """

    system: System
    free: tuple[Free, ...]
    outputs: tuple[int, ...]
    output_names: tuple[str, ...]
    substeps: int
    length: int
    n_segments: int
    first: tuple[int, ...]
    run_lengths: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Passes:
    """CasADi functions of a layout.

    ``value(theta, w, nodes, data) -> (ends, cost)``, ``slope(...) -> (ends, sensitivities, gram, gradient)``
    per segment, ``series(...) -> (residuals, states)`` per sample.
    """

    value: ca.Function
    slope: ca.Function
    series: ca.Function


def injection_targets(system: System, outputs: tuple[int, ...]) -> tuple[tuple[int, int, int | None, ca.SX], ...]:
    """Return for each output that shows a state: (output, state, state of its rate, factor).

    Outputs that show none are predicted but do not correct the prediction.
    """
    found = []
    for position, index in enumerate(outputs):
        shown = shown_state(system, system.variables[index].name)
        if shown is None:
            continue
        state, factor = shown
        rate: int | None = None
        for other in range(system.x.numel()):
            if ca.is_equal(system.ode[state], system.x[other]):
                rate = other
        found.append((position, state, rate, factor))
    return tuple(found)


def shown_state(system: System, name: str) -> tuple[int, ca.SX] | None:
    """Return the state that a variable shows, and its factor: the variable is factor times state, and more.

    It is the state that the variable is, up to a factor; or else the one of the same unit that it differs from, as by
    the deflection of a shaft; or that of the variable it is named after, as ``encoder.s.sensor_delay.y`` is.
    """
    names = {variable.name for variable in system.variables}
    while name:
        relation = system.state_relations.get(name)
        if relation is not None:
            return relation.state, relation.factor
        slope = ca.jacobian(system.outputs[system.index_of(name)], system.x) if name in names else ca.SX(1, 0)
        for state in slope.sparsity().get_triplet()[1]:
            is_fixed = not ca.depends_on(slope[0, state], ca.vertcat(system.x, system.u, system.time))
            if is_fixed and system.unit_of(system.states[state]) == system.unit_of(name) != "1":
                return state, slope[0, state]
        name = name.rpartition(".")[0]
    return None


def passes(layout: Layout) -> Passes:
    """Build the functions of a layout; the time it takes depends on the model, not on the data."""
    system = layout.system
    n_x, n_u, n_y, n_p = system.x.numel(), system.u.numel(), len(layout.outputs), len(layout.free)
    theta, w, x = ca.SX.sym("theta", n_p), ca.SX.sym("w", n_y), ca.SX.sym("x", n_x)
    data = ca.SX.sym("data", 2 + 2 * n_u + 2 * n_y)
    x_next, error = _sample(layout, theta, w, x, data)
    carried = ca.vertcat(theta, w)
    size = n_x + n_p
    seeds = ca.SX.sym("seeds", n_x, size)
    full = ca.vertcat(seeds, ca.horzcat(ca.SX.zeros(n_p, n_x), ca.SX.eye(n_p)))
    moved = ca.jtimes(ca.vertcat(x_next, error), ca.vertcat(x, theta), full)
    seeds_next, error_slope = moved[:n_x, :], moved[n_x:, :]
    gram, gradient, cost = ca.SX.sym("gram", size, size), ca.SX.sym("gradient", size), ca.SX.sym("cost")
    cost_next = cost + ca.sumsqr(error) / 2
    value = _fold("value", [carried, x, cost], [carried, x_next, cost_next], data, layout.length)
    slope = _fold(
        "slope",
        [carried, x, ca.vec(seeds), ca.vec(gram), gradient],
        [
            carried,
            x_next,
            ca.vec(seeds_next),
            ca.vec(gram + error_slope.T @ error_slope),
            gradient + error_slope.T @ error,
        ],
        data,
        layout.length,
    )
    state = ca.vertcat(carried, x)
    series = ca.Function("series", [state, data], [ca.vertcat(carried, x_next), error, x], {"cse": True})
    return Passes(value, slope, series.mapaccum(layout.length))


def _fold(name: str, before: list[ca.SX], after: list[ca.SX], data: ca.SX, length: int) -> ca.Function:
    step = ca.Function(name, [ca.vertcat(*before), data], [ca.vertcat(*after)], {"cse": True})
    return step.fold(length)


def _sample(layout: Layout, theta: ca.SX, w: ca.SX, x: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the state at the next sample and the weighted residual of this one."""
    system = layout.system
    n_u, n_y = system.u.numel(), len(layout.outputs)
    time, width, u_a, u_b, measured, weight = ca.vertsplit(
        data, [0, 1, 2, 2 + n_u, 2 + 2 * n_u, 2 + 2 * n_u + n_y, 2 + 2 * n_u + 2 * n_y]
    )
    p = ca.SX(ca.DM(system.parameter_values))
    for position, free in enumerate(layout.free):
        p[system.parameter_index(free.name)] = theta[position] * free.scale
    outputs = ca.Function(
        "measured",
        [system.time, system.x, system.u, system.p, system.frictions.force],
        [system.outputs[list(layout.outputs)]],
    )
    error = measured - outputs(time, x, u_a, p, ca.SX.zeros(system.frictions.force.numel()))
    corrected = ca.SX(x)
    # width is 0 at the last sample of a run and at padding: nothing is corrected or stepped there
    for position, state, rate, factor in injection_targets(system, layout.outputs):
        factor = ca.substitute(factor, system.p, p) if system.p.numel() else factor
        rho = ca.exp(-w[position] * width)
        seen = (weight[position] > 0) * error[position] / factor
        if rate is None:
            corrected[state] += (1 - rho) * seen
        else:
            corrected[state] += (1 - rho**2) * seen
            corrected[rate] += (1 - rho) ** 2 * seen / ca.fmax(width, 1e-30)
    step = runge_kutta(system, substeps=layout.substeps).function
    return step(time, width, corrected, u_a, u_b, p), weight * error


def stack_data(layout: Layout, experiments: tuple[Experiment, ...], weights: np.ndarray) -> np.ndarray:
    """Return the samples of all runs in segments, shape (n_rows, n_segments * length).

    Rows are time, width of the interval, inputs at its ends, measured outputs, weights (1/sd, 0 where missing).

    Parameters
    ----------
    layout
        The layout of the same experiments.
    experiments
        The runs.
    weights
        1/sd of each output, shape (n_y,).
    """
    n_u, n_y = layout.system.u.numel(), len(layout.outputs)
    columns = np.zeros((2 + 2 * n_u + 2 * n_y, layout.n_segments * layout.length))
    for run, (experiment, first) in enumerate(zip(experiments, layout.first, strict=True)):
        n = layout.run_lengths[run]
        block = columns[:, first * layout.length :][:, :n]
        block[0] = experiment.time
        block[1, :-1] = np.diff(experiment.time)
        for row, name in enumerate(layout.system.inputs):
            left, right = interval_inputs(experiment, layout.system, name)
            block[2 + row], block[2 + n_u + row] = left, right
        for row, name in enumerate(layout.output_names):
            if name not in experiment.outputs:
                continue
            values = experiment.outputs[name].values
            known = np.isfinite(values)
            block[2 + 2 * n_u + row] = np.where(known, values, 0.0)
            block[2 + 2 * n_u + n_y + row] = np.where(known, weights[row], 0.0)
    return columns


def interval_inputs(experiment: Experiment, system: System, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return an input at both ends of the interval after each sample, shapes (n,)."""
    if name not in experiment.inputs:
        value = system.variables[system.index_of(name)].declaration.default or 0.0
        constant = np.full(experiment.time.size, value)
        return constant, constant
    channel = experiment.inputs[name]
    if channel.hold == "zoh":
        return channel.values, channel.values
    return channel.values, np.append(channel.values[1:], channel.values[-1])
