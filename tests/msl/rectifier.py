"""A three-phase bridge of diodes with line inductors, two capacitors and a constant load current."""

from math import pi, sqrt

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import electrical, electrical_sources, signals

SPEC = "Modelica.Electrical.Analog.Examples.Rectifier"


class Rectifier(Component):
    """A three-phase bridge of diodes with line inductors, two capacitors and a constant load current."""

    def __post_init__(self) -> None:
        V = 326.59863237109
        self.SineVoltage1 = electrical_sources.SineVoltage(V=V, f=50.0)
        self.SineVoltage2 = electrical_sources.SineVoltage(V=V, f=50.0, phase=-2 * pi / 3)
        self.SineVoltage3 = electrical_sources.SineVoltage(V=V, f=50.0, phase=-4 * pi / 3)
        self.Inductor1 = electrical.Inductor(L=6e-5)
        self.Inductor2 = electrical.Inductor(L=6e-5)
        self.Inductor3 = electrical.Inductor(L=6e-5)
        self.IdealDiode1 = electrical.IdealDiode(Ron=0.001, Goff=0.001, Vknee=2.0)
        self.IdealDiode2 = electrical.IdealDiode(Ron=0.001, Goff=0.001, Vknee=2.0)
        self.IdealDiode3 = electrical.IdealDiode(Ron=0.001, Goff=0.001, Vknee=2.0)
        self.IdealDiode4 = electrical.IdealDiode(Ron=0.001, Goff=0.001, Vknee=2.0)
        self.IdealDiode5 = electrical.IdealDiode(Ron=0.001, Goff=0.001, Vknee=2.0)
        self.IdealDiode6 = electrical.IdealDiode(Ron=0.001, Goff=0.001, Vknee=2.0)
        self.Capacitor1 = electrical.Capacitor(C=0.03)
        self.Capacitor2 = electrical.Capacitor(C=0.03)
        self.Ground1 = electrical.Ground()
        self.SignalCurrent1 = electrical_sources.CurrentSource()
        self.Constant1 = signals.Constant(k=500.0)

    def equations(self) -> Statements:
        yield connect(self.SineVoltage1.pin_n, self.SineVoltage2.pin_n)
        yield connect(self.SineVoltage2.pin_n, self.SineVoltage3.pin_n)
        yield connect(self.SineVoltage1.pin_p, self.Inductor1.pin_p)
        yield connect(self.SineVoltage2.pin_p, self.Inductor2.pin_p)
        yield connect(self.SineVoltage3.pin_p, self.Inductor3.pin_p)
        yield connect(self.IdealDiode1.pin_p, self.IdealDiode4.pin_n)
        yield connect(self.IdealDiode2.pin_p, self.IdealDiode5.pin_n)
        yield connect(self.IdealDiode3.pin_p, self.IdealDiode6.pin_n)
        yield connect(self.IdealDiode1.pin_n, self.IdealDiode2.pin_n)
        yield connect(self.IdealDiode2.pin_n, self.IdealDiode3.pin_n)
        yield connect(self.IdealDiode4.pin_p, self.IdealDiode5.pin_p)
        yield connect(self.IdealDiode5.pin_p, self.IdealDiode6.pin_p)
        yield connect(self.Capacitor2.pin_n, self.IdealDiode6.pin_p)
        yield connect(self.IdealDiode3.pin_n, self.Capacitor1.pin_p)
        yield connect(self.Capacitor1.pin_n, self.Capacitor2.pin_p)
        yield connect(self.Capacitor2.pin_p, self.Ground1.pin)
        yield connect(self.Capacitor1.pin_p, self.SignalCurrent1.pin_p)
        yield connect(self.SignalCurrent1.pin_n, self.Capacitor2.pin_n)
        yield connect(self.Constant1.y, self.SignalCurrent1.i)
        yield connect(self.Inductor1.pin_n, self.IdealDiode1.pin_p)
        yield connect(self.Inductor2.pin_n, self.IdealDiode2.pin_p)
        yield connect(self.Inductor3.pin_n, self.IdealDiode3.pin_p)
        yield initial(self.Inductor2.i == 0.0)
        yield initial(self.Inductor3.i == 0.0)
        yield initial(self.Capacitor1.u == 200.0 * sqrt(2.0))
        yield initial(self.Capacitor2.u == 200.0 * sqrt(2.0))
