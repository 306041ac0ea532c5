"""The electro-mechanical positioning system EMPS: a motor drives a slide by a ball screw.

References
----------
A. Janot, M. Gautier, M. Brunot (2019), Data Set and Reference Models of EMPS, Nonlinear System Identification
Benchmarks Workshop, Eindhoven.
"""

from cartpend_dae import Component, Statements, connect
from cartpend_dae.library.signals import Add, Feedback, Gain, Limiter
from cartpend_dae.library.translational import Drive, Fixed, Mass, PositionSensor, RailFriction, SpeedSensor


class EMPS(Component):
    """Drive, axis and guide, m der(v) = k u - d v - f_c sgn v, in its position loop if `controlled`.

    The open model is driven by `drive.u` [V]. The controlled one has the inputs `reference.u` [m] and
    `pulses.u` [V], and u = kv (kp (reference - s) - v) + pulses, limited to 10 V either way. The drive acts
    on the load, so all inertia is in `axis.m` [kg]. Without `f_c` [N] the guide has no dry friction.
    """

    controlled: bool = False
    f_c: float = 0.0

    def __post_init__(self) -> None:
        self.ground = Fixed()
        self.drive = Drive(k=35.15065)
        self.axis = Mass(m=95.0)
        self.guide = RailFriction(d=200.0, f_c=self.f_c)
        self.encoder = PositionSensor()
        if self.controlled:
            self.tachometer = SpeedSensor()
            self.reference, self.pulses = Gain(k=1.0), Gain(k=1.0)
            self.position_error, self.kp = Feedback(), Gain(k=160.18)
            self.speed_error, self.kv = Feedback(), Gain(k=243.45)
            self.command, self.limiter = Add(), Limiter(y_max=10.0, y_min=-10.0)

    def equations(self) -> Statements:
        yield connect(self.drive.flange, self.axis.flange_a)
        yield connect(self.ground.flange, self.guide.flange_a)
        yield connect(self.guide.flange_b, self.axis.flange_a)
        yield connect(self.encoder.flange, self.axis.flange_b)
        if self.controlled:
            yield from self._position_loop()

    def _position_loop(self) -> Statements:
        yield connect(self.tachometer.flange, self.axis.flange_b)
        yield connect(self.reference.y, self.position_error.u1)
        yield connect(self.encoder.s, self.position_error.u2)
        yield connect(self.position_error.y, self.kp.u)
        yield connect(self.kp.y, self.speed_error.u1)
        yield connect(self.tachometer.v, self.speed_error.u2)
        yield connect(self.speed_error.y, self.kv.u)
        yield connect(self.kv.y, self.command.u1)
        yield connect(self.pulses.y, self.command.u2)
        yield connect(self.command.y, self.limiter.u)
        yield connect(self.limiter.y, self.drive.u)
