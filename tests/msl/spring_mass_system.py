"""Two masses on vertical sliders, held by a spring on the joint and by one in the plane."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import planar, translational

SPEC = "Modelica.Mechanics.MultiBody.Examples.Elementary.SpringMassSystem"


class SpringMassSystem(Component):
    """Two masses on vertical sliders, held by a spring on the joint and by one in the plane."""

    def __post_init__(self) -> None:
        self.world = planar.World()
        self.p1 = planar.Prismatic(n=(0.0, -1.0))
        self.spring1 = translational.Spring(s_rel0=0.1, c=30.0)
        self.body1 = planar.Body(m=1.0, g=self.world.g)
        self.bar1 = planar.FixedTranslation(r_x=0.3)
        self.bar2 = planar.FixedTranslation(r_x=0.3)
        self.body2 = planar.Body(m=1.0, g=self.world.g)
        self.p2 = planar.Prismatic(n=(0.0, -1.0))
        self.spring2 = planar.Spring(s_unstretched=0.1, c=30.0)

    def equations(self) -> Statements:
        yield connect(self.body1.frame_a, self.p1.frame_b)
        yield connect(self.world.frame_b, self.bar1.frame_a)
        yield connect(self.bar1.frame_b, self.p1.frame_a)
        yield connect(self.spring1.flange_b, self.p1.axis)
        yield connect(self.bar1.frame_b, self.bar2.frame_a)
        yield connect(self.bar2.frame_b, self.p2.frame_a)
        yield connect(self.p2.frame_b, self.body2.frame_a)
        yield connect(self.bar2.frame_b, self.spring2.frame_a)
        yield connect(self.body2.frame_a, self.spring2.frame_b)
        yield connect(self.spring1.flange_a, self.p1.support)
        yield initial(self.p1.s == 0.1)
        yield initial(self.p1.v == 0.0)
        yield initial(self.p2.s == 0.1)
        yield initial(self.p2.v == 0.0)
