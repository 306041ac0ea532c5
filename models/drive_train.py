"""The drive of the rig alone: two motors, one at each end of the chain, and the gears between them."""

from math import pi

from gear_stage import GearStage

from cartpend_dae import Component, Param, Statements, connect, param, port
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.electrical import DCMotor, Ground, Resistor
from cartpend_dae.library.rotational import BearingFriction


class DriveTrain(Component):
    """Motor, gears, chain, and the same mirrored to the brake motor; the cart hangs on `chain`.

        motor --[gears]-- chain --[brake_gears]-- brake_motor

    Its inertial mass is 2 (J_gear_1 + J_hub + J_gear_2)/r_1^2 + (2 J_gear_3 + J_motor + J_brake) (r_2/(r_1 r_3))^2,
    which no equation here states: it follows from the parts. The terminals of both motors are open, so that no
    current flows; `motor_load` and `brake_load` [Ohm] close them over an external resistance (0 is a short circuit).

    The study prints 0.219 kg.m2 for `J_brake`, a thousand times too much; `models/studies/rig_report.py` shows it.
    """

    chain = port(translational.Flange, doc="chain, positive as the motors turn")
    J_motor: Param = param(unit="kg.m2", default=1.20e-4, min=0, doc="rotor of the motor")
    J_brake: Param = param(unit="kg.m2", default=2.19e-4, min=0, doc="rotor of the brake motor")
    motor_load: float | None = None
    brake_load: float | None = None

    def __post_init__(self) -> None:
        # Back-EMF constants of 0.0178 and 0.00924 V/rpm; the published torque constants agree.
        self.motor = DCMotor(R=0.739, k=0.0178 * 30 / pi, L=245e-6, J=self.J_motor)
        self.brake_motor = DCMotor(R=1.10, k=0.00924 * 30 / pi, L=1100e-6, J=self.J_brake)
        self.ground, self.brake_ground = Ground(), Ground()
        self.housing = rotational.Fixed()
        self.motor_bearing, self.brake_bearing = BearingFriction(d=2.094e-6), BearingFriction(d=7.330e-7)
        self.gears, self.brake_gears = GearStage(), GearStage()
        self.resistor = None if self.motor_load is None else Resistor(R=self.motor_load)
        self.brake_resistor = None if self.brake_load is None else Resistor(R=self.brake_load)

    def equations(self) -> Statements:
        yield connect(self.housing.flange, self.motor_bearing.flange_a, self.brake_bearing.flange_a)
        yield connect(self.motor.shaft, self.motor_bearing.flange_b, self.gears.flange_R)
        yield connect(self.brake_motor.shaft, self.brake_bearing.flange_b, self.brake_gears.flange_R)
        # The rigid chain is a connection.
        yield connect(self.gears.flange_T, self.brake_gears.flange_T, self.chain)
        yield connect(self.motor.pin_n, self.ground.pin)
        yield connect(self.brake_motor.pin_n, self.brake_ground.pin)
        if self.resistor is not None:
            yield connect(self.motor.pin_p, self.resistor.pin_p)
            yield connect(self.resistor.pin_n, self.ground.pin)
        if self.brake_resistor is not None:
            yield connect(self.brake_motor.pin_p, self.brake_resistor.pin_p)
            yield connect(self.brake_resistor.pin_n, self.brake_ground.pin)
