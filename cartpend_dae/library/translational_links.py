"""What stands between two points that a model joins rigidly: give, gap and loss; signs as in `translational`.

    flange_a [==element==] flange_b      s_b = s_a + q      f = f_b, into the element at flange b

At its default a link is rigid and without loss: the motion is exactly that of the model without it. A spring alone
cannot do that, as rigid means an infinite stiffness. So a link carries the compliance h = 1/c, and its deflection q
follows the force with a lag of second order, der(der(y)) = w_c^2 (f - y) - 2 D w_c der(y), q = h y: that is a spring
c = 1/h, a damper 2 D c/w_c and an inertance c/w_c^2 side by side. Below the cut-off w_c it is the spring and the
damper; above, it is rigid, and no vibration is faster than w_c, so that fixed steps can follow it. For h = 0 the state
y still follows the force, so that the derivative of the motion with respect to h exists there. Unless a run says
otherwise it starts at ease, in the middle of a gap.
"""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, dry_friction, initial, param, port, var
from cartpend_dae.library.friction import growing
from cartpend_dae.library.laws import SHORTEST, hardened, past_gap, softer
from cartpend_dae.library.translational import Flange


class Link(Component):
    """A massless element with the same force at both ends, s_b = s_a + q; base of links."""

    flange_a = port(Flange, doc="one point")
    flange_b = port(Flange, doc="the other point")
    f = var(unit="N", doc="force of the element, into it at flange b")
    q = var(unit="m", doc="deflection")

    def equations(self) -> Statements:
        yield self.flange_b.s == self.flange_a.s + self.q
        yield self.flange_b.f == self.f
        yield self.flange_a.f == -self.f


class Compliance(Link):
    """Compliance of a chain or a rod, y = q/h (1 + (n q/h)^2), der(der(y)) = w_c^2 (f - y) - 2 D w_c der(q)/h.

    Below w_c it is a spring of stiffness 1/h that hardens with the cube of its stretch from loads of about 1/n on, and
    a damper 2 D/(h w_c) beside it, which does not harden.
    """

    y = var(unit="N", doc="force that the spring has")
    yd = var(unit="N/s", doc="derivative of y")
    h: Param = param(unit="m/N", default=0.0, min=0, doc="compliance, 1/c")
    w_c: Param = param(unit="rad/s", default=200.0, min=0, doc="cut-off, above which it is rigid")
    D: Param = param(unit="1", default=0.2, min=0, doc="damping ratio at w_c")
    n: Param = param(unit="1/N", default=0.0, min=0, doc="hardening, 1 over the load where it shows")

    def equations(self) -> Statements:
        yield from super().equations()
        stretch = self.y * hardened(self.n * self.y)
        stretching = self.yd / (1 + 3 * (self.n * stretch) ** 2)
        yield self.q == self.h * stretch
        yield self.yd == der(self.y)
        yield initial(self.y == 0, fixed=False)
        yield der(self.yd) == self.w_c * (self.w_c * (self.f - self.y) - 2 * self.D * stretching)


class KelvinVoigt(Link):
    """Spring and damper side by side, q = h y, T_d der(y) = f - y: c = 1/h, d = T_d/h.

    It is for a place where no mass enters the force, as that of a current in a rotor without inertia, which answers
    the speed at once: the force of `Compliance` would settle there faster than steps can follow.
    """

    y = var(unit="N", doc="force that the spring has")
    h: Param = param(unit="m/N", default=0.0, min=0, doc="compliance, 1/c")
    T_d: Param = param(unit="s", default=0.005, min=0, doc="time of creep, d/c")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.q == self.h * self.y
        yield initial(self.y == 0, fixed=False)
        yield self.T_d * der(self.y) == self.f - self.y


