"""Consistent start values: which state starts where, from fixed values, guesses and equations."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.errors import SolverError
from cartpend_dae.system import System


@dataclass(frozen=True, slots=True)
class Start:
    """Start of a simulation: states (n_x,), algebraic variables (n_z,)."""

    x: np.ndarray
    z: np.ndarray


@dataclass(frozen=True, slots=True)
class _Conditions:
    """Conditions in order of priority: residuals in (x, z), their ranks 0 (must hold) to 4, and names."""

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
        [residual, ca.densify(ca.jacobian(residual, unknowns))],
    )

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, j = function(point, u, p, time)
        return np.asarray(r).ravel(), np.asarray(j)

    point = np.zeros(n)
    chosen = np.zeros(0, dtype=int)
    for _ in range(50):
        r, j = evaluate(point)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(j))):
            raise SolverError(
                f"{system.name}: the start equations give no finite numbers at the guess; give start values."
            )
        chosen = _independent(j, n)
        step = np.linalg.solve(j[chosen], -r[chosen])
        point = point + step
        if np.max(np.abs(step)) <= 1e-13 * max(1.0, float(np.max(np.abs(point)))):
            break
    r, _ = evaluate(point)
    _check(system, conditions, r, chosen, bool(start))
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
    for i, variable in enumerate(system.variables):
        if variable.declaration.start is not None:
            residuals.append(system.outputs[i] - variable.declaration.start)
            priority.append(3)
            names.append(f"start of `{variable.name}`")
    residuals += [system.x, system.z]
    priority += [4] * (system.x.numel() + system.z.numel())
    names += [*system.states, *system.algebraics]
    order = np.argsort(np.array(priority), kind="stable")
    stacked = ca.vertcat(*residuals)
    return _Conditions(stacked[order.tolist()], np.array(priority)[order], tuple(names[i] for i in order))


def _independent(jacobian: np.ndarray, n: int) -> np.ndarray:
    """Choose the first n rows that are linearly independent of those before them (Gram-Schmidt)."""
    basis = np.zeros((0, n))
    chosen = []
    for i, row in enumerate(jacobian):
        size = float(np.linalg.norm(row))
        if size == 0.0:
            continue
        rest = row / size
        rest = rest - basis.T @ (basis @ rest)
        rest = rest - basis.T @ (basis @ rest)
        if np.linalg.norm(rest) > 1e-9:
            chosen.append(i)
            basis = np.vstack([basis, rest / np.linalg.norm(rest)])
            if len(chosen) == n:
                break
    return np.array(chosen, dtype=int)


def _check(system: System, conditions: _Conditions, r: np.ndarray, chosen: np.ndarray, overruled: bool) -> None:
    """Refuse what must hold and does not; fixed initial equations may give way to the caller's start values."""
    must = conditions.priority <= (1 if overruled else 2)
    scale = 1e-8 * (1.0 + np.abs(r))
    broken = np.flatnonzero(must & (np.abs(r) > scale))
    if not broken.size:
        return
    bad = "; ".join(f"{conditions.names[i]} misses by {abs(r[i]):.3g}" for i in broken)
    used = ", ".join(conditions.names[i] for i in chosen if conditions.priority[i] <= 2)
    raise SolverError(
        f"{system.name}: the start values contradict each other or the equations: {bad}. "
        f"In use already: {used or 'none'}. Drop one of them."
    )
