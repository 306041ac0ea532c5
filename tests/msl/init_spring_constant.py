"""A rod held level by a spring whose stiffness follows from the rest at the start."""

from cartpend_dae.language import Component, Statements, connect, initial, unknown
from cartpend_dae.library import planar, rotational

SPEC = "Modelica.Mechanics.MultiBody.Examples.Elementary.InitSpringConstant"


class InitSpringConstant(Component):
    """A rod held level by a spring whose stiffness follows from the rest at the start."""

    def __post_init__(self) -> None:
        self.world = planar.World()
        self.rev = planar.Revolute()
        self.damper = rotational.Damper(d=0.1)
        self.body = planar.BodyShape(r_x=1.0, r_CM_x=0.5, m=1.0, g=self.world.g)
        self.fixed = planar.Fixed(r_x=1.0, r_y=0.2)
        self.spring = planar.Spring(c=unknown(100.0), s_unstretched=0.1)

    def equations(self) -> Statements:
        yield connect(self.world.frame_b, self.rev.frame_a)
        yield connect(self.damper.flange_b, self.rev.axis)
        yield connect(self.rev.support, self.damper.flange_a)
        yield connect(self.rev.frame_b, self.body.frame_a)
        yield connect(self.fixed.frame_b, self.spring.frame_a)
        yield connect(self.body.frame_b, self.spring.frame_b)
        yield initial(self.rev.phi == 0.0)
        yield initial(self.rev.w == 0.0)
        yield initial(self.rev.a == 0.0)
