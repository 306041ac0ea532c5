"""The rig of `closed_loop.py` without its controller: measured voltage in, what both encoders count out."""

from math import pi

from swing_up import D_BEARING, D_RAIL, GRAVITY, LENGTH, M_CART, M_ROD, R_MOTOR

from cartpend_dae import Component, Param, Statements, connect, initial, param
from cartpend_dae.library import rotational
from cartpend_dae.library.electrical import Amplifier, DCMotor
from cartpend_dae.library.planar import HangingRod
from cartpend_dae.library.rotational import BearingFriction, IdealGearR2T, Inertia
from cartpend_dae.library.translational import Fixed, Mass, PositionSensor, RailFriction

# turns of a rotor per travel of the chain, r_2/(r_1 r_3) of `gear_stage.py` [rad/m]; what all gears and hubs weigh at
# the chain (`rig_report.py` prints their shares) [kg]
RATIO, M_GEARS = 0.0252 / (0.0164 * 0.0181), 4.3197


class VoltageRig(Component):
    """Motor, gears, rigid chain, brake motor with open terminals, cart on its rail and the rod; driven by a voltage.

        motor --[gears]-- wheels -- chain -- cart      the rotor of the brake motor turns with the chain

    The voltage comes from a controller; what that does about disturbances is in the voltage, so that the controller
    itself is not needed. `encoder.s` counts on the motor's side of the chain; `bearing.phi` is 0 where the rod hangs.
    The winding's inductance is over within a third of a millisecond and left out.
    """

    J_brake: Param = param(unit="kg.m2", default=2.19e-4, min=0, doc="rotor of the brake motor")

    def __post_init__(self) -> None:
        self.amplifier = Amplifier(gain=1.0)
        self.motor = DCMotor(R=R_MOTOR, k=0.0178 * 30 / pi, J=1.2e-4)
        self.gears, self.brake_gears = IdealGearR2T(ratio=RATIO), IdealGearR2T(ratio=RATIO)
        self.wheels, self.brake_rotor = Mass(m=M_GEARS), Inertia(J=self.J_brake)
        self.encoder = PositionSensor()
        self.cart, self.rod = Mass(m=M_CART), HangingRod(m=M_ROD, l=LENGTH, g=GRAVITY)
        self.ground, self.rail = Fixed(), RailFriction(d=D_RAIL)
        self.housing, self.bearing = rotational.Fixed(), BearingFriction(d=D_BEARING)

    def equations(self) -> Statements:
        yield connect(self.amplifier.pin_p, self.motor.pin_p)
        yield connect(self.amplifier.pin_n, self.motor.pin_n)
        yield connect(self.motor.shaft, self.gears.flange_R)
        yield connect(self.brake_rotor.flange_a, self.brake_gears.flange_R)
        yield connect(self.gears.flange_T, self.brake_gears.flange_T, self.wheels.flange_a, self.encoder.flange)
        # The rigid chain is a connection.
        yield connect(self.wheels.flange_b, self.cart.flange_a)
        yield connect(self.ground.flange, self.rail.flange_a)
        yield connect(self.rail.flange_b, self.cart.flange_b)
        yield connect(self.cart.flange_b, self.rod.pivot)
        yield connect(self.housing.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.shaft)
        yield initial(self.encoder.s == 0)
        yield initial(self.cart.v == 0)
        yield initial(self.bearing.phi == 0)
        yield initial(self.bearing.w == 0)
