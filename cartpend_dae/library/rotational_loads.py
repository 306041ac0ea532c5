"""Springs, stops, inertia and loads that a turning joint can have unnoticed; signs as in `rotational`.

Every size is 0 unless it is set, and then the component is not felt.
"""

import casadi as ca

from cartpend_dae.language import Param, Statements, der, initial, param, var
from cartpend_dae.library.laws import SHORTEST, bouc_wen_rate, contact, wave
from cartpend_dae.library.rotational import Compliant, CompliantWithSpeed


class AddedInertia(CompliantWithSpeed):
    """Inertia that was forgotten, tau = J der(w_rel)."""

    J: Param = param(unit="kg.m2", default=0.0, min=0, doc="moment of inertia")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.J * der(self.w_rel)


class OneSidedSpring(Compliant):
    """Spring above phi_0, tau = c max(0, phi_rel - phi_0); with `side` = -1 below, tau = c min(0, phi_rel - phi_0).

    With a negative c it is what a spring beside it loses where it goes slack.
    """

    c: Param = param(unit="N.m/rad", default=0.0, doc="stiffness")
    phi_0: Param = param(unit="rad", default=0.0, doc="where the spring begins")
    side: Param = param(unit="1", default=1.0, doc="1 above phi_0, -1 below")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.c * self.side * ca.fmax(0, self.side * (self.phi_rel - self.phi_0))


class SlackSpring(Compliant):
    """What a spring lacks that cannot push, tau = e c (max(0, h - phi_0) - h), h = phi_rel - phi_rel0.

    Beside a spring of stiffness c and the same rest position; with e = 1 both together are c max(0, h - phi_0).
    """

    e: Param = param(unit="1", default=0.0, min=0, doc="share of the spring that goes slack, 0 none, 1 all of it")
    phi_0: Param = param(unit="rad", default=0.0, doc="stretch from which the spring pulls")
    c: Param = param(unit="N.m/rad", default=1.0, min=0, doc="stiffness of the spring")
    phi_rel0: Param = param(unit="rad", default=0.0, doc="where the spring beside it is at rest")

    def equations(self) -> Statements:
        yield from super().equations()
        stretch = self.phi_rel - self.phi_rel0
        yield self.tau == self.e * self.c * (ca.fmax(0, stretch - self.phi_0) - stretch)


class EndStop(CompliantWithSpeed):
    """Soft stop beyond phi_m, tau = c h^1.5 (1 + d_c der(h)), h = phi_rel - phi_m, never pulling.

    With `side` = -1 it stops motion downwards: h = -phi_rel - phi_m, and the torque is negative.
    """

    c: Param = param(unit="N.m", default=0.0, min=0, doc="stiffness of the contact")
    d_c: Param = param(unit="s/rad", default=0.2, min=0, doc="loss per speed of impact")
    phi_m: Param = param(unit="rad", default=0.5, doc="where the stop begins, counted to its side")
    side: Param = param(unit="1", default=1.0, doc="1 stops motion upwards, -1 downwards")

    def equations(self) -> Statements:
        yield from super().equations()
        depth = self.side * self.phi_rel - self.phi_m
        yield self.tau == self.side * contact(depth, self.side * self.w_rel, self.c, self.d_c)


class Hysteresis(CompliantWithSpeed):
    """Bouc-Wen hysteresis, tau = c_h z_h z, der(z) = (v - (beta |v| z + (1 - beta) v |z|) |z|^(n-1))/z_0, v = w_rel.

    z_0 = max(z_h, n |v| T_0). c_h is the stiffness at small amplitudes, c_h z_h the largest torque.
    Stiffness beside it is an effect of its own.
    """

    z = var(unit="1", doc="memory, between -1 and 1")
    c_h: Param = param(unit="N.m/rad", default=0.0, min=0, doc="stiffness at small amplitudes")
    z_h: Param = param(unit="rad", default=0.1, min=0, doc="deflection at which it yields")
    beta: Param = param(unit="1", default=0.5, min=0.5, max=1, doc="shape of the loop; 1 is the widest")
    n: Param = param(unit="1", default=1.0, min=1, doc="how sharply it yields")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="shortest time of change", is_shortest_time=True)

    def equations(self) -> Statements:
        yield from super().equations()
        yield der(self.z) == bouc_wen_rate(self.z, self.w_rel, self.z_h, self.T_0, self.beta, self.n)
        yield self.tau == self.c_h * self.z_h * self.z


