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
    """Return for each output that is a state (up to a factor): (output, state, state of its rate, factor).

    Outputs that are no states are predicted but do not correct the prediction.
    """
    found = []
    for position, index in enumerate(outputs):
        relation = system.state_relations.get(system.variables[index].name)
        if relation is None:
            continue
        rate: int | None = None
        target = system.ode[relation.state]
        for other in range(system.x.numel()):
            if ca.is_equal(target, system.x[other]):
                rate = other
        found.append((position, relation.state, rate, relation.factor))
    return tuple(found)


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


@dataclass(frozen=True, slots=True)
class Programme:
    """The nonlinear programme: `solver` for IPOPT and the functions that evaluate a point of it.

    Variables are theta (scaled), the free start values of all runs (scaled), and the start states of
    all segments; the parameters are w and the data.
    """

    layout: Layout
    functions: Passes
    starts: tuple[RunStart, ...]
    solver: ca.Function
    n_theta: int
    n_start: int


def programme(
    layout: Layout, starts: tuple[RunStart, ...], functions: Passes, options: dict[str, object] | None = None
) -> Programme:
    """Set up the nonlinear programme with hand-made sparse derivatives.

    Parameters
    ----------
    layout
        The structure of the problem.
    starts
        The start of each run.
    functions
        The passes of the layout.
    options
        More options for CasADi's `nlpsol`.
    """
    n_x, n_p, n_y = layout.system.x.numel(), len(layout.free), len(layout.outputs)
    n_s = sum(len(start.free) for start in starts)
    m = layout.n_segments
    n = n_p + n_s + n_x * m
    v = ca.MX.sym("v", n)
    n_rows = 2 + 2 * layout.system.u.numel() + 2 * n_y
    parameter = ca.MX.sym("p", n_y + n_rows * m * layout.length)
    w, data = parameter[:n_y], ca.reshape(parameter[n_y:], n_rows, m * layout.length)
    theta, nodes = v[:n_p], ca.reshape(v[n_p + n_s :], n_x, m)
    carried = ca.repmat(ca.vertcat(theta, w), 1, m)
    ends, cost = _evaluate_value(layout, functions, carried, nodes, data)
    slopes = _evaluate_slope(layout, functions, carried, nodes, data)
    g = ca.vertcat(*_start_defects(layout, starts, v, nodes), ca.vec(ends[:, _inner(layout)] - _followers(layout, nodes)))
    f = ca.sum2(cost)
    ends_s, sensitivity, gram, gradient = slopes
    grad_f = ca.vertcat(ca.sum2(gradient[n_x:, :]), ca.MX.zeros(n_s, 1), ca.vec(gradient[:n_x, :]))
    jac_g = _jacobian(layout, starts, sensitivity, n)
    hessian = _hessian(layout, gram, n, n_s)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    hooks: dict[str, object] = {
        "grad_f": ca.Function("nlp_grad_f", [v, parameter], [f, grad_f], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [v, parameter], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [v, parameter, lam_f, lam_g],
            [ca.triu(hessian) * lam_f],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }
    quiet = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "show_eval_warnings": False}
    # residuals are in standard deviations: a change of the cost by 1e-6 is far below any decision
    settings = {"ipopt.tol": 1e-7, "ipopt.acceptable_tol": 1e-5, "ipopt.max_iter": 100, "ipopt.mu_strategy": "adaptive"}
    solver = ca.nlpsol("fit", "ipopt", {"x": v, "p": parameter, "f": f, "g": g}, hooks | quiet | settings | (options or {}))
    return Programme(layout, functions, starts, solver, n_p, n_s)


def _evaluate_value(
    layout: Layout, functions: Passes, carried: ca.MX, nodes: ca.MX, data: ca.MX
) -> tuple[ca.MX, ca.MX]:
    m, n_x, n_c = layout.n_segments, layout.system.x.numel(), carried.size1()
    result = functions.value.map(m)(ca.vertcat(carried, nodes, ca.MX.zeros(1, m)), data)
    return result[n_c : n_c + n_x, :], result[n_c + n_x :, :]


def _evaluate_slope(
    layout: Layout, functions: Passes, carried: ca.MX, nodes: ca.MX, data: ca.MX
) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
    """Return ends (n_x, m), sensitivities (n_x * size, m), Gram matrices (size^2, m) and gradients (size, m)."""
    m, n_x, n_p, n_c = layout.n_segments, layout.system.x.numel(), len(layout.free), carried.size1()
    size = n_x + n_p
    seeds = ca.DM(np.hstack([np.eye(n_x), np.zeros((n_x, n_p))]))
    constant = ca.repmat(ca.vertcat(ca.vec(seeds), ca.DM.zeros(size * size + size, 1)), 1, m)
    result = functions.slope.map(m)(ca.vertcat(carried, nodes, ca.MX(constant)), data)
    return tuple(ca.vertsplit(result[n_c:, :], np.cumsum([0, n_x, n_x * size, size * size, size]).tolist()))  # type: ignore[return-value]


