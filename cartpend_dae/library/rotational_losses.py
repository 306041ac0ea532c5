"""Friction that a turning joint can have besides Coulomb and viscous friction; signs as in `rotational`.

Every level is 0 unless it is set, and then the component is not felt. None of them has events of its own: where
motion sticks, `dry_friction` says so.
"""

import casadi as ca

from cartpend_dae.language import Param, Statements, der, dry_friction, initial, param, signal, var
from cartpend_dae.library.laws import (
    SHORTEST,
    beyond,
    breakaway_level,
    creep_level,
    each_way,
    not_negative,
    presliding_rate,
    slipping_rate,
    stribeck_level,
    wave,
)
from cartpend_dae.library.rotational import CompliantWithSpeed


class StribeckFriction(CompliantWithSpeed):
    """Stribeck friction, tau = (tau_c + (tau_s - tau_c) exp(-(v/w_s)^2)) sgn v + d v, v = w_rel, sticking exactly."""

    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level, at high speed")
    tau_s: Param = param(unit="N.m", default=0.0, min=0, doc="peak, at rest")
    w_s: Param = param(unit="rad/s", default=0.5, min=0, doc="speed at which the peak has gone")
    d: Param = param(unit="N.m.s/rad", default=0.0, min=0, doc="viscous damping")

    def equations(self) -> Statements:
        yield from super().equations()
        level = stribeck_level(self.w_rel, self.tau_c, self.tau_s, self.w_s)
        yield self.tau == dry_friction(self.w_rel, level, static=self.tau_s) + self.d * self.w_rel


class BreakawayFriction(CompliantWithSpeed):
    """Coulomb friction with break-away, tau = tau_c sgn w_rel, rising to tau_s from the speed w_s down to rest.

    The band below w_s is that of Karnopp's stiction; a narrow one is the textbook's static friction.
    """

    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level, while sliding")
    tau_s: Param = param(unit="N.m", default=0.0, min=0, doc="break-away torque")
    w_s: Param = param(unit="rad/s", default=0.5, min=0, doc="half width of the band of speeds around rest")

    def equations(self) -> Statements:
        yield from super().equations()
        level = breakaway_level(self.w_rel, self.tau_c, self.tau_s, self.w_s)
        yield self.tau == dry_friction(self.w_rel, level, static=self.tau_s)


class CreepingFriction(CompliantWithSpeed):
    """Coulomb friction that creeps instead of sticking, tau = tau_c tanh(w_rel/w_r).

    A film or grease yields before the contact slides: below w_r the torque grows with the speed, and is 0 at rest. The
    narrower w_r, the nearer to Coulomb friction; steps end where the motion turns, as there.

    References
    ----------
    S. Andersson, A. Soderberg, S. Bjorklund, Tribology International 40 (2007), 580-587,
    doi:10.1016/j.triboint.2005.11.014.
    """

    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level, while sliding")
    w_r: Param = param(unit="rad/s", default=0.05, min=0, doc="speed below which it creeps")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == dry_friction(self.w_rel, creep_level(self.w_rel, self.tau_c, self.w_r))


class AsymmetricFriction(CompliantWithSpeed):
    """Friction by direction, tau = tau_c_pos + d_pos v forward, tau = -tau_c_neg + d_neg v backward, v = w_rel."""

    tau_c_pos: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level forward")
    tau_c_neg: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level backward")
    d_pos: Param = param(unit="N.m.s/rad", default=0.0, min=0, doc="viscous damping forward")
    d_neg: Param = param(unit="N.m.s/rad", default=0.0, min=0, doc="viscous damping backward")

    def equations(self) -> Statements:
        yield from super().equations()
        viscous = each_way(self.w_rel, self.d_pos, self.d_neg)
        yield self.tau == dry_friction(self.w_rel, self.tau_c_pos, self.tau_c_neg) + viscous


class PositionDependentFriction(CompliantWithSpeed):
    """Friction that changes along the way, tau = (tau_c + tau_c_sin sin(n x) + tau_c_cos cos(n x)) sgn w_rel.

    x = phi_rel. Where the sum is negative there is no friction.
    """

    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="mean Coulomb level")
    tau_c_sin: Param = param(unit="N.m", default=0.0, doc="sine amplitude of the level")
    tau_c_cos: Param = param(unit="N.m", default=0.0, doc="cosine amplitude of the level")
    n: Param = param(unit="1", default=1.0, min=0, doc="order")

    def equations(self) -> Statements:
        yield from super().equations()
        level = self.tau_c + wave(self.n * self.phi_rel, self.tau_c_sin, self.tau_c_cos)
        yield self.tau == dry_friction(self.w_rel, not_negative(level))


