"""What goes from sample to sample in linear systems: states with their derivatives, and covariances.

References
----------
R. E. Kalman, J. Basic Eng. 82 (1960), 35-45, doi:10.1115/1.3662552 (the filter, here with the root of what is seen).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from cartpend_dae.calls import called
from cartpend_dae.compiled import compiled

# samples that one call goes through: CasADi takes 0.1 s to make a loop over 1,500 of them
TOGETHER = 128


@np.errstate(over="ignore", invalid="ignore")
def carried_along(transition: np.ndarray, pushes: np.ndarray, begin: Mapping[int, np.ndarray]) -> np.ndarray:
    """Return X (n, n_x, m), X[k + 1] = A[k] X[k] + B[k], and as `begin` has it where a run begins.

    Parameters
    ----------
    transition, pushes
        A (n, n_x, n_x) and B (n, n_x, m).
    begin
        X (n_x, m) by sample.
    """
    found, now = np.empty_like(pushes), np.zeros(pushes.shape[1:])
    for k, (step, push) in enumerate(zip(transition, pushes, strict=True)):
        found[k] = now = begin.get(k, now)
        now = step @ now + push
    return found


@dataclass(frozen=True, slots=True)
class Filter:
    """The Kalman filter of several chains side by side, each under several sets of forces, at each of their samples.

    Parameters
    ----------
    covariance
        Of the states before what is measured there (n, n_sets, n_runs, n_x, n_x).
    gain
        What a residual less its prediction corrects of the states (n, n_sets, n_runs, n_x, n_y).
    step, push
        States at the next sample follow by these from states (n, n_sets, n_runs, n_x, n_x) and residuals (..., n_y).
    root
        The inverse of the root of the covariance of what is seen, lower (n, n_sets, n_runs, n_y, n_y).
    """

    covariance: np.ndarray
    gain: np.ndarray
    step: np.ndarray
    push: np.ndarray
    root: np.ndarray


def filters(
    transition: np.ndarray, pushes: np.ndarray, seen: np.ndarray, keep: np.ndarray, sizes: np.ndarray
) -> Filter:
    """Return the filter of states that Ornstein-Uhlenbeck forces push, seen with noise of size 1.

    Parameters
    ----------
    transition, pushes, seen
        A (n, n_runs, n_own, n_own), B (n, n_runs, n_own, n_d) and C (n, n_runs, n_y, n_own).
    keep
        How much of each force is left at the next sample (n, n_sets, n_runs, n_d).
    sizes
        Standard deviations of forces (n_sets, n_runs, n_d); forces come after a system's own states.
    """
    n, n_sets, n_runs, n_d = keep.shape
    n_own, n_y = transition.shape[2], seen.shape[2]
    n_x = n_own + n_d
    shapes = {"covariance": (n_x, n_x), "gain": (n_x, n_y), "step": (n_x, n_x), "push": (n_x, n_y), "root": (n_y, n_y)}
    ends = np.cumsum([0, *(a * b for a, b in shapes.values())])
    advance, n_calls = _advance(n_own, n_d, n_y), -(-n // TOGETHER)
    known = np.concatenate([part.reshape(n, n_runs, -1) for part in (transition, pushes, seen)], axis=2)
    news = sizes**2 * (1 - keep**2)
    data = np.zeros((n_calls * TOGETHER, known.shape[2] + 2 * n_d))
    found = np.empty((n, n_sets, n_runs, ends[-1]))
    for i in range(n_sets):
        for j in range(n_runs):
            data[:n] = np.hstack([known[:, j], keep[:, i, j], news[:, i, j]])
            covariance = np.diag(np.r_[np.zeros(n_own), sizes[i, j] ** 2]).reshape(-1, 1)
            for first in range(0, n, TOGETHER):
                part = data[first : first + TOGETHER].T
                after, shown = called(advance, {0: covariance, 1: part}, (0, 1))
                covariance = after[:, -1:]
                found[first : first + TOGETHER, i, j] = shown.T[: n - first]
    parts = [
        found[..., a:b].reshape(*found.shape[:3], *shape)
        for a, b, shape in zip(ends[:-1], ends[1:], shapes.values(), strict=True)
    ]
    return Filter(*parts)


@lru_cache(maxsize=64)
def _advance(n_own: int, n_d: int, n_y: int) -> ca.Function:
    """Return (covariance, data) -> (covariances one sample later, what `Filter` has), a column for each sample.

    Matrices are packed row by row.
    """
    n_x = n_own + n_d
    covariance = ca.SX.sym("covariance", n_x * n_x)
    counts = [n_own * n_own, n_own * n_d, n_y * n_own, n_d, n_d]
    data = ca.SX.sym("data", sum(counts))
    a, b, c, keep, news = ca.vertsplit(data, np.cumsum([0, *counts]).tolist())
    p = ca.reshape(covariance, n_x, n_x)
    step = ca.blockcat(_rows(a, n_own), _rows(b, n_own), ca.SX(n_d, n_own), ca.diag(keep))
    seen = ca.horzcat(_rows(c, n_y), ca.SX(n_y, n_d))
    crossed = p @ seen.T
    inverse = _inverse_root(ca.SX.eye(n_y) + seen @ crossed)
    gain_root = crossed @ inverse.T
    gain = gain_root @ inverse
    after = step @ (p - gain_root @ gain_root.T) @ step.T + ca.diag(ca.vertcat(ca.SX(n_own, 1), news))
    push = step @ gain
    lower = ca.tril(after)
    after = lower + ca.tril(after, False).T
    shown = [ca.vec(ca.densify(m).T) for m in (p, gain, step - push @ seen, push, inverse)]
    packed = [ca.vec(ca.densify(after)), ca.vertcat(*shown)]
    one = ca.Function("advance", [covariance, data], packed, {"cse": True})
    # a search goes through millions of samples, in a fifth of the time; the code depends on nothing but the sizes
    return compiled(one.mapaccum(TOGETHER), optimisation="g")


def _rows(packed: ca.SX, n: int) -> ca.SX:
    """Return a matrix of n rows that was packed row by row."""
    return ca.reshape(packed, packed.numel() // n, n).T if n and packed.numel() else ca.SX(n, 0)


def _inverse_root(covariance: ca.SX) -> ca.SX:
    """Return the inverse of the lower Cholesky factor, whose rows are divided one after the other."""
    n = covariance.size1()
    table = ca.horzcat(covariance, ca.SX.eye(n))
    rows: list[ca.SX] = []
    for i in range(n):
        row = table[i, :]
        for above in rows:
            row = row - above[i] * above
        rows.append(row / ca.sqrt(row[i]))
    return ca.vertcat(*rows)[:, n:]
