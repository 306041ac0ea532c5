"""How far an integration comes that fails, and what is wrong there."""

import re

import casadi as ca
import numpy as np

from cartpend_dae.diagnose import listed
from cartpend_dae.integration import Integration
from cartpend_dae.system import System
from cartpend_dae.trouble import trouble_at

_MOST_TRIALS = 8
_PLACE = re.compile(r"\S*\.cpp:\d+: ?")


def breakdown_sentence(system: System, run: Integration, failure: tuple[str, str], u: np.ndarray) -> str:
    """Say how far an integration comes, and what is wrong there.

    Parameters
    ----------
    system, run
        The assembled system, and the integration that failed.
    failure
        CasADi's integrator, and what it said.
    u
        Inputs at the output times, shape (n_u, n).
    """
    plugin, reason = failure
    grid, n_x = run.grid, system.x.numel()
    last, beyond, at = 0, grid.size - 1, (run.x, run.z)
    for _ in range(_MOST_TRIALS):
        middle = (last + beyond) // 2
        if middle == last:
            break
        further = run.point(plugin, middle)
        last, beyond, at = (last, middle, at) if further is None else (middle, beyond, further)
    point = float(grid[last]), at[0][:n_x], at[1], u[:, last], run.p
    what = trouble_at(system, *point) or _sought(system, at[1]) or _fastest(system, *point)
    where = f" At {grid[last]:g} s {what}." if what else ""
    tail = _PLACE.sub("", reason.strip().splitlines()[-1])[:200].rstrip(".") if reason.strip() else "no reason given"
    return (
        f"{system.name}: {plugin} could not integrate from {grid[0]:g} s to {grid[-1]:g} s ({tail}).{where} "
        f"Look for a state that runs away, a division by zero or a discontinuity; try `rtol`, or `method`."
    )


def _sought(system: System, z: np.ndarray) -> str:
    """Name the algebraic variables and the equations that must give them: no integrator takes a step without."""
    if not z.size:
        return ""
    names = listed([f"`{name}` ({value:.6g})" for name, value in zip(system.algebraics, z, strict=True)], ", ")
    left = [origin for block in system.blocks for origin in block.left]
    return f"it looks for {names} in {listed(left, '; ')}"


def _fastest(system: System, time: float, x: np.ndarray, z: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
    """Name the states that change fastest, measured by their size."""
    s = system
    function = ca.Function("rates", [s.time, s.x, s.z, s.u, s.p, s.frictions.force], [s.ode])
    rates = np.asarray(function(time, x, z, u, p, np.zeros(s.frictions.force.numel()))).ravel()
    order = np.argsort(-np.abs(rates) / np.maximum(1.0, np.abs(x)))[:3]
    items = [f"`{s.states[i]}` ({x[i]:.3g}, by {rates[i]:.3g}/s)" for i in order.tolist()]
    return f"these change fastest: {', '.join(items)}" if items else ""
