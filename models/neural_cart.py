"""The cart between springs with a neural network in the place of springs, rail and friction."""

from cartpend_dae import Component, Param, Statements, connect, initial, param
from cartpend_dae.library.closures import SlidingNetwork
from cartpend_dae.library.translational import Fixed, Mass, PositionSensor


class NeuralCart(Component):
    """A mass that is driven by a network of its position and speed alone, m der(v) = -f_0 n(s/s_0, v/v_0).

    Only the mass is physics, and the numbers by which forces, positions and speeds are scaled. All weights are 0 at
    first: then the cart is free.
    """

    m: Param = param(unit="kg", default=4.609 + 6.8, min=0, doc="cart and rotating parts")

    def __post_init__(self) -> None:
        self.ground = Fixed()
        self.law = SlidingNetwork(f_0=300.0, s_0=0.13, v_0=2.0)
        self.cart = Mass(m=self.m)
        self.encoder = PositionSensor()

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.law.flange_a)
        yield connect(self.law.flange_b, self.cart.flange_a)
        yield connect(self.encoder.flange, self.cart.flange_a)
        yield initial(self.encoder.s == 0.1)
        yield initial(self.cart.v == 0)
