"""Translation: contact, wanted states, and sensors beyond position, speed and force."""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, param, port, signal, var
from cartpend_dae.library.translational import CompliantWithSpeed, Flange, Rigid


class RelativeStates(Component):
    """Asks for the relative position and speed as states, s_rel = s_b - s_a, v_rel = der(s_rel); no force."""

    flange_a = port(Flange, doc="left point")
    flange_b = port(Flange, doc="right point")
    s_rel = var(unit="m", state_select="prefer", doc="position of flange b against flange a")
    v_rel = var(unit="m/s", state_select="prefer", doc="speed of flange b against flange a")
    a_rel = var(unit="m/s2", doc="acceleration of flange b against flange a")

    def equations(self) -> Statements:
        yield self.s_rel == self.flange_b.s - self.flange_a.s
        yield self.v_rel == der(self.s_rel)
        yield self.a_rel == der(self.v_rel)
        yield self.flange_a.f == 0
        yield self.flange_b.f == 0


class AccelerationSensor(Component):
    """Ideal acceleration sensor, a = der(der(s)), without load."""

    flange = port(Flange, doc="the measured point")
    v = var(unit="m/s", doc="speed of the point")
    a = signal("out", unit="m/s2", doc="measured acceleration")

    def equations(self) -> Statements:
        yield self.v == der(self.flange.s)
        yield self.a == der(self.v)
        yield self.flange.f == 0


class RelativePositionSensor(Component):
    """Ideal sensor of the distance of two points, s_rel = s_b - s_a, without load."""

    flange_a = port(Flange, doc="left point")
    flange_b = port(Flange, doc="right point")
    s_rel = signal("out", unit="m", doc="measured position of flange b against flange a")

    def equations(self) -> Statements:
        yield self.s_rel == self.flange_b.s - self.flange_a.s
        yield self.flange_a.f == 0
        yield self.flange_b.f == 0


class RelativeSpeedSensor(Component):
    """Ideal sensor of the speed between two points, v_rel = der(s_b - s_a), without load."""

    flange_a = port(Flange, doc="left point")
    flange_b = port(Flange, doc="right point")
    v_rel = signal("out", unit="m/s", doc="measured speed of flange b against flange a")

    def equations(self) -> Statements:
        yield self.v_rel == der(self.flange_b.s - self.flange_a.s)
        yield self.flange_a.f == 0
        yield self.flange_b.f == 0


class PowerSensor(Rigid):
    """Ideal power sensor in a rigid joint, power = f_a der(s), f_a + f_b = 0."""

    power = signal("out", unit="W", doc="power that passes from flange a to flange b")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.flange_a.f + self.flange_b.f == 0
        yield self.power == self.flange_a.f * der(self.s)


class ElastoGap(CompliantWithSpeed):
    """One-sided contact, f = -c s_ref (x/s_ref)^n + d v_rel, x = s_rel0 - s_rel > 0, and f = 0 where the gap is open.

    The sides only push, and the damper's force is at most as large as the spring's.
    """

    c: Param = param(unit="N/m", min=0, doc="stiffness; for n other than 1 the mean one up to s_ref")
    d: Param = param(unit="N.s/m", min=0, doc="damping")
    n: Param = param(unit="1", default=1.0, min=0, doc="exponent of the spring")
    s_rel0: Param = param(unit="m", default=0.0, doc="relative position at which the contact closes")
    s_ref: Param = param(unit="m", default=1.0, min=0, doc="depth at which the spring has the force c s_ref")

    def equations(self) -> Statements:
        yield from super().equations()
        depth = ca.fmax(self.s_rel0 - self.s_rel, 0)
        spring = self.c * self.s_ref * ca.if_else(depth > 0, (depth / self.s_ref) ** self.n, 0)
        damper = ca.if_else(depth > 0, self.d * self.v_rel, 0)
        yield self.f == -spring + ca.fmin(ca.fmax(damper, -spring), spring)
