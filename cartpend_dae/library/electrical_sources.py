"""Sources that depend on time or on a signal, sensors and the ideal amplifier; signs as in `electrical`."""

from math import pi

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, param, port, signal, time, var
from cartpend_dae.library.electrical import Branch, OnePort, Pin
from cartpend_dae.library.signals import rise
from cartpend_dae.switching import if_else


class StepVoltage(OnePort):
    """Voltage that steps, u = offset, and offset + V from start_time on."""

    V: Param = param(unit="V", doc="height of the step")
    offset: Param = param(unit="V", default=0.0, doc="voltage before the step")
    start_time: Param = param(unit="s", default=0.0, doc="time of the step")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.offset + if_else(time() >= self.start_time, self.V, 0)


class RampVoltage(OnePort):
    """Voltage that rises, u = offset + V x, where x runs from 0 to 1 between start_time and start_time + duration."""

    V: Param = param(unit="V", doc="height of the ramp")
    duration: Param = param(unit="s", min=0, doc="how long the ramp takes")
    offset: Param = param(unit="V", default=0.0, doc="voltage before the ramp")
    start_time: Param = param(unit="s", default=0.0, doc="time at which the ramp starts")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.offset + self.V * rise(time() - self.start_time, self.duration)


class SineVoltage(OnePort):
    """Sine, u = offset + V sin(2 pi f (t - start_time) + phase), and u = offset before start_time."""

    V: Param = param(unit="V", doc="amplitude")
    f: Param = param(unit="Hz", min=0, doc="frequency")
    phase: Param = param(unit="rad", default=0.0, doc="phase at start_time")
    offset: Param = param(unit="V", default=0.0, doc="mean value")
    start_time: Param = param(unit="s", default=0.0, doc="time at which the sine starts")

    def equations(self) -> Statements:
        yield from super().equations()
        wave = self.V * ca.sin(2 * pi * self.f * (time() - self.start_time) + self.phase)
        yield self.u == self.offset + if_else(time() >= self.start_time, wave, 0)


class ConstantCurrent(Component):
    """Constant current, i = I from pin_p to pin_n through the source."""

    pin_p = port(Pin, doc="positive pin")
    pin_n = port(Pin, doc="negative pin")
    I: Param = param(unit="A", doc="current from pin_p to pin_n")  # noqa: E741 (the symbol of circuits)

    def equations(self) -> Statements:
        yield self.pin_p.i == self.I
        yield self.pin_n.i == -self.I


class CurrentSource(Component):
    """Current given by a signal, i_p = i, i_n = -i."""

    pin_p = port(Pin, doc="positive pin")
    pin_n = port(Pin, doc="negative pin")
    i = signal("in", unit="A", doc="current from pin_p to pin_n through the source")

    def equations(self) -> Statements:
        yield self.pin_p.i == self.i
        yield self.pin_n.i == -self.i


class VoltageSourceWithResistance(OnePort):
    """Battery, u = V + R i: the current i flows into the positive pin."""

    V: Param = param(unit="V", doc="voltage without load")
    R: Param = param(unit="Ohm", min=0, doc="inner resistance")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.V + self.R * self.i


class Conductor(OnePort):
    """Conductor, i = G u."""

    G: Param = param(unit="S", min=0, doc="conductance")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.i == self.G * self.u


class CurrentSensor(Component):
    """Ideal current sensor, i = i_p = -i_n, without voltage drop."""

    pin_p = port(Pin, doc="positive pin")
    pin_n = port(Pin, doc="negative pin")
    i = signal("out", unit="A", doc="measured current from pin_p to pin_n")

    def equations(self) -> Statements:
        yield self.pin_p.v == self.pin_n.v
        yield self.i == self.pin_p.i
        yield self.pin_p.i + self.pin_n.i == 0


class VoltageSensor(Component):
    """Ideal voltage sensor, u = v_p - v_n, without current."""

    pin_p = port(Pin, doc="positive pin")
    pin_n = port(Pin, doc="negative pin")
    u = signal("out", unit="V", doc="measured voltage from pin_p to pin_n")

    def equations(self) -> Statements:
        yield self.u == self.pin_p.v - self.pin_n.v
        yield self.pin_p.i == 0
        yield self.pin_n.i == 0


class IdealOpAmp(Component):
    """Ideal operational amplifier, v_p1 = v_n1 and no input current; the output takes what current it needs, i2."""

    p1 = port(Pin, doc="positive input")
    n1 = port(Pin, doc="negative input")
    p2 = port(Pin, doc="output")
    n2 = port(Pin, doc="return of the output")
    v2 = var(unit="V", doc="output voltage")

    def equations(self) -> Statements:
        yield self.p1.v == self.n1.v
        yield self.p1.i == 0
        yield self.n1.i == 0
        yield self.v2 == self.p2.v - self.n2.v
        yield self.p2.i + self.n2.i == 0


class Brush(Branch):
    """Voltage drop of brushes, v_p - v_n = V i/I_linear between -V and V, and the nearer of the two outside."""

    V: Param = param(unit="V", min=0, doc="drop at high current")
    I_linear: Param = param(unit="A", min=0, doc="current up to which the drop is linear")

    def equations(self) -> Statements:
        yield from super().equations()
        drop = self.V * ca.fmin(ca.fmax(self.i / self.I_linear, -1), 1)
        yield self.pin_p.v - self.pin_n.v == drop
