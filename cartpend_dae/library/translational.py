"""Motion along a fixed line: position s [m], and force f [N], positive into the component.

    flange_a [==element==] flange_b      s_rel = flange_b.s - flange_a.s
                                         f = flange_b.f = -flange_a.f

So a positive `f` of an element pulls the body at flange b back, and the body at flange a forward.
"""

from cartpend_dae.language import (
    Component,
    Param,
    Port,
    Statements,
    der,
    dry_friction,
    flow,
    param,
    port,
    signal,
    var,
)
from cartpend_dae.library.friction import drag, viscous_and_coulomb
from cartpend_dae.library.laws import softened


class Flange(Port):
    """A point on the line: position s, and force f into the component."""

    s = var(unit="m", doc="position")
    f = flow(unit="N", doc="force into the component")


class Rigid(Component):
    """A rigid joint without extent, s = s_a = s_b; base of sensors."""

    flange_a = port(Flange, doc="left side")
    flange_b = port(Flange, doc="right side")
    s = var(unit="m", doc="position")

    def equations(self) -> Statements:
        yield self.flange_a.s == self.s
        yield self.flange_b.s == self.s


class Compliant(Component):
    """A massless element between two points, f = f_b = -f_a; base of springs and loads."""

    flange_a = port(Flange, doc="left end")
    flange_b = port(Flange, doc="right end")
    s_rel = var(unit="m", doc="position of flange b against flange a")
    f = var(unit="N", doc="force of the element, into it at flange b")

    def equations(self) -> Statements:
        yield self.s_rel == self.flange_b.s - self.flange_a.s
        yield self.flange_b.f == self.f
        yield self.flange_a.f == -self.f


class CompliantWithSpeed(Compliant):
    """A massless element whose force depends on the relative speed; base of dampers and friction.

    The speed is the difference of the flanges' own speeds: der(s_rel) would make s_rel a state,
    which between two bodies with states of their own is one too many.
    """

    v_rel = var(unit="m/s", doc="speed of flange b against flange a")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.v_rel == der(self.flange_b.s - self.flange_a.s)


class Mass(Component):
    """Sliding body, m a = f_a + f_b, with s in its middle: s_a = s - L/2, s_b = s + L/2."""

    flange_a = port(Flange, doc="left side")
    flange_b = port(Flange, doc="right side")
    s = var(unit="m", doc="position")
    v = var(unit="m/s", doc="speed")
    a = var(unit="m/s2", doc="acceleration")
    m: Param = param(unit="kg", min=0, doc="mass")
    L: Param = param(unit="m", default=0.0, doc="length, from flange a to flange b")

    def equations(self) -> Statements:
        half = 0 if self.is_zero("L") else self.L / 2
        yield self.flange_a.s == self.s - half
        yield self.flange_b.s == self.s + half
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.m * self.a == self.flange_a.f + self.flange_b.f


class Rod(Component):
    """Rigid massless rod, s_a = s - L/2, s_b = s + L/2, f_a + f_b = 0."""

    flange_a = port(Flange, doc="left end")
    flange_b = port(Flange, doc="right end")
    s = var(unit="m", doc="position of the middle")
    L: Param = param(unit="m", doc="length, from flange a to flange b")

    def equations(self) -> Statements:
        yield self.flange_a.s == self.s - self.L / 2
        yield self.flange_b.s == self.s + self.L / 2
        yield self.flange_a.f + self.flange_b.f == 0


class Fixed(Component):
    """A point of the ground, s = s0."""

    flange = port(Flange, doc="the held point")
    s0: Param = param(unit="m", default=0.0, doc="position at which it is held")

    def equations(self) -> Statements:
        yield self.flange.s == self.s0


class Spring(Compliant):
    """Linear spring, f = c (s_rel - s_rel0)."""

    c: Param = param(unit="N/m", min=0, doc="stiffness")
    s_rel0: Param = param(unit="m", default=0.0, doc="unstretched length")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.c * (self.s_rel - self.s_rel0)


class Damper(CompliantWithSpeed):
    """Linear damper, f = d v_rel."""

    d: Param = param(unit="N.s/m", min=0, doc="damping")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.d * self.v_rel


class SpringDamper(CompliantWithSpeed):
    """Linear spring and damper in parallel, f = c (s_rel - s_rel0) + d v_rel."""

    c: Param = param(unit="N/m", min=0, doc="stiffness")
    d: Param = param(unit="N.s/m", min=0, doc="damping")
    s_rel0: Param = param(unit="m", default=0.0, doc="unstretched length")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.c * (self.s_rel - self.s_rel0) + self.d * self.v_rel


class Force(Component):
    """Force given by a signal, f_flange = -f: positive accelerates the body; the ground reacts."""

    flange = port(Flange, doc="the driven point")
    f = signal("in", unit="N", doc="driving force")

    def equations(self) -> Statements:
        yield self.flange.f == -self.f