class BaseCompliance(Link):
    """Base that gives way, q = h y, der(der(y)) = w_c^2 (f - y) - 2 D w_c der(y), between ground and what it holds.

    One end of it is fixed, so this is a base of stiffness c = 1/h with the natural frequency w_c and the damping
    ratio D, that is with the mass c/w_c^2; h = 0 is a base that does not move.
    """

    y = var(unit="N", doc="force that the spring of the base has")
    yd = var(unit="N/s", doc="derivative of y")
    h: Param = param(unit="m/N", default=0.0, min=0, doc="compliance, 1/c")
    w_c: Param = param(unit="rad/s", default=40.0, min=0, doc="natural frequency of the base")
    D: Param = param(unit="1", default=0.1, min=0, doc="damping ratio")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.q == self.h * self.y
        yield self.yd == der(self.y)
        yield initial(self.y == 0, fixed=False)
        yield der(self.yd) == self.w_c * (self.w_c * (self.f - self.y) - 2 * self.D * self.yd)


class CarriedBase(Component):
    """Base under a cart that carries a body, s_a = s_b + q, between the body's pivot (a) and the cart (b).

    (m_b + m) (der(der(q)) + 2 D w_c der(q) + w_c^2 (1 + n q^2) q) = -m der(v_b) + f_a and f_b = m der(der(q)) - f_a,
    with the cart's mass m, that of the base m_b = 1/h, and forces f into this component.

    The rig stands on the base with all that drives, holds and measures it, so that positions of the model are against
    the base, and those beyond flange a against the ground. h = 0 is a base that does not move. What rubs on the rail
    is between the cart and the base.
    """

    flange_a = port(Flange, doc="pivot of the body that the cart carries")
    flange_b = port(Flange, doc="the cart")
    v = var(unit="m/s", doc="speed of the cart against the base")
    # states, so that the position of the base follows from nothing that is measured while it is none
    q = var(unit="m", doc="position of the base", state_select="prefer")
    qd = var(unit="m/s", doc="derivative of q", state_select="prefer")
    h: Param = param(unit="1/kg", default=0.0, min=0, doc="1/m_b")
    m: Param = param(unit="kg", default=5.0, min=0, doc="mass of the cart, which moves with the base")
    w_c: Param = param(unit="rad/s", default=20.0, min=0, doc="natural frequency of the base with the cart held")
    D: Param = param(unit="1", default=0.1, min=0, doc="damping ratio of the base")
    n: Param = param(unit="1/m2", default=0.0, min=0, doc="hardening of the base")

    def equations(self) -> Statements:
        yield self.flange_a.s == self.flange_b.s + self.q
        yield self.v == der(self.flange_b.s)
        yield self.qd == der(self.q)
        yield initial(self.q == 0, fixed=False)
        yield initial(self.qd == 0, fixed=False)
        yield self.flange_a.f + self.flange_b.f == self.m * der(self.qd)
        spring = self.w_c * self.q * (1 + self.n * self.q**2)
        share = self.h / (1 + self.h * self.m)  # 1/(m_b + m)
        yield der(self.qd) + self.w_c * (spring + 2 * self.D * self.qd) == share * (
            self.flange_a.f - self.m * der(self.v)
        )


class Backlash(Link):
    """Backlash, q = b x/2, der(der(x)) = w_c^2 (f/f_r - 9 e) - 4 D w_c min(1, 9 |e|) der(x), e = x beyond -1 to 1.

    x is the place in the gap of the total width b, and -1 and 1 are its flanks. In the gap the force is only that of
    an inertance 2 f_r/(b w_c^2), so f_r is to be small against what is passed on; the flanks are springs of
    18 f_r/b with dampers. For b = 0 the two ends move as one, while x still shows on which flank they are.
    Where contact sets in gradually, e is rounded over r: x + (|x - 1| - |x + 1|)/2 with (z^2 + r^2)^(1/2) for each |z|.
    Steps that cannot follow the flanks see softer ones, with w_c no larger than 1/(3 T_0).
    """

    x = var(unit="1", doc="place in the gap, -1 and 1 at its flanks")
    xd = var(unit="1/s", doc="derivative of x")
    b: Param = param(unit="m", default=0.0, min=0, doc="total width of the gap")
    f_r: Param = param(unit="N", default=5.0, min=0, doc="force that carries it through the gap within 1/w_c")
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
        push = self.f / self.f_r - 9 * depth
        touch = ca.fmin(1, 9 * ca.fabs(depth))
        w_c = self.w_c / ca.fmax(1, 3 * self.w_c * self.T_0)
        yield der(self.xd) == w_c * (w_c * push - 4 * self.D * touch * self.xd)


