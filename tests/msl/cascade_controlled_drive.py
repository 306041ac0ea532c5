"""Position control of one inertia around a speed control."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import controllers, rotational, signals

SPEC = "Modelica.Clocked.Examples.CascadeControlledDrive.Continuous"


class CascadeControlledDrive(Component):
    """Position control of one inertia around a speed control."""

    def __post_init__(self) -> None:
        self.load = rotational.Inertia(J=10.0)
        self.speed = rotational.SpeedSensor()
        self.PI = controllers.PI(k=100.0, T=0.5)
        self.feedback2 = signals.Feedback()
        self.torque = rotational.Torque()
        self.angle = rotational.AngleSensor()
        self.kinematicPTP = controllers.KinematicPTP2(q_end=3.1415926535898, qd_max=2.0, qdd_max=3.0)
        self.feedback1 = signals.Feedback()
        self.gain = signals.Gain(k=20.0)

    def equations(self) -> Statements:
        yield connect(self.speed.flange, self.load.flange_b)
        yield connect(self.feedback2.y, self.PI.u)
        yield connect(self.torque.flange, self.load.flange_a)
        yield connect(self.angle.flange, self.load.flange_b)
        yield connect(self.PI.y, self.torque.tau)
        yield connect(self.speed.w, self.feedback2.u2)
        yield connect(self.angle.phi, self.feedback1.u2)
        yield connect(self.kinematicPTP.q, self.feedback1.u1)
        yield connect(self.feedback1.y, self.gain.u)
        yield connect(self.gain.y, self.feedback2.u1)
        yield initial(self.load.phi == 0.0)
        yield initial(self.load.w == 0.0)
        yield initial(self.PI.x == 0)
