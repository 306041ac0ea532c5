"""Sampled PI control of the speed of one inertia along a ramp."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, sampled, signals

SPEC = "Modelica.Clocked.Examples.SimpleControlledDrive.ClockedWithDiscreteController"
PARTIAL = True  # there the blocks infer their clock


class ClockedDrive(Component):
    """Sampled PI control of the speed of one inertia along a ramp."""

    def __post_init__(self) -> None:
        self.load = rotational.Inertia(J=10.0)
        self.speed = rotational.SpeedSensor()
        self.ramp = signals.Ramp(height=1.0, duration=2.0)
        self.feedback = signals.Feedback()
        self.torque = rotational.Torque()
        self.sample2 = sampled.SampleAndHold()
        self.hold1 = sampled.SampleAndHold()
        self.sample1 = sampled.SampleAndHold()
        self.PI = sampled.PI(T=0.1, k=110.0, Ts=0.1)
        self.periodicClock = sampled.Clock(period=0.1)

    def equations(self) -> Statements:
        yield connect(self.speed.flange, self.load.flange_b)
        yield connect(self.torque.flange, self.load.flange_a)
        yield connect(self.ramp.y, self.sample2.u)
        yield connect(self.sample2.y, self.feedback.u1)
        yield connect(self.hold1.y, self.torque.tau)
        yield connect(self.speed.w, self.sample1.u)
        yield connect(self.sample1.y, self.feedback.u2)
        yield connect(self.feedback.y, self.PI.u)
        yield connect(self.PI.y, self.hold1.u)
        yield connect(self.periodicClock.y, self.sample2.clock)
        yield connect(self.periodicClock.y, self.sample1.clock)
        yield connect(self.periodicClock.y, self.PI.clock)
        yield connect(self.periodicClock.y, self.hold1.clock)
        yield initial(self.load.phi == 0.0)
        yield initial(self.load.w == 0.0)