class RadialLoadFriction(CompliantWithSpeed):
    """Friction of a bearing that carries the force N, tau = (tau_c + r_f |y| + r_2 y^2) sgn w_rel, with exact sticking.

    y follows N with the lag T_f, so that friction does not depend on itself at the same instant; with k_s = 1 it
    follows N_s instead, the load that weight and swing make, as in laws of a cart and pole that leave out the
    acceleration of the cart.
    """

    N = signal("in", unit="N", doc="force that the bearing carries")
    N_s = signal("in", unit="N", doc="part of it that weight and swing make")
    y = var(unit="N", doc="force that the bearing carries, smoothed")
    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level without load")
    r_f: Param = param(unit="m", default=0.0, min=0, doc="radius of the journal times its coefficient of friction")
    r_2: Param = param(unit="m/N", default=0.0, min=0, doc="growth of that product with the force")
    k_s: Param = param(unit="1", default=0.0, min=0, max=1, doc="how far the load is that of weight and swing alone")
    T_f: Param = param(unit="s", default=SHORTEST, min=0, doc="lag of the load", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        load = (1 - self.k_s) * self.N + self.k_s * self.N_s
        yield self.T_f * der(self.y) == load - self.y
        yield initial(self.y == load, fixed=False)
        level = self.tau_c + self.r_f * ca.fabs(self.y) + self.r_2 * self.y**2
        yield self.tau == dry_friction(self.w_rel, level)


class DahlFriction(CompliantWithSpeed):
    """Dahl friction, tau = tau_c z, der(z) = v (1 - z sgn v)^a/max(phi_s, |v| T_0), v = w_rel.

    z is the deflection of the contact in parts of that at sliding, phi_s; the stiffness at rest is tau_c/phi_s. Above
    the speed phi_s/T_0 it changes within T_0, so that fixed steps can follow it.
    """

    z = var(unit="1", doc="deflection of the contact, between -1 and 1")
    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level")
    phi_s: Param = param(unit="rad", default=0.02, min=0, doc="presliding angle")
    a: Param = param(unit="1", default=1.0, min=1, doc="exponent, 2 where it yields more gradually")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        yield der(self.z) == presliding_rate(self.z, self.w_rel, self.phi_s, self.T_0, exponent=self.a)
        yield self.tau == self.tau_c * self.z


class LuGreFriction(CompliantWithSpeed):
    """LuGre friction, tau = tau_c z + d_1 (v - |v| z/r) + d v, der(z) = (v - |v| z/r)/max(phi_s, |v| T_0), v = w_rel.

    r = 1 + (r_s - 1) exp(-(v/w_s)^2). z is the bristles' deflection in parts of phi_s, that of sliding at high speed.
    In the paper's letters sigma_0 = tau_c/phi_s, sigma_1 = d_1 and g(v) = tau_c r. As the peak is a ratio, the law is
    defined, and linear, where the levels are 0. Above the speed phi_s/T_0 the bristles take the time T_0.
    """

    z = var(unit="1", doc="deflection of the bristles, between -r_s and r_s")
    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level, at high speed")
    r_s: Param = param(unit="1", default=1.0, min=1, doc="peak, at low speed, in parts of the Coulomb level")
    w_s: Param = param(unit="rad/s", default=0.5, min=0, doc="speed at which the peak has gone")
    phi_s: Param = param(unit="rad", default=0.02, min=0, doc="presliding angle")
    d_1: Param = param(unit="N.m.s/rad", default=0.0, min=0, doc="damping of the bristles")
    d: Param = param(unit="N.m.s/rad", default=0.0, min=0, doc="viscous damping")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        ratio = stribeck_level(self.w_rel, ca.SX(1), self.r_s, self.w_s)
        yield der(self.z) == presliding_rate(self.z, self.w_rel, self.phi_s, self.T_0, ratio)
        slip = self.w_rel - ca.fabs(self.w_rel) * self.z / ratio
        yield self.tau == self.tau_c * self.z + self.d_1 * slip + self.d * self.w_rel


class MaxwellSlipFriction(CompliantWithSpeed):
    """Maxwell-slip friction, tau = tau_c (y_1 + y_2 + y_3 + y_4)/4: four springs that slip one after the other.

    Spring k slips after the way s = phi_s (k/4)^(1 + p): der(z_k) = v/s - (z_k - y_k)/T_0, v = w_rel; y_k is z_k cut
    off at -1 and 1. While it slips z_k is beyond by v T_0/s, of which nothing is left when the motion turns. With p > 0
    most of the contacts slip early, as in joints whose contacts have limits of a density that falls with a power.
    """

    z_1 = var(unit="1", doc="deflection of the first spring, slipping beyond -1 and 1")
    z_2 = var(unit="1", doc="deflection of the second spring")
    z_3 = var(unit="1", doc="deflection of the third spring")
    z_4 = var(unit="1", doc="deflection of the fourth spring")
    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="Coulomb level")
    phi_s: Param = param(unit="rad", default=0.02, min=0, doc="way after which all slip")
    p: Param = param(unit="1", default=0.0, min=-0.5, max=3.0, doc="by how much the power of their ways is more than 1")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        springs = (self.z_1, self.z_2, self.z_3, self.z_4)
        for k, z in enumerate(springs, start=1):
            way = self.phi_s * (k / 4) ** (1 + self.p)
            yield der(z) == slipping_rate(z, self.w_rel, way, self.T_0)
        yield self.tau == self.tau_c * sum(z - beyond(z, -1.0, 1.0) for z in springs) / 4


class IronLoss(CompliantWithSpeed):
    """Loss in the iron of a machine, tau = d w_rel + tau_c sgn w_rel + tau_e |w_rel/w_1|^0.5 sgn w_rel.

    The terms are eddy currents, remagnetisation, and the excess of moving domain walls, which grows with the power 1.5
    of the frequency. Near rest that one has a slope: the speed is sqrt(w_rel^2 + w_0^2) under the root.
    """

    d: Param = param(unit="N.m.s/rad", default=0.0, min=0, doc="eddy currents")
    tau_c: Param = param(unit="N.m", default=0.0, min=0, doc="remagnetisation (hysteresis of the iron)")
    tau_e: Param = param(unit="N.m", default=0.0, min=0, doc="excess loss at the speed w_1")
    w_1: Param = param(unit="rad/s", default=1.0, min=0, doc="speed at which the excess loss is tau_e")
    w_0: Param = param(unit="rad/s", default=0.1, min=0, doc="speed below which the excess loss has a slope")

    def equations(self) -> Statements:
        yield from super().equations()
        excess = self.w_rel / (self.w_1 * ca.sqrt(self.w_rel**2 + self.w_0**2)) ** 0.5
        yield self.tau == self.d * self.w_rel + dry_friction(self.w_rel, self.tau_c) + self.tau_e * excess
