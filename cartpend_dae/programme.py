"""The nonlinear programme of an estimation for IPOPT, with hand-made sparse derivatives.

Variables are parameters, free start values and the start states of all segments; constraints join the
segments. The Hessian is that of Gauss and Newton, summed from the Gram matrices of the segments.
"""

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from cartpend_dae.passes import Passes
from cartpend_dae.transcribe import Layout
from cartpend_dae.unknowns import Free

Hessian = Literal["gauss-newton", "exact"]

# residuals are in standard deviations: a change of the cost by 1e-6 is far below any decision
SETTINGS: dict[str, str | bool | float] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": False,
    "show_eval_warnings": False,
    "ipopt.tol": 1e-7,
    "ipopt.acceptable_tol": 1e-5,
    "ipopt.max_iter": 100,
    "ipopt.mu_strategy": "adaptive",
}
# share added to the diagonal of the Hessian: along a direction that the data leave open, rounding must not make a step
DAMPING = 1e-8


@dataclass(frozen=True, slots=True)
class _Map:
    """Where the variables of a programme stand: global indices of theta (n_slots, n_segments), starts and nodes."""

    n: int
    n_v: int
    theta: np.ndarray
    starts: tuple[np.ndarray, ...]
    nodes: np.ndarray

    @property
    def local(self) -> np.ndarray:
        """Variables of each segment, its node and then theta, shape (n_state + n_slots, n_segments)."""
        return np.vstack([self.nodes, self.theta])