class Drive(Component):
    """Drive with its amplifier, f = k u, f_flange = -f: positive accelerates the body; the ground reacts."""

    flange = port(Flange, doc="the driven point")
    u = signal("in", unit="V", doc="control voltage")
    f = var(unit="N", doc="driving force")
    k: Param = param(unit="N/V", doc="gain")

    def equations(self) -> Statements:
        yield self.f == self.k * self.u
        yield self.flange.f == -self.f


class RailFriction(Component):
    """Slide between rail (flange a) and carriage (flange b), f = d v + f_c sgn v, with exact sticking.

    The dry friction is left out altogether if `f_c` is the number 0.
    """

    flange_a = port(Flange, doc="rail")
    flange_b = port(Flange, doc="carriage")
    s = var(unit="m", doc="position of the carriage on the rail")
    v = var(unit="m/s", doc="speed of the carriage on the rail")
    f = var(unit="N", doc="friction force, opposes v")
    d: Param = param(unit="N.s/m", default=0.0, min=0, doc="viscous damping")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb friction force")

    def equations(self) -> Statements:
        yield self.s == self.flange_b.s - self.flange_a.s
        yield self.v == der(self.s)
        yield self.f == viscous_and_coulomb(self, self.v, self.d, "f_c")
        yield self.flange_b.f == self.f
        yield self.flange_a.f == -self.f


class PositionSensor(Component):
    """Ideal position sensor, s = s_flange, without load."""

    flange = port(Flange, doc="the measured point")
    s = signal("out", unit="m", doc="measured position")

    def equations(self) -> Statements:
        yield self.s == self.flange.s
        yield self.flange.f == 0


class SpeedSensor(Component):
    """Ideal speed sensor, v = der(s), without load."""

    flange = port(Flange, doc="the measured point")
    s = var(unit="m", doc="position of the point")
    v = signal("out", unit="m/s", doc="measured speed")

    def equations(self) -> Statements:
        yield self.s == self.flange.s
        yield self.v == der(self.s)
        yield self.flange.f == 0


class ForceSensor(Rigid):
    """Ideal force sensor in a rigid joint, f = f_a = -f_b: what passes from flange a to flange b."""

    f = signal("out", unit="N", doc="measured force")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.flange_a.f
        yield self.flange_a.f + self.flange_b.f == 0


class CoulombFriction(CompliantWithSpeed):
    """Coulomb friction, f = f_c sgn v_rel, with exact sticking."""

    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb friction force")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == dry_friction(self.v_rel, self.f_c)


class ViscousFriction(CompliantWithSpeed):
    """Viscous friction, f = d v_rel."""

    d: Param = param(unit="N.s/m", default=0.0, min=0, doc="viscous damping")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.d * self.v_rel


class ConstantLoad(Compliant):
    """Constant load, f = f_0; positive opposes motion in the positive direction."""

    f_0: Param = param(unit="N", default=0.0, doc="load force")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.f_0


class QuadraticDrag(CompliantWithSpeed):
    """Quadratic drag, f = d2 v_rel |v_rel|, or another power of the speed, f = d2 v_rel |v_rel| |v_rel/v_1|^q."""

    d2: Param = param(unit="N.s2/m2", default=0.0, min=0, doc="drag coefficient")
    q: Param = param(unit="1", default=0.0, min=-0.5, max=1.5, doc="by how much its power is more than 2")
    v_1: Param = param(unit="m/s", default=1.0, min=0, doc="speed at which the power does not matter")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == drag(self.v_rel, self.d2, self.q, self.v_1)


class CubicStiffness(Compliant):
    """Cubic and quintic stiffness, f = c3 x^3 + c5 x^5, x = s_rel - s_rel0; negative softens a spring."""

    c3: Param = param(unit="N/m3", default=0.0, doc="cubic stiffness")
    c5: Param = param(unit="N/m5", default=0.0, doc="quintic stiffness")
    s_rel0: Param = param(unit="m", default=0.0, doc="where it is at rest")

    def equations(self) -> Statements:
        yield from super().equations()
        x = self.s_rel - self.s_rel0
        yield self.f == (self.c3 + self.c5 * x**2) * x**3


class LinearStiffness(Compliant):
    """Linear stiffness, f = c s_rel - f_0, at rest at f_0/c; negative weakens a spring beside it.

    It may soften about its rest position, f = c x/(1 + k x^2)^0.5, x = s_rel - f_0/c; see `laws.softened`.
    """

    c: Param = param(unit="N/m", default=0.0, doc="stiffness")
    f_0: Param = param(unit="N", default=0.0, doc="preload, towards larger s_rel")
    k: Param = param(
        unit="1/m2", default=0.0, min=0, doc="softening: inverse square of the stretch at which it has set in"
    )

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == softened(self.c, self.s_rel, self.f_0, self.k)
