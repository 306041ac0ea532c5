"""The closed loop of components: amplifier, motor with inductance, gears, cart, rod upright, state feedback."""

from math import pi

import hand

from cartpend_dae import Component, Param, Statements, connect, initial, param, signal
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.electrical import Amplifier, DCMotor, OnePort
from cartpend_dae.library.planar import HangingRod
from cartpend_dae.library.sampled import Clock, SampleAndHold
from cartpend_dae.library.signals import Constant, Feedback, Integrator, Sine

# the states of `hand.py`, in its order
STATES = ("inertial.s", "inertial.v", "rod.phi", "rod.w", "motor.inductor.i", "integrator.y")


class StateFeedback(Component):
    """Control voltage, u = -sum of gain times deviation."""

    s = signal("in", unit="m", doc="error of the position")
    v = signal("in", unit="m/s", doc="speed of the cart")
    phi = signal("in", unit="rad", doc="angle off upright")
    w = signal("in", unit="rad/s", doc="speed of the rod")
    i = signal("in", unit="A", doc="current")
    e = signal("in", unit="m", doc="integral of the error over 1 s")
    u = signal("out", unit="V", doc="control voltage")
    k_s: Param = param(unit="V/m", doc="gain of s")
    k_v: Param = param(unit="V.s/m", doc="gain of v")
    k_phi: Param = param(unit="V/rad", doc="gain of phi")
    k_w: Param = param(unit="V.s/rad", doc="gain of w")
    k_i: Param = param(unit="V/A", doc="gain of i")
    k_e: Param = param(unit="V/m", doc="gain of e")

    def equations(self) -> Statements:
        motion = self.k_s * self.s + self.k_v * self.v + self.k_phi * self.phi + self.k_w * self.w
        yield self.u == -(motion + self.k_i * self.i + self.k_e * self.e)


class CurrentSensor(OnePort):
    """Ideal current sensor, u = 0, measured = i."""

    measured = signal("out", unit="A", doc="measured current, positive from pin_p to pin_n")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == 0
        yield self.measured == self.i


class ClosedLoop(Component):
    """The rig of `hand.py`; with `f_c` [N] there is dry friction on the rail, with `period` [s] the voltage is held."""

    f_c: float = 0.0
    period: float | None = None

    def __post_init__(self) -> None:
        self.amplifier = Amplifier()
        self.motor = DCMotor(R=hand.RESISTANCE, k=hand.TORQUE_CONSTANT, L=hand.INDUCTANCE)
        self.ammeter = CurrentSensor()
        self.gears = rotational.IdealGearR2T(ratio=hand.RATIO)
        self.inertial = translational.Mass(m=hand.INERTIAL_MASS)
        self.cart = translational.Mass(m=hand.MASS_CART)
        self.ground = translational.Fixed()
        self.rail = translational.RailFriction(d=hand.DAMPING_RAIL, f_c=self.f_c)
        self.rod = HangingRod(m=hand.MASS_ROD, l=hand.LENGTH, g=hand.GRAVITY)
        self.housing, self.bearing = rotational.Fixed(), rotational.BearingFriction(d=hand.DAMPING_BEARING)
        self.encoder, self.tachometer = translational.PositionSensor(), translational.SpeedSensor()
        self.rod_angle, self.rod_speed = rotational.AngleSensor(), rotational.SpeedSensor()
        self.set_point = Sine(amplitude=hand.STROKE, f=hand.FREQUENCY)
        self.upright = Constant(k=pi)
        self.error, self.tilt = Feedback(), Feedback()
        self.integrator = Integrator()
        self.clock = None if self.period is None else Clock(period=self.period)
        self.hold = None if self.period is None else SampleAndHold()
        self.control = StateFeedback(**{f"k_{name}": gain for name, gain in hand.GAINS.items()})

    def equations(self) -> Statements:
        yield connect(self.amplifier.pin_p, self.ammeter.pin_p)
        yield connect(self.ammeter.pin_n, self.motor.pin_p)
        yield connect(self.amplifier.pin_n, self.motor.pin_n)
        yield connect(self.motor.shaft, self.gears.flange_R)
        yield connect(self.gears.flange_T, self.inertial.flange_a)
        yield connect(self.inertial.flange_b, self.cart.flange_a, self.encoder.flange, self.tachometer.flange)
        yield connect(self.ground.flange, self.rail.flange_a)
        yield connect(self.cart.flange_b, self.rail.flange_b, self.rod.pivot)
        yield connect(self.housing.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.shaft, self.rod_angle.flange, self.rod_speed.flange)
        yield connect(self.encoder.s, self.error.u1)
        yield connect(self.set_point.y, self.error.u2)
        yield connect(self.rod_angle.phi, self.tilt.u1)
        yield connect(self.upright.y, self.tilt.u2)
        yield connect(self.error.y, self.integrator.u, self.control.s)
        yield connect(self.tachometer.v, self.control.v)
        yield connect(self.tilt.y, self.control.phi)
        yield connect(self.rod_speed.w, self.control.w)
        yield connect(self.ammeter.measured, self.control.i)
        yield connect(self.integrator.y, self.control.e)
        if self.clock is None or self.hold is None:
            yield connect(self.control.u, self.amplifier.u)
        else:
            yield connect(self.control.u, self.hold.u)
            yield connect(self.clock.y, self.hold.clock)
            yield connect(self.hold.y, self.amplifier.u)
        yield initial(self.rod.s == 0)
        yield initial(self.rod.v == 0)
        yield initial(self.rod.phi == hand.START["phi"])
        yield initial(self.rod.w == 0)
        yield initial(self.motor.i == 0)
        yield initial(self.integrator.y == 0)
