"""What stands between two shaft ends that a model joins rigidly: give, gap and loss; signs as in `rotational`.

    flange_a [==element==] flange_b      phi_b = phi_a + q      tau = tau_b, into the element at flange b

At its default a link is rigid and without loss: the motion is exactly that of the model without it. A spring alone
cannot do that, as rigid means an infinite stiffness. So a link carries the compliance h = 1/c, and its deflection q
follows the torque with a lag of second order, der(der(y)) = w_c^2 (tau - y) - 2 D w_c der(y), q = h y: that is a spring
c = 1/h, a damper 2 D c/w_c and an inertance c/w_c^2 side by side. Below the cut-off w_c it is the spring and the
damper; above, it is rigid, and no vibration is faster than w_c, so that fixed steps can follow it. For h = 0 the state
y still follows the torque, so that the derivative of the motion with respect to h exists there. Unless a run says
otherwise it starts at ease, in the middle of a gap.
"""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, dry_friction, initial, param, port, var
from cartpend_dae.library.friction import growing
from cartpend_dae.library.laws import SHORTEST, hardened, past_gap
from cartpend_dae.library.rotational import Flange


class Link(Component):
    """A massless element with the same torque at both ends, phi_b = phi_a + q; base of links."""

    flange_a = port(Flange, doc="one shaft end")
    flange_b = port(Flange, doc="the other shaft end")
    tau = var(unit="N.m", doc="torque of the element, into it at flange b")
    q = var(unit="rad", doc="deflection")

    def equations(self) -> Statements:
        yield self.flange_b.phi == self.flange_a.phi + self.q
        yield self.flange_b.tau == self.tau
        yield self.flange_a.tau == -self.tau


class Compliance(Link):
    """Compliance of a shaft, y = q/h (1 + (n q/h)^2), der(der(y)) = w_c^2 (tau - y) - 2 D w_c der(q)/h.

    Below w_c it is a spring of stiffness 1/h that hardens with the cube of its stretch from loads of about 1/n on, and
    a damper 2 D/(h w_c) beside it, which does not harden.
    """

    y = var(unit="N.m", doc="torque that the spring has")
    yd = var(unit="N.m/s", doc="derivative of y")
    h: Param = param(unit="rad/(N.m)", default=0.0, min=0, doc="compliance, 1/c")
    w_c: Param = param(unit="rad/s", default=200.0, min=0, doc="cut-off, above which it is rigid")
    D: Param = param(unit="1", default=0.2, min=0, doc="damping ratio at w_c")
    n: Param = param(unit="1/(N.m)", default=0.0, min=0, doc="hardening, 1 over the load where it shows")

    def equations(self) -> Statements:
        yield from super().equations()
        stretch = self.y * hardened(self.n * self.y)
        stretching = self.yd / (1 + 3 * (self.n * stretch) ** 2)
        yield self.q == self.h * stretch
        yield self.yd == der(self.y)
        yield initial(self.y == 0, fixed=False)
        yield der(self.yd) == self.w_c * (self.w_c * (self.tau - self.y) - 2 * self.D * stretching)


class KelvinVoigt(Link):
    """Spring and damper side by side, q = h y, T_d der(y) = tau - y: c = 1/h, d = T_d/h.

    It is for a place where no mass enters the torque, as that of a current in a rotor without inertia, which answers
    the speed at once: the torque of `Compliance` would settle there faster than steps can follow.
    """

    y = var(unit="N.m", doc="torque that the spring has")
    h: Param = param(unit="rad/(N.m)", default=0.0, min=0, doc="compliance, 1/c")
    T_d: Param = param(unit="s", default=0.005, min=0, doc="time of creep, d/c")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.q == self.h * self.y
        yield initial(self.y == 0, fixed=False)
        yield self.T_d * der(self.y) == self.tau - self.y


class BaseCompliance(Link):
    """Base that gives way, q = h y, der(der(y)) = w_c^2 (tau - y) - 2 D w_c der(y), between ground and what it holds.

    One end of it is fixed, so this is a base of stiffness c = 1/h with the natural frequency w_c and the damping
    ratio D, that is with the moment of inertia c/w_c^2; h = 0 is a base that does not move.
    """

    y = var(unit="N.m", doc="torque that the spring of the base has")
    yd = var(unit="N.m/s", doc="derivative of y")
    h: Param = param(unit="rad/(N.m)", default=0.0, min=0, doc="compliance, 1/c")
    w_c: Param = param(unit="rad/s", default=40.0, min=0, doc="natural frequency of the base")
    D: Param = param(unit="1", default=0.1, min=0, doc="damping ratio")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.q == self.h * self.y
        yield self.yd == der(self.y)
        yield initial(self.y == 0, fixed=False)
        yield der(self.yd) == self.w_c * (self.w_c * (self.tau - self.y) - 2 * self.D * self.yd)


