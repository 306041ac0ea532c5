"""Gauss and Newton's method for multiple shooting, on the few variables that are left when the segments are joined.

The start states of the segments follow, to first order, from parameters and free starts; what remains is a small
least squares problem with bounds. One pass over the data gives value, gradient and Hessian of a step.

References
----------
H. G. Bock, "Recent advances in parameter identification techniques for ODE", in P. Deuflhard, E. Hairer (eds.),
Numerical Treatment of Inverse Problems (1983), 95-121, doi:10.1007/978-1-4684-7324-7_7.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from cartpend_dae.errors import SolverError
from cartpend_dae.problem import Problem
from cartpend_dae.programme import Hessian
from cartpend_dae.shooting import carried_on, start_slopes, start_states

# of the cost, half a sum of squares in standard deviations: what a step still promises at the end (0.0014 standard
# deviations, and that step is taken), and what is enough where the kinks of dry friction keep it from being reached
DONE, ENOUGH = 1e-6, 1e-4
# of the whole cost: rounding, below which nothing can be promised
ROUNDING = 1e-12
ITERATIONS, HALVINGS = 50, 10
# a parameter whose curvature is this share of the largest has no effect: its sensitivity is rounding
NOTHING = 1e-26
ARMIJO = 1e-4
# curvature relative to the largest below which a direction is left where it is
FLAT = 1e-13


@dataclass(frozen=True, slots=True)
class Solution:
    """Where the method ended: scaled variables (n_all,), nodes (n_state, n_segments), and the cost there."""

    values: np.ndarray
    nodes: np.ndarray
    cost: float
    success: bool
    message: str
    iterations: int


@dataclass(frozen=True, slots=True)
class _Point:
    """A point, its cost, and by how much each segment starts away from where it should, shape (n_state, m)."""

    values: np.ndarray
    nodes: np.ndarray
    cost: float
    defects: np.ndarray

    def merit(self, penalty: np.ndarray) -> float:
        return self.cost + float(np.sum(penalty * np.abs(self.defects)))


@dataclass(frozen=True, slots=True)
class _Step:
    """A step in variables and nodes: the `decrease` of the cost that it promises, and the multipliers of the joints."""

    values: np.ndarray
    nodes: np.ndarray
    decrease: float
    multipliers: np.ndarray


@dataclass(frozen=True, slots=True)
class _Work:
    """What stays the same in all steps; bounds are scaled."""

    problem: Problem
    w: np.ndarray
    data: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def gauss_newton(
    problem: Problem,
    values: np.ndarray,
    nodes: np.ndarray,
    w: np.ndarray,
    data: np.ndarray,
    *,
    iterations: int = ITERATIONS,
) -> Solution:
    """Minimise the cost of a problem from a point.

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
    iterations
        Largest number of steps.
    """
    work = _Work(problem, w, data, *bounds(problem))
    point = _evaluated(work, values, nodes)
    penalty = np.zeros_like(nodes)
    for iteration in range(iterations):
        if not np.isfinite(point.cost):
            return Solution(point.values, point.nodes, point.cost, False, "Invalid_Number_Detected", iteration)
        step = _step(work, point)
        if not np.isfinite(step.decrease):
            return Solution(point.values, point.nodes, point.cost, False, "Invalid_Number_Detected", iteration)
        penalty = np.maximum(penalty, 2 * np.abs(step.multipliers))
        promised = step.decrease + float(np.sum(penalty * np.abs(point.defects)))
        size = 1e-300 + np.abs(point.nodes).max(axis=1, keepdims=True, initial=0.0)
        if promised < DONE + ROUNDING * point.cost and np.all(np.abs(point.defects) < 1e-7 * size):
            last = _evaluated(work, point.values + step.values, point.nodes + step.nodes)
            best = last if last.merit(penalty) <= point.merit(penalty) + DONE + ROUNDING * point.cost else point
            return Solution(best.values, best.nodes, best.cost, True, "Solve_Succeeded", iteration + 1)
        found = _searched(work, point, step, penalty, promised)
        if found is None:
            is_enough = promised < ENOUGH
            message = "Solved_To_Acceptable_Level" if is_enough else "Search_Direction_Becomes_Too_Small"
            return Solution(point.values, point.nodes, point.cost, is_enough, message, iteration + 1)
        point = found
    return Solution(point.values, point.nodes, point.cost, False, "Maximum_Iterations_Exceeded", iterations)


def interior_point(
    problem: Problem,
    values: np.ndarray,
    nodes: np.ndarray,
    w: np.ndarray,
    data: np.ndarray,
    *,
    hessian: Hessian = "gauss-newton",
) -> Solution:
    """Minimise the cost of a problem from a point by IPOPT; arguments as of `gauss_newton`.

    Raises
    ------
    SolverError
        If the solver ends without a usable point.
    """
    lower, upper = bounds(problem)
    open_nodes = np.full(nodes.size, np.inf)
    solver = problem.programme if hessian == "gauss-newton" else problem.exact_programme
    result = solver(
        x0=np.concatenate([values, nodes.ravel(order="F")]),
        p=np.concatenate([w, data.ravel(order="F")]),
        lbx=np.concatenate([lower, -open_nodes]),
        ubx=np.concatenate([upper, open_nodes]),
        lbg=0.0,
        ubg=0.0,
    )
    stats = solver.stats()
    solution, message = np.asarray(result["x"]).ravel(), str(stats["return_status"])
    if not np.all(np.isfinite(solution)):
        raise SolverError(f"The fit of {problem.system.name} gave no finite parameters ({message}).")
    found, ends = np.split(solution, [values.size])
    found = np.clip(found, lower, upper)  # IPOPT relaxes them a little
    success = message in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    return Solution(
        found, ends.reshape(nodes.shape, order="F"), float(result["f"]), success, message, int(stats["iter_count"])
    )


def bounds(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper bounds of the scaled variables, shapes (n_all,)."""
    lower, upper = (
        np.array([item.scaled(getattr(item, end)) for item in problem.variables]) for end in ("lower", "upper")
    )
    return lower, upper


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _searched(work: _Work, point: _Point, step: _Step, penalty: np.ndarray, promised: float) -> _Point | None:
    """Halve the step until the merit falls as it should; None if it does not."""
    share, before = 1.0, point.merit(penalty)
    for _ in range(HALVINGS):
        found = _evaluated(work, point.values + share * step.values, point.nodes + share * step.nodes)
        if np.isfinite(found.cost) and found.merit(penalty) <= before - ARMIJO * share * promised:
            return found
        share /= 2
    return None


