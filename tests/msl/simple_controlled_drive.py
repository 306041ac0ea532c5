"""PI control of the speed of one inertia along a ramp."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import controllers, rotational, signals

SPEC = "Modelica.Clocked.Examples.SimpleControlledDrive.Continuous"


class SimpleControlledDrive(Component):
    """PI control of the speed of one inertia along a ramp."""

    def __post_init__(self) -> None:
        self.load = rotational.Inertia(J=10.0)
        self.speed = rotational.SpeedSensor()
        self.ramp = signals.Ramp(height=1.0, duration=2.0)
        self.PI = controllers.PI(T=0.1, k=110.0)
        self.feedback = signals.Feedback()
        self.torque = rotational.Torque()

    def equations(self) -> Statements:
        yield connect(self.speed.flange, self.load.flange_b)
        yield connect(self.feedback.y, self.PI.u)
        yield connect(self.torque.flange, self.load.flange_a)
        yield connect(self.ramp.y, self.feedback.u1)
        yield connect(self.PI.y, self.torque.tau)
        yield connect(self.speed.w, self.feedback.u2)
        yield initial(self.load.phi == 0.0)
        yield initial(self.load.w == 0.0)
        yield initial(self.PI.y == 0)