def _inner(layout: Layout) -> list[int]:
    """Return the segments that another one of the same run follows."""
    return [k for k in range(layout.n_segments) if k + 1 < layout.n_segments and k + 1 not in layout.first]


def _followers(layout: Layout, nodes: ca.MX) -> ca.MX:
    return nodes[:, [k + 1 for k in _inner(layout)]]


def _start_defects(layout: Layout, starts: tuple[RunStart, ...], v: ca.MX, nodes: ca.MX) -> list[ca.MX]:
    defects, position = [], len(layout.free)
    for start, first in zip(starts, layout.first, strict=True):
        x = ca.MX(ca.DM(start.x))
        for state, factor, offset, free in start.free:
            x[state] = (v[position] * free.scale - offset) / factor
            position += 1
        defects.append(nodes[:, first] - x)
    return defects


def _jacobian(layout: Layout, starts: tuple[RunStart, ...], sensitivity: ca.MX, n: int) -> ca.MX:
    """Place the sensitivities of the segments into the sparse Jacobian of the constraints."""
    n_x, n_p, m = layout.system.x.numel(), len(layout.free), layout.n_segments
    n_s = sum(len(start.free) for start in starts)
    rows: list[int] = []
    columns: list[int] = []
    constants: list[float] = []
    row, position = 0, n_p
    for start, first in zip(starts, layout.first, strict=True):
        for i in range(n_x):
            rows.append(row + i), columns.append(n_p + n_s + first * n_x + i), constants.append(1.0)
        for state, factor, _, free in start.free:
            rows.append(row + state), columns.append(position), constants.append(-free.scale / factor)
            position += 1
        row += n_x
    inner = _inner(layout)
    for count, k in enumerate(inner):
        for i in range(n_x):
            rows.append(row + count * n_x + i), columns.append(n_p + n_s + (k + 1) * n_x + i), constants.append(-1.0)
    fixed = len(constants)
    for count, k in enumerate(inner):
        for column in range(n_x + n_p):
            place = n_p + n_s + k * n_x + column if column < n_x else column - n_x
            for i in range(n_x):
                rows.append(row + count * n_x + i), columns.append(place)
    assert m >= len(inner)
    return _sparse(rows, columns, constants, fixed, ca.vec(sensitivity[:, inner]), (row + len(inner) * n_x, n))


def _sparse(
    rows: list[int], columns: list[int], constants: list[float], fixed: int, values: ca.MX, shape: tuple[int, int]
) -> ca.MX:
    """Make a sparse matrix of constants, which stand first, and of computed values."""
    order = np.lexsort((np.array(rows), np.array(columns)))
    sparsity = ca.Sparsity.triplet(shape[0], shape[1], rows, columns)
    everything = ca.vertcat(ca.MX(ca.DM(constants[:fixed])), values) if fixed else values
    return ca.sparsity_cast(everything[order.tolist()], sparsity)


def _hessian(layout: Layout, gram: ca.MX, n: int, n_s: int) -> ca.MX:
    """Place the Gram matrices: parameters with parameters (summed), parameters with nodes, nodes with themselves."""
    n_x, n_p, m = layout.system.x.numel(), len(layout.free), layout.n_segments
    size = n_x + n_p
    index = np.arange(size * size).reshape(size, size, order="F")
    summed = ca.sum2(gram)
    rows: list[int] = []
    columns: list[int] = []
    picks_sum = index[n_x:, n_x:].ravel(order="F").tolist()
    for j in range(n_p):
        for i in range(n_p):
            rows.append(i), columns.append(j)
    picks: list[int] = []
    for k in range(m):
        base = n_p + n_s + k * n_x
        for j in range(n_x):
            for i in range(n_x):
                rows.append(base + i), columns.append(base + j), picks.append(k * size * size + int(index[i, j]))
            for i in range(n_p):
                rows.append(i), columns.append(base + j), picks.append(k * size * size + int(index[n_x + i, j]))
                rows.append(base + j), columns.append(i), picks.append(k * size * size + int(index[n_x + i, j]))
    values = ca.vertcat(summed[picks_sum], ca.vec(gram)[picks]) if picks_sum else ca.vec(gram)[picks]
    return _sparse(rows, columns, [], 0, values, (n, n))
