"""The motor of the rig alone on the bench: voltage in, current and speed out."""

from cartpend_dae import Component, Statements, connect, initial
from cartpend_dae.library.electrical import Amplifier, DCMotor
from cartpend_dae.library.rotational import BearingFriction, Fixed, SpeedSensor


class Motor(Component):
    """Motor on an amplifier, its shaft free: u = R i + L der(i) + k w, J der(w) + d w + tau_c sgn w = k i.

    `amplifier.u` is the voltage; `motor.i` and `tachometer.w` are measured. It starts at rest without current.
    """

    def __post_init__(self) -> None:
        self.amplifier = Amplifier(gain=1.0)
        self.motor = DCMotor(R=0.739, k=0.170, L=245e-6, J=1.20e-4)
        self.ground, self.bearing = Fixed(), BearingFriction(d=5e-4, tau_c=0.01)
        self.tachometer = SpeedSensor()

    def equations(self) -> Statements:
        yield connect(self.amplifier.pin_p, self.motor.pin_p)
        yield connect(self.amplifier.pin_n, self.motor.pin_n)
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.motor.shaft, self.bearing.flange_b, self.tachometer.flange)
        yield initial(self.motor.i == 0)
        yield initial(self.tachometer.w == 0)
