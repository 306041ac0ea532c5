"""Two springs with masses driven at resonance, one of them damped."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import signals, translational

SPEC = "Modelica.Mechanics.Translational.Examples.Oscillator"


class Oscillator(Component):
    """Two springs with masses driven at resonance, one of them damped."""

    def __post_init__(self) -> None:
        self.mass1 = translational.Mass(L=1.0, m=1.0)
        self.spring1 = translational.Spring(s_rel0=1.0, c=10000.0)
        self.fixed1 = translational.Fixed(s0=1.0)
        self.force1 = translational.Force()
        self.sine1 = signals.Sine(amplitude=1.0, f=15.9155)
        self.mass2 = translational.Mass(L=1.0, m=1.0)
        self.spring2 = translational.Spring(s_rel0=1.0, c=10000.0)
        self.fixed2 = translational.Fixed(s0=1.0)
        self.force2 = translational.Force()
        self.sine2 = signals.Sine(amplitude=1.0, f=15.9155)
        self.damper1 = translational.Damper(d=10.0)

    def equations(self) -> Statements:
        yield connect(self.mass1.flange_b, self.spring1.flange_a)
        yield connect(self.spring2.flange_a, self.damper1.flange_a)
        yield connect(self.mass2.flange_b, self.spring2.flange_a)
        yield connect(self.damper1.flange_b, self.spring2.flange_b)
        yield connect(self.sine1.y, self.force1.f)
        yield connect(self.sine2.y, self.force2.f)
        yield connect(self.spring1.flange_b, self.fixed1.flange)
        yield connect(self.force2.flange, self.mass2.flange_a)
        yield connect(self.force1.flange, self.mass1.flange_a)
        yield connect(self.spring2.flange_b, self.fixed2.flange)
        yield initial(self.mass1.s == -0.5)
        yield initial(self.mass1.v == 0.0)
        yield initial(self.mass2.s == -0.5)
        yield initial(self.mass2.v == 0.0)
