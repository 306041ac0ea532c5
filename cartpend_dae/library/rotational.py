"""Rotation about a fixed axis: angle phi [rad], and torque tau [N.m], positive into the component.

    flange_a [==element==] flange_b      phi_rel = flange_b.phi - flange_a.phi
                                         tau = flange_b.tau = -flange_a.tau

So a positive `tau` of an element pulls the body at flange b back, and the body at flange a forward.
"""

import casadi as ca

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
from cartpend_dae.library import translational
from cartpend_dae.library.friction import drag, viscous_and_coulomb
from cartpend_dae.library.laws import softened


class Flange(Port):
    """A shaft end: angle phi, and torque tau into the component."""

    phi = var(unit="rad", doc="angle of the shaft end")
    tau = flow(unit="N.m", doc="torque into the component")


class Rigid(Component):
    """A rigid shaft, phi = phi_a = phi_b; base of bodies."""

    flange_a = port(Flange, doc="left end of the shaft")
    flange_b = port(Flange, doc="right end of the shaft")
    phi = var(unit="rad", doc="angle of the shaft")

    def equations(self) -> Statements:
        yield self.flange_a.phi == self.phi
        yield self.flange_b.phi == self.phi


class Compliant(Component):
    """A massless element between two shafts, tau = tau_b = -tau_a; base of springs and loads."""

    flange_a = port(Flange, doc="left shaft end")
    flange_b = port(Flange, doc="right shaft end")
    phi_rel = var(unit="rad", doc="angle of flange b against flange a")
    tau = var(unit="N.m", doc="torque of the element, into it at flange b")

    def equations(self) -> Statements:
        yield self.phi_rel == self.flange_b.phi - self.flange_a.phi
        yield self.flange_b.tau == self.tau
        yield self.flange_a.tau == -self.tau


class CompliantWithSpeed(Compliant):
    """A massless element whose torque depends on the relative speed; base of dampers and friction.

    The speed is the difference of the flanges' own speeds: der(phi_rel) would make phi_rel a state,
    which between two bodies with states of their own is one too many.
    """

    w_rel = var(unit="rad/s", doc="speed of flange b against flange a")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.w_rel == der(self.flange_b.phi - self.flange_a.phi)


class Inertia(Rigid):
    """Rotating body, J a = tau_a + tau_b."""

    w = var(unit="rad/s", doc="speed")
    a = var(unit="rad/s2", doc="acceleration")
    J: Param = param(unit="kg.m2", min=0, doc="moment of inertia")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.w == der(self.phi)
        yield self.a == der(self.w)
        yield self.J * self.a == self.flange_a.tau + self.flange_b.tau


class Fixed(Component):
    """A shaft end held by the ground, phi = phi0."""

    flange = port(Flange, doc="the held shaft end")
    phi0: Param = param(unit="rad", default=0.0, doc="angle at which it is held")

    def equations(self) -> Statements:
        yield self.flange.phi == self.phi0


class Spring(Compliant):
    """Linear rotational spring, tau = c (phi_rel - phi_rel0)."""

    c: Param = param(unit="N.m/rad", min=0, doc="stiffness")
    phi_rel0: Param = param(unit="rad", default=0.0, doc="unstretched angle")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.c * (self.phi_rel - self.phi_rel0)


class Damper(CompliantWithSpeed):
    """Linear rotational damper, tau = d w_rel."""

    d: Param = param(unit="N.m.s/rad", min=0, doc="damping")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.d * self.w_rel


class SpringDamper(CompliantWithSpeed):
    """Linear rotational spring and damper in parallel, tau = c (phi_rel - phi_rel0) + d w_rel."""

    c: Param = param(unit="N.m/rad", min=0, doc="stiffness")
    d: Param = param(unit="N.m.s/rad", min=0, doc="damping")
    phi_rel0: Param = param(unit="rad", default=0.0, doc="unstretched angle")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.c * (self.phi_rel - self.phi_rel0) + self.d * self.w_rel


