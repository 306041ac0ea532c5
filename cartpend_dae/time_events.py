"""Relations that time alone decides, such as a step at 0.5 s or a pulse in each second: hit exactly, known before."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from cartpend_dae.along import AllTimes
from cartpend_dae.errors import ModelError
from cartpend_dae.inputs import DrivenInputs
from cartpend_dae.prepared import content, once
from cartpend_dae.system import System

MOST_TIMES = 100_000


def with_time_events(
    system: System, p: np.ndarray, grid: np.ndarray, driven: DrivenInputs
) -> tuple[System, np.ndarray, DrivenInputs]:
    """Make inputs of the relations that depend on nothing that changes but time, and on time by straight pieces.

    Pieces are those of ``floor(x)`` with x linear in time: between two whole numbers x, the relation is linear.

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

    Raises
    ------
    ModelError
        For more than 100000 times.
    """
    timed = once(system, "time events", None, lambda: _timed(system))
    if not timed.relations:
        return system, grid, driven
    fine, rows = once(system, "grid", content(p, grid), lambda: _decided(system, timed, p, grid))
    return timed.system, fine, _refined(driven, grid, fine, rows)


@dataclass(frozen=True, slots=True)
class _Relation:
    """A relation by straight pieces of time: values and slopes of its difference and of the arguments of its floors."""

    difference: AllTimes
    floors: tuple[AllTimes, ...]


@dataclass(frozen=True, slots=True)
class _Timed:
    """The relations of time alone, all that `decide` them, and the system in which they are inputs."""

    relations: tuple[_Relation, ...]
    decide: AllTimes
    system: System


def _timed(system: System) -> _Timed:
    found, s = time_relations(system), system

    def line(expression: ca.SX) -> AllTimes:
        column = ca.vertcat(expression, ca.jacobian(expression, s.time))
        return AllTimes(ca.Function("line", [s.time, s.p], [column]))

    relations = [_Relation(line(s.hybrid.differences[k]), tuple(line(f) for f in fs)) for k, fs in found.items()]
    decide = ca.Function("decide", [s.time, s.p], [s.hybrid.differences[list(found), 0] < 0])
    return _Timed(tuple(relations), AllTimes(decide), _system(s, list(found)) if found else s)


def _decided(system: System, timed: _Timed, p: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a grid with the times at which relations change, and their values over its intervals, a row for each."""
    times = np.concatenate([_crossings(system, relation, p, grid) for relation in timed.relations])
    inside = np.unique(times[(times > grid[0]) & (times < grid[-1])])
    close = 1e-12 * max(1.0, float(np.abs(grid).max()))
    new = inside[np.diff(inside, prepend=-np.inf) > close]
    new = new[np.abs(grid[_nearest(grid, new)] - new) > close]
    fine = np.union1d(grid, new)
    ends = np.concatenate([grid[:1], inside, grid[-1:]])
    pieces = timed.decide([0.5 * (ends[:-1] + ends[1:])[None, :], p], inside.size + 1).T
    return fine, pieces[:, np.searchsorted(inside, 0.5 * (fine[:-1] + fine[1:]))]


def time_relations(system: System) -> dict[int, tuple[ca.SX, ...]]:
    """Return the relations of time alone that are straight by pieces, by number: the arguments of their floors."""
    h = system.hybrid
    if not h.relation_places:
        return {}
    moving = ca.vertcat(system.x, system.z, system.u, system.d, h.symbols, system.frictions.force)
    moves = ca.which_depends(h.differences, moving, 1, True) if moving.numel() else [False] * len(h.relation_places)
    found = {}
    for k, is_moving in enumerate(moves):
        if is_moving:
            continue
        floors: list[ca.SX] = []
        straight = [_without_floors(h.differences[k], floors), *floors]
        if not any(ca.which_depends(ca.vertcat(*straight), system.time, 2, True)):
            found[k] = tuple(floors)
    return found


def _without_floors(expression: ca.SX, floors: list[ca.SX]) -> ca.SX:
    """Return an expression with a symbol for each floor; the arguments of the floors are added to `floors`."""
    if expression.is_leaf():
        return expression
    parts = [_without_floors(expression.dep(i), floors) for i in range(expression.n_dep())]
    if expression.op() == ca.OP_FLOOR:
        floors.append(parts[0])
        return ca.SX.sym("floor")
    return ca.SX.unary(expression.op(), *parts) if len(parts) == 1 else ca.SX.binary(expression.op(), *parts)


def _jumps(system: System, relation: _Relation, p: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return the times from the first to the last of the grid between which a relation is linear in time [s]."""
    times = [np.array([grid[0], grid[-1]])]
    for argument in relation.floors:
        value, slope = argument([grid[None, :1], p], 1)[0].tolist()
        last = value + slope * (grid[-1] - grid[0])
        if abs(last - value) > MOST_TIMES:
            raise ModelError(
                f"{system.name}: a source repeats itself {abs(last - value):.3g} times from {grid[0]:g} s to "
                f"{grid[-1]:g} s, and {MOST_TIMES} at most are told apart: check its period."
            )
        if slope:
            whole = np.arange(np.ceil(min(value, last)), np.floor(max(value, last)) + 1)
            times.append(grid[0] + (whole - value) / slope)
    return np.unique(np.concatenate(times))


def _crossings(system: System, relation: _Relation, p: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return the times at which a relation may change: where it jumps, and where it passes zero in between [s]."""
    jumps = _jumps(system, relation, p, grid)
    middle = 0.5 * (jumps[:-1] + jumps[1:])
    value, slope = relation.difference([middle[None, :], p], middle.size).T
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(slope != 0, middle - value / slope, np.inf)
    inside = times[(times > jumps[:-1]) & (times < jumps[1:]) & np.isfinite(times)]
    return np.concatenate([jumps[1:-1], inside])


def _nearest(grid: np.ndarray, times: np.ndarray) -> np.ndarray:
    right = np.clip(np.searchsorted(grid, times), 1, grid.size - 1)
    return right - (times - grid[right - 1] < grid[right] - times)


def _system(system: System, timed: Sequence[int]) -> System:
    h = system.hybrid
    rest = [k for k in range(len(h.relation_places)) if k not in timed]
    places = tuple(h.relation_places[k] for k in rest)
    hybrid = replace(h, relations=h.relations[rest, 0], differences=h.differences[rest, 0], relation_places=places)
    names = tuple(f"time event {k + 1} ({h.relation_places[k]})" for k in timed)
    return replace(
        system, inputs=(*system.inputs, *names), u=ca.vertcat(system.u, h.relations[timed, 0]), hybrid=hybrid
    )


def _refined(driven: DrivenInputs, grid: np.ndarray, fine: np.ndarray, rows: np.ndarray) -> DrivenInputs:
    """Return inputs over the intervals of a finer grid, with further rows of them."""
    left, slope = driven.left, driven.slope
    if fine.size > grid.size:
        interval = np.clip(np.searchsorted(grid, fine[:-1], side="right") - 1, 0, grid.size - 2)
        slope = slope[:, interval]
        left = left[:, interval] + slope * (fine[:-1] - grid[interval])
    return DrivenInputs(np.vstack([left, rows]), np.vstack([slope, np.zeros_like(rows)]), driven.expressions)
