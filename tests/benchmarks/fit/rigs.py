"""The two rigs of the benchmark of identification, each of a few components."""

from cartpend_dae import Component, Statements, connect, initial
from cartpend_dae.library import rotational, translational


class Pendulum(Component):
    """A rod in a bearing with dry and viscous friction; `bearing.phi` is 0 where it hangs."""

    def __post_init__(self) -> None:
        self.ground = rotational.Fixed()
        self.bearing = rotational.BearingFriction(d=0.01, tau_c=0.015)
        self.rod = rotational.SlenderRod(m=0.1719, l=0.86, g=9.81)

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.flange)
        yield initial(self.bearing.phi == -0.7)
        yield initial(self.bearing.w == 0)


class CartBetweenSprings(Component):
    """A cart with dry and viscous friction on its rail; both springs are stretched by 0.095 m at `cart.s` = 0."""

    def __post_init__(self) -> None:
        self.left, self.right = translational.Fixed(s0=-0.205), translational.Fixed(s0=0.22)
        self.spring_1 = translational.Spring(c=1197.3, s_rel0=0.11)
        self.spring_2 = translational.Spring(c=1320.1, s_rel0=0.125)
        self.cart = translational.Mass(m=11.409)
        self.ground, self.rail = translational.Fixed(), translational.RailFriction(d=20.0, f_c=10.0)

    def equations(self) -> Statements:
        yield connect(self.left.flange, self.spring_1.flange_a)
        yield connect(self.spring_1.flange_b, self.cart.flange_a, self.rail.flange_b)
        yield connect(self.cart.flange_b, self.spring_2.flange_a)
        yield connect(self.spring_2.flange_b, self.right.flange)
        yield connect(self.ground.flange, self.rail.flange_a)
        yield initial(self.cart.s == 0.1146)
        yield initial(self.cart.v == 0)