def _evaluated(work: _Work, values: np.ndarray, nodes: np.ndarray) -> _Point:
    problem, layout = work.problem, work.problem.layout
    values = np.clip(values, work.lower, work.upper)
    carried = carried_on(problem, values, work.w)
    packed = np.vstack([carried, nodes, np.zeros((1, layout.n_segments))])
    result = problem.functions.evaluated("value", packed, work.data)[0][len(carried) :]
    cost = float(result[-1].sum()) + float(np.sum(prior_errors(problem, values)[0] ** 2)) / 2
    return _Point(values, nodes, cost, _targets(problem, values, result[:-1]) - nodes)


def _targets(problem: Problem, values: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return where each segment should start, given where each one ends."""
    targets = np.roll(ends, 1, axis=1)
    targets[:, list(problem.layout.first)] = np.column_stack(start_states(problem, values))
    return targets


def prior_errors(problem: Problem, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors against what was known before, in standard deviations, and their slopes."""
    errors, slopes = np.zeros(values.size), np.zeros(values.size)
    for i, (item, value) in enumerate(zip(problem.variables, values, strict=True)):
        if item.prior is not None:
            errors[i] = (float(item.value(value)) - item.prior.value) / item.prior.sd
            slopes[i] = item.slope(value) / item.prior.sd
    return errors, slopes


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _step(work: _Work, point: _Point) -> _Step:
    """Return the step to the minimum of the linearised problem within the bounds."""
    problem, layout = work.problem, work.problem.layout
    n_x, m, n_all = layout.n_state, layout.n_segments, point.values.size
    sensitivity, gram, gradient = _linearised(work, point)
    begin = dict(zip(layout.first, start_slopes(problem, point.values), strict=True))
    eye, owners = np.eye(n_all), layout.owners[layout.runs]
    error, prior_slope = prior_errors(problem, point.values)
    hessian, pull = np.diag(prior_slope**2), prior_slope * error
    slopes, shifts = np.zeros((m, n_x, n_all)), np.zeros((m, n_x))
    slope, shift = np.zeros((n_x, n_all)), np.zeros(n_x)
    for k in range(m):
        slope, shift = (begin[k], np.zeros(n_x)) if k in begin else (slope, shift)
        slopes[k], shifts[k] = slope, shift + point.defects[:, k]
        to_local, moved = np.vstack([slope, eye[owners[k]]]), np.zeros(gradient.shape[1])
        moved[:n_x] = shifts[k]
        hessian += to_local.T @ gram[k] @ to_local
        pull += to_local.T @ (gradient[k] + gram[k] @ moved)
        slope, shift = sensitivity[k] @ to_local, sensitivity[k] @ moved
    if not (np.all(np.isfinite(hessian)) and np.all(np.isfinite(pull))):
        return _Step(np.zeros_like(point.values), np.zeros_like(point.nodes), np.inf, np.zeros_like(point.nodes))
    values = bounded_step(hessian, pull, work.lower - point.values, work.upper - point.values)
    nodes = (slopes @ values + shifts).T
    local = np.concatenate([nodes.T, values[owners]], axis=1)
    slopes_of_cost = gradient + np.einsum("kij,kj->ki", gram, local)
    multipliers = np.zeros((m, n_x))
    for k in reversed(range(m)):
        follows = k + 1 < m and k + 1 not in begin
        multipliers[k] = slopes_of_cost[k, :n_x] + (sensitivity[k][:, :n_x].T @ multipliers[k + 1] if follows else 0.0)
    decrease = -float(np.sum(gradient * local)) - float((prior_slope * error) @ values)
    return _Step(values, nodes, decrease, multipliers.T)


def _linearised(work: _Work, point: _Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return by segment the sensitivities of its end (m, n_state, size), Gram matrix and gradient of its residuals."""
    problem, layout = work.problem, work.problem.layout
    n_x, m, size = layout.n_state, layout.n_segments, layout.n_state + len(layout.slots)
    carried = carried_on(problem, point.values, work.w)
    seeds = np.eye(n_x, size).ravel(order="F")
    start = np.concatenate([seeds, np.zeros(size * size + size)])
    packed = np.vstack([carried, point.nodes, np.tile(start[:, None], m)])
    out = problem.functions.evaluated("slope", packed, work.data)[0][len(carried) + n_x :]
    ends = np.cumsum([n_x * size, size * size])
    sensitivity, gram, gradient = np.split(out.T, ends, axis=1)
    return (
        sensitivity.reshape(m, size, n_x).transpose(0, 2, 1),
        gram.reshape(m, size, size),
        gradient,
    )


def bounded_step(hessian: np.ndarray, pull: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Minimise d'H d/2 + pull'd with lower <= d <= upper; directions without curvature are left alone."""
    if not pull.size:
        return pull
    curved = np.diag(hessian) > NOTHING * np.diag(hessian).max()  # of scaled parameters
    size = np.where(curved, np.sqrt(np.clip(np.diag(hessian), 1e-300, None)), 1.0)
    eigenvalues, vectors = np.linalg.eigh(hessian / np.outer(size, size))
    good = eigenvalues > FLAT * max(1.0, eigenvalues.max())
    root, vectors = np.sqrt(eigenvalues[good]), vectors[:, good]
    scaled = np.where(curved, -(vectors / root) @ ((vectors / root).T @ (pull / size)), 0.0)
    if np.all(scaled >= lower * size) and np.all(scaled <= upper * size):
        return scaled / size
    is_open = (upper > lower) & curved
    matrix, target = (root[:, None] * vectors.T)[:, is_open], -(vectors / root).T @ (pull / size)
    found = np.zeros(pull.size)
    bounds = (lower * size)[is_open], (upper * size)[is_open]
    found[is_open] = lsq_linear(matrix, target, bounds, method="bvls").x
    return np.clip(found / size, lower, upper)
