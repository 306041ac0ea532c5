"""Time stepping of a mechanism with set-valued friction, for many data sets at once; numpy alone.

A midpoint rule in the manner of Moreau: half a step of the positions, one step of the velocities in which dry
friction is an impulse, half a step of the positions. In each step the friction law is solved exactly for
accelerations that are constant within it, so that a body stops, sticks or turns at the right instant and the rule
stays of second order. A body that sticks has the velocity 0, not a small one.

J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics" (1988), doi:10.1007/978-3-7091-2624-0_1.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SWEEPS = 8


@dataclass(slots=True)
class Levels:
    """Dry friction along a coordinate, shapes (n_sets,): while it slides up or down, and what it holds at rest."""

    up: Array
    down: Array
    hold_up: Array
    hold_down: Array

    def add(self, up: Array, down: Array, hold_up: Array, hold_down: Array) -> None:
        self.up = self.up + up
        self.down = self.down + down
        self.hold_up = self.hold_up + hold_up
        self.hold_down = self.hold_down + hold_down


@dataclass(slots=True)
class Moment:
    """A state of all data sets at one instant: what laws read, and the forces and friction that they add to."""

    t: Array
    q: Array
    v: Array
    u: Array
    i: Array
    force: Array
    index: dict[str, int]
    a: Array
    levels: dict[int, Levels] = field(default_factory=dict)

    def x(self, coordinate: str) -> Array:
        return self.q[self.index[coordinate]]

    def w(self, coordinate: str) -> Array:
        return self.v[self.index[coordinate]]

    def push(self, coordinate: str, force: Array) -> None:
        self.force[self.index[coordinate]] += force

    def rub(self, coordinate: str, up: Array, down: Array, hold_up: Array, hold_down: Array) -> None:
        k = self.index[coordinate]
        if k in self.levels:
            self.levels[k].add(up, down, hold_up, hold_down)
        else:
            self.levels[k] = Levels(up, down, hold_up, hold_down)


def rubbed(v: Array, free: Array, W: Array, h: Array, levels: Levels) -> Array:
    """Return the velocity after a step with dry friction.

    Parameters
    ----------
    v, free
        Velocity before the step, and after it if there were no friction along this coordinate.
    W
        Inverse of the mass that friction feels.
    h
        Step [s].
    levels
        Friction forces.
    """
    a = (free - v) / h
    leaves = np.where(a > W * levels.hold_up, 1.0, np.where(a < -W * levels.hold_down, -1.0, 0.0))
    way = np.where(v == 0, leaves, np.sign(v))
    braking = W * np.where(way > 0, levels.up, levels.down)
    end = free - way * h * braking
    stops = (v != 0) & (end * way < 0)
    deceleration = np.where(stops, braking - way * a, 1.0)
    rest = h - np.abs(v) / deceleration
    onward = rest * (a - leaves * W * np.where(leaves > 0, levels.up, levels.down))
    return np.where(way == 0, 0.0, np.where(stops, np.where(leaves == 0, 0.0, onward), end))


def velocities(v: Array, force: Array, inverse: Array, h: Array, levels: dict[int, Levels]) -> Array:
    """Return the velocities (n, n_sets) after a step, by Gauss-Seidel over the coordinates with dry friction.

    Parameters
    ----------
    v, force
        Velocities before the step and forces, shapes (n, n_sets).
    inverse
        Inverse of the mass matrix, shape (n, n, n_sets).
    h
        Step [s].
    levels
        Friction by coordinate.
    """
    end = v + h * np.einsum("ijb,jb->ib", inverse, force) if v.shape[0] > 1 else v + h * inverse[0] * force
    if not levels:
        return end
    if v.shape[0] == 1:
        return rubbed(v[0], end[0], inverse[0, 0], h, levels[0])[None]
    impulse = {k: np.zeros_like(h) for k in levels}
    exact: dict[int, Array] = {}
    for _ in range(SWEEPS if len(levels) > 1 else 1):
        for k, level in levels.items():
            W = inverse[k, k]
            without = end[k] - W * impulse[k]
            exact[k] = rubbed(v[k], without, W, h, level)
            change = (exact[k] - end[k]) / W
            impulse[k] = impulse[k] + change
            end = end + inverse[:, k] * change
    for k, value in exact.items():
        end[k] = value
    return end


def inverse_of(mass: Array) -> Array:
    """Invert mass matrices of shape (n, n, n_sets)."""
    n = mass.shape[0]
    if n == 1:
        return 1.0 / mass
    if n == 2:
        (a, b), (_, d) = mass
        determinant = a * d - b * b
        return np.array([[d, -b], [-b, a]]) / determinant
    return np.moveaxis(np.linalg.inv(np.moveaxis(mass, 2, 0)), 0, 2)
