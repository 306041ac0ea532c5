"""Integration of right-hand sides that only Python can call, with events located between steps; scipy's LSODA steps.

What CasADi cannot see, the inside of an FMU, it cannot integrate with its events. Here a plant is asked for rates and
indicators, one point at a time.
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.integrate import LSODA

from cartpend_dae.errors import SolverError

# an event is located to this part of the time
RESOLUTION = 1e-14
# largest step as part of the whole time: two crossings within one step would go unseen
SHARE = 1 / 200
# so many events at one instant, told by this part of the whole time, end the run
CROWD, INSTANT = 500, 1e-10


class EndedByModel(Exception):
    """The plant asks for the end of the run: no failure."""


class Plant(Protocol):
    """What is integrated: continuous states (n_x,) between events."""

    name: str
    n_falling: int
    """So many indicators, the first ones, count only where they fall through zero; the others in both directions."""

    def rates(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return the derivatives (n_x,)."""
        ...

    def indicators(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return what changes its sign at an event (n_z,)."""
        ...

    def next_time(self) -> float:
        """Return when the next event is that time decides [s]."""
        ...

    def completed(self, time: float, x: np.ndarray) -> bool:
        """Take note of a finished step; return whether an event follows from it."""
        ...

    def event(self, time: float, x: np.ndarray) -> np.ndarray:
        """Decide at an event, and return the states after it."""
        ...

    def observe(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return a row of the result."""
        ...


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Relative tolerance, and absolute ones (n_x,)."""

    relative: float
    absolute: np.ndarray


class _Record:
    """Rows of the result at the output times."""

    def __init__(self, plant: Plant, grid: np.ndarray) -> None:
        self._plant, self._grid, self._next = plant, grid, 0
        self.rows: list[np.ndarray] = []

    def until(self, time: float, state: Callable[[float], np.ndarray], *, is_end: bool = False) -> None:
        """Record the output times before a time, at the end that time too."""
        while self._next < self._grid.size and (self._grid[self._next] < time or is_end):
            at = float(self._grid[self._next])
            self.rows.append(self._plant.observe(at, state(at)))
            self._next += 1


def march(plant: Plant, x: np.ndarray, grid: np.ndarray, tolerance: Tolerance) -> tuple[np.ndarray, int]:
    """Integrate over a grid of output times.

    Parameters
    ----------
    plant
        What is integrated, at its start.
    x
        States at the start (n_x,).
    grid
        Output times (n,) [s].
    tolerance
        Of the integration.

    Returns
    -------
    tuple
        The observed rows (n, n_columns), those at an event after it, and the number of events. Rows are missing at
        the end if the plant asked for the end before.

    Raises
    ------
    SolverError
        If the integration fails, or events follow each other without end.
    """
    time, end = float(grid[0]), float(grid[-1])
    record, n_events, crowd = _Record(plant, grid), 0, 0
    last = -math.inf
    try:
        while time < end:
            time, x, is_event = _smooth(plant, time, x, end, record, tolerance)
            if is_event:
                crowd = crowd + 1 if time - last <= INSTANT * (end - grid[0]) else 0
                if crowd > CROWD:
                    raise SolverError(f"{plant.name}: events follow each other without end at {time:.6g} s.")
                x, last, n_events = plant.event(time, x), time, n_events + 1
        if plant.next_time() <= end + RESOLUTION * max(1.0, abs(end)):
            x, n_events = plant.event(end, x), n_events + 1
        record.until(end, lambda _: x, is_end=True)
    except EndedByModel:
        pass
    return np.array(record.rows), n_events


def _smooth(
    plant: Plant, time: float, x: np.ndarray, end: float, record: _Record, tolerance: Tolerance
) -> tuple[float, np.ndarray, bool]:
    """Integrate up to the next event, or to the end; return time, states before the event, and whether it is one."""
    bound = min(plant.next_time(), end)
    if bound <= time:
        return time, x, True
    padded = x if x.size else np.zeros(1)

    def real(state: np.ndarray) -> np.ndarray:
        return state[: x.size]

    def rates(at: float, state: np.ndarray) -> np.ndarray:
        found = plant.rates(at, real(state))
        return found if x.size else np.zeros(1)

    width = (record._grid[-1] - record._grid[0]) * SHARE
    absolute: Any = tolerance.absolute if x.size else 1.0
    solver = LSODA(rates, time, padded, bound, max_step=width, rtol=tolerance.relative, atol=absolute)
    watch = _Watch(plant, plant.indicators(time, x) > 0)
    while solver.status == "running":
        before = solver.t
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            message = solver.step()
        if solver.status == "failed" or not np.all(np.isfinite(solver.y)):
            raise SolverError(f"{plant.name}: the integration stops at {before:.6g} s: {message or 'not finite'}.")
        dense = solver.dense_output()
        crossed = _crossed(watch, dense, before, solver.t, real)
        if crossed is not None:
            at = _located(watch, dense, before, crossed, real)
            record.until(at, lambda t, d=dense: real(d(t)))
            return at, real(dense(at)), True
        is_last = solver.status == "finished"
        record.until(solver.t, lambda t, d=dense: real(d(t)))
        now = real(solver.y)
        watch.rise()
        if plant.completed(solver.t, now) or (is_last and bound < end):
            return solver.t, now, True
    return bound, real(solver.y), False


class _Watch:
    """The signs of indicators since the last event."""

    def __init__(self, plant: Plant, signs: np.ndarray) -> None:
        self._plant, self.signs, self._last = plant, signs, signs
        self._falls = np.arange(signs.size) < plant.n_falling

    def is_crossed(self, time: float, x: np.ndarray) -> bool:
        """Whether an indicator has another sign than before."""
        signs = self._last = self._plant.indicators(time, x) > 0
        return bool(np.any(np.where(self._falls, self.signs & ~signs, self.signs != signs)))

    def rise(self) -> None:
        """Take note of what has risen above zero, as it was seen last, and may fall."""
        self.signs = np.where(self._falls, self.signs | self._last, self.signs)


def _crossed(
    watch: _Watch,
    dense: Callable[[float], np.ndarray],
    before: float,
    after: float,
    real: Callable[[np.ndarray], np.ndarray],
) -> float | None:
    """Return a time of a step at which an indicator has another sign, None where none is seen."""
    if not watch.signs.size:
        return None
    for at in (0.5 * (before + after), after):
        if watch.is_crossed(at, real(dense(at))):
            return at
    return None


def _located(
    watch: _Watch,
    dense: Callable[[float], np.ndarray],
    low: float,
    high: float,
    real: Callable[[np.ndarray], np.ndarray],
) -> float:
    """Return the first time at which a sign has changed, by bisection."""
    while high - low > RESOLUTION * max(1.0, abs(high)):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if watch.is_crossed(middle, real(dense(middle))):
            high = middle
        else:
            low = middle
    return high
