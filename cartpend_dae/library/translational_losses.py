"""Friction that a sliding joint can have besides Coulomb and viscous friction; signs as in `translational`.

Every level is 0 unless it is set, and then the component is not felt. None of them has events of its own: where
motion sticks, `dry_friction` says so.
"""

import casadi as ca

from cartpend_dae.language import Param, Statements, der, dry_friction, param, var
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
from cartpend_dae.library.translational import CompliantWithSpeed


class StribeckFriction(CompliantWithSpeed):
    """Stribeck friction, f = (f_c + (f_s - f_c) exp(-(v/v_s)^2)) sgn v + d v, v = v_rel, sticking exactly."""

    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level, at high speed")
    f_s: Param = param(unit="N", default=0.0, min=0, doc="peak, at rest")
    v_s: Param = param(unit="m/s", default=0.02, min=0, doc="speed at which the peak has gone")
    d: Param = param(unit="N.s/m", default=0.0, min=0, doc="viscous damping")

    def equations(self) -> Statements:
        yield from super().equations()
        level = stribeck_level(self.v_rel, self.f_c, self.f_s, self.v_s)
        yield self.f == dry_friction(self.v_rel, level, static=self.f_s) + self.d * self.v_rel


class BreakawayFriction(CompliantWithSpeed):
    """Coulomb friction with break-away, f = f_c sgn v_rel, rising to f_s from the speed v_s down to rest.

    The band below v_s is that of Karnopp's stiction; a narrow one is the textbook's static friction.
    """

    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level, while sliding")
    f_s: Param = param(unit="N", default=0.0, min=0, doc="break-away force")
    v_s: Param = param(unit="m/s", default=0.02, min=0, doc="half width of the band of speeds around rest")

    def equations(self) -> Statements:
        yield from super().equations()
        level = breakaway_level(self.v_rel, self.f_c, self.f_s, self.v_s)
        yield self.f == dry_friction(self.v_rel, level, static=self.f_s)


class CreepingFriction(CompliantWithSpeed):
    """Coulomb friction that creeps instead of sticking, f = f_c tanh(v_rel/v_r).

    A film or grease yields before the contact slides: below v_r the force grows with the speed, and is 0 at rest. The
    narrower v_r, the nearer to Coulomb friction; steps end where the motion turns, as there.

    References
    ----------
    S. Andersson, A. Soderberg, S. Bjorklund, Tribology International 40 (2007), 580-587,
    doi:10.1016/j.triboint.2005.11.014.
    """

    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level, while sliding")
    v_r: Param = param(unit="m/s", default=0.005, min=0, doc="speed below which it creeps")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == dry_friction(self.v_rel, creep_level(self.v_rel, self.f_c, self.v_r))


class AsymmetricFriction(CompliantWithSpeed):
    """Friction by direction, f = f_c_pos + d_pos v forward, f = -f_c_neg + d_neg v backward, v = v_rel."""

    f_c_pos: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level forward")
    f_c_neg: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level backward")
    d_pos: Param = param(unit="N.s/m", default=0.0, min=0, doc="viscous damping forward")
    d_neg: Param = param(unit="N.s/m", default=0.0, min=0, doc="viscous damping backward")

    def equations(self) -> Statements:
        yield from super().equations()
        viscous = each_way(self.v_rel, self.d_pos, self.d_neg)
        yield self.f == dry_friction(self.v_rel, self.f_c_pos, self.f_c_neg) + viscous


class PositionDependentFriction(CompliantWithSpeed):
    """Friction that changes along the way, f = (f_c + f_c_sin sin(k x) + f_c_cos cos(k x)) sgn v_rel.

    x = s_rel. Where the sum is negative there is no friction.
    """

    f_c: Param = param(unit="N", default=0.0, min=0, doc="mean Coulomb level")
    f_c_sin: Param = param(unit="N", default=0.0, doc="sine amplitude of the level")
    f_c_cos: Param = param(unit="N", default=0.0, doc="cosine amplitude of the level")
    k: Param = param(unit="rad/m", default=30.0, min=0, doc="wave number")

    def equations(self) -> Statements:
        yield from super().equations()
        level = self.f_c + wave(self.k * self.s_rel, self.f_c_sin, self.f_c_cos)
        yield self.f == dry_friction(self.v_rel, not_negative(level))


