"""Where the numbers of a model fail, in the words of the model: which equations, of which unknowns, at what time."""

import casadi as ca
import numpy as np

from cartpend_dae.diagnose import listed
from cartpend_dae.system import System

MOST_DENSE = 400
"""So many algebraic variables at most are searched for what determines none of them: a dense matrix."""


def trouble_at(system: System, time: float, x: np.ndarray, z: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
    """Say which equations give no finite number at a point, or do not determine their unknowns; "" if all do.

    Parameters
    ----------
    system
        The assembled system.
    time, x, z, u, p
        The point: time [s], states (n_x,), algebraic variables (n_z,), inputs (n_u,), parameters (n_p,), SI units.
    """
    s = system
    function = ca.Function(
        "values",
        [s.time, s.x, s.z, s.u, s.p, s.frictions.force],
        [s.outputs, s.ode, s.alg, ca.densify(ca.jacobian(s.alg, s.z)) if s.z.numel() <= MOST_DENSE else ca.SX(0, 0)],
    )
    found = function(time, x, z, u, p, np.zeros(s.frictions.force.numel()))
    values, rates, residual, slopes = (np.asarray(value) for value in found)
    bad = {variable.name for variable, v in zip(s.variables, values.ravel(), strict=True) if not np.isfinite(v)}
    bad |= {f"der({name})" for name, v in zip(s.states, rates.ravel(), strict=True) if not np.isfinite(v)}
    left = [origin for block in s.blocks for origin in block.left]
    if bad or not np.all(np.isfinite(residual)):
        return _not_finite(system, bad, [left[i] for i in np.flatnonzero(~np.isfinite(residual.ravel()))])
    return _undetermined(system, left, slopes)


def _not_finite(system: System, bad: set[str], left: list[str]) -> str:
    """Name the first block, in the order of solution, whose unknowns are not finite: the others follow from it."""
    for block in system.blocks:
        names = [name for name in block.unknowns if name in bad]
        if names:
            return f"no finite {_quoted(names)} follows from {listed(block.origins, '; ')}"
    return (
        f"not finite are {_quoted(sorted(bad))}, from {listed(left, '; ')}"
        if bad
        else f"{listed(left, '; ')} is not finite"
    )


def _undetermined(system: System, left: list[str], slopes: np.ndarray) -> str:
    if not slopes.size or not np.all(np.isfinite(slopes)):
        return ""
    free, rows = _support(slopes), _support(slopes.T)
    if not free:
        return ""
    names = [system.algebraics[j] for j in free]
    return f"{_quoted(names)} may have any value: there it has no influence on {listed([left[i] for i in rows], '; ')}"


def _support(matrix: np.ndarray) -> list[int]:
    """Return the columns that may change while the product with the matrix stays zero."""
    scale = np.abs(matrix).max(axis=1)
    _, singular, rows = np.linalg.svd(matrix / np.where(scale > 0, scale, 1.0)[:, None])
    null = rows[singular <= 1e-12 * max(1.0, float(singular[0]))]
    return np.flatnonzero(np.abs(null).max(axis=0, initial=0.0) > 1e-8).tolist()


def _quoted(names: list[str]) -> str:
    return listed([f"`{name}`" for name in names], ", ")
