"""Springs, stops, inertia and loads that a sliding joint can have unnoticed; signs as in `translational`.

Every size is 0 unless it is set, and then the component is not felt.
"""

import casadi as ca

from cartpend_dae.language import Param, Statements, der, param, var
from cartpend_dae.library.laws import SHORTEST, bouc_wen_rate, contact, presliding_rate, wave
from cartpend_dae.library.translational import Compliant, CompliantWithSpeed


class AddedInertia(CompliantWithSpeed):
    """Inertia that was forgotten, f = m der(v_rel)."""

    m: Param = param(unit="kg", default=0.0, min=0, doc="mass")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.m * der(self.v_rel)


class MovingBase(CompliantWithSpeed):
    """Base under the whole rig, f = m_r der(der(q)), der(der(q)) = -w_c^2 (1 + n q^2) q - 2 D w_c der(q) - der(v_rel).

    The rig stands on the base with all that drives, holds and measures it, so that positions are against the base.
    A body of mass m on a base of mass m_b moves it by q m/(m_b + m), and m_r = m^2/(m_b + m); w_c is the natural
    frequency of the base with the body held on it, and (m_b + m) w_c^2 the base's stiffness.
    """

    q = var(unit="m", doc="motion of the base times (m_b + m)/m")
    qd = var(unit="m/s", doc="derivative of q")
    m_r: Param = param(unit="kg", default=0.0, min=0, doc="share of the body's mass that shakes the base")
    w_c: Param = param(unit="rad/s", default=20.0, min=0, doc="natural frequency of the base with the body held")
    D: Param = param(unit="1", default=0.1, min=0, doc="damping ratio of the base")
    n: Param = param(unit="1/m2", default=0.0, min=0, doc="hardening of the base")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.qd == der(self.q)
        spring = self.w_c * self.q * (1 + self.n * self.q**2)
        yield der(self.qd) + der(self.v_rel) == -self.w_c * (spring + 2 * self.D * self.qd)
        yield self.f == self.m_r * der(self.qd)


class OneSidedSpring(Compliant):
    """Spring above s_0, f = c max(0, s_rel - s_0); with `side` = -1 below, f = c min(0, s_rel - s_0).

    With a negative c it is what a spring beside it loses where it goes slack.
    """

    c: Param = param(unit="N/m", default=0.0, doc="stiffness")
    s_0: Param = param(unit="m", default=0.0, doc="where the spring begins")
    side: Param = param(unit="1", default=1.0, doc="1 above s_0, -1 below")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.c * self.side * ca.fmax(0, self.side * (self.s_rel - self.s_0))


class SlackSpring(Compliant):
    """What a spring lacks that cannot push, f = e c (max(0, h - s_0) - h), h = s_rel - s_rel0.

    Beside a spring of stiffness c and the same rest position; with e = 1 both together are c max(0, h - s_0).
    """

    e: Param = param(unit="1", default=0.0, min=0, doc="share of the spring that goes slack, 0 none, 1 all of it")
    s_0: Param = param(unit="m", default=0.0, doc="stretch from which the spring pulls")
    c: Param = param(unit="N/m", default=1.0, min=0, doc="stiffness of the spring")
    s_rel0: Param = param(unit="m", default=0.0, doc="where the spring beside it is at rest")

    def equations(self) -> Statements:
        yield from super().equations()
        stretch = self.s_rel - self.s_rel0
        yield self.f == self.e * self.c * (ca.fmax(0, stretch - self.s_0) - stretch)


class EndStop(CompliantWithSpeed):
    """Soft stop beyond s_m, f = c h^1.5 (1 + d_c der(h)), h = s_rel - s_m, never pulling.

    With `side` = -1 it stops motion downwards: h = -s_rel - s_m, and the force is negative.
    """

    c: Param = param(unit="N/m^(3/2)", default=0.0, min=0, doc="stiffness of the contact")
    d_c: Param = param(unit="s/m", default=0.2, min=0, doc="loss per speed of impact")
    s_m: Param = param(unit="m", default=0.1, doc="where the stop begins, counted to its side")
    side: Param = param(unit="1", default=1.0, doc="1 stops motion upwards, -1 downwards")

    def equations(self) -> Statements:
        yield from super().equations()
        depth = self.side * self.s_rel - self.s_m
        yield self.f == self.side * contact(depth, self.side * self.v_rel, self.c, self.d_c)


class Hysteresis(CompliantWithSpeed):
    """Bouc-Wen hysteresis, f = c_h z_h z, der(z) = (v - (beta |v| z + (1 - beta) v |z|) |z|^(n-1))/z_0, v = v_rel.

    z_0 = max(z_h, n |v| T_0). c_h is the stiffness at small amplitudes, c_h z_h the largest force.
    Stiffness beside it is an effect of its own.
    """

    z = var(unit="1", doc="memory, between -1 and 1")
    c_h: Param = param(unit="N/m", default=0.0, min=0, doc="stiffness at small amplitudes")
    z_h: Param = param(unit="m", default=0.01, min=0, doc="deflection at which it yields")
    beta: Param = param(unit="1", default=0.5, min=0.5, max=1, doc="shape of the loop; 1 is the widest")
    n: Param = param(unit="1", default=1.0, min=1, doc="how sharply it yields")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        yield der(self.z) == bouc_wen_rate(self.z, self.v_rel, self.z_h, self.T_0, self.beta, self.n)
        yield self.f == self.c_h * self.z_h * self.z


class RailUnevenness(Compliant):
    """Unevenness of a rail, f = w(k; f_sin, f_cos) + w(k_2; f_2_sin, f_2_cos): weight times slope, of two waves.

    w(k; a, b) = a sin(k s_rel) + b cos(k s_rel). No rail is a single wave; the second has a length of its own.
    """

    f_sin: Param = param(unit="N", default=0.0, doc="sine amplitude")
    f_cos: Param = param(unit="N", default=0.0, doc="cosine amplitude")
    k: Param = param(unit="rad/m", default=30.0, min=0, doc="wave number")
    f_2_sin: Param = param(unit="N", default=0.0, doc="sine amplitude of the second wave")
    f_2_cos: Param = param(unit="N", default=0.0, doc="cosine amplitude of the second wave")
    k_2: Param = param(unit="rad/m", default=60.0, min=0, doc="wave number of the second wave")

    def equations(self) -> Statements:
        yield from super().equations()
        first = wave(self.k * self.s_rel, self.f_sin, self.f_cos)
        yield self.f == first + wave(self.k_2 * self.s_rel, self.f_2_sin, self.f_2_cos)


class CableDrag(CompliantWithSpeed):
    """Drag of a cable or hose, f = c s_rel - f_0 + f_c z, der(z) = (v - |v| z)/max(s_s, |v| T_0), v = v_rel.

    Its spring is at ease where s_rel = f_0/c.
    """

    z = var(unit="1", doc="state of the memory, between -1 and 1")
    c: Param = param(unit="N/m", default=0.0, min=0, doc="stiffness of the cable")
    f_0: Param = param(unit="N", default=0.0, doc="preload of its spring, towards larger s_rel")
    f_c: Param = param(unit="N", default=0.0, min=0, doc="half the height of the loop")
    s_s: Param = param(unit="m", default=0.02, min=0, doc="way after a reversal until the other branch is reached")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        yield der(self.z) == presliding_rate(self.z, self.v_rel, self.s_s, self.T_0)
        yield self.f == self.c * self.s_rel - self.f_0 + self.f_c * self.z
