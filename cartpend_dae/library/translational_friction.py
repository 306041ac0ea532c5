"""Bodies on a line with dry friction against a guide, and with hard stops; signs as in `translational`."""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, discrete, dry_friction, param, port, var
from cartpend_dae.library.friction import check_rows, interpolated
from cartpend_dae.library.translational import Flange
from cartpend_dae.switching import if_else, reinit, when

# the force of a stop has no bound
STOP = 1e300
# a body breaks away a little above the level at which it begins to slide, so that it does not stick again at once
BREAKAWAY = 1.001


class SupportFriction(Component):
    """Friction of a guide, f_a + f_b = f = K(v) sgn v, with exact sticking up to peak K(0); both flanges are one point.

    K joins the points (speed in v_unit, force in f_unit) of `f_pos` by lines. The guide is the ground, unless
    `use_support` is True: then it is `support`.
    """

    flange_a = port(Flange, doc="left side")
    flange_b = port(Flange, doc="right side")
    support = port(Flange, doc="guide, if use_support is True")
    s = var(unit="m", doc="position against the guide")
    v = var(unit="m/s", doc="speed against the guide")
    f = var(unit="N", doc="friction force, opposes v")
    mode = discrete(unit="1", doc="-1 sliding backward, 0 stuck, 1 sliding forward")
    use_support: bool = False
    f_pos: tuple[tuple[float, float], ...]
    v_unit: Param = param(unit="m/s", default=1.0, min=0, doc="unit of the speeds of f_pos")
    f_unit: Param = param(unit="N", default=1.0, min=0, doc="unit of the forces of f_pos")
    peak: Param = param(unit="1", default=1.0, min=1, doc="largest force of sticking as a multiple of K(0)")

    def __post_init__(self) -> None:
        check_rows(type(self).__name__, "f_pos", self.f_pos)

    def equations(self) -> Statements:
        yield self.flange_a.s == self.flange_b.s
        yield self.s == (self.flange_a.s - self.support.s if self.use_support else self.flange_a.s)
        yield self.v == der(self.s)
        level = self.f_unit * interpolated(self.f_pos, ca.fabs(self.v) / self.v_unit)
        static = self.peak * self.f_unit * interpolated(self.f_pos, ca.SX(0))
        yield self.f == dry_friction(self.v, level, static=static, mode=self.mode)
        yield self.flange_a.f + self.flange_b.f == self.f
        yield self.support.f == -self.f if self.use_support else self.support.s == 0


class MassWithStopAndFriction(Component):
    """Sliding body between hard stops, m a = f_a + f_b - f.

    Its friction is f = F_prop v + sgn v (F_Coulomb + F_Stribeck exp(-fexp |v|)), and sticking holds it exactly up to
    1.001 (F_Coulomb + F_Stribeck). Its ends stay between smin and smax: s between smin + L/2 and smax - L/2. At a stop
    its speed v becomes -e v, and 0 where |v| is below v_small; then the stop holds it.
    """

    flange_a = port(Flange, doc="left side")
    flange_b = port(Flange, doc="right side")
    s = var(unit="m", state_select="prefer", doc="position of the middle")
    v = var(unit="m/s", state_select="prefer", doc="speed")
    a = var(unit="m/s2", doc="acceleration")
    f = var(unit="N", doc="force of the guide and of the stops, opposes v")
    mode = discrete(unit="1", doc="-1 moving backward, 0 stuck or held, 1 moving forward, 2 without friction")
    m: Param = param(unit="kg", min=0, doc="mass")
    L: Param = param(unit="m", default=0.0, min=0, doc="length, from flange a to flange b")
    smin: Param = param(unit="m", default=-25.0, doc="left stop")
    smax: Param = param(unit="m", default=25.0, doc="right stop")
    F_prop: Param = param(unit="N.s/m", default=0.0, min=0, doc="viscous damping")
    F_Coulomb: Param = param(unit="N", default=0.0, min=0, doc="Coulomb friction force")
    F_Stribeck: Param = param(unit="N", default=0.0, min=0, doc="Stribeck force: what friction loses with speed")
    fexp: Param = param(unit="s/m", default=0.0, min=0, doc="how fast it loses that")
    e: Param = param(unit="1", default=0.0, min=0, max=1, doc="coefficient of restitution of the stops")
    v_small: Param = param(unit="m/s", default=1e-3, min=0, doc="speed below which a stop gives no rebound")

    def equations(self) -> Statements:
        low, high = self.smin + self.L / 2, self.smax - self.L / 2
        yield self.flange_a.s == self.s - self.L / 2
        yield self.flange_b.s == self.s + self.L / 2
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.m * self.a == self.flange_a.f + self.flange_b.f - self.f
        level = self.F_Coulomb + self.F_Stribeck * ca.exp(-self.fexp * ca.fabs(self.v))
        static = BREAKAWAY * (self.F_Coulomb + self.F_Stribeck)
        held_high, held_low = if_else(self.s > high, STOP, static), if_else(self.s < low, STOP, static)
        friction = dry_friction(self.v, level, static=held_high, static_neg=held_low, mode=self.mode)
        yield self.f == self.F_prop * self.v + friction
        rebound = ca.if_else(ca.fabs(self.v) > self.v_small, -self.e * self.v, 0)
        yield when(self.s > high, reinit(self.s, high), reinit(self.v, rebound))
        yield when(self.s < low, reinit(self.s, low), reinit(self.v, rebound))
