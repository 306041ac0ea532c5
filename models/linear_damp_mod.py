"""Experiment 2 of the published study: a cart between two springs, all rotating parts in one mass."""

from cartpend_dae import Component, Param, Statements, connect, initial, param
from cartpend_dae.library.translational import Fixed, Mass, PositionSensor, RailFriction, Spring


class LinearDampMod(Component):
    """Inertial mass, chain, cart, springs: (m_c + m_in) der(v) + d v + f_c sgn v + K1 (s + a) - K2 (a - s) = 0.

        left |--spring_1--[cart]--spring_2--| right      rail: between ground and cart
                             |
                          (chain)--[inertial]--encoder

    At `encoder.s` = 0 both springs are stretched by a. Without `f_c` [N] the rail has no dry friction.
    """

    a: Param = param(unit="m", default=0.095, min=0, doc="stretch of both springs at s = 0")
    l_1: Param = param(unit="m", default=0.11, min=0, doc="unstretched length of spring 1")
    l_2: Param = param(unit="m", default=0.125, min=0, doc="unstretched length of spring 2")
    f_c: float = 0.0

    def __post_init__(self) -> None:
        self.left = Fixed(s0=-(self.l_1 + self.a))
        self.spring_1 = Spring(c=1197.3, s_rel0=self.l_1)
        self.cart = Mass(m=4.609)
        self.spring_2 = Spring(c=1320.1, s_rel0=self.l_2)
        self.right = Fixed(s0=self.l_2 + self.a)
        self.ground = Fixed()
        self.rail = RailFriction(d=48.0, f_c=self.f_c)
        self.inertial = Mass(m=6.8)
        self.encoder = PositionSensor()

    def equations(self) -> Statements:
        yield connect(self.left.flange, self.spring_1.flange_a)
        yield connect(self.spring_1.flange_b, self.cart.flange_a)
        yield connect(self.cart.flange_b, self.spring_2.flange_a)
        yield connect(self.spring_2.flange_b, self.right.flange)
        yield connect(self.ground.flange, self.rail.flange_a)
        yield connect(self.rail.flange_b, self.cart.flange_a)
        # A rigid chain is a connection; the encoder sits on the motor's side of it.
        yield connect(self.inertial.flange_b, self.cart.flange_a)
        yield connect(self.encoder.flange, self.inertial.flange_a)
        yield initial(self.encoder.s == 0.1146)
        yield initial(self.inertial.v == 0)
