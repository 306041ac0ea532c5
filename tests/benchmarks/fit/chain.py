"""Three masses in a row between springs and dampers, pushed at the last: 6 states, 10 parameters to be found."""

from cartpend_dae import Component, Statements, connect
from cartpend_dae.library import translational


class Chain(Component):
    """ground - mass_1 - mass_2 - mass_3 <- force, with a spring and damper in each gap and a rail under mass_3."""

    def __post_init__(self) -> None:
        self.ground, self.force = translational.Fixed(), translational.Force()
        self.mass_1, self.mass_2, self.mass_3 = (translational.Mass(m=m) for m in (1.0, 1.5, 0.7))
        self.gap_1 = translational.SpringDamper(c=200.0, d=1.0)
        self.gap_2 = translational.SpringDamper(c=300.0, d=2.0)
        self.gap_3 = translational.SpringDamper(c=150.0, d=0.5)
        self.rail = translational.RailFriction(d=1.5)

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.gap_1.flange_a, self.rail.flange_a)
        yield connect(self.gap_1.flange_b, self.mass_1.flange_a)
        yield connect(self.mass_1.flange_b, self.gap_2.flange_a)
        yield connect(self.gap_2.flange_b, self.mass_2.flange_a)
        yield connect(self.mass_2.flange_b, self.gap_3.flange_a)
        yield connect(self.gap_3.flange_b, self.mass_3.flange_a, self.rail.flange_b, self.force.flange)
