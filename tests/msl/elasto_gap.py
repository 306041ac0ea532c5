"""A mass between two springs, and one between two stops that only push."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import translational, translational_parts

SPEC = "Modelica.Mechanics.Translational.Examples.ElastoGap"


class ElastoGap(Component):
    """A mass between two springs, and one between two stops that only push."""

    def __post_init__(self) -> None:
        self.fixed = translational.Fixed()
        self.rod1 = translational.Rod(L=2.0)
        self.rod2 = translational.Rod(L=2.0)
        self.springDamper1 = translational.SpringDamper(s_rel0=1.0, c=10.0, d=1.5)
        self.springDamper2 = translational.SpringDamper(s_rel0=1.0, c=10.0, d=1.5)
        self.mass1 = translational.Mass(m=1.0)
        self.elastoGap1 = translational_parts.ElastoGap(s_rel0=1.5, c=10.0, d=1.5)
        self.elastoGap2 = translational_parts.ElastoGap(s_rel0=1.5, c=10.0, d=1.5)
        self.mass2 = translational.Mass(m=1.0)

    def equations(self) -> Statements:
        yield connect(self.rod1.flange_b, self.fixed.flange)
        yield connect(self.fixed.flange, self.rod2.flange_a)
        yield connect(self.springDamper1.flange_a, self.rod1.flange_a)
        yield connect(self.springDamper2.flange_b, self.rod2.flange_b)
        yield connect(self.springDamper1.flange_b, self.mass1.flange_a)
        yield connect(self.mass1.flange_b, self.springDamper2.flange_a)
        yield connect(self.rod1.flange_a, self.elastoGap1.flange_a)
        yield connect(self.rod2.flange_b, self.elastoGap2.flange_b)
        yield connect(self.elastoGap1.flange_b, self.mass2.flange_a)
        yield connect(self.mass2.flange_b, self.elastoGap2.flange_a)
        yield initial(self.springDamper1.s_rel == 1.0, fixed=False)
        yield initial(self.springDamper2.s_rel == 1.0, fixed=False)
        yield initial(self.mass1.s == 2.0)
        yield initial(self.mass1.v == 0.0)
        yield initial(self.elastoGap1.s_rel == 1.5, fixed=False)
        yield initial(self.elastoGap2.s_rel == 1.5, fixed=False)
        yield initial(self.mass2.s == 2.0)
        yield initial(self.mass2.v == 0.0)
