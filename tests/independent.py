"""Pendulum, cart and motor with dry friction, simulated without the package: data that it did not make itself.

Runge-Kutta of order four at a small fixed step while the sign of the friction holds. A step in which the
speed changes its sign is cut by bisection where the speed is zero; there the body stays for good if friction
can hold it, and else goes on the other way. Pendulum and cart have no driving force, so what has come to rest
stays at rest; the motor starts again when its current can move it.
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
    quadratic: float = 0.0,
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
    viscous, coulomb, quadratic
        Friction of the bearing [N.m.s/rad, N.m, N.m.s2/rad2].
    mass, length, gravity
        The rod [kg, m] and gravity [m/s2].
    noise
        Standard deviation [rad] of what `generator` adds to each sample.
    step
        Step of the integration [s].
    """
    inertia = mass * length**2 / 3
    weight, damping, drag = mass * gravity * length / 2 / inertia, viscous / inertia, quadratic / inertia
    times, angles = _slide(
        lambda phi, w: -weight * math.sin(phi) - damping * w - drag * abs(w) * w,
        coulomb / inertia,
        angle,
        speed,
        duration,
        step,
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


def dc_motor(
    *,
    voltage: FloatArray,
    resistance: float,
    inductance: float,
    constant: float,
    inertia: float,
    viscous: float,
    coulomb: float,
    sample: float = 5e-4,
    noise: tuple[float, float] = (0.0, 0.0),
    generator: np.random.Generator | None = None,
    step: float = 1e-5,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times [s], currents [A] and speeds [rad/s] of a DC motor that starts at rest without current.

    Parameters
    ----------
    voltage
        What is at the terminals from each sample to the next [V], shape (n,).
    resistance, inductance
        The winding [Ohm, H].
    constant
        Torque per current, and back-EMF per speed [N.m/A].
    inertia, viscous, coulomb
        The rotor and its bearings [kg.m2, N.m.s/rad, N.m].
    sample
        Time between samples [s].
    noise
        Standard deviations of what `generator` adds to currents and speeds [A, rad/s].
    step
        Step of the integration [s].
    """

    def rates(u: float, i: float, w: float, sign: float) -> tuple[float, float]:
        torque = constant * i - viscous * w - sign * coulomb if sign else 0.0
        return (u - resistance * i - constant * w) / inductance, torque / inertia

    substeps = math.ceil(sample / step - 1e-9)
    h = sample / substeps
    i = w = sign = 0.0
    found = np.zeros((len(voltage), 2))
    for k, u in enumerate(voltage.tolist()):
        found[k] = i, w
        for _ in range(substeps):
            i, w, sign = _motor_step(rates, lambda i: _way(constant * i, coulomb), (u, i, w, sign), h)
    current, speed = found.T
    times = sample * np.arange(len(voltage))
    return times, _noisy(current, noise[0], generator), _noisy(speed, noise[1], generator)


def driven_cart(
    *,
    voltage: FloatArray,
    mass: float,
    viscous: float,
    resistance: float = 0.739,
    constant: float = 0.170,
    ratio: float = 84.9,
    rod: float = 0.1719,
    length: float = 0.86,
    bearing: float = 0.0375,
    gravity: float = 9.81,
    step: float = 1e-3,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return times [s], positions [m], angles [rad, 0 = hanging] and currents [A] of the driven rig at 100 Hz.

    Parameters
    ----------
    voltage
        What is at the motor from each sample to the next [V], shape (n,).
    mass, viscous
        All that moves with the cart but the rod, and the friction of the rail [kg, N.s/m].
    resistance, constant, ratio
        The motor [Ohm, N.m/A], and its turning per travel [rad/m].
    rod, length, bearing, gravity
        The rod [kg, m], the friction of its bearing [N.m.s/rad] and gravity [m/s2].
    step
        Step of the integration [s].
    """
    drive, moment, inertia = constant * ratio, rod * length / 2, rod * length**2 / 3

    def rate(u: float, x: FloatArray) -> FloatArray:
        _, v, phi, w = x
        push = drive * (u - drive * v) / resistance - viscous * v + moment * w * w * math.sin(phi)
        turn = -moment * gravity * math.sin(phi) - bearing * w
        coupling = moment * math.cos(phi)
        determinant = (mass + rod) * inertia - coupling**2
        return np.array(
            [
                v,
                (inertia * push - coupling * turn) / determinant,
                w,
                ((mass + rod) * turn - coupling * push) / determinant,
            ]
        )

    substeps = math.ceil(SAMPLE / step - 1e-9)
    h, x = SAMPLE / substeps, np.zeros(4)
    states = np.zeros((len(voltage), 4))
    for k, u in enumerate(voltage.tolist()):
        states[k] = x
        for _ in range(substeps):
            r_1 = rate(u, x)
            r_2 = rate(u, x + h / 2 * r_1)
            r_3 = rate(u, x + h / 2 * r_2)
            x = x + h / 6 * (r_1 + 2 * r_2 + 2 * r_3 + rate(u, x + h * r_3))
    s, v, phi, _ = states.T
    return SAMPLE * np.arange(len(voltage)), s, phi, (voltage - drive * v) / resistance


def _way(push: float, level: float) -> float:
    """Return the sign of the motion into which a force pushes what rests, 0 if friction holds it."""
    return 0.0 if abs(push) <= level else math.copysign(1.0, push)


def _motor_step(
    rates: Callable[[float, float, float, float], tuple[float, float]],
    way: Callable[[float], float],
    now: tuple[float, float, float, float],
    h: float,
) -> tuple[float, float, float]:
    """Advance voltage, current, speed and sign by h; from a stop or a release on, go the way of the current."""
    u, i, w, sign = now
    i_next, w_next = _two_states(rates, u, i, w, sign, h)
    if (sign and w_next * sign >= 0) or (not sign and not way(i_next)):
        return i_next, w_next, sign
    early, late = 0.0, h
    for _ in range(50):
        middle = (early + late) / 2
        i_middle, w_middle = _two_states(rates, u, i, w, sign, middle)
        if (w_middle * sign > 0) if sign else not way(i_middle):
            early = middle
        else:
            late = middle
    i_turn, _ = _two_states(rates, u, i, w, sign, late)
    sign = way(i_turn)
    return *_two_states(rates, u, i_turn, 0.0, sign, h - late), sign


def _two_states(
    rates: Callable[[float, float, float, float], tuple[float, float]],
    u: float,
    i: float,
    w: float,
    sign: float,
    h: float,
) -> tuple[float, float]:
    i_1, w_1 = rates(u, i, w, sign)
    i_2, w_2 = rates(u, i + h / 2 * i_1, w + h / 2 * w_1, sign)
    i_3, w_3 = rates(u, i + h / 2 * i_2, w + h / 2 * w_2, sign)
    i_4, w_4 = rates(u, i + h * i_3, w + h * w_3, sign)
    return i + h / 6 * (i_1 + 2 * i_2 + 2 * i_3 + i_4), w + h / 6 * (w_1 + 2 * w_2 + 2 * w_3 + w_4)


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
