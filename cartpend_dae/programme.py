"""The nonlinear programme of an estimation for IPOPT, with hand-made sparse derivatives.

Variables are parameters, free start values and the start states of all segments; constraints join the
segments. The Hessian is that of Gauss and Newton, summed from the Gram matrices of the segments.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae.transcribe import Layout, Passes, RunStart


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
    layout: Layout, starts: tuple[RunStart, ...], functions: Passes, options: dict[str, Any] | None = None
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
    g = ca.vertcat(
        *_start_defects(layout, starts, v, nodes), ca.vec(ends[:, _inner(layout)] - _followers(layout, nodes))
    )
    f = ca.sum2(cost)
    _, sensitivity, gram, gradient = slopes
    grad_f = ca.vertcat(ca.sum2(gradient[n_x:, :]), ca.MX.zeros(n_s, 1), ca.vec(gradient[:n_x, :]))
    jac_g = _jacobian(layout, starts, sensitivity, n)
    hessian = _hessian(layout, gram, n, n_p + n_s)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    hooks: dict[str, Any] = {
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
    settings = {
        "ipopt.tol": 1e-7,
        "ipopt.acceptable_tol": 1e-5,
        "ipopt.max_iter": 100,
        "ipopt.mu_strategy": "adaptive",
    }
    solver = ca.nlpsol(
        "fit", "ipopt", {"x": v, "p": parameter, "f": f, "g": g}, hooks | quiet | settings | (options or {})
    )
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
    """Place the sensitivities of the segments into the sparse Jacobian of the constraints.

    Rows are the start defects of the runs, then the joints after the segments that another one follows.
    """
    n_x, n_p = layout.system.x.numel(), len(layout.free)
    n_v = n - n_x * layout.n_segments
    inner, states = np.array(_inner(layout), dtype=int), np.arange(n_x)
    n_runs = len(starts)
    constants: list[tuple[int, int, float]] = []
    position = n_p
    for run, (start, first) in enumerate(zip(starts, layout.first, strict=True)):
        constants += [(run * n_x + i, n_v + first * n_x + i, 1.0) for i in range(n_x)]
        for state, factor, _, free in start.free:
            constants.append((run * n_x + state, position, -free.scale / factor))
            position += 1
    for count, k in enumerate(inner.tolist()):
        constants += [((n_runs + count) * n_x + i, n_v + (k + 1) * n_x + i, -1.0) for i in range(n_x)]
    columns = np.hstack([n_v + inner[:, None] * n_x + states, np.tile(np.arange(n_p), (len(inner), 1))])
    rows = (n_runs + np.arange(len(inner)))[:, None] * n_x + states
    all_rows = np.broadcast_to(rows[:, None, :], (len(inner), n_x + n_p, n_x))
    all_columns = np.broadcast_to(columns[:, :, None], all_rows.shape)
    return _sparse(
        np.concatenate([[c[0] for c in constants], all_rows.ravel()]),
        np.concatenate([[c[1] for c in constants], all_columns.ravel()]),
        ca.vertcat(ca.MX(ca.DM([c[2] for c in constants])), ca.vec(sensitivity[:, inner.tolist()])),
        ((n_runs + len(inner)) * n_x, n),
    )


def _sparse(rows: np.ndarray, columns: np.ndarray, values: ca.MX, shape: tuple[int, int]) -> ca.MX:
    """Make a sparse matrix of values at (row, column), each pair once."""
    order = np.lexsort((rows, columns))
    sparsity = ca.Sparsity.triplet(shape[0], shape[1], rows.astype(int).tolist(), columns.astype(int).tolist())
    return ca.sparsity_cast(values[order.tolist()], sparsity)


def _hessian(layout: Layout, gram: ca.MX, n: int, n_v: int) -> ca.MX:
    """Place the Gram matrices (columns of `gram`): parameters summed over segments, each node by itself."""
    n_x, n_p, m = layout.system.x.numel(), len(layout.free), layout.n_segments
    size = n_x + n_p
    index = np.arange(size * size).reshape(size, size, order="F")
    i, j = np.meshgrid(np.arange(n_p), np.arange(n_p), indexing="ij")
    summed = ca.sum2(gram)[index[n_x + i, n_x + j].ravel().tolist()]
    rows, columns, picks = [i.ravel()], [j.ravel()], []
    local_i, local_j = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    keep = (local_i < n_x) | (local_j < n_x)
    local_i, local_j = local_i[keep], local_j[keep]
    for k in range(m):
        rows.append(_place(local_i, k, n_x, n_v))
        columns.append(_place(local_j, k, n_x, n_v))
        picks.append(k * size * size + index[local_i, local_j])
    values = ca.vertcat(summed, ca.vec(gram)[np.concatenate(picks).tolist()])
    return _sparse(np.concatenate(rows), np.concatenate(columns), values, (n, n))


def _place(local: np.ndarray, segment: int, n_x: int, n_v: int) -> np.ndarray:
    """Return the variables of a segment's own order: its node first, then the parameters."""
    return np.where(local < n_x, n_v + segment * n_x + local, local - n_x)