class Driven(Component):
    """A driven shaft end and the housing that takes the reaction; base of sources.

    The housing is the ground, unless `use_support` is True: then it is `support`, which must be connected.
    """

    flange = port(Flange, doc="the driven shaft end")
    support = port(Flange, doc="housing, if use_support is True")
    use_support: bool = False

    def equations(self) -> Statements:
        if self.use_support:
            yield self.flange.tau + self.support.tau == 0
        else:
            yield self.support.phi == 0


class Torque(Driven):
    """Torque given by a signal, tau_flange = -tau: positive accelerates the shaft; the housing reacts."""

    tau = signal("in", unit="N.m", doc="driving torque")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.flange.tau == -self.tau


class BearingFriction(Component):
    """Bearing between housing (flange a) and shaft (flange b), tau = d w + tau_c sgn w, with exact sticking.

    The dry friction is left out altogether if `tau_c` is the number 0.
    """

    flange_a = port(Flange, doc="housing")
    flange_b = port(Flange, doc="shaft")
    phi = var(unit="rad", doc="angle of the shaft against the housing")
    w = var(unit="rad/s", doc="speed of the shaft against the housing")
    tau = var(unit="N.m", doc="friction torque, opposes w")
    d: Param = param(unit="N.m.s/rad", default=0.0, min=0, doc="viscous damping")
    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb friction torque")

    def equations(self) -> Statements:
        yield self.phi == self.flange_b.phi - self.flange_a.phi
        yield self.w == der(self.phi)
        yield self.tau == viscous_and_coulomb(self, self.w, self.d, "tau_c")
        yield self.flange_b.tau == self.tau
        yield self.flange_a.tau == -self.tau


class SlenderRod(Component):
    """Slender rod turning about its end under gravity, tau_flange = (m l^2/3) a + (m g l/2) sin phi.

    phi = 0 is hanging, phi = pi is upright.
    """

    flange = port(Flange, doc="shaft at the end of the rod")
    phi = var(unit="rad", doc="angle, 0 = hanging")
    w = var(unit="rad/s", doc="speed")
    a = var(unit="rad/s2", doc="acceleration")
    m: Param = param(unit="kg", min=0, doc="mass")
    l: Param = param(unit="m", min=0, doc="length")  # noqa: E741 (the symbol of mechanics)
    g: Param = param(unit="m/s2", default=9.81, doc="acceleration of gravity")

    def equations(self) -> Statements:
        J = self.m * self.l**2 / 3
        yield self.flange.phi == self.phi
        yield self.w == der(self.phi)
        yield self.a == der(self.w)
        yield self.flange.tau == J * self.a + self.m * self.g * self.l / 2 * ca.sin(self.phi)


class IdealGear(Component):
    """Gear without loss or inertia, phi_a = ratio phi_b (both against the housing), ratio tau_a + tau_b = 0.

    The housing is the ground, unless `use_support` is True: then it is `support`, which must be connected and
    takes the torque -(tau_a + tau_b).
    """

    flange_a = port(Flange, doc="driving shaft")
    flange_b = port(Flange, doc="driven shaft")
    support = port(Flange, doc="housing, if use_support is True")
    use_support: bool = False
    ratio: Param = param(unit="1", doc="angle of flange a per angle of flange b")

    def equations(self) -> Statements:
        yield self.ratio * self.flange_a.tau + self.flange_b.tau == 0
        if self.use_support:
            phi = self.support.phi
            yield self.flange_a.phi - phi == self.ratio * (self.flange_b.phi - phi)
            yield self.flange_a.tau + self.flange_b.tau + self.support.tau == 0
        else:
            yield self.flange_a.phi == self.ratio * self.flange_b.phi
            yield self.support.phi == 0


class Sprocket(Component):
    """Wheel that moves a chain or a rack without slip or loss: s = r phi, tau + r f = 0."""

    flange_R = port(Flange, doc="shaft of the wheel")
    flange_T = port(translational.Flange, doc="chain or rack")
    r: Param = param(unit="m", doc="pitch radius; negative if the chain runs the other way")

    def equations(self) -> Statements:
        yield self.flange_T.s == self.r * self.flange_R.phi
        yield self.flange_R.tau + self.r * self.flange_T.f == 0


