"""A step at a passive low-pass filter of fifth order with two loops of capacitors."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import electrical, electrical_sources

SPEC = "Modelica.Electrical.Analog.Examples.CauerLowPassAnalog"


class CauerLowPassAnalog(Component):
    """A step at a passive low-pass filter of fifth order with two loops of capacitors."""

    def __post_init__(self) -> None:
        self.G = electrical.Ground()
        self.C1 = electrical.Capacitor(C=1.072)
        self.C2 = electrical.Capacitor(C=0.26380177746658)
        self.C3 = electrical.Capacitor(C=1.682)
        self.C4 = electrical.Capacitor(C=0.8365378334948)
        self.C5 = electrical.Capacitor(C=0.7262)
        self.L1 = electrical.Inductor(L=1.304)
        self.L2 = electrical.Inductor(L=0.8586)
        self.R1 = electrical.Resistor(R=1.0)
        self.R2 = electrical.Resistor(R=1.0)
        self.V = electrical_sources.StepVoltage(start_time=1.0, V=1.0)

    def equations(self) -> Statements:
        yield connect(self.R1.pin_n, self.C1.pin_p)
        yield connect(self.C1.pin_n, self.G.pin)
        yield connect(self.L1.pin_p, self.C2.pin_p)
        yield connect(self.L1.pin_p, self.C1.pin_p)
        yield connect(self.L1.pin_n, self.C2.pin_n)
        yield connect(self.C2.pin_n, self.C3.pin_p)
        yield connect(self.C2.pin_n, self.C4.pin_p)
        yield connect(self.C2.pin_n, self.L2.pin_p)
        yield connect(self.L2.pin_n, self.C4.pin_n)
        yield connect(self.C4.pin_n, self.C5.pin_p)
        yield connect(self.C4.pin_n, self.R2.pin_p)
        yield connect(self.C1.pin_n, self.C3.pin_n)
        yield connect(self.C1.pin_n, self.C5.pin_n)
        yield connect(self.R2.pin_n, self.C1.pin_n)
        yield connect(self.R1.pin_p, self.V.pin_p)
        yield connect(self.V.pin_n, self.G.pin)
        yield initial(self.C1.u == 0.0)
        yield initial(self.C3.u == 0.0)
        yield initial(self.C5.u == 0.0)
        yield initial(self.L1.i == 0.0)
        yield initial(self.L2.i == 0.0)
