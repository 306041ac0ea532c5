"""Consistent start values: which state starts where, from fixed values, guesses and equations."""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve

from cartpend_dae.errors import SolverError
from cartpend_dae.system import System

Sparse = Any  # a scipy csr_array: scipy ships no types for its slices


@dataclass(frozen=True, slots=True)
class Start:
    """Start of a simulation: states (n_x,), algebraic variables (n_z,)."""

    x: np.ndarray
    z: np.ndarray


@dataclass(frozen=True, slots=True)
class _Conditions:
    """Conditions in order of priority: residuals in (x, z), their ranks 0 (must hold) to 6, and names."""

    residual: ca.SX
    priority: np.ndarray
    names: tuple[str, ...]


def initialize(system: System, p: np.ndarray, u: np.ndarray, start: dict[str, float], time: float = 0.0) -> Start:
    """Find start values that satisfy, in this order: equations, `start`, fixed initial equations, guesses, zero.

    A lower condition is used only where the higher ones leave freedom.

    Parameters
    ----------
    system
        The assembled system.
    p, u
        Parameters (n_p,) and inputs at the start (n_u,), SI units.
    start
        Start values by variable name, SI units; they overrule the model's own.
    time
        Start time [s].

    Raises
    ------
    SolverError
        If two fixed start values contradict each other, or Newton's method fails.
    """
    conditions = _conditions(system, start)
    unknowns = ca.vertcat(system.x, system.z)
    n = unknowns.numel()
    if n == 0:
        return Start(np.zeros(0), np.zeros(0))
    zero_force = ca.SX.zeros(system.frictions.force.numel())
    residual = ca.substitute(conditions.residual, system.frictions.force, zero_force)
    function = ca.Function(
        "conditions",
        [unknowns, system.u, system.p, system.time],
        [residual, ca.jacobian(residual, unknowns)],
    )

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, Sparse]:
        r, j = function(point, u, p, time)
        return np.asarray(r).ravel(), csr_array(j.sparse())

    point = _first_guess(evaluate(np.zeros(n)), conditions.priority)
    chosen = np.zeros(0, dtype=int)
    for _ in range(50):
        r, j = evaluate(point)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(j.data))):
            raise SolverError(
                f"{system.name}: the start equations give no finite numbers at the guess; give start values."
            )
        chosen = _independent(j, n)
        step = _solve(j[chosen], -r[chosen])
        point = point + step
        if np.max(np.abs(step)) <= 1e-13 * max(1.0, float(np.max(np.abs(point)))):
            break
    _check(system, conditions, evaluate(point), chosen)
    return Start(point[: system.x.numel()], point[system.x.numel() :])


def _conditions(system: System, start: dict[str, float]) -> _Conditions:
    residuals = [system.alg, system.invariants]
    priority = [0] * (system.z.numel() + system.invariants.numel())
    names = [*system.algebraics, *system.invariant_origins]
    for name, value in start.items():
        residuals.append(system.outputs[system.index_of(name)] - value)
        priority.append(1)
        names.append(f"start of `{name}`")
    for i, (fixed, origin) in enumerate(zip(system.initials.fixed, system.initials.origins, strict=True)):
        residuals.append(system.initials.residual[i])
        priority.append(2 if fixed else 3)
        names.append(origin)
    algebraics = set(system.algebraics)
    for i, variable in enumerate(system.variables):
        if variable.declaration.start is not None:
            residuals.append(system.outputs[i] - variable.declaration.start)
            # of a variable that equations give, a start value only says which of several solutions is meant
            priority.append(5 if variable.name in algebraics else 3)
            names.append(f"start of `{variable.name}`")
    residuals += [system.x, system.z]
    priority += [4] * system.x.numel() + [6] * system.z.numel()
    names += [*system.states, *system.algebraics]
    order = np.argsort(np.array(priority), kind="stable")
    stacked = ca.vertcat(*residuals)
    return _Conditions(stacked[order.tolist()], np.array(priority)[order], tuple(names[i] for i in order))


def _independent(jacobian: Sparse, n: int) -> np.ndarray:
    """Choose the first n rows that are linearly independent of those before them (sparse elimination)."""
    pivots: dict[int, dict[int, float]] = {}
    chosen = []
    for i in range(jacobian.shape[0]):
        span = slice(jacobian.indptr[i], jacobian.indptr[i + 1])
        row = dict(zip(jacobian.indices[span].tolist(), jacobian.data[span].tolist(), strict=True))
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
        if len(chosen) == n:
            break
    return np.array(chosen, dtype=int)


def _first_guess(at_zero: tuple[np.ndarray, Sparse], priority: np.ndarray) -> np.ndarray:
    """Return the point that start values and guesses name, from which the equations themselves are then solved."""
    residual, jacobian = at_zero
    is_finite = np.isfinite(residual) & np.isfinite(jacobian.sum(axis=1))
    named = np.flatnonzero((priority >= 1) & is_finite)
    rows = named[_independent(csr_array(jacobian[named]), jacobian.shape[1])]
    return _solve(jacobian[rows], -residual[rows])


def _solve(matrix: Sparse, right: np.ndarray) -> np.ndarray:
    solution: Any = spsolve(matrix.tocsc(), right)
    return np.asarray(solution).ravel()


def _check(system: System, conditions: _Conditions, at_end: tuple[np.ndarray, Sparse], chosen: np.ndarray) -> None:
    """Refuse what must hold and does not; a fixed initial equation gives way only to the caller's start values."""
    r, j = at_end
    broken = [i for i in np.flatnonzero((conditions.priority <= 2) & (np.abs(r) > 1e-8 * (1.0 + np.abs(r)))).tolist()]
    overruled = []
    for i in broken:
        weights = _solve(j[chosen].T, j[[i]].toarray().ravel())
        by = chosen[np.abs(weights) > 1e-9 * np.abs(weights).max(initial=1.0)]
        if conditions.priority[i] == 2 and np.any(conditions.priority[by] == 1):
            overruled.append(i)
    broken = [i for i in broken if i not in overruled]
    if not broken:
        return
    bad = "; ".join(f"{conditions.names[i]} misses by {abs(r[i]):.3g}" for i in broken)
    used = ", ".join(conditions.names[i] for i in chosen if conditions.priority[i] <= 2)
    raise SolverError(
        f"{system.name}: the start values contradict each other or the equations: {bad}. "
        f"In use already: {used or 'none'}. Drop one of them."
    )
