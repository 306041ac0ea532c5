"""Relations that time alone decides, such as a step at 0.5 s: known before the run, and hit exactly."""

from dataclasses import replace

import casadi as ca
import numpy as np

from cartpend_dae.inputs import DrivenInputs
from cartpend_dae.system import System


def with_time_events(
    system: System, p: np.ndarray, grid: np.ndarray, driven: DrivenInputs
) -> tuple[System, np.ndarray, DrivenInputs]:
    """Make inputs of the relations that are linear in time and depend on nothing else that changes.

    Parameters
    ----------
    system, p
        The system and its parameters (n_p,).
    grid
        Times of the run (n,) [s].
    driven
        Inputs over its intervals.

    Returns
    -------
    tuple
        The system with these relations as further inputs, the grid with their times, and all inputs over it.
    """
    h = system.hybrid
    timed = _decided_by_time(system)
    if not timed:
        return system, grid, driven
    chosen = h.differences[timed, 0]
    function = ca.Function("times", [system.time, system.p], [chosen, ca.jacobian(chosen, system.time)])
    value, slope = (np.asarray(part).ravel() for part in function(grid[0], p))
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(slope != 0, grid[0] - value / slope, np.inf)
    inside = times[(times > grid[0]) & (times < grid[-1]) & np.isfinite(times)]
    close = 1e-12 * max(1.0, float(np.abs(grid).max()))
    new = [t for t in np.unique(inside) if np.abs(grid - t).min() > close]
    fine = np.union1d(grid, new)
    middle = 0.5 * (fine[:-1] + fine[1:])
    rows = (value[:, None] + slope[:, None] * (middle - grid[0])[None, :] < 0).astype(float)
    return _system(system, timed), fine, _refined(driven, grid, fine, rows)


def _decided_by_time(system: System) -> list[int]:
    h = system.hybrid
    if not h.relation_places:
        return []
    moving = ca.vertcat(system.x, system.z, system.u, system.d, h.symbols, system.frictions.force)
    moves = ca.which_depends(h.differences, moving, 1, True) if moving.numel() else [False] * len(h.relation_places)
    bent = ca.which_depends(h.differences, system.time, 2, True)
    return [k for k in range(len(h.relation_places)) if not moves[k] and not bent[k]]


def _system(system: System, timed: list[int]) -> System:
    h = system.hybrid
    rest = [k for k in range(len(h.relation_places)) if k not in timed]
    places = tuple(h.relation_places[k] for k in rest)
    hybrid = replace(h, relations=h.relations[rest, 0], differences=h.differences[rest, 0], relation_places=places)
    names = tuple(f"time event {k + 1} ({h.relation_places[k]})" for k in timed)
    return replace(
        system, inputs=(*system.inputs, *names), u=ca.vertcat(system.u, h.relations[timed, 0]), hybrid=hybrid
    )


def _refined(driven: DrivenInputs, grid: np.ndarray, fine: np.ndarray, rows: np.ndarray) -> DrivenInputs:
    interval = np.clip(np.searchsorted(grid, fine[:-1], side="right") - 1, 0, grid.size - 2)
    slope = driven.slope[:, interval]
    left = driven.left[:, interval] + slope * (fine[:-1] - grid[interval])
    return DrivenInputs(np.vstack([left, rows]), np.vstack([slope, np.zeros_like(rows)]), driven.expressions)
