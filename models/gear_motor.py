"""A small geared DC motor on its amplifier: voltage in, speed of the output shaft out."""

from cartpend_dae import Component, Statements, connect
from cartpend_dae.library.electrical import Amplifier, DCMotor
from cartpend_dae.library.rotational import BearingFriction, Fixed, IdealGear, SpeedSensor


class GearMotor(Component):
    """Amplifier, motor with its rotor, ideal gear of 60, output shaft in a bearing without friction.

    To a voltage `amplifier.u` the speed `tachometer.w` answers as a first-order lag, with the gain 1/(60 k) and the
    time constant J R/k^2. The winding's inductance of 0.3 mH is over within a quarter of a millisecond and left out.
    """

    def __post_init__(self) -> None:
        self.amplifier = Amplifier(gain=1.0)
        self.motor = DCMotor(R=1.371, k=0.006, J=1e-5)
        self.gear = IdealGear(ratio=60.0)
        self.ground, self.bearing = Fixed(), BearingFriction()
        self.tachometer = SpeedSensor()

    def equations(self) -> Statements:
        yield connect(self.amplifier.pin_p, self.motor.pin_p)
        yield connect(self.amplifier.pin_n, self.motor.pin_n)
        yield connect(self.motor.shaft, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.bearing.flange_b, self.tachometer.flange)
        yield connect(self.ground.flange, self.bearing.flange_a)
