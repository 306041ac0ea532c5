"""Circuits and DC machines: potential v [V], and current i [A], positive into the component.

    pin_p [--element--] pin_n      u = pin_p.v - pin_n.v,  i = pin_p.i = -pin_n.i

So u i is the power that an element takes up. Every circuit needs one point at potential 0: a `Ground`, or the
`Amplifier`, which has one inside.
"""

import casadi as ca

from cartpend_dae.language import (
    Component,
    Param,
    Port,
    Statements,
    connect,
    der,
    discrete,
    flow,
    param,
    port,
    signal,
    var,
)
from cartpend_dae.library import rotational
from cartpend_dae.switching import assign, if_else


class Pin(Port):
    """A terminal: potential v, and current i into the component."""

    v = var(unit="V", doc="potential")
    i = flow(unit="A", doc="current into the component")


class Branch(Component):
    """Two pins that one current passes, i = i_p = -i_n; base of elements and sources."""

    pin_p = port(Pin, doc="positive pin")
    pin_n = port(Pin, doc="negative pin")
    i = var(unit="A", doc="current from pin_p to pin_n")

    def equations(self) -> Statements:
        yield self.i == self.pin_p.i
        yield self.pin_p.i + self.pin_n.i == 0


class OnePort(Branch):
    """Two pins with the voltage u = v_p - v_n between them; base of elements."""

    u = var(unit="V", doc="voltage from pin_p to pin_n")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.pin_p.v - self.pin_n.v


class Ground(Component):
    """The point of potential 0, v = 0; it takes up whatever current flows into it."""

    pin = port(Pin, doc="the grounded point")

    def equations(self) -> Statements:
        yield self.pin.v == 0


class Resistor(OnePort):
    """Resistor, u = R i."""

    R: Param = param(unit="Ohm", min=0, doc="resistance")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.R * self.i


class Inductor(OnePort):
    """Inductor, u = L der(i)."""

    L: Param = param(unit="H", min=0, doc="inductance")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.L * der(self.i)


class Capacitor(OnePort):
    """Capacitor, i = C der(u)."""

    C: Param = param(unit="F", min=0, doc="capacitance")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.i == self.C * der(self.u)


class EMF(OnePort):
    """Electromechanical conversion without loss, u = k w, tau_flange = -k i; its housing is on the ground."""

    flange = port(rotational.Flange, doc="shaft")
    phi = var(unit="rad", doc="angle of the shaft")
    w = var(unit="rad/s", doc="speed of the shaft")
    k: Param = param(unit="N.m/A", doc="torque constant, equal to the back-EMF constant [V.s/rad]")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.phi == self.flange.phi
        yield self.w == der(self.phi)
        yield self.u == self.k * self.w
        yield self.flange.tau == -self.k * self.i


class VoltageSource(Branch):
    """Voltage given by a signal, v_p - v_n = u."""

    u = signal("in", unit="V", doc="voltage from pin_p to pin_n")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.pin_p.v - self.pin_n.v == self.u


class ConstantVoltage(OnePort):
    """Constant voltage, u = V."""

    V: Param = param(unit="V", doc="voltage from pin_p to pin_n")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.V


class Amplifier(Component):
    """Ideal voltage amplifier, v = gain u, with pin_n on its own ground: the circuit needs no other."""

    pin_p = port(Pin, doc="output")
    pin_n = port(Pin, doc="return, potential 0")
    u = signal("in", unit="V", doc="control voltage")
    v = var(unit="V", doc="output voltage")
    i = var(unit="A", doc="output current, positive out of pin_p")
    gain: Param = param(unit="1", default=1.0, doc="output voltage per control voltage")

    def equations(self) -> Statements:
        yield self.v == self.gain * self.u
        yield self.i == -self.pin_p.i
        yield self.pin_p.v == self.v
        yield self.pin_n.v == 0


class PowerStage(Component):
    """Amplifier with saturation, v = gain u between -v_max and v_max of its supply."""

    pin = port(Pin, doc="output against ground")
    u = signal("in", unit="V", doc="control voltage")
    gain: Param = param(unit="1", default=1.0, doc="output voltage per control voltage")
    v_max: Param = param(unit="V", default=24.0, min=0, doc="supply voltage")

    def equations(self) -> Statements:
        yield self.pin.v == ca.fmin(ca.fmax(self.gain * self.u, -self.v_max), self.v_max)


