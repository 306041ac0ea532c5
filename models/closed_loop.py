"""The whole rig under sampled control: swing the pendulum up from hanging, catch it and balance it."""

from math import pi

from drive_train import DriveTrain
from swing_up import D_BEARING, D_RAIL, GRAVITY, LENGTH, M_CART, M_ROD, SwingUp

from cartpend_dae import Component, Param, Statements, connect, initial, param
from cartpend_dae.library import rotational
from cartpend_dae.library.electrical import PowerStage
from cartpend_dae.library.planar import HangingRod
from cartpend_dae.library.rotational import AngleSensor, BearingFriction
from cartpend_dae.library.translational import Fixed, Mass, PositionSensor, RailFriction, SpringDamper
from cartpend_dae.library.translational_sources import Push


class ClosedLoop(Component):
    """Controller - power stage - motors, gears, chain - cart on its rail - rod, with encoders and a hand that pushes.

    `start` is "tilted" (10 degrees from upright) or "hanging"; `elastic_chain` puts the stiffness of both sides
    between drive and cart; `brake_load` [Ohm] closes the terminals of the brake motor.
    """

    f_c: Param = param(unit="N", default=6.0, min=0, doc="Coulomb friction of the rail")
    start: str = "tilted"
    elastic_chain: bool = False
    brake_load: float | None = None

    def __post_init__(self) -> None:
        self.controller, self.stage = SwingUp(), PowerStage()
        self.drive = DriveTrain(brake_load=self.brake_load)
        self.chain = SpringDamper(c=4e5, d=100.0) if self.elastic_chain else None
        self.cart, self.rod = Mass(m=M_CART), HangingRod(m=M_ROD, l=LENGTH, g=GRAVITY)
        self.ground, self.rail = Fixed(), RailFriction(d=D_RAIL, f_c=self.f_c)
        self.housing, self.bearing = rotational.Fixed(), BearingFriction(d=D_BEARING)
        self.encoder, self.angle = PositionSensor(), AngleSensor()
        self.hand = Push()

    def equations(self) -> Statements:
        yield connect(self.controller.u, self.stage.u)
        yield connect(self.stage.pin, self.drive.motor.pin_p)
        if self.chain is None:
            yield connect(self.drive.chain, self.cart.flange_a)
        else:
            yield connect(self.drive.chain, self.chain.flange_a)
            yield connect(self.chain.flange_b, self.cart.flange_a)
        yield connect(self.encoder.flange, self.drive.chain)
        yield connect(self.encoder.s, self.controller.s)
        yield connect(self.ground.flange, self.rail.flange_a)
        yield connect(self.rail.flange_b, self.cart.flange_b)
        yield connect(self.hand.flange, self.cart.flange_b)
        yield connect(self.cart.flange_b, self.rod.pivot)
        yield connect(self.housing.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.shaft)
        yield connect(self.angle.flange, self.rod.shaft)
        yield connect(self.angle.phi, self.controller.phi)
        yield initial(self.cart.s == 0)
        yield initial(self.cart.v == 0)
        yield initial(self.bearing.phi == (pi - pi / 18 if self.start == "tilted" else 0.0))
        yield initial(self.bearing.w == 0)
        if self.chain is not None:
            yield initial(self.chain.s_rel == 0)
            yield initial(self.encoder.s == 0, fixed=False)
