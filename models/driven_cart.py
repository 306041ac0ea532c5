"""The driven rig with everything rigid: voltage in, position of the cart and angle of the pendulum out."""

from cartpend_dae import Component, Statements, connect, initial
from cartpend_dae.library import rotational
from cartpend_dae.library.electrical import Amplifier, DCMotor
from cartpend_dae.library.planar import HangingRod
from cartpend_dae.library.rotational import BearingFriction, IdealGearR2T
from cartpend_dae.library.translational import Fixed, Mass, PositionSensor, RailFriction


class DrivenCart(Component):
    """Amplifier, motor, ideal gears, inertial mass, rigid chain, and the cart with the pendulum under it.

    Positive `amplifier.u` drives `encoder.s` up; `bearing.phi` is 0 where the rod hangs, positive with its
    tip towards +s. Rotor and gears are massless: all rotating inertia is in `inertial.m`. It starts at rest.
    """

    def __post_init__(self) -> None:
        self.amplifier = Amplifier(gain=1.0)
        self.motor = DCMotor(R=0.739, k=0.170)
        self.gears = IdealGearR2T(ratio=84.9)
        self.inertial = Mass(m=6.763)
        self.encoder = PositionSensor()
        self.cart = Mass(m=4.609)
        self.ground, self.rail = Fixed(), RailFriction(d=12.0)
        self.rod = HangingRod(m=0.1719, l=0.86, g=9.81)
        # The cart does not turn, so the housing of the bearing is held.
        self.housing, self.bearing = rotational.Fixed(), BearingFriction(d=0.0375)

    def equations(self) -> Statements:
        yield connect(self.amplifier.pin_p, self.motor.pin_p)
        yield connect(self.amplifier.pin_n, self.motor.pin_n)
        yield connect(self.motor.shaft, self.gears.flange_R)
        yield connect(self.gears.flange_T, self.inertial.flange_a)
        yield connect(self.encoder.flange, self.inertial.flange_a)
        # The rigid chain is a connection.
        yield connect(self.inertial.flange_b, self.cart.flange_a)
        yield connect(self.ground.flange, self.rail.flange_a)
        yield connect(self.rail.flange_b, self.cart.flange_b)
        yield connect(self.cart.flange_b, self.rod.pivot)
        yield connect(self.housing.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.shaft)
        yield initial(self.encoder.s == 0)
        yield initial(self.inertial.v == 0)
        yield initial(self.bearing.phi == 0)
        yield initial(self.bearing.w == 0)
