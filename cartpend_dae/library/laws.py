"""Laws of effects that a model can lack, the same for forces and for torques, and for lengths and for angles.

x is a displacement, v = der(x) a speed; z is a state of unit 1 whose equation is der(z) = rate(...). Levels multiply z
from outside, so that every effect is exactly absent where its level is 0, and linear in it.
"""

import casadi as ca
import numpy as np

# shortest time of a memory [s]: at 5 rad/s it changes nothing where the presliding angle is above 2.5 mrad, and steps
# of 1 ms can follow it
SHORTEST = 0.0005
# a spring that is at rest far beyond so many times the stretch at which it softens is as good as a load; and a
# stiffness [N.m/rad or N/m] that is none
REMOTE, NO_STIFFNESS = 100.0, 1e-9
# a share of the load where a spring hardens that changes nothing
SLIGHT = 1e-4


def stribeck_level(v: ca.SX, level: ca.SX, peak: ca.SX, v_s: ca.SX) -> ca.SX:
    """Return level + (peak - level) exp(-(v/v_s)^2), the level of friction that falls with speed."""
    return level + (peak - level) * ca.exp(-((v / v_s) ** 2))


def breakaway_level(v: ca.SX, level: ca.SX, peak: ca.SX, v_s: ca.SX) -> ca.SX:
    """Return the peak at rest, the level above the speed v_s, and a straight line in between."""
    return level + (peak - level) * ca.fmax(0, 1 - ca.fabs(v) / v_s)


def creep_level(v: ca.SX, level: ca.SX, v_r: ca.SX) -> ca.SX:
    """Return level tanh(|v|/v_r), the level of friction that creeps below the speed v_r and is 0 at rest."""
    return level * ca.tanh(ca.fabs(v) / v_r)


def grown_lag(lag: ca.SX, floor: ca.SX) -> ca.SX:
    """Return a lag [s] that grows from a floor where it is nothing, and is itself to 0.3 % from twice the floor on."""
    r = lag / floor
    return floor * ca.sqrt(r**2 + ca.exp(-(r**2)))


def softened(c: ca.SX, x: ca.SX, preload: ca.SX, k: ca.SX) -> ca.SX:
    """Return the force F/(1 + k (x - x_0)^2)^0.5 of a spring F = c x - preload that softens about its rest position.

    x_0 is preload/c, less by the share k (x_0/100)^2, and 0 where there is no spring: the force has slopes there.
    """
    x_0 = c * preload / (c**2 + k * (preload / REMOTE) ** 2 + NO_STIFFNESS**2)
    return (c * x - preload) / ca.sqrt(1 + k * (x - x_0) ** 2)


def hardened(load: ca.SX) -> ca.SX:
    """Return by which factor a spring that hardens gives way less under a load, 1 without one and to 1e-8 near it.

    The load is y(u) = u + u^3, that of a linear and a cubic spring over the load where both have the same; the factor
    is u/y, by Cardano's formula.
    """
    y = ca.sqrt(load**2 + SLIGHT**2)
    return 2 / (np.sqrt(3) * y) * ca.sinh(ca.asinh(1.5 * np.sqrt(3) * y) / 3)


def not_negative(level: ca.SX) -> ca.SX:
    """Return the level where it is not negative, else 0; at 0 it has the slope of the level."""
    return ca.if_else(level >= 0, level, 0)


def each_way(v: ca.SX, forward: ca.SX, backward: ca.SX) -> ca.SX:
    """Return forward v while v > 0, and backward v while v < 0."""
    return forward * ca.fmax(v, 0) + backward * ca.fmin(v, 0)


def presliding_rate(
    z: ca.SX, v: ca.SX, length: ca.SX, lag: ca.SX, peak: ca.SX | float = 1.0, exponent: ca.SX | float = 1.0
) -> ca.SX:
    """Return v (1 - z sgn v/peak)^exponent / max(length, lag |v|): z goes to peak sgn v.

    Below the speed length/lag it depends on the way alone: z is there after a few lengths, and at rest it stays. Above,
    where that would take less time than `lag`, it takes `lag`; what is gone by then does not show, and fixed steps can
    follow it.

    References
    ----------
    P. R. Dahl, AIAA Journal 14 (1976), 1675-1682, doi:10.2514/3.61511, without lag.
    """
    to_go = 1 - z * ca.sign(v) / peak
    # a power of what may be 0 has no slope there; 1e-6 of the way to go does not show
    slower = (to_go**2 + 1e-12) ** ((exponent - 1) / 2)
    return (v - ca.fabs(v) * z / peak) * slower / ca.fmax(length, lag * ca.fabs(v))


def slipping_rate(z: ca.SX, v: ca.SX, length: ca.SX, lag: ca.SX) -> ca.SX:
    """Return v/length less what z is above 1, or below -1, over `lag`.

    Cut off at 1 and -1, z is the force of a spring that slips. How far it is beyond when the motion turns does not
    matter, as it is back within `lag`.
    """
    return v / length - beyond(z, -1.0, 1.0) / lag


def bouc_wen_rate(z: ca.SX, v: ca.SX, length: ca.SX, lag: ca.SX, beta: ca.SX, n: ca.SX) -> ca.SX:
    """Return (v - (beta |v| z + (1 - beta) v |z|) |z|^(n-1)) / max(length, n lag |v|); -1 < z < 1, lag as above.

    References
    ----------
    Y. K. Wen, J. Eng. Mech. Div. 102 (1976), 249-263, doi:10.1061/JMCEA3.0002106, with A = 1, without lag.
    """
    power = ca.fmax(ca.fabs(z), 1e-9) ** (n - 1)  # at 0 a power has no slope in its exponent
    rate = v - (beta * ca.fabs(v) * z + (1 - beta) * v * ca.fabs(z)) * power
    return rate / ca.fmax(length, n * lag * ca.fabs(v))


def wave(angle: ca.SX, sine: ca.SX, cosine: ca.SX) -> ca.SX:
    """Return sine sin(angle) + cosine cos(angle)."""
    return sine * ca.sin(angle) + cosine * ca.cos(angle)


def contact(depth: ca.SX, speed: ca.SX, c: ca.SX, d_c: ca.SX) -> ca.SX:
    """Return c depth^1.5 (1 + d_c speed) where depth > 0, never pulling; 0 elsewhere.

    References
    ----------
    K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42 (1975), 440-445, doi:10.1115/1.3423596.
    """
    return c * ca.fmax(depth, 0) ** 1.5 * ca.fmax(0, 1 + d_c * speed)


def softer(force: ca.SX, scale: ca.SX) -> ca.SX:
    """Return scale atan(force/scale), a deflection per compliance that grows ever more slowly with the force."""
    return scale * ca.atan(force / scale)


def length_of(x: ca.SX, y: ca.SX) -> ca.SX:
    """Return sqrt(x^2 + y^2), the length of a vector; at 0 it has the slope 0."""
    return ca.sqrt(ca.fmax(x**2 + y**2, 1e-300))


def past_gap(x: ca.SX, width: ca.SX) -> ca.SX:
    """Return by how much x is beyond -1 to 1, with corners that are hyperbolas: half their width at -1 and 1."""
    return x + (length_of(x - 1, width) - length_of(x + 1, width)) / 2


def beyond(x: ca.SX, low: ca.SX | float, high: ca.SX | float) -> ca.SX:
    """Return by how much x is above high, or (negative) below low; 0 in between."""
    return x - ca.fmin(ca.fmax(x, low), high)
