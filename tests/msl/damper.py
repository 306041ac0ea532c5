"""Three masses thrown against a damper, a damper beside a spring, and a spring-damper."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import translational

SPEC = "Modelica.Mechanics.Translational.Examples.Damper"


class Damper(Component):
    """Three masses thrown against a damper, a damper beside a spring, and a spring-damper."""

    def __post_init__(self) -> None:
        self.mass1 = translational.Mass(L=1.0, m=1.0)
        self.damper1 = translational.Damper(d=25.0)
        self.fixed1 = translational.Fixed(s0=4.5)
        self.mass2 = translational.Mass(L=1.0, m=1.0)
        self.damper2 = translational.Damper(d=25.0)
        self.fixed2 = translational.Fixed(s0=4.5)
        self.mass3 = translational.Mass(L=1.0, m=1.0)
        self.fixed3 = translational.Fixed(s0=4.5)
        self.spring2 = translational.Spring(s_rel0=1.0, c=1.0)
        self.springDamper3 = translational.SpringDamper(s_rel0=1.0, d=25.0, c=1.0)

    def equations(self) -> Statements:
        yield connect(self.mass1.flange_b, self.damper1.flange_a)
        yield connect(self.mass2.flange_b, self.damper2.flange_a)
        yield connect(self.damper2.flange_b, self.spring2.flange_b)
        yield connect(self.damper2.flange_a, self.spring2.flange_a)
        yield connect(self.mass3.flange_b, self.springDamper3.flange_a)
        yield connect(self.damper1.flange_b, self.fixed1.flange)
        yield connect(self.damper2.flange_b, self.fixed2.flange)
        yield connect(self.springDamper3.flange_b, self.fixed3.flange)
        yield initial(self.mass1.s == 3.0)
        yield initial(self.mass1.v == 10.0)
        yield initial(self.mass2.s == 3.0)
        yield initial(self.mass2.v == 10.0)
        yield initial(self.mass3.s == 3.0)
        yield initial(self.mass3.v == 10.0)
