"""Where Newton's method fails, ways to a point from which it does not: steps in time, and a path of solutions.

References
----------
C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35 (1998), 508-523, doi:10.1137/S0036142996304796 (implicit Euler).
E. L. Allgower, K. Georg, Numerical Continuation Methods (1990), doi:10.1007/978-3-642-61257-2 (the path).
"""

import numpy as np
from scipy.sparse import csr_array, diags_array, hstack, vstack

from cartpend_dae.start_solver import Evaluate, Factors, Ranked, Sparse, factors_of, finite_rows, independent, newton


def relaxed(problem: Ranked, point: np.ndarray, rates: np.ndarray, others: np.ndarray) -> np.ndarray | None:
    """Step towards a rest by implicit Euler with growing steps; return where it ends.

    Parameters
    ----------
    problem
        Its rows `rates` are the derivatives of the first unknowns, and `others` give the unknowns after those.
    point
        The beginning.
    """
    n_x, n = rates.size, rates.size + others.size
    residual, _ = problem.evaluate(point)
    if not np.all(np.isfinite(residual[rates])):
        return None
    fastest = float(np.max(np.abs(residual[rates]) / np.maximum(np.abs(point[:n_x]), problem.scale[:n_x]), initial=0.0))
    width = 0.1 / max(fastest, 1e-6)
    shift = diags_array(np.concatenate([np.ones(n_x), np.zeros(n - n_x)]))
    rows = np.concatenate([rates, others])

    def implicit(begin: np.ndarray, h: float) -> Evaluate:
        def evaluate(part: np.ndarray) -> tuple[np.ndarray, Sparse]:
            r, j = problem.evaluate(np.concatenate([part, point[n:]]))
            value = r[rows] * np.where(np.arange(n) < n_x, -h, 1.0)
            value[:n_x] += part[:n_x] - begin[:n_x]
            factor = diags_array(np.where(np.arange(n) < n_x, -h, 1.0))
            return value, csr_array(shift + factor @ j[rows][:, :n])

        return evaluate

    part = point[:n]
    for _ in range(80):
        stage = Ranked(implicit(part, width), np.zeros(n, dtype=int), problem.scale[:n], 0)
        found = newton(stage, part, most=8)
        if not found.is_solved:
            width /= 4
            if width < 1e-12:
                return None
            continue
        moved = float(np.max(np.abs(found.point - part) / np.maximum(np.abs(part), problem.scale[:n]), initial=0.0))
        part = found.point
        if width > 1e9 or (moved < 1e-10 and width > 1e3):
            break
        width *= 1.5 if moved > 0.5 else 3.0
    return np.concatenate([part, point[n:]])


def followed(problem: Ranked, point: np.ndarray, direction: float) -> np.ndarray | None:
    """Follow the path r(v) = (1 - s) r(v_0) by arc length from s = 0; return where it meets s = 1."""
    first, jacobian = problem.evaluate(point)
    chosen = independent(jacobian, finite_rows(first, jacobian))
    n, begin = point.size, first[chosen]
    if chosen.size != n or not np.all(np.isfinite(begin)):
        return None
    scale = np.append(np.maximum(np.abs(point), problem.scale), 1.0)
    at, tangent, width = np.append(point, 0.0), np.append(np.zeros(n), direction), 0.1
    for _ in range(100):
        found = _tangent(problem, at, chosen, begin, tangent / scale**2)
        if found is None:
            return None
        following = found / np.linalg.norm(found / scale)
        # the step brings the path near s = 1, where Newton's method takes over
        step = width if following[n] <= 0 else min(width, (1.0 - at[n]) / following[n])
        corrected = _corrected(problem, at + step * following, chosen, begin, following / scale**2)
        if corrected is None:
            width /= 4
            if width < 1e-6:
                return None
            continue
        at, tangent, width = corrected, following, width * 2
        if at[n] > 1.0 - 1e-6:
            return at[:n]
    return None


def _bordered(jacobian: Sparse, begin: np.ndarray, row: np.ndarray) -> Factors:
    return factors_of(csr_array(vstack([hstack([jacobian, csr_array(begin[:, None])]), csr_array(row[None, :])])))


def _tangent(
    problem: Ranked, at: np.ndarray, chosen: np.ndarray, begin: np.ndarray, row: np.ndarray
) -> np.ndarray | None:
    _, jacobian = problem.evaluate(at[:-1])
    factors = _bordered(jacobian[chosen], begin, row)
    return None if factors is None else factors.solve(np.append(np.zeros(begin.size), 1.0))


def _corrected(
    problem: Ranked, at: np.ndarray, chosen: np.ndarray, begin: np.ndarray, row: np.ndarray
) -> np.ndarray | None:
    """Return to the path, at right angles to the tangent; None if four steps do not suffice."""
    last = np.inf
    for _ in range(5):
        residual, jacobian = problem.evaluate(at[:-1])
        value = residual[chosen] - (1.0 - at[-1]) * begin
        factors = _bordered(jacobian[chosen], begin, row) if np.all(np.isfinite(value)) else None
        if factors is None:
            return None
        step = factors.solve(np.append(value, 0.0))
        at = at - step
        size = float(np.linalg.norm(step[:-1] / np.maximum(np.abs(at[:-1]), problem.scale)))
        if size < 1e-8:
            return at
        if size > 0.5 * last:
            return None
        last = size
    return None