class Backlash(Link):
    """Backlash, q = b x/2, der(der(x)) = w_c^2 (tau/tau_r - 9 e) - 4 D w_c min(1, 9 |e|) der(x), e = x beyond -1 to 1.

    x is the place in the gap of the total width b, and -1 and 1 are its flanks. In the gap the torque is only that of
    an inertance 2 tau_r/(b w_c^2), so tau_r is to be small against what is passed on; the flanks are springs of
    18 tau_r/b with dampers. For b = 0 the two ends move as one, while x still shows on which flank they are.
    Where contact sets in gradually, e is rounded over r: x + (|x - 1| - |x + 1|)/2 with (z^2 + r^2)^(1/2) for each |z|.
    Steps that cannot follow the flanks see softer ones, with w_c no larger than 1/(3 T_0).
    """

    x = var(unit="1", doc="place in the gap, -1 and 1 at its flanks")
    xd = var(unit="1/s", doc="derivative of x")
    b: Param = param(unit="rad", default=0.0, min=0, doc="total width of the gap")
    tau_r: Param = param(unit="N.m", default=0.05, min=0, doc="torque that carries it through the gap within 1/w_c")
    w_c: Param = param(unit="rad/s", default=100.0, min=0, doc="rate at which the gap is crossed")
    r: Param = param(unit="1", default=0.0, min=0, doc="width over which contact sets in, in units of x")
    D: Param = param(unit="1", default=1.0, min=0, doc="damping of the flanks, 1.5 times their damping ratio")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.q == self.b / 2 * self.x
        yield self.xd == der(self.x)
        yield initial(self.x == 0, fixed=False)
        depth = past_gap(self.x, self.r)
        push = self.tau / self.tau_r - 9 * depth
        touch = ca.fmin(1, 9 * ca.fabs(depth))
        w_c = self.w_c / ca.fmax(1, 3 * self.w_c * self.T_0)
        yield der(self.xd) == w_c * (w_c * push - 4 * self.D * touch * self.xd)


class LoadDependentFriction(Component):
    """Friction against ground that grows with the load, tau = (tau_c + mu |y|) sgn w, with exact sticking.

    y follows the torque that passes from flange b to flange a with the lag T_f, so that friction does not depend on
    itself at the same instant. It may grow with a power of the load, mu |y| |y/tau_1|^p.
    """

    flange_a = port(Flange, doc="one shaft end")
    flange_b = port(Flange, doc="the other shaft end")
    w = var(unit="rad/s", doc="speed against ground")
    tau = var(unit="N.m", doc="friction torque, opposes w")
    y = var(unit="N.m", doc="load, smoothed")
    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level without load")
    mu: Param = param(unit="1", default=0.0, min=0, max=1, doc="friction per load")
    p: Param = param(unit="1", default=0.0, min=-0.5, max=1.0, doc="by how much its power is more than 1")
    tau_1: Param = param(unit="N.m", default=1.0, min=0, doc="load at which the power does not matter")
    T_f: Param = param(unit="s", default=SHORTEST, min=0, doc="lag of the load", is_shortest_time=True)

    def equations(self) -> Statements:
        yield self.flange_a.phi == self.flange_b.phi
        yield self.w == der(self.flange_a.phi)
        yield self.T_f * der(self.y) == self.flange_b.tau - self.y
        yield initial(self.y == self.flange_b.tau, fixed=False)
        yield self.tau == dry_friction(self.w, self.tau_c + self.mu * growing(self.y, self.p, self.tau_1))
        yield self.flange_a.tau + self.flange_b.tau == self.tau


class GearLoss(Component):
    """Gear with the efficiency 1 - e in both directions of power, tau = e |y| sgn w or e/(1 - e) |y| sgn w.

    The first holds where the power enters at flange b, the second where it leaves there: lost is the share e of the
    torque that drives. y follows the torque at flange b with the lag T_f, so that the loss does not depend on itself at
    the same instant.
    """

    flange_a = port(Flange, doc="one shaft end")
    flange_b = port(Flange, doc="the other shaft end")
    w = var(unit="rad/s", doc="speed")
    tau = var(unit="N.m", doc="lost torque, opposes w")
    y = var(unit="N.m", doc="torque that is passed on, smoothed")
    e: Param = param(unit="1", default=0.0, min=0, max=0.99, doc="share that is lost")
    T_f: Param = param(unit="s", default=SHORTEST, min=0, doc="lag of y", is_shortest_time=True)

    def equations(self) -> Statements:
        yield self.flange_a.phi == self.flange_b.phi
        yield self.w == der(self.flange_a.phi)
        yield self.T_f * der(self.y) == self.flange_b.tau - self.y
        yield initial(self.y == self.flange_b.tau, fixed=False)
        driving, driven = self.e * ca.fabs(self.y), self.e / (1 - self.e) * ca.fabs(self.y)
        forward, backward = ca.if_else(self.y > 0, driving, driven), ca.if_else(self.y < 0, driving, driven)
        yield self.tau == dry_friction(self.w, forward, backward)
        yield self.flange_a.tau + self.flange_b.tau == self.tau
