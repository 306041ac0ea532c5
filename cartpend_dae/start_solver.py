"""Ranked nonlinear equations: the first that are independent, as many as there are unknowns, are solved.

References
----------
P. Deuflhard, Newton Methods for Nonlinear Problems (2004), doi:10.1007/978-3-642-23899-4 (natural monotonicity).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

Sparse = Any  # a scipy csr_array: scipy ships no types for its slices
Factors = Any  # of splu, and None for a singular matrix
Evaluate = Callable[[np.ndarray], tuple[np.ndarray, Sparse]]
NOTHING = np.zeros(0, dtype=int)


@dataclass(frozen=True, slots=True)
class Ranked:
    """Residuals by rank, the strongest first: `evaluate(point) -> (residual, jacobian)`, and the size of unknowns.

    Rows of a rank up to `wanted` must hold, but for those that give way to stronger ones from rank 1 on.
    """

    evaluate: Evaluate
    ranks: np.ndarray
    scale: np.ndarray
    wanted: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """Where a search ended: `chosen` rows were solved, and `broken` ones do not hold though they must."""

    point: np.ndarray
    residual: np.ndarray
    jacobian: Sparse
    chosen: np.ndarray
    broken: np.ndarray
    has_converged: bool

    @property
    def is_solved(self) -> bool:
        """Whether all that must hold does."""
        return self.has_converged and not self.broken.size

    @property
    def is_finite(self) -> bool:
        """Whether the chosen equations have numbers at all."""
        return self.chosen.size == self.point.size


def finite_rows(residual: np.ndarray, jacobian: Sparse) -> np.ndarray:
    """Return which rows hold finite numbers only."""
    is_finite = np.isfinite(residual)
    bad = np.flatnonzero(~np.isfinite(jacobian.data))
    is_finite[np.searchsorted(jacobian.indptr, bad, side="right") - 1] = False
    return is_finite


def independent(jacobian: Sparse, allowed: np.ndarray) -> np.ndarray:
    """Choose, of the allowed rows, each that is linearly independent of those chosen before it, up to square.

    Parameters
    ----------
    jacobian
        Shape (n_rows, n); eliminated row by row, as sparse as it is.
    allowed
        Whether a row may be chosen, shape (n_rows,).
    """
    n = jacobian.shape[1]
    pointers, columns, data = jacobian.indptr.tolist(), jacobian.indices.tolist(), jacobian.data.tolist()
    pivots: dict[int, dict[int, float]] = {}
    chosen = []
    for i in np.flatnonzero(allowed).tolist():
        if len(chosen) == n:
            break
        begin, end = pointers[i], pointers[i + 1]
        if end - begin == 1 and not pivots.get(columns[begin]):  # a value of one unknown: the usual case, made quick
            if columns[begin] not in pivots and data[begin] != 0.0:
                pivots[columns[begin]] = {}
                chosen.append(i)
            continue
        row = dict(zip(columns[begin:end], data[begin:end], strict=True))
        size = max((abs(value) for value in row.values()), default=0.0)
        while (column := next((c for c in row if c in pivots), None)) is not None:
            ratio = row.pop(column)
            for other, value in pivots[column].items():
                row[other] = row.get(other, 0.0) - ratio * value
        row = {column: value for column, value in row.items() if abs(value) > 1e-9 * size}
        if not row:
            continue
        pivot = max(row, key=lambda c: abs(row[c]))
        lead = row.pop(pivot)
        pivots[pivot] = {column: value / lead for column, value in row.items()}
        chosen.append(i)
    return np.array(chosen, dtype=int)


def first_guess(problem: Ranked, base: np.ndarray, from_rank: int) -> np.ndarray:
    """Return the point that the linear rows from a rank on name; what is not linear would lead anywhere from `base`."""
    residual, jacobian = problem.evaluate(base)
    _, other = problem.evaluate(next(shifted(base, problem.scale)))
    is_linear = finite_rows(residual, jacobian)
    bent = np.flatnonzero(jacobian.data != other.data)
    is_linear[np.searchsorted(jacobian.indptr, bent, side="right") - 1] = False
    rows = independent(jacobian, is_linear & (problem.ranks >= from_rank))
    factors = factors_of(jacobian[rows])
    return base if factors is None else base - factors.solve(residual[rows])


def dependence(outcome: Outcome, row: int) -> np.ndarray:
    """Return the chosen rows of which a row is a linear combination."""
    factors = factors_of(outcome.jacobian[outcome.chosen].T)
    line = outcome.jacobian[[row]].toarray().ravel()
    if factors is None or not np.all(np.isfinite(line)):
        return NOTHING
    weights = np.abs(factors.solve(line))
    sizes = weights * np.sqrt(np.asarray(outcome.jacobian[outcome.chosen].power(2).sum(axis=1)).ravel())
    return outcome.chosen[sizes > 1e-9 * sizes.max(initial=1e-300)]


def newton(problem: Ranked, point: np.ndarray, *, most: int = 100) -> Outcome:
    """Solve by Newton's method; a step is shortened until the next one, with the same slopes, is shorter.

    The rows are chosen at the beginning, and again where they become singular or leave a stronger row unsolved.
    """
    residual, jacobian = problem.evaluate(point)
    chosen, last, choices, has_converged = NOTHING, np.inf, 0, not point.size
    n_short = 0
    for _ in range(most if point.size else 0):
        if not chosen.size:
            choices += 1
            chosen = independent(jacobian, finite_rows(residual, jacobian))
        factors = factors_of(jacobian[chosen]) if np.all(np.isfinite(residual[chosen])) else None
        if factors is None:
            if choices > 20 or not _moved(chosen, jacobian, residual):
                break
            chosen = NOTHING
            continue
        step = -factors.solve(residual[chosen])
        size = float(np.max(np.abs(step), initial=0.0)) / max(1.0, float(np.max(np.abs(point), initial=0.0)))
        if size <= 1e-13 or (size <= 1e-9 and size > 0.25 * last):
            point = point + step
            residual, jacobian = problem.evaluate(point)
            again = _better_choice(problem, residual, jacobian, chosen)
            has_converged = again is None
            if again is None or choices > 20:
                break
            chosen, last, choices = again, np.inf, choices + 1
            continue
        moved = _shortened(problem, point, step, factors, chosen)
        if moved is None:
            break
        last, n_short = size, n_short + 1 if np.max(np.abs(moved[0] - point)) < 1e-3 * np.max(np.abs(step)) else 0
        point, residual, jacobian = moved
        if n_short == 4:  # a minimum of the residuals, not a root
            break
    return _outcome(problem, (point, residual, jacobian), chosen, has_converged)


def factors_of(matrix: Sparse) -> Factors:
    """Return the sparse factors of a square matrix, or None if it has none."""
    if matrix.shape[0] != matrix.shape[1] or not matrix.shape[0] or not np.all(np.isfinite(matrix.data)):
        return None
    try:
        return splu(csc_array(matrix))
    except RuntimeError:  # exactly singular
        return None


def _moved(chosen: np.ndarray, jacobian: Sparse, residual: np.ndarray) -> bool:
    """Whether a choice of rows made here differs from the one in use."""
    return not np.array_equal(chosen, independent(jacobian, finite_rows(residual, jacobian)))


def _better_choice(problem: Ranked, residual: np.ndarray, jacobian: Sparse, chosen: np.ndarray) -> np.ndarray | None:
    """Return another choice of rows if a row that must hold does not and is independent here."""
    if not np.any(_unmet(problem, residual, jacobian)):
        return None
    again = independent(jacobian, finite_rows(residual, jacobian))
    if np.array_equal(again, chosen) or not np.any(_unmet(problem, residual, jacobian)[again]):
        return None
    return again


def _unmet(problem: Ranked, residual: np.ndarray, jacobian: Sparse) -> np.ndarray:
    """Return which of the rows that must hold miss by more than rounding leaves."""
    return (problem.ranks <= problem.wanted) & ~_is_small(residual, jacobian)


def _is_small(residual: np.ndarray, jacobian: Sparse) -> np.ndarray:
    sizes = np.asarray(abs(jacobian).sum(axis=1)).ravel()
    return np.abs(residual) <= 1e-8 * (1.0 + np.where(np.isfinite(sizes), 1e-4 * sizes, 0.0))


def is_met(outcome: Outcome) -> np.ndarray:
    """Return which conditions hold where a search ended, shape (n_conditions,)."""
    return _is_small(outcome.residual, outcome.jacobian)


def _shortened(
    problem: Ranked, point: np.ndarray, step: np.ndarray, factors: Factors, chosen: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Sparse] | None:
    weight = 1.0 / np.maximum(np.abs(point), problem.scale)
    size = float(np.max(np.abs(step * weight)))
    share = 1.0
    while share > 1e-6:
        trial = point + share * step
        residual, jacobian = problem.evaluate(trial)
        if np.all(np.isfinite(residual[chosen])) and np.all(np.isfinite(jacobian[chosen].data)):
            following = float(np.max(np.abs(factors.solve(residual[chosen]) * weight)))
            if following <= (1.0 - share / 4) * size or size <= 1e-9:
                return trial, residual, jacobian
        share /= 2
    return None


def _outcome(
    problem: Ranked, at: tuple[np.ndarray, np.ndarray, Sparse], chosen: np.ndarray, has_converged: bool
) -> Outcome:
    point, residual, jacobian = at
    is_square = chosen.size == point.size and bool(np.all(np.isfinite(residual[chosen])))
    outcome = Outcome(point, residual, jacobian, chosen if is_square else NOTHING, NOTHING, has_converged)
    broken = np.flatnonzero(_unmet(problem, residual, jacobian))
    if has_converged:
        ranks = problem.ranks
        broken = np.array(
            [
                i
                for i in broken.tolist()
                if ranks[i] < 2 or not np.any((ranks[by := dependence(outcome, i)] >= 1) & (ranks[by] < ranks[i]))
            ],
            dtype=int,
        )
    return Outcome(point, residual, jacobian, outcome.chosen, broken, has_converged)


def shifted(point: np.ndarray, scale: np.ndarray) -> Iterator[np.ndarray]:
    """Yield points around a guess, nearer ones first, shifted without pattern (by multiples of the golden ratio)."""
    pattern = 0.5 + ((np.arange(point.size) + 1) * 0.6180339887498949 % 1)
    for size in (1e-3, 0.1, 1.0, 10.0):
        for sign in (1.0, -1.0):
            yield point + sign * size * scale * pattern