class DahlFriction(CompliantWithSpeed):
    """Dahl friction, f = f_c z, der(z) = v (1 - z sgn v)^a/max(s_s, |v| T_0), v = v_rel.

    z is the deflection of the contact in parts of that at sliding, s_s; the stiffness at rest is f_c/s_s. Above the
    speed s_s/T_0 it changes within T_0, so that fixed steps can follow it.
    """

    z = var(unit="1", doc="deflection of the contact, between -1 and 1")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level")
    s_s: Param = param(unit="m", default=0.002, min=0, doc="presliding length")
    a: Param = param(unit="1", default=1.0, min=1, doc="exponent, 2 where it yields more gradually")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        yield der(self.z) == presliding_rate(self.z, self.v_rel, self.s_s, self.T_0, exponent=self.a)
        yield self.f == self.f_c * self.z


class LuGreFriction(CompliantWithSpeed):
    """LuGre friction, f = f_c z + d_1 (v - |v| z/r) + d v, der(z) = (v - |v| z/r)/max(s_s, |v| T_0), v = v_rel.

    r = 1 + (r_s - 1) exp(-(v/v_s)^2). z is the bristles' deflection in parts of s_s, that of sliding at high speed.
    In the paper's letters sigma_0 = f_c/s_s, sigma_1 = d_1 and g(v) = f_c r. As the peak is a ratio, the law is
    defined, and linear, where the levels are 0. Above the speed s_s/T_0 the bristles take the time T_0.
    """

    z = var(unit="1", doc="deflection of the bristles, between -r_s and r_s")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level, at high speed")
    r_s: Param = param(unit="1", default=1.0, min=1, doc="peak, at low speed, in parts of the Coulomb level")
    v_s: Param = param(unit="m/s", default=0.02, min=0, doc="speed at which the peak has gone")
    s_s: Param = param(unit="m", default=0.002, min=0, doc="presliding length")
    d_1: Param = param(unit="N.s/m", default=0.0, min=0, doc="damping of the bristles")
    d: Param = param(unit="N.s/m", default=0.0, min=0, doc="viscous damping")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        ratio = stribeck_level(self.v_rel, ca.SX(1), self.r_s, self.v_s)
        yield der(self.z) == presliding_rate(self.z, self.v_rel, self.s_s, self.T_0, ratio)
        slip = self.v_rel - ca.fabs(self.v_rel) * self.z / ratio
        yield self.f == self.f_c * self.z + self.d_1 * slip + self.d * self.v_rel


class MaxwellSlipFriction(CompliantWithSpeed):
    """Maxwell-slip friction, f = f_c (y_1 + y_2 + y_3 + y_4)/4: four springs that slip one after the other.

    Spring k slips after the way s = s_s (k/4)^(1 + p): der(z_k) = v/s - (z_k - y_k)/T_0, v = v_rel; y_k is z_k cut
    off at -1 and 1. While it slips z_k is beyond by v T_0/s, of which nothing is left when the motion turns. With p > 0
    most of the contacts slip early, as in joints whose contacts have limits of a density that falls with a power.
    """

    z_1 = var(unit="1", doc="deflection of the first spring, slipping beyond -1 and 1")
    z_2 = var(unit="1", doc="deflection of the second spring")
    z_3 = var(unit="1", doc="deflection of the third spring")
    z_4 = var(unit="1", doc="deflection of the fourth spring")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level")
    s_s: Param = param(unit="m", default=0.002, min=0, doc="way after which all slip")
    p: Param = param(unit="1", default=0.0, min=-0.5, max=3.0, doc="by how much the power of their ways is more than 1")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        springs = (self.z_1, self.z_2, self.z_3, self.z_4)
        for k, z in enumerate(springs, start=1):
            way = self.s_s * (k / 4) ** (1 + self.p)
            yield der(z) == slipping_rate(z, self.v_rel, way, self.T_0)
        yield self.f == self.f_c * sum(z - beyond(z, -1.0, 1.0) for z in springs) / 4
