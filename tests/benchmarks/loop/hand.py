"""The closed loop by hand: its numbers, and its equations of motion in CasADi and in numpy.

A rod stands on a cart, which a DC motor moves through gears. The motor's voltage is a weighted sum of the six states:
position and speed of the cart, angle and speed of the rod, current, and the integral of the error of position. The
set point of the position is a sine; the rod starts 10 degrees off.

    m v' + S (cos(phi) w' - sin(phi) w^2) + d v = k n i        m all masses, S = m_rod l/2, n the gear ratio
    S cos(phi) v' + J w' + S g sin(phi) + b w = 0              J = m_rod l^2/3
    L i' + R i + k n v = u
"""

from math import pi, radians

STOP, POINTS, EVERY = 60.0, 6001, 10  # s; peers compare every tenth output
MASS_CART, INERTIAL_MASS, DAMPING_RAIL = 4.609, 6.763, 12.0  # kg, kg, N.s/m
MASS_ROD, LENGTH, DAMPING_BEARING, GRAVITY = 0.1719, 0.86, 0.0375, 9.81  # kg, m, N.m.s/rad, m/s2
RESISTANCE, INDUCTANCE, TORQUE_CONSTANT, RATIO = 0.739, 245e-6, 0.170, 84.9  # Ohm, H, N.m/A, rad/m
STROKE, FREQUENCY = 0.1, 0.5  # m, Hz
START = {"phi": pi - radians(10.0)}
STATES = ("s", "v", "phi", "w", "i", "e")
# An LQR for these numbers, rounded; u = -sum of gain times deviation, the rod measured from upright.
GAINS = {"s": -90.9, "v": -82.4, "phi": 258.0, "w": 56.5, "i": 0.071, "e": -31.6}


def rates(time, state, lib):
    """Return the derivatives of s, v, phi, w, i, e; `lib` is casadi, numpy or math."""
    s, v, phi, w, i, e = state
    m, S, J = MASS_CART + INERTIAL_MASS + MASS_ROD, MASS_ROD * LENGTH / 2, MASS_ROD * LENGTH**2 / 3
    sin, cos, kn = lib.sin(phi), lib.cos(phi), TORQUE_CONSTANT * RATIO
    error = s - STROKE * lib.sin(2 * pi * FREQUENCY * time)
    deviations = {"s": error, "v": v, "phi": phi - pi, "w": w, "i": i, "e": e}
    u = -sum(GAINS[name] * value for name, value in deviations.items())
    f = kn * i - DAMPING_RAIL * v + S * sin * w**2
    tau = -DAMPING_BEARING * w - S * GRAVITY * sin
    c = S * cos
    det = m * J - c**2
    return v, (J * f - c * tau) / det, w, (m * tau - c * f) / det, (u - RESISTANCE * i - kn * v) / INDUCTANCE, error


def start():
    """Return the states at the start: all at rest, the rod off upright."""
    return [START.get(name, 0.0) for name in STATES]
