"""A pendulum whose body slides along the rod against a spring and a damper."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import planar

SPEC = "Modelica.Mechanics.MultiBody.Examples.Elementary.PendulumWithSpringDamper"


class PendulumWithSpringDamper(Component):
    """A pendulum whose body slides along the rod against a spring and a damper."""

    def __post_init__(self) -> None:
        self.world = planar.World()
        self.body1 = planar.Body(I=1.0, m=1.0, g=self.world.g)
        self.bar1 = planar.FixedTranslation(r_x=0.3)
        self.spring1 = planar.Spring(s_unstretched=0.2, c=20.0)
        self.damper1 = planar.Damper(d=1.0)
        self.revolute = planar.Revolute()
        self.prismatic = planar.Prismatic()

    def equations(self) -> Statements:
        yield connect(self.world.frame_b, self.bar1.frame_a)
        yield connect(self.revolute.frame_a, self.bar1.frame_b)
        yield connect(self.prismatic.frame_a, self.revolute.frame_b)
        yield connect(self.damper1.frame_a, self.bar1.frame_b)
        yield connect(self.damper1.frame_b, self.prismatic.frame_b)
        yield connect(self.spring1.frame_a, self.bar1.frame_b)
        yield connect(self.spring1.frame_b, self.prismatic.frame_b)
        yield connect(self.body1.frame_a, self.prismatic.frame_b)
        yield initial(self.revolute.phi == 0.0)
        yield initial(self.revolute.w == 0.0)
        yield initial(self.prismatic.s == 0.5)
        yield initial(self.prismatic.v == 0.0)
