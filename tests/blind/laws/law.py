"""What every law can do; a law overrides the few hooks that it needs."""

from typing import TYPE_CHECKING

import numpy as np

from blind.stepping import Array, Moment

if TYPE_CHECKING:
    from blind.plant import Plant


class Law:
    """An effect at a place with parameters `p`, shape (n_sets,) each; it may hold internal states."""

    coordinates: tuple[str, ...] = ()  # that it adds to the mechanism
    drives = False  # it takes the place of the motor's coupling to the chain
    is_implicit = False  # it makes the equation of the current nonlinear
    is_node = False  # it separates the measured angle from the rod
    shifts_time = False  # the voltage is read at other times

    def __init__(self, at: str, p: dict[str, Array]) -> None:
        self.at, self.p = at, p
        self.along = ""

    def join(self, plant: "Plant") -> None:
        """See the plant before the run."""
        self.plant, self.zero = plant, plant.zero
        self.along = plant.coordinate(self.at)

    def begin(self, m: Moment) -> None:
        """Set internal states."""

    def mass(self, mass: Array, index: dict[str, int]) -> None:
        """Add to the mass matrix."""

    def load(self, m: Moment) -> None:
        """Add forces and dry friction."""

    def advance(self, m: Moment, h: Array) -> None:
        """Advance internal states by h, positions and velocities held."""

    def motor(self, m: Moment, ratio: Array, k: Array, R: Array) -> tuple[Array, Array, Array]:
        """Change ratio [rad/m], torque constant and resistance."""
        return ratio, k, R

    def drop(self, m: Moment, i: Array) -> tuple[Array, Array]:
        """Return a further voltage drop in the circuit and its slope."""
        return self.zero, self.zero

    def flux(self, m: Moment, i: Array) -> tuple[Array, Array]:
        """Return the factor of the torque constant and its slope."""
        return self.zero + 1.0, self.zero

    def voltage(self, m: Moment, u: Array) -> Array:
        """Change the voltage before the motor."""
        return u

    def late(self, t: Array) -> Array:
        """Return the time whose voltage arrives at t."""
        return t

    def clock(self, h: Array) -> Array:
        """Change the true length of a step."""
        return h

    def drive(self, m: Moment) -> None:
        """Take the place of the motor (`drives`)."""

    def angle(self, m: Moment) -> Array:
        """Return the measured angle (`is_node`)."""
        return m.x("phi")

    def show(self, m: Moment, shown: dict[str, Array], sample: int) -> dict[str, Array]:
        """Change what the sensors show."""
        return shown


def linear_end(z: Array, target: Array, rate: Array, h: Array) -> Array:
    """Return the exact solution after h of der(z) = rate (target - z)."""
    return target + (z - target) * np.exp(-rate * h)
