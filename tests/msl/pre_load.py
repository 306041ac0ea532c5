"""A valve spool between preloaded spring plates, with four stiff one-sided contacts."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import signals, translational, translational_parts

SPEC = "Modelica.Mechanics.Translational.Examples.PreLoad"


class PreLoad(Component):
    """A valve spool between preloaded spring plates, with four stiff one-sided contacts."""

    def __post_init__(self) -> None:
        self.innerContactA = translational_parts.ElastoGap(s_rel0=0.001, c=1e6, d=250.0)
        self.innerContactB = translational_parts.ElastoGap(s_rel0=0.001, c=1e6, d=250.0)
        self.spool = translational.Mass(L=0.19, m=0.15)
        self.fixedLe = translational.Fixed(s0=-0.0955)
        self.springPlateA = translational.Mass(L=0.002, m=0.01)
        self.springPlateB = translational.Mass(L=0.002, m=0.01)
        self.spring = translational.Spring(s_rel0=0.025, c=20000.0)
        self.outerContactA = translational_parts.ElastoGap(s_rel0=0.0015, c=1e6, d=250.0)
        self.outerContactB = translational_parts.ElastoGap(s_rel0=0.0015, c=1e6, d=250.0)
        self.rod1 = translational.Rod(L=0.007)
        self.friction = translational.Damper(d=2500.0)
        self.force = translational.Force()
        self.housing = translational.Rod(L=0.0305)
        self.rod3 = translational.Rod(L=0.00575)
        self.rod4 = translational.Rod(L=0.00575)
        self.rod2 = translational.Rod(L=0.007)
        self.sineForce = signals.Sine(amplitude=150.0, f=0.01)

    def equations(self) -> Statements:
        yield connect(self.outerContactA.flange_b, self.springPlateA.flange_a)
        yield connect(self.springPlateA.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.springPlateB.flange_a)
        yield connect(self.springPlateB.flange_b, self.outerContactB.flange_a)
        yield connect(self.outerContactB.flange_b, self.housing.flange_b)
        yield connect(self.springPlateA.flange_b, self.rod1.flange_a)
        yield connect(self.innerContactA.flange_a, self.rod3.flange_a)
        yield connect(self.innerContactA.flange_b, self.rod1.flange_b)
        yield connect(self.rod2.flange_a, self.innerContactB.flange_a)
        yield connect(self.rod4.flange_b, self.innerContactB.flange_b)
        yield connect(self.friction.flange_b, self.rod3.flange_a)
        yield connect(self.rod3.flange_b, self.rod4.flange_a)
        yield connect(self.rod2.flange_b, self.springPlateB.flange_a)
        yield connect(self.spool.flange_a, self.rod4.flange_a)
        yield connect(self.sineForce.y, self.force.f)
        yield connect(self.force.flange, self.spool.flange_a)
        yield connect(self.outerContactA.flange_a, self.fixedLe.flange)
        yield connect(self.housing.flange_a, self.fixedLe.flange)
        yield connect(self.friction.flange_a, self.fixedLe.flange)
        yield initial(self.spool.s == 0.01475)
        yield initial(self.spool.v == 0.0)
        yield initial(self.springPlateA.s == -0.093)
        yield initial(self.springPlateA.v == 0.0)
        yield initial(self.springPlateB.s == -0.06925)
        yield initial(self.springPlateB.v == 0.0)
