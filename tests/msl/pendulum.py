"""A pendulum with a damped joint, let go from the level."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import planar, rotational

SPEC = "Modelica.Mechanics.MultiBody.Examples.Elementary.Pendulum"


class Pendulum(Component):
    """A pendulum with a damped joint, let go from the level."""

    def __post_init__(self) -> None:
        self.world = planar.World()
        self.rev = planar.Revolute()
        self.damper = rotational.Damper(d=0.1)
        self.body = planar.Body(m=1.0, r_CM_x=0.5, g=self.world.g)

    def equations(self) -> Statements:
        yield connect(self.world.frame_b, self.rev.frame_a)
        yield connect(self.damper.flange_b, self.rev.axis)
        yield connect(self.rev.support, self.damper.flange_a)
        yield connect(self.body.frame_a, self.rev.frame_b)
        yield initial(self.rev.phi == 0.0)
        yield initial(self.rev.w == 0.0)
