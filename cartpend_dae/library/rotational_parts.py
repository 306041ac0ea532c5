"""Rotation: the wheel, the planetary gear, play, wanted states, and sensors beyond angle, speed and torque."""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, param, port, signal, var
from cartpend_dae.library import translational
from cartpend_dae.library.rotational import CompliantWithSpeed, Flange, Rigid
from cartpend_dae.switching import if_else


class IdealRollingWheel(Component):
    """Wheel that rolls without slip or loss, s = radius phi, tau + radius f = 0, both against its housings.

    The housings are the ground, unless `use_support_R` or `use_support_T` is True: then `support_R` or
    `support_T` must be connected.
    """

    flange_R = port(Flange, doc="shaft of the wheel")
    flange_T = port(translational.Flange, doc="what the wheel moves")
    support_R = port(Flange, doc="housing of the shaft, if use_support_R is True")
    support_T = port(translational.Flange, doc="ground of the motion, if use_support_T is True")
    use_support_R: bool = False
    use_support_T: bool = False
    radius: Param = param(unit="m", doc="radius of the wheel")

    def equations(self) -> Statements:
        phi, s = self.flange_R.phi, self.flange_T.s
        yield self.flange_R.tau + self.radius * self.flange_T.f == 0
        if self.use_support_R:
            phi = phi - self.support_R.phi
            yield self.flange_R.tau + self.support_R.tau == 0
        else:
            yield self.support_R.phi == 0
        if self.use_support_T:
            s = s - self.support_T.s
            yield self.flange_T.f + self.support_T.f == 0
        else:
            yield self.support_T.s == 0
        yield s == self.radius * phi


class IdealPlanetary(Component):
    """Planetary gear, (1 + ratio) phi_carrier = phi_sun + ratio phi_ring, without loss or inertia.

    tau_ring = ratio tau_sun, tau_carrier = -(1 + ratio) tau_sun.
    """

    sun = port(Flange, doc="shaft of the sun wheel")
    carrier = port(Flange, doc="shaft of the planet carrier")
    ring = port(Flange, doc="shaft of the ring wheel")
    ratio: Param = param(unit="1", min=0, doc="teeth of the ring per teeth of the sun")

    def equations(self) -> Statements:
        yield (1 + self.ratio) * self.carrier.phi == self.sun.phi + self.ratio * self.ring.phi
        yield self.ring.tau == self.ratio * self.sun.tau
        yield self.carrier.tau == -(1 + self.ratio) * self.sun.tau


class RelativeStates(Component):
    """Asks for the relative angle and speed as states, phi_rel = phi_b - phi_a, w_rel = der(phi_rel); no torque."""

    flange_a = port(Flange, doc="left shaft end")
    flange_b = port(Flange, doc="right shaft end")
    phi_rel = var(unit="rad", state_select="prefer", doc="angle of flange b against flange a")
    w_rel = var(unit="rad/s", state_select="prefer", doc="speed of flange b against flange a")
    a_rel = var(unit="rad/s2", doc="acceleration of flange b against flange a")

    def equations(self) -> Statements:
        yield self.phi_rel == self.flange_b.phi - self.flange_a.phi
        yield self.w_rel == der(self.phi_rel)
        yield self.a_rel == der(self.w_rel)
        yield self.flange_a.tau == 0
        yield self.flange_b.tau == 0


class AccelerationSensor(Component):
    """Ideal acceleration sensor, a = der(der(phi)), without load."""

    flange = port(Flange, doc="the measured shaft end")
    w = var(unit="rad/s", doc="speed of the shaft end")
    a = signal("out", unit="rad/s2", doc="measured acceleration")

    def equations(self) -> Statements:
        yield self.w == der(self.flange.phi)
        yield self.a == der(self.w)
        yield self.flange.tau == 0


class RelativeAngleSensor(Component):
    """Ideal sensor of the angle between two shafts, phi_rel = phi_b - phi_a, without load."""

    flange_a = port(Flange, doc="left shaft end")
    flange_b = port(Flange, doc="right shaft end")
    phi_rel = signal("out", unit="rad", doc="measured angle of flange b against flange a")

    def equations(self) -> Statements:
        yield self.phi_rel == self.flange_b.phi - self.flange_a.phi
        yield self.flange_a.tau == 0
        yield self.flange_b.tau == 0


class RelativeSpeedSensor(Component):
    """Ideal sensor of the speed between two shafts, w_rel = der(phi_b - phi_a), without load."""

    flange_a = port(Flange, doc="left shaft end")
    flange_b = port(Flange, doc="right shaft end")
    w_rel = signal("out", unit="rad/s", doc="measured speed of flange b against flange a")

    def equations(self) -> Statements:
        yield self.w_rel == der(self.flange_b.phi - self.flange_a.phi)
        yield self.flange_a.tau == 0
        yield self.flange_b.tau == 0


class PowerSensor(Rigid):
    """Ideal power sensor in a rigid shaft, power = tau_a der(phi), tau_a + tau_b = 0."""

    power = signal("out", unit="W", doc="power that passes from flange a to flange b")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.flange_a.tau + self.flange_b.tau == 0
        yield self.power == self.flange_a.tau * der(self.phi)


def backlash(rel: ca.SX, spring_slope: ca.SX, damping: ca.SX, half: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the spring's effort outside the gap of +-half, and the damper's where there is contact."""
    spring = spring_slope * (ca.fmax(rel - half, 0) + ca.fmin(rel + half, 0))
    return spring, ca.if_else(ca.fabs(rel) > half, damping, 0)


class ElastoBacklash(CompliantWithSpeed):
    """Spring and damper with play b: tau = c (x -+ b/2) + d w_rel for |x| > b/2, and 0 within; x = phi_rel - phi_rel0.

    The sides only push, tau x >= 0, and the damper's torque is at most as large as the spring's, so that the torque
    does not jump at a contact.
    """

    c: Param = param(unit="N.m/rad", min=0, doc="stiffness")
    d: Param = param(unit="N.m.s/rad", min=0, doc="damping")
    b: Param = param(unit="rad", default=0.0, min=0, doc="total play")
    phi_rel0: Param = param(unit="rad", default=0.0, doc="angle in the middle of the play")

    def equations(self) -> Statements:
        yield from super().equations()
        spring, damper = backlash(self.phi_rel - self.phi_rel0, self.c, self.d * self.w_rel, self.b / 2)
        size = ca.fabs(spring)
        yield self.tau == spring + ca.fmin(ca.fmax(damper, -size), size)


class ElastoBacklash2(CompliantWithSpeed):
    """Spring and damper with play b, tau = c (x -+ b/2) + d w_rel for |x| > b/2, and 0 within; x = phi_rel - phi_rel0.

    The sides only push, tau x >= 0; the damper acts in full from the contact on, an event, where the torque jumps.
    """

    c: Param = param(unit="N.m/rad", min=0, doc="stiffness")
    d: Param = param(unit="N.m.s/rad", min=0, doc="damping")
    b: Param = param(unit="rad", default=0.0, min=0, doc="total play")
    phi_rel0: Param = param(unit="rad", default=0.0, doc="angle in the middle of the play")

    def equations(self) -> Statements:
        yield from super().equations()
        x, damper, half = self.phi_rel - self.phi_rel0, self.d * self.w_rel, self.b / 2
        forward, backward = self.c * (x - half) + damper, self.c * (x + half) + damper
        pushed_back = if_else(x < -half, ca.fmin(backward, 0), 0)
        yield self.tau == if_else(x > half, ca.fmax(forward, 0), pushed_back)
