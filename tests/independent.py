"""Pendulum and cart with dry friction, simulated without the package: data that it did not make itself.

Runge-Kutta of order four at a small fixed step while the sign of the friction holds. A step in which the
speed changes its sign is cut by bisection where the speed is zero; there the body stays for good if friction
can hold it, and else goes on the other way. There is no driving force, so what has come to rest stays at
rest.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Acceleration = Callable[[float, float], float]
SAMPLE = 0.01


def pendulum(
    *,
    duration: float,
    angle: float,
    viscous: float,
    coulomb: float,
    speed: float = 0.0,
    mass: float = 0.1719,
    length: float = 0.86,
    gravity: float = 9.81,
    noise: float = 0.0,
    generator: np.random.Generator | None = None,
    step: float = 1e-4,
) -> tuple[FloatArray, FloatArray]:
    """Return times [s] and angles [rad, 0 = hanging] at 100 Hz of a slender rod in a bearing.

    Parameters
    ----------
    duration
        Length of the run [s].
    angle, speed
        Start [rad, rad/s].
    viscous, coulomb
        Friction of the bearing [N.m.s/rad, N.m].
    mass, length, gravity
        The rod [kg, m] and gravity [m/s2].
    noise
        Standard deviation [rad] of what `generator` adds to each sample.
    step
        Step of the integration [s].
    """
    inertia = mass * length**2 / 3
    weight, damping = mass * gravity * length / 2 / inertia, viscous / inertia
    times, angles = _slide(
        lambda phi, w: -weight * math.sin(phi) - damping * w, coulomb / inertia, angle, speed, duration, step
    )
    return times, _noisy(angles, noise, generator)


def cart_between_springs(
    *,
    duration: float,
    position: float,
    viscous: float,
    coulomb: float,
    speed: float = 0.0,
    mass: float = 4.609 + 6.8,
    stiffness_1: float = 1197.3,
    stiffness_2: float = 1320.1,
    stretch: float = 0.095,
    noise: float = 0.0,
    generator: np.random.Generator | None = None,
    step: float = 1e-4,
) -> tuple[FloatArray, FloatArray]:
    """Return times [s] and positions [m, 0 = both springs stretched alike] at 100 Hz of a cart on a rail.

    Parameters
    ----------
    duration
        Length of the run [s].
    position, speed
        Start [m, m/s].
    viscous, coulomb
        Friction of the rail [N.s/m, N].
    mass, stiffness_1, stiffness_2, stretch
        The cart [kg], the springs on its negative and positive side [N/m], their stretch at position 0 [m].
    noise
        Standard deviation [m] of what `generator` adds to each sample.
    step
        Step of the integration [s].
    """

    def acceleration(s: float, v: float) -> float:
        return (stiffness_2 * (stretch - s) - stiffness_1 * (s + stretch) - viscous * v) / mass

    times, positions = _slide(acceleration, coulomb / mass, position, speed, duration, step)
    return times, _noisy(positions, noise, generator)


def _noisy(values: FloatArray, noise: float, generator: np.random.Generator | None) -> FloatArray:
    return values if generator is None else values + noise * generator.standard_normal(values.size)


def _slide(
    acceleration: Acceleration, level: float, x: float, v: float, duration: float, step: float
) -> tuple[FloatArray, FloatArray]:
    """Solve x'' = acceleration(x, x') - level sgn x' with sticking, and sample x at 100 Hz."""
    n_samples, substeps = round(duration / SAMPLE), math.ceil(SAMPLE / step - 1e-9)
    h = SAMPLE / substeps
    sign = math.copysign(1.0, v) if v else _way_from_rest(acceleration, level, x)
    positions = np.empty(n_samples + 1)
    positions[0] = x
    for k in range(n_samples):
        for _ in range(substeps):
            if sign:
                x, v, sign = _step(acceleration, level, x, v, sign, h)
        positions[k + 1] = x
    return SAMPLE * np.arange(n_samples + 1), positions


def _way_from_rest(acceleration: Acceleration, level: float, x: float) -> float:
    """Return the sign of the motion that starts from rest, 0 if friction holds the body."""
    pull = acceleration(x, 0.0)
    return 0.0 if abs(pull) <= level else math.copysign(1.0, pull)


def _step(
    acceleration: Acceleration, level: float, x: float, v: float, sign: float, h: float
) -> tuple[float, float, float]:
    """Advance by h with the friction of one sign, and from a stop on with the next."""
    friction = sign * level
    x_next, v_next = _runge_kutta(acceleration, friction, x, v, h)
    if v_next * sign >= 0:
        return x_next, v_next, sign
    early, late = 0.0, h
    for _ in range(50):
        middle = (early + late) / 2
        if _runge_kutta(acceleration, friction, x, v, middle)[1] * sign > 0:
            early = middle
        else:
            late = middle
    x_stop, _ = _runge_kutta(acceleration, friction, x, v, late)
    sign = _way_from_rest(acceleration, level, x_stop)
    if not sign:
        return x_stop, 0.0, 0.0
    return *_runge_kutta(acceleration, sign * level, x_stop, 0.0, h - late), sign


def _runge_kutta(acceleration: Acceleration, friction: float, x: float, v: float, h: float) -> tuple[float, float]:
    a_1 = acceleration(x, v) - friction
    v_2 = v + h / 2 * a_1
    a_2 = acceleration(x + h / 2 * v, v_2) - friction
    v_3 = v + h / 2 * a_2
    a_3 = acceleration(x + h / 2 * v_2, v_3) - friction
    v_4 = v + h * a_3
    a_4 = acceleration(x + h * v_3, v_4) - friction
    return x + h / 6 * (v + 2 * v_2 + 2 * v_3 + v_4), v + h / 6 * (a_1 + 2 * a_2 + 2 * a_3 + a_4)