def programme(
    layout: Layout,
    variables: tuple[Free, ...],
    begins: tuple[ca.Function, ...],
    start_places: tuple[np.ndarray, ...],
    functions: Passes,
    *,
    hessian: Hessian = "gauss-newton",
    options: dict[str, Any] | None = None,
) -> ca.Function:
    """Return the solver of the nonlinear programme.

    Its variables are those of `layout.free` (scaled), the free start values of all runs (scaled), and the start
    states of all segments; its parameters are w and the data.

    Parameters
    ----------
    layout
        The structure of the problem.
    variables
        Parameters and free starts.
    begins
        The start state of each run as a function of (theta, free starts).
    start_places
        Where the free starts of each run stand among the variables.
    functions
        The passes of the layout.
    hessian
        The exact one is differentiated by CasADi.
    options
        More options for CasADi's `nlpsol`.
    """
    places = _places(layout, start_places, len(variables))
    n_y, m = len(layout.outputs), layout.n_segments
    v = ca.MX.sym("v", places.n)
    n_rows = 2 + 2 * layout.system.u.numel() + 2 * n_y
    parameter = ca.MX.sym("p", n_y + n_rows * m * layout.length)
    w, data = parameter[:n_y], ca.reshape(parameter[n_y:], n_rows, m * layout.length)
    theta, nodes = _pick(v, places.theta), _pick(v, places.nodes)
    carried = ca.vertcat(theta, ca.repmat(w, 1, m))
    ends, cost = _evaluate_value(layout, functions, carried, nodes, data)
    _, sensitivity, gram, gradient = _evaluate_slope(layout, functions, carried, nodes, data)
    inner = _inner(layout)
    first, slopes = _start_defects(layout, places, begins, v, theta, nodes)
    g = ca.vertcat(*first, ca.vec(ends[:, inner] - nodes[:, [k + 1 for k in inner]]))
    prior, prior_slope, prior_curvature = prior_terms(variables, v)
    f = ca.sum2(cost) + prior
    grad_f = summed(gradient, places.local, places.n) + prior_slope
    jac_g = _jacobian(layout, places, slopes, sensitivity)
    curvature = _hessian(places, gram, prior_curvature)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    hooks: dict[str, Any] = {
        "grad_f": ca.Function("nlp_grad_f", [v, parameter], [f, grad_f], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [v, parameter], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [v, parameter, lam_f, lam_g],
            [ca.triu(curvature) * lam_f],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }
    if hessian == "exact":
        del hooks["hess_lag"]
    return ca.nlpsol("fit", "ipopt", {"x": v, "p": parameter, "f": f, "g": g}, hooks | SETTINGS | (options or {}))


def _places(layout: Layout, start_places: tuple[np.ndarray, ...], n_v: int) -> _Map:
    n_x, m = layout.n_state, layout.n_segments
    nodes = n_v + np.arange(n_x * m).reshape(n_x, m, order="F")
    return _Map(n_v + n_x * m, n_v, layout.owners[layout.runs].T, start_places, nodes)


def _pick(v: ca.MX, index: np.ndarray) -> ca.MX:
    return ca.reshape(v[index.ravel(order="F").tolist()], *index.shape)


def _evaluate_value(
    layout: Layout, functions: Passes, carried: ca.MX, nodes: ca.MX, data: ca.MX
) -> tuple[ca.MX, ca.MX]:
    m, n_x, n_c = layout.n_segments, layout.n_state, carried.size1()
    result = functions.value.map(m)(ca.vertcat(carried, nodes, ca.MX.zeros(1, m)), data)
    return result[n_c : n_c + n_x, :], result[n_c + n_x :, :]


def _evaluate_slope(
    layout: Layout, functions: Passes, carried: ca.MX, nodes: ca.MX, data: ca.MX
) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
    """Return ends (n_state, m), sensitivities (n_state * size, m), Gram matrices (size^2, m), gradients (size, m)."""
    m, n_x, n_p, n_c = layout.n_segments, layout.n_state, len(layout.slots), carried.size1()
    size = n_x + n_p
    seeds = ca.DM(np.hstack([np.eye(n_x), np.zeros((n_x, n_p))]))
    constant = ca.repmat(ca.vertcat(ca.vec(seeds), ca.DM.zeros(size * size + size, 1)), 1, m)
    result = functions.slope.map(m)(ca.vertcat(carried, nodes, ca.MX(constant)), data)
    return tuple(ca.vertsplit(result[n_c:, :], np.cumsum([0, n_x, n_x * size, size * size, size]).tolist()))  # type: ignore[return-value]


def _inner(layout: Layout) -> list[int]:
    """Return the segments that another one of the same run follows."""
    return [k for k in range(layout.n_segments) if k + 1 < layout.n_segments and k + 1 not in layout.first]


def _start_defects(
    layout: Layout, places: _Map, begins: tuple[ca.Function, ...], v: ca.MX, theta: ca.MX, nodes: ca.MX
) -> tuple[list[ca.MX], list[ca.MX]]:
    """Return node - begin of each run, and the slopes of begin in (theta, free starts)."""
    defects, slopes = [], []
    for begin, first, free in zip(begins, layout.first, places.starts, strict=True):
        arguments = theta[:, first], v[free.tolist()]
        value = begin(*arguments)
        defects.append(nodes[:, first] - value)
        jacobians = begin.jacobian()(*arguments, ca.MX(*value.shape))
        slopes.append(ca.densify(ca.horzcat(*jacobians)))
    return defects, slopes


def prior_terms(
    everything: tuple[Free, ...], v: ca.MX, *, is_exact: bool = False
) -> tuple[ca.MX, ca.MX, dict[int, ca.MX]]:
    """Return the cost of what was known before, its gradient (n, 1), and its curvature by variable, exact or not."""
    cost, gradient, curvature = ca.MX(0), ca.MX.zeros(v.numel()), {}
    for i, item in enumerate(everything):
        if item.prior is None:
            continue
        slope = (ca.exp(v[i]) if item.is_log else 1) * item.scale / item.prior.sd
        error = (item.value(v[i]) - item.prior.value) / item.prior.sd
        cost += error**2 / 2
        gradient[i] = slope * error
        curvature[i] = slope**2 + (slope * error if is_exact and item.is_log else 0)
    return cost, gradient, curvature


def summed(values: ca.MX, index: np.ndarray, n: int) -> ca.MX:
    """Return a vector (n, 1) in which each value stands at its index, those with the same index added."""
    flat = index.ravel(order="F")
    order = np.argsort(flat, kind="stable")
    select = ca.DM(ca.Sparsity.triplet(n, flat.size, flat[order].tolist(), order.tolist()), 1.0)
    return ca.densify(ca.mtimes(ca.MX(select), ca.vec(values)))


def _jacobian(layout: Layout, places: _Map, slopes: list[ca.MX], sensitivity: ca.MX) -> ca.MX:
    """Place the sensitivities of the segments into the sparse Jacobian of the constraints.

    Rows are the start defects of the runs, then the joints after the segments that another one follows.
    """
    n_x, inner = layout.n_state, np.array(_inner(layout), dtype=int)
    n_runs, states = len(slopes), np.arange(n_x)
    rows, columns, values = [], [], []
    for run, (slope, first, free) in enumerate(zip(slopes, layout.first, places.starts, strict=True)):
        into = np.concatenate([places.theta[:, first], free])
        rows += [run * n_x + states, np.tile(run * n_x + states, into.size)]
        columns += [places.nodes[:, first], np.repeat(into, n_x)]
        values += [ca.MX.ones(n_x), -ca.vec(slope)]
    if inner.size:
        joint = (n_runs + np.arange(inner.size)) * n_x
        at = (joint[None, :] + states[:, None]).ravel(order="F")
        rows.append(at)
        columns.append(places.nodes[:, inner + 1].ravel(order="F"))
        values.append(-ca.MX.ones(at.size))
        local = places.local[:, inner]
        rows.append(np.broadcast_to(joint + states[:, None, None], (n_x, *local.shape)).ravel(order="F"))
        columns.append(np.broadcast_to(local, (n_x, *local.shape)).ravel(order="F"))
        values.append(ca.vec(sensitivity[:, inner.tolist()]))
    shape = ((n_runs + inner.size) * n_x, places.n)
    return placed(np.concatenate(rows), np.concatenate(columns), ca.vertcat(*values), shape)


def placed(rows: np.ndarray, columns: np.ndarray, values: ca.MX, shape: tuple[int, int]) -> ca.MX:
    """Make a sparse matrix of values at (row, column); those at the same place are added."""
    keys, inverse = np.unique(columns.astype(int) * shape[0] + rows.astype(int), return_inverse=True)
    sparsity = ca.Sparsity.triplet(shape[0], shape[1], (keys % shape[0]).tolist(), (keys // shape[0]).tolist())
    return ca.sparsity_cast(summed(values, inverse, keys.size), sparsity)


def _hessian(places: _Map, gram: ca.MX, prior: dict[int, ca.MX]) -> ca.MX:
    """Place the Gram matrices (columns of `gram`) of the segments, and the curvature of what was known before."""
    local = places.local
    size = local.shape[0]
    rows = np.tile(local, (size, 1)).ravel(order="F")
    columns = np.repeat(local, size, axis=0).ravel(order="F")
    known = np.array(list(prior), dtype=int)
    damping = 1 + DAMPING * np.eye(size).ravel()
    values = ca.vertcat(ca.vec(gram * ca.repmat(ca.DM(damping), 1, gram.size2())), *prior.values())
    return placed(np.concatenate([rows, known]), np.concatenate([columns, known]), values, (places.n, places.n))
