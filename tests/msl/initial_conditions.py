"""Two chains of masses, started by relative positions and by absolute ones."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import translational

SPEC = "Modelica.Mechanics.Translational.Examples.InitialConditions"


class InitialConditions(Component):
    """Two chains of masses, started by relative positions and by absolute ones."""

    def __post_init__(self) -> None:
        self.fixed2 = translational.Fixed(s0=1.0)
        self.s2 = translational.Spring(s_rel0=2.0, c=1000.0)
        self.m3 = translational.Mass(L=3.0, m=1.0)
        self.sd2 = translational.SpringDamper(s_rel0=4.0, c=111.0, d=1.0)
        self.m4 = translational.Mass(L=5.0, m=1.0)
        self.fixed1 = translational.Fixed(s0=-1.0)
        self.s1 = translational.Spring(s_rel0=1.0, c=1000.0)
        self.m1 = translational.Mass(L=1.0, m=1.0)
        self.sd1 = translational.SpringDamper(s_rel0=1.0, c=111.0, d=1.0)
        self.m2 = translational.Mass(L=2.0, m=1.0)

    def equations(self) -> Statements:
        yield connect(self.s2.flange_a, self.fixed2.flange)
        yield connect(self.s1.flange_a, self.fixed1.flange)
        yield connect(self.m1.flange_a, self.s1.flange_b)
        yield connect(self.sd1.flange_a, self.m1.flange_b)
        yield connect(self.m2.flange_a, self.sd1.flange_b)
        yield connect(self.m4.flange_a, self.sd2.flange_b)
        yield connect(self.sd2.flange_a, self.m3.flange_b)
        yield connect(self.m3.flange_a, self.s2.flange_b)
        yield initial(self.m3.s == 4.5)
        yield initial(self.m3.v == 0.0)
        yield initial(self.m4.s == 12.5)
        yield initial(self.m4.v == 0.0)
        yield initial(self.s1.s_rel == 0.5)
        yield initial(self.m1.v == 0.0)
        yield initial(self.sd1.s_rel == 1.0)
        yield initial(self.sd1.v_rel == 0.0)
