"""Experiment 2 of the published study, with motors, gears, hubs and sprockets as parts."""

from drive_train import DriveTrain

from cartpend_dae import Component, Param, Statements, connect, initial, param
from cartpend_dae.library.translational import Fixed, Mass, PositionSensor, RailFriction, Spring


class LinearDamp(Component):
    """Drive train, rigid chain, cart and springs: as `LinearDampMod`, but the inertial mass follows from its parts.

        left |--spring_1--[cart]--spring_2--| right      rail: between ground and cart
                             |
                          (chain)--[drive]--encoder

    At `encoder.s` = 0 both springs are stretched by a. The study does not say whether the terminals of its motors
    were open: here they are, and `motor_load` and `brake_load` [Ohm] close them over an external resistance.
    """

    a: Param = param(unit="m", default=0.095, min=0, doc="stretch of both springs at s = 0")
    l_1: Param = param(unit="m", default=0.11, min=0, doc="unstretched length of spring 1")
    l_2: Param = param(unit="m", default=0.125, min=0, doc="unstretched length of spring 2")
    motor_load: float | None = None
    brake_load: float | None = None

    def __post_init__(self) -> None:
        self.left = Fixed(s0=-(self.l_1 + self.a))
        self.spring_1 = Spring(c=1197.3, s_rel0=self.l_1)
        self.cart = Mass(m=4.609)
        self.spring_2 = Spring(c=1320.1, s_rel0=self.l_2)
        self.right = Fixed(s0=self.l_2 + self.a)
        self.ground = Fixed()
        self.rail = RailFriction(d=48.0)
        self.drive = DriveTrain(motor_load=self.motor_load, brake_load=self.brake_load)
        self.encoder = PositionSensor()

    def equations(self) -> Statements:
        yield connect(self.left.flange, self.spring_1.flange_a)
        yield connect(self.spring_1.flange_b, self.cart.flange_a)
        yield connect(self.cart.flange_b, self.spring_2.flange_a)
        yield connect(self.spring_2.flange_b, self.right.flange)
        yield connect(self.ground.flange, self.rail.flange_a)
        yield connect(self.rail.flange_b, self.cart.flange_a)
        yield connect(self.drive.chain, self.cart.flange_a)
        yield connect(self.encoder.flange, self.drive.chain)
        yield initial(self.encoder.s == 0.1146)
        yield initial(self.cart.v == 0)