class Cogging(Compliant):
    """Cogging, tau = tau_k_sin sin a + tau_k_cos cos a + tau_k_2_sin sin 2a + tau_k_2_cos cos 2a, with a = n phi_rel.

    It is a wave of the angle and its second harmonic, whatever the current is.
    """

    tau_k_sin: Param = param(unit="N.m", default=0.0, doc="sine amplitude")
    tau_k_cos: Param = param(unit="N.m", default=0.0, doc="cosine amplitude")
    tau_k_2_sin: Param = param(unit="N.m", default=0.0, doc="sine amplitude of the second harmonic")
    tau_k_2_cos: Param = param(unit="N.m", default=0.0, doc="cosine amplitude of the second harmonic")
    n: Param = param(unit="1", default=12.0, min=0, doc="periods per turn")

    def equations(self) -> Statements:
        yield from super().equations()
        angle = self.n * self.phi_rel
        first = wave(angle, self.tau_k_sin, self.tau_k_cos)
        yield self.tau == first + wave(2 * angle, self.tau_k_2_sin, self.tau_k_2_cos)


class Imbalance(Compliant):
    """Weight off the axis, tau = tau_sin sin(phi_rel) + tau_cos cos(phi_rel), as of an offset pivot."""

    tau_sin: Param = param(unit="N.m", default=0.0, doc="sine amplitude, m g times the offset along phi_rel = 0")
    tau_cos: Param = param(unit="N.m", default=0.0, doc="cosine amplitude, m g times the offset across")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == wave(self.phi_rel, self.tau_sin, self.tau_cos)


class BearingTorsion(CompliantWithSpeed):
    """Torsion of a cable or of grease, tau = c phi_rel + c_1 (x + e_0 y), der(x) = w_rel - x/T_1: part is forgotten.

    y is the angle of the start, which is forgotten in the same way, der(y) = -y/T_1: e_0 is 0 after a long rest there,
    and 1 if it has just been brought there.
    """

    x = var(unit="rad", doc="angle since the start that is not forgotten yet")
    y = var(unit="rad", doc="angle of the start that is not forgotten yet")
    c: Param = param(unit="N.m/rad", default=0.0, min=0, doc="stiffness that stays")
    c_1: Param = param(unit="N.m/rad", default=0.0, min=0, doc="stiffness that relaxes")
    T_1: Param = param(unit="s", default=0.5, min=0, doc="time in which it relaxes")
    e_0: Param = param(unit="1", default=0.0, min=0, max=1, doc="share of the angle not forgotten at the start")

    def equations(self) -> Statements:
        yield from super().equations()
        yield der(self.x) == self.w_rel - self.x / self.T_1
        yield der(self.y) == -self.y / self.T_1
        yield initial(self.y == self.phi_rel)
        yield self.tau == self.c * self.phi_rel + self.c_1 * (self.x + self.e_0 * self.y)


class FlexibleRod(CompliantWithSpeed):
    """Flexible rod, tau = J_1 der(der(q)), der(der(q)) = -w_1^2 (q + n q^3) - 2 D w_1 der(q) - der(w_rel).

    The share J_1 of the moment of inertia that the model has is not rigid, but swings by q against the rest, in the
    first mode. As it bends further it gets stiffer by n.
    """

    q = var(unit="rad", doc="deflection of the mode")
    qd = var(unit="rad/s", doc="derivative of q")
    J_1: Param = param(unit="kg.m2", default=0.0, min=0, doc="moment of inertia that takes part in the mode")
    w_1: Param = param(unit="rad/s", default=40.0, min=0, doc="frequency of the mode with the shaft held")
    D: Param = param(unit="1", default=0.02, min=0, doc="damping ratio of the mode")
    n: Param = param(unit="1/rad2", default=0.0, min=0, doc="hardening: by it times q^2 the mode is stiffer")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.qd == der(self.q)
        push = self.w_1 * self.q * (1 + self.n * self.q**2)
        yield der(self.qd) + der(self.w_rel) == -self.w_1 * (push + 2 * self.D * self.qd)
        yield self.tau == self.J_1 * der(self.qd)
