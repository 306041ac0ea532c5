"""The cart on its rail with the rod hanging below it, of planar joints and bodies."""

from cartpend_dae import Component, Statements, connect, initial
from cartpend_dae.library.planar import Body, Prismatic, Revolute, World
from cartpend_dae.library.rotational import BearingFriction
from cartpend_dae.library.translational import PositionSensor, RailFriction


class CartPendulum(Component):
    """World - slide (prismatic, level) - cart - pivot (revolute) - rod; friction of rail and bearing in the joints.

    `encoder.s` is the position of the cart, `bearing.phi` the angle of the rod: 0 where it hangs, positive with
    its tip towards +s. The cart starts at rest with the rod held at 1 rad.
    """

    def __post_init__(self) -> None:
        m, l = 0.1719, 0.86  # noqa: E741 (the symbol of mechanics)
        self.world = World(g=9.81)
        self.slide, self.pivot = Prismatic(n=(1.0, 0.0)), Revolute()
        self.cart = Body(m=4.609, g=self.world.g)
        self.rod = Body(m=m, I=m * l**2 / 12, r_CM_y=-l / 2, g=self.world.g)
        self.rail, self.bearing = RailFriction(d=12.0), BearingFriction(d=0.0375)
        self.encoder = PositionSensor()

    def equations(self) -> Statements:
        yield connect(self.world.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.cart.frame_a, self.pivot.frame_a)
        yield connect(self.pivot.frame_b, self.rod.frame_a)
        yield connect(self.slide.support, self.rail.flange_a)
        yield connect(self.slide.axis, self.rail.flange_b, self.encoder.flange)
        yield connect(self.pivot.support, self.bearing.flange_a)
        yield connect(self.pivot.axis, self.bearing.flange_b)
        yield initial(self.encoder.s == 0)
        yield initial(self.rail.v == 0)
        yield initial(self.bearing.phi == 1.0)
        yield initial(self.bearing.w == 0)