class LoadDependentFriction(Component):
    """Friction against ground that grows with the load, f = (f_c + mu |y|) sgn v, with exact sticking.

    y follows the force that passes from flange b to flange a with the lag T_f, so that friction does not depend on
    itself at the same instant. It may grow with a power of the load, mu |y| |y/f_1|^p.
    """

    flange_a = port(Flange, doc="one point")
    flange_b = port(Flange, doc="the other point")
    v = var(unit="m/s", doc="speed against ground")
    f = var(unit="N", doc="friction force, opposes v")
    y = var(unit="N", doc="load, smoothed")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level without load")
    mu: Param = param(unit="1", default=0.0, min=0, max=1, doc="friction per load")
    p: Param = param(unit="1", default=0.0, min=-0.5, max=1.0, doc="by how much its power is more than 1")
    f_1: Param = param(unit="N", default=1.0, min=0, doc="load at which the power does not matter")
    T_f: Param = param(unit="s", default=SHORTEST, min=0, doc="lag of the load", is_shortest_time=True)

    def equations(self) -> Statements:
        yield self.flange_a.s == self.flange_b.s
        yield self.v == der(self.flange_a.s)
        yield self.T_f * der(self.y) == self.flange_b.f - self.y
        yield initial(self.y == self.flange_b.f, fixed=False)
        yield self.f == dry_friction(self.v, self.f_c + self.mu * growing(self.y, self.p, self.f_1))
        yield self.flange_a.f + self.flange_b.f == self.f


class ChainTensionFriction(Link):
    """Chain that sags, q = h f_p atan(y/f_p), der(der(y)) = w_c^2 (f - y) - 2 D w_c der(y), with friction at flange b.

    It gives way by h under small forces and less under large ones, which pull it straight; f_p is its pre-tension.
    Bearings under the tension f_p + |z| add the friction e (f_p + |z|) sgn v against ground, with exact sticking; z
    follows f with the lag T_f, so that friction does not depend on itself at the same instant. It may grow with a power
    of the force, e (f_p + |z| |z/f_1|^p).
    """

    v = var(unit="m/s", doc="speed of flange b against ground")
    f_f = var(unit="N", doc="friction force, opposes v")
    y = var(unit="N", doc="force in the chain, smoothed")
    yd = var(unit="N/s", doc="derivative of y")
    z = var(unit="N", doc="force in the chain, with the lag T_f")
    h: Param = param(unit="m/N", default=0.0, min=0, doc="compliance at small forces")
    e: Param = param(unit="1", default=0.0, min=0, max=1, doc="friction per tension")
    f_p: Param = param(unit="N", default=50.0, min=0, doc="pre-tension")
    p: Param = param(unit="1", default=0.0, min=-0.5, max=1.0, doc="by how much its power is more than 1")
    f_1: Param = param(unit="N", default=100.0, min=0, doc="force at which the power does not matter")
    w_c: Param = param(unit="rad/s", default=200.0, min=0, doc="cut-off, above which it is rigid")
    D: Param = param(unit="1", default=0.2, min=0, doc="damping ratio at w_c")
    T_f: Param = param(unit="s", default=SHORTEST, min=0, doc="lag of the tension", is_shortest_time=True)

    def equations(self) -> Statements:
        yield self.flange_b.s == self.flange_a.s + self.q
        yield self.flange_a.f == -self.f
        yield self.flange_b.f == self.f + self.f_f
        yield self.q == self.h * softer(self.y, self.f_p)
        yield self.yd == der(self.y)
        yield initial(self.y == 0, fixed=False)
        yield der(self.yd) == self.w_c * (self.w_c * (self.f - self.y) - 2 * self.D * self.yd)
        yield self.T_f * der(self.z) == self.f - self.z
        yield initial(self.z == self.f, fixed=False)
        yield self.v == der(self.flange_b.s)
        carried = growing(self.z, self.p, self.f_1)
        yield self.f_f == dry_friction(self.v, self.e * (self.f_p + carried))