class IdealGearR2T(Component):
    """Rotation to translation without loss: phi = ratio s, ratio tau + f = 0."""

    flange_R = port(Flange, doc="rotating side")
    flange_T = port(translational.Flange, doc="translating side")
    ratio: Param = param(unit="rad/m", doc="angle per position")

    def equations(self) -> Statements:
        yield self.flange_R.phi == self.ratio * self.flange_T.s
        yield self.ratio * self.flange_R.tau + self.flange_T.f == 0


class AngleSensor(Component):
    """Ideal angle sensor, phi = phi_flange, without load."""

    flange = port(Flange, doc="the measured shaft end")
    phi = signal("out", unit="rad", doc="measured angle")

    def equations(self) -> Statements:
        yield self.phi == self.flange.phi
        yield self.flange.tau == 0


class SpeedSensor(Component):
    """Ideal speed sensor, w = der(phi), without load."""

    flange = port(Flange, doc="the measured shaft end")
    phi = var(unit="rad", doc="angle of the shaft end")
    w = signal("out", unit="rad/s", doc="measured speed")

    def equations(self) -> Statements:
        yield self.phi == self.flange.phi
        yield self.w == der(self.phi)
        yield self.flange.tau == 0


class TorqueSensor(Rigid):
    """Ideal torque sensor in a rigid shaft, tau = tau_a = -tau_b: what passes from flange a to flange b."""

    tau = signal("out", unit="N.m", doc="measured torque")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.flange_a.tau
        yield self.flange_a.tau + self.flange_b.tau == 0


class CoulombFriction(CompliantWithSpeed):
    """Coulomb friction, tau = tau_c sgn w_rel, with exact sticking."""

    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb friction torque")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == dry_friction(self.w_rel, self.tau_c)


class ViscousFriction(CompliantWithSpeed):
    """Viscous friction, tau = d w_rel."""

    d: Param = param(unit="N.m.s/rad", default=0.0, min=0, doc="viscous damping")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.d * self.w_rel


class ConstantLoad(Compliant):
    """Constant load, tau = tau_0; positive opposes motion in the positive direction."""

    tau_0: Param = param(unit="N.m", default=0.0, doc="load torque")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.tau_0


class QuadraticDrag(CompliantWithSpeed):
    """Quadratic drag, tau = d2 w_rel |w_rel|, or another power of the speed, tau = d2 w_rel |w_rel| |w_rel/w_1|^q."""

    d2: Param = param(unit="N.m.s2/rad2", default=0.0, min=0, doc="drag coefficient")
    q: Param = param(unit="1", default=0.0, min=-0.5, max=1.5, doc="by how much its power is more than 2")
    w_1: Param = param(unit="rad/s", default=1.0, min=0, doc="speed at which the power does not matter")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == drag(self.w_rel, self.d2, self.q, self.w_1)


class CubicStiffness(Compliant):
    """Cubic and quintic stiffness, tau = c3 x^3 + c5 x^5, x = phi_rel - phi_rel0; negative softens a spring."""

    c3: Param = param(unit="N.m/rad3", default=0.0, doc="cubic stiffness")
    c5: Param = param(unit="N.m/rad5", default=0.0, doc="quintic stiffness")
    phi_rel0: Param = param(unit="rad", default=0.0, doc="where it is at rest")

    def equations(self) -> Statements:
        yield from super().equations()
        x = self.phi_rel - self.phi_rel0
        yield self.tau == (self.c3 + self.c5 * x**2) * x**3


class LinearStiffness(Compliant):
    """Linear stiffness, tau = c phi_rel - tau_0, at rest at tau_0/c; negative weakens a spring beside it.

    It may soften about its rest position, tau = c x/(1 + k x^2)^0.5, x = phi_rel - tau_0/c; see `laws.softened`.
    """

    c: Param = param(unit="N.m/rad", default=0.0, doc="stiffness")
    tau_0: Param = param(unit="N.m", default=0.0, doc="preload, towards larger phi_rel")
    k: Param = param(
        unit="1/rad2", default=0.0, min=0, doc="softening: inverse square of the angle at which it has set in"
    )

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == softened(self.c, self.phi_rel, self.tau_0, self.k)
