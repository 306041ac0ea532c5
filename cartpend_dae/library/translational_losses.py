"""Friction that a sliding joint can have besides Coulomb and viscous friction; signs as in `translational`.

Every level is 0 unless it is set, and then the component is not felt. None of them has events of its own: where
motion sticks, `dry_friction` says so.
"""

import casadi as ca

from cartpend_dae.language import Param, Statements, der, dry_friction, param, var
from cartpend_dae.library.laws import (
    breakaway_level,
    each_way,
    not_negative,
    presliding_rate,
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
        yield self.f == dry_friction(self.v_rel, level) + self.d * self.v_rel


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
        yield self.f == dry_friction(self.v_rel, level)


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
    """Dahl friction, f = f_c z, der(z) = (v - |v| z)/(s_s + |v| T_0), v = v_rel.

    z is the deflection of the contact in parts of that at sliding, s_s; the stiffness at rest is f_c/s_s. Above the
    speed s_s/T_0 it changes within T_0, so that fixed steps can follow it.
    """

    z = var(unit="1", doc="deflection of the contact, between -1 and 1")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level")
    s_s: Param = param(unit="m", default=0.002, min=0, doc="presliding length")
    T_0: Param = param(unit="s", default=0.005, min=0, doc="shortest time in which it changes")

    def equations(self) -> Statements:
        yield from super().equations()
        yield der(self.z) == presliding_rate(self.z, self.v_rel, self.s_s, self.T_0)
        yield self.f == self.f_c * self.z


class LuGreFriction(CompliantWithSpeed):
    """LuGre friction, f = g(v) z + d_1 (v - |v| z) + d v, der(z) = (v - |v| z)/(s_s + |v| T_0), v = v_rel.

    g = f_c + (f_s - f_c) exp(-(v/v_s)^2). z is the bristles' deflection in parts of that at sliding. In the
    paper's letters sigma_0 = g(v)/s_s and sigma_1 = d_1: the bristles slide at the deflection s_s at every speed,
    which keeps the law defined, and linear, where the levels are 0. Curve at steady speed, presliding and the lag
    of friction behind the speed are those of the paper. Above the speed s_s/T_0 the bristles take the time T_0.
    """

    z = var(unit="1", doc="deflection of the bristles, between -1 and 1")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level, at high speed")
    f_s: Param = param(unit="N", default=0.0, min=0, doc="peak, at low speed")
    v_s: Param = param(unit="m/s", default=0.02, min=0, doc="speed at which the peak has gone")
    s_s: Param = param(unit="m", default=0.002, min=0, doc="presliding length")
    d_1: Param = param(unit="N.s/m", default=0.0, min=0, doc="damping of the bristles")
    d: Param = param(unit="N.s/m", default=0.0, min=0, doc="viscous damping")
    T_0: Param = param(unit="s", default=0.005, min=0, doc="shortest time in which it changes")

    def equations(self) -> Statements:
        yield from super().equations()
        rate = presliding_rate(self.z, self.v_rel, self.s_s, self.T_0)
        level = stribeck_level(self.v_rel, self.f_c, self.f_s, self.v_s)
        yield der(self.z) == rate
        yield (
            self.f
            == level * self.z + self.d_1 * (self.s_s + ca.fabs(self.v_rel) * self.T_0) * rate + self.d * self.v_rel
        )


class MaxwellSlipFriction(CompliantWithSpeed):
    """Maxwell-slip friction, f = f_c (z_1 + z_2 + z_3 + z_4)/4: four springs that slip one after the other.

    Spring k slips after the way k s_s/4: der(z_k) = (v - |v| z_k |z_k|^3)/(k s_s/4 + 4 |v| T_0), v = v_rel; the
    power rounds the corner at which a spring begins to slip, so that the law has a slope everywhere. T_0 is the
    shortest time in which they change.
    """

    z_1 = var(unit="1", doc="deflection of the first spring, between -1 and 1")
    z_2 = var(unit="1", doc="deflection of the second spring")
    z_3 = var(unit="1", doc="deflection of the third spring")
    z_4 = var(unit="1", doc="deflection of the fourth spring")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="Coulomb level")
    s_s: Param = param(unit="m", default=0.002, min=0, doc="way after which all slip")
    T_0: Param = param(unit="s", default=0.005, min=0, doc="shortest time in which it changes")

    def equations(self) -> Statements:
        yield from super().equations()
        springs = (self.z_1, self.z_2, self.z_3, self.z_4)
        for k, z in enumerate(springs, start=1):
            yield der(z) == presliding_rate(z, self.v_rel, k * self.s_s / 4, self.T_0, order=4)
        yield self.f == self.f_c * (self.z_1 + self.z_2 + self.z_3 + self.z_4) / 4