class DCMotor(Component):
    """DC motor with permanent magnets, u = R i + L der(i) + k w, J der(w) = k i + tau_shaft.

    Without inductance or rotor inertia (the number 0) the part for it does not exist.
    """

    pin_p = port(Pin, doc="positive terminal")
    pin_n = port(Pin, doc="negative terminal")
    shaft = port(rotational.Flange, doc="shaft")
    i = var(unit="A", doc="current")
    R: Param = param(unit="Ohm", min=0, doc="armature resistance")
    k: Param = param(unit="N.m/A", doc="torque constant, equal to the back-EMF constant [V.s/rad]")
    L: Param = param(unit="H", default=0.0, min=0, doc="armature inductance")
    J: Param = param(unit="kg.m2", default=0.0, min=0, doc="moment of inertia of the rotor")

    def __post_init__(self) -> None:
        self.resistor, self.emf = Resistor(R=self.R), EMF(k=self.k)
        self.inductor = None if self.is_zero("L") else Inductor(L=self.L)
        self.rotor = None if self.is_zero("J") else rotational.Inertia(J=self.J)

    def equations(self) -> Statements:
        yield self.i == self.pin_p.i
        yield connect(self.pin_p, self.resistor.pin_p)
        if self.inductor is None:
            yield connect(self.resistor.pin_n, self.emf.pin_p)
        else:
            yield connect(self.resistor.pin_n, self.inductor.pin_p)
            yield connect(self.inductor.pin_n, self.emf.pin_p)
        yield connect(self.emf.pin_n, self.pin_n)
        if self.rotor is None:
            yield connect(self.emf.flange, self.shaft)
        else:
            yield connect(self.emf.flange, self.rotor.flange_a)
            yield connect(self.rotor.flange_b, self.shaft)


class IdealDiode(OnePort):
    """Diode of two straight lines, i = Goff u below Vknee, and i = (u - Vknee)/Ron + Goff Vknee above it."""

    Ron: Param = param(unit="Ohm", default=1e-5, min=0, doc="resistance above the knee")
    Goff: Param = param(unit="S", default=1e-5, min=0, doc="conductance below the knee")
    Vknee: Param = param(unit="V", default=0.0, min=0, doc="voltage of the knee")

    def equations(self) -> Statements:
        yield from super().equations()
        # the law times Ron: well conditioned on both lines, and linear while the diode is on one of them
        slope = if_else(self.u < self.Vknee, self.Ron * self.Goff, 1)
        yield self.Ron * (self.i - self.Goff * self.Vknee) == slope * (self.u - self.Vknee)


class IdealThyristor(OnePort):
    """Thyristor, i = Goff u while it blocks, and i = (u - Vknee)/Ron + Goff Vknee while it conducts.

    It begins to conduct where `fire` > 0.5 and u >= Vknee, and conducts until u < Vknee.
    """

    fire = signal("in", unit="1", doc="lets it conduct above 0.5")
    off = discrete(unit="1", start=1.0, doc="1 while it blocks, 0 while it conducts")
    Ron: Param = param(unit="Ohm", default=1e-5, min=0, doc="resistance while it conducts")
    Goff: Param = param(unit="S", default=1e-5, min=0, doc="conductance while it blocks")
    Vknee: Param = param(unit="V", default=0.0, min=0, doc="voltage of the knee")

    def equations(self) -> Statements:
        yield from super().equations()
        waits = ca.logic_and(self.off, if_else(self.fire > 0.5, 0, 1))
        yield assign(self.off, if_else(self.u < self.Vknee, 1, waits))
        slope = ca.if_else(self.off, self.Ron * self.Goff, 1)
        yield self.Ron * (self.i - self.Goff * self.Vknee) == slope * (self.u - self.Vknee)


class IdealSwitch(OnePort):
    """Switch, i = u/Ron while control > 0.5, and i = Goff u otherwise."""

    control = signal("in", unit="1", doc="closed above 0.5")
    Ron: Param = param(unit="Ohm", default=1e-5, min=0, doc="resistance of the closed switch")
    Goff: Param = param(unit="S", default=1e-5, min=0, doc="conductance of the open switch")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.Ron * self.i == self.u * if_else(self.control > 0.5, 1, self.Ron * self.Goff)
