"""A sampled controller that swings a pendulum on a cart up and balances it."""

from math import pi

import casadi as ca
import numpy as np
from scipy.linalg import expm, solve_discrete_are

from cartpend_dae import Component, Param, Statements, assign, discrete, if_else, noevent, param, sample, signal, when

M_CART, M_DRIVE, M_ROD, LENGTH, GRAVITY = 4.609, 6.763, 0.1719, 0.86, 9.81
R_MOTOR, K_MOTOR, RATIO, D_RAIL, D_BEARING = 0.739, 0.170, 84.9, 12.0, 0.0375


def balancing_gains(period: float) -> tuple[float, float, float, float]:
    """Return volts per metre, m/s, rad and rad/s of a discrete linear-quadratic regulator about the upright rod.

    The cart is driven through a motor without inductance; the weights allow 0.1 m, 0.5 m/s, 0.1 rad, 0.5 rad/s, 8 V.
    """
    mass, S, J = M_CART + M_DRIVE + M_ROD, M_ROD * LENGTH / 2, M_ROD * LENGTH**2 / 3
    drive = K_MOTOR * RATIO / R_MOTOR
    damping = D_RAIL + drive * K_MOTOR * RATIO
    # mass v' - S w' = drive u - damping v;  J w' - S v' = S g e - d w, with e the angle from upright
    inertia = np.array([[mass, -S], [-S, J]])
    forces = np.array([[0.0, -damping, 0.0, 0.0, drive], [0.0, 0.0, S * GRAVITY, -D_BEARING, 0.0]])
    rates = np.linalg.solve(inertia, forces)
    continuous = np.zeros((5, 5))
    continuous[0, 1] = continuous[2, 3] = 1.0
    continuous[1], continuous[3] = rates
    sampled = expm(continuous * period)
    A, B = sampled[:4, :4], sampled[:4, 4:]
    Q, R = np.diag([1 / 0.1**2, 1 / 0.5**2, 1 / 0.1**2, 1 / 0.5**2]), np.array([[1 / 8.0**2]])
    P = solve_discrete_are(A, B, Q, R)
    gains = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A).ravel()
    return float(gains[0]), float(gains[1]), float(gains[2]), float(gains[3])


class SwingUp(Component):
    """Swings the rod up by energy, catches it near the top and balances it; all at the instants of its clock.

    It sees the positions that the encoders count, and takes speeds from their differences through a low pass.
    """

    s = signal("in", unit="m", default=0.0, doc="position of the cart")
    phi = signal("in", unit="rad", default=0.0, doc="angle of the rod, 0 = hanging")
    u = signal("out", unit="V", doc="control voltage, held between samples")
    period: Param = param(unit="s", default=0.01, min=1e-4, doc="sampling period")
    step_s: Param = param(unit="m", default=0.25e-3, min=0, doc="resolution of the position")
    step_phi: Param = param(unit="rad", default=1e-3, min=0, doc="resolution of the angle")
    reach: Param = param(unit="m", default=0.40, min=0, doc="largest travel asked for while swinging up")
    w_reach: Param = param(unit="rad/s", default=1.5, min=0, doc="angular speed that asks for the whole travel")
    lead: Param = param(unit="s", default=0.15, min=0, doc="time that the cart needs for its travel")
    stiffness: Param = param(unit="1/s2", default=400.0, min=0, doc="acceleration per travel that is missing")
    held = discrete(unit="V", doc="control voltage")
    s_m = discrete(unit="m", doc="last position")
    phi_m = discrete(unit="rad", doc="last angle")
    v_m = discrete(unit="m/s", doc="estimated speed")
    w_m = discrete(unit="rad/s", doc="estimated angular speed")
    balances = discrete(unit="1", doc="1 while it balances, 0 while it swings up")
    has_begun = discrete(unit="1", doc="1 after the first sample")

    def equations(self) -> Statements:
        yield self.u == self.held
        s = ca.floor(self.s / self.step_s + 0.5) * self.step_s
        phi = ca.floor(self.phi / self.step_phi + 0.5) * self.step_phi
        v = self._filtered(self.v_m, s, self.s_m)
        w = self._filtered(self.w_m, phi, self.phi_m)
        e = ca.atan2(ca.sin(phi - pi), ca.cos(phi - pi))
        k = balancing_gains(0.01)
        balance = -(k[0] * s + k[1] * v + k[2] * e + k[3] * w)
        near = ca.logic_and(ca.fabs(e) < 0.30, ca.fabs(w) < 3.0)
        held_on = ca.logic_and(self.balances > 0.5, ca.fabs(e) < 0.6)
        is_up = if_else(noevent(ca.logic_or(near, held_on)), 1.0, 0.0)
        yield when(
            sample(self.period),
            assign(self.held, ca.if_else(is_up > 0.5, balance, self._swing(s, v, phi, w))),
            assign(self.s_m, s),
            assign(self.phi_m, phi),
            assign(self.v_m, v),
            assign(self.w_m, w),
            assign(self.balances, is_up),
            assign(self.has_begun, 1.0),
        )

    def _filtered(self, speed: ca.SX, position: ca.SX, last: ca.SX) -> ca.SX:
        """Return a speed from the difference of two samples, half of it new."""
        return self.has_begun * (0.5 * speed + 0.5 * (position - last) / self.period)

    def _swing(self, s: ca.SX, v: ca.SX, phi: ca.SX, w: ca.SX) -> ca.SX:
        """Return the voltage that raises the energy of the rod to that at rest upright.

        The power of the cart on the rod is -S cos(phi) w a (Astrom and Furuta 2000, doi:10.1016/S0005-1098(99)00140-5).
        The rail is short, so the travel follows w cos(phi), as it soon will be: at the pace of the rod the
        acceleration is opposite to the travel.
        """
        S, J = M_ROD * LENGTH / 2, M_ROD * LENGTH**2 / 3
        energy = 0.5 * J * w**2 - S * GRAVITY * (1 + ca.cos(phi))
        kick = ca.if_else(ca.fabs(w) + ca.fabs(ca.sin(phi)) < 0.1, 1.0, 0.0)
        swing = -(S * GRAVITY * ca.sin(phi) + D_BEARING * w) / J
        soon = w * ca.cos(phi) + self.lead * (swing * ca.cos(phi) - w**2 * ca.sin(phi))
        share = ca.fmin(ca.fmax(soon / self.w_reach + kick, -1.0), 1.0)
        target = ca.if_else(energy < 0.02, self.reach * share, 0.0)
        a = self.stiffness * (target - s) - 1.6 * ca.sqrt(self.stiffness) * v
        force = (M_CART + M_DRIVE) * a + D_RAIL * v
        return R_MOTOR / (K_MOTOR * RATIO) * force + K_MOTOR * RATIO * v
