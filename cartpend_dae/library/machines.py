"""DC machines with their losses, and the averaged converter that feeds them."""

from itertools import pairwise

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, connect, der, param, port, var
from cartpend_dae.library import rotational
from cartpend_dae.library.electrical import EMF, Inductor, Pin, Resistor
from cartpend_dae.library.electrical_sources import Brush, Conductor


class MachineFriction(Component):
    """Friction and windage, tau = (P_ref/w_ref) (|w|/w_ref)^power sgn w, linear below w_ref/1000; opposes w."""

    flange = port(rotational.Flange, doc="shaft")
    w = var(unit="rad/s", doc="speed")
    tau = var(unit="N.m", doc="friction torque, opposes w")
    P_ref: Param = param(unit="W", min=0, doc="loss at w_ref")
    w_ref: Param = param(unit="rad/s", min=0, doc="reference speed")
    power: Param = param(unit="1", default=2.0, min=0, doc="exponent of the torque")

    def equations(self) -> Statements:
        z, linear = self.w / self.w_ref, 1e-3
        size = ca.fabs(z)
        curve = ca.if_else(size < linear, z * linear ** (self.power - 1), ca.sign(z) * size**self.power)
        yield self.w == der(self.flange.phi)
        yield self.tau == self.P_ref / self.w_ref * curve
        yield self.flange.tau == self.tau


class StrayLoad(Component):
    """Stray load loss, tau = (P_ref/w_ref) (i/I_ref)^2 w/w_ref, in the line of the current without a drop."""

    pin_p = port(Pin, doc="positive pin")
    pin_n = port(Pin, doc="negative pin")
    flange = port(rotational.Flange, doc="shaft")
    i = var(unit="A", doc="current from pin_p to pin_n")
    w = var(unit="rad/s", doc="speed")
    tau = var(unit="N.m", doc="braking torque")
    P_ref: Param = param(unit="W", min=0, doc="loss at I_ref and w_ref")
    I_ref: Param = param(unit="A", min=0, doc="reference current")
    w_ref: Param = param(unit="rad/s", min=0, doc="reference speed")

    def equations(self) -> Statements:
        yield self.pin_p.v == self.pin_n.v
        yield self.pin_p.i + self.pin_n.i == 0
        yield self.i == self.pin_p.i
        yield self.w == der(self.flange.phi)
        yield self.tau == self.P_ref / self.w_ref * (self.i / self.I_ref) ** 2 * self.w / self.w_ref
        yield self.flange.tau == self.tau


def warm(R: ca.SX, alpha20: ca.SX, T_ref: ca.SX, T: ca.SX) -> ca.SX:
    """Return the resistance at T [K] of a winding that has R at T_ref; alpha20 [1/K] holds at 293.15 K."""
    return R * (1 + alpha20 / (1 + alpha20 * (T_ref - 293.15)) * (T - T_ref))


class DCPermanentMagnet(Component):
    """DC machine with permanent magnets, v_a = ra i + la der(i) + k w, J_r der(w) = k i + tau_flange, with losses.

    The constant k follows from the nominal point: k w_nominal = Va_nominal - R(Ta_nominal) Ia_nominal - brush drop.
    The winding has the resistance Ra at Ta_ref and works at Ta_operational, with the coefficient alpha20a at 20 degC.
    Losses are given at the nominal point: friction_P, core_P (in parallel to inductance and EMF), stray_P, and the
    brushes' drop brush_V, linear below brush_I. La and Jr are inductance and rotor inertia. A loss of the number 0
    has no part. The stator is on the ground.
    """

    pin_ap = port(Pin, doc="positive terminal of the armature")
    pin_an = port(Pin, doc="negative terminal of the armature")
    flange = port(rotational.Flange, doc="shaft")
    phi_mechanical = var(unit="rad", doc="angle of the shaft")
    w_mechanical = var(unit="rad/s", doc="speed of the shaft")
    ia = var(unit="A", doc="current into the positive terminal")
    Va_nominal: Param = param(unit="V", doc="nominal voltage")
    Ia_nominal: Param = param(unit="A", doc="nominal current")
    w_nominal: Param = param(unit="rad/s", doc="nominal speed")
    Ra: Param = param(unit="Ohm", min=0, doc="armature resistance at Ta_ref")
    La: Param = param(unit="H", min=0, doc="armature inductance")
    Jr: Param = param(unit="kg.m2", min=0, doc="moment of inertia of the rotor")
    alpha20a: Param = param(unit="1/K", default=0.0, doc="temperature coefficient of the winding at 20 degC")
    Ta_ref: Param = param(unit="K", default=293.15, min=0, doc="temperature at which Ra holds")
    Ta_nominal: Param = param(unit="K", default=293.15, min=0, doc="winding temperature of the nominal point")
    Ta_operational: Param = param(unit="K", default=293.15, min=0, doc="winding temperature")
    friction_P: Param = param(unit="W", default=0.0, min=0, doc="friction loss at nominal speed")
    core_P: Param = param(unit="W", default=0.0, min=0, doc="core loss at the nominal point")
    stray_P: Param = param(unit="W", default=0.0, min=0, doc="stray load loss at the nominal point")
    brush_V: Param = param(unit="V", default=0.0, min=0, doc="voltage drop of the brushes")
    brush_I: Param = param(unit="A", default=1.0, min=0, doc="current up to which the brushes' drop is linear")

    def __post_init__(self) -> None:
        hot = warm(self.Ra, self.alpha20a, self.Ta_ref, self.Ta_nominal)
        drop = 0 if self.is_zero("brush_V") else self.brush_V * ca.fmin(self.Ia_nominal / self.brush_I, 1)
        V_i = self.Va_nominal - hot * self.Ia_nominal - drop
        nominal = {"w_ref": self.w_nominal}
        self.ra = Resistor(R=warm(self.Ra, self.alpha20a, self.Ta_ref, self.Ta_operational))
        self.la, self.emf, self.rotor = Inductor(L=self.La), EMF(k=V_i / self.w_nominal), rotational.Inertia(J=self.Jr)
        self.brush = None if self.is_zero("brush_V") else Brush(V=self.brush_V, I_linear=self.brush_I)
        self.core = None if self.is_zero("core_P") else Conductor(G=self.core_P / V_i**2)
        self.friction = None if self.is_zero("friction_P") else MachineFriction(P_ref=self.friction_P, **nominal)
        self.stray = (
            None if self.is_zero("stray_P") else StrayLoad(P_ref=self.stray_P, I_ref=self.Ia_nominal, **nominal)
        )

    def equations(self) -> Statements:
        yield self.phi_mechanical == self.flange.phi
        yield self.w_mechanical == self.rotor.w
        yield self.ia == self.pin_ap.i
        line = [part for part in (self.ra, self.brush, self.stray) if part is not None]
        yield connect(self.pin_ap, line[0].pin_p)
        for left, right in pairwise(line):
            yield connect(left.pin_n, right.pin_p)
        yield connect(line[-1].pin_n, self.la.pin_p)
        yield connect(self.la.pin_n, self.emf.pin_p)
        yield connect(self.emf.pin_n, self.pin_an)
        if self.core is not None:
            yield connect(self.core.pin_p, self.la.pin_p)
            yield connect(self.core.pin_n, self.pin_an)
        yield connect(self.emf.flange, self.rotor.flange_a)
        yield connect(self.rotor.flange_b, self.flange)
        for loss in (self.friction, self.stray):
            if loss is not None:
                yield connect(loss.flange, self.flange)
