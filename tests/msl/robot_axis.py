"""One axis of a robot: a motor with current control moves an inertia through a springy gear with friction."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import controllers, rotational, rotational_friction, servos

SPEC = "Modelica.Mechanics.MultiBody.Examples.Systems.RobotR3.OneAxis"
EVENTS = (0.3, 0.698131700797732, 0.998131700797732)
PARTIAL = True
FOLDERS = ("axis.gear.", "axis.", "pathPlanning.")
RENAMED = {
    "axis.initializeFlange.phi_flange": "load.phi",
    "axis.initializeFlange.w_flange": "load.w",
    "axis.motor.C.v": "motor.C.u",
}


class RobotAxis(Component):
    """One axis of a robot: a motor with current control moves an inertia through a springy gear with friction."""

    def __post_init__(self) -> None:
        self.controller = servos.PositionCascade(kp=5.0, ks=0.5, Ts=0.05, ratio=210.0)
        self.motor = servos.CurrentControlledMotor(J=0.0013, k=1.1616, w=5500.0, D=0.6)
        self.bearingFriction = rotational_friction.TableBearing(tau_pos=((0.0, 0.5), (1.0, 0.50076923076923)))
        self.spring = rotational.SpringDamper(c=8.0, d=0.01)
        self.gear = rotational.IdealGear(ratio=210.0)
        self.load = rotational.Inertia(J=19.5)
        self.path = controllers.KinematicPTP2(q_end=2.0943951023932, qd_max=3.0, qdd_max=10.0)

    def equations(self) -> Statements:
        yield connect(self.motor.flange, self.bearingFriction.flange_a)
        yield connect(self.bearingFriction.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.load.flange_a)
        yield connect(self.path.q, self.controller.phi_ref)
        yield connect(self.path.qd, self.controller.w_ref)
        yield connect(self.motor.phi_mechanical, self.controller.phi)
        yield connect(self.motor.w_mechanical, self.controller.w)
        yield connect(self.controller.y, self.motor.i_ref)
        yield initial(self.load.phi == 0)
        yield initial(self.load.w == 0)
        yield initial(self.spring.phi_rel == 0)
        yield initial(self.spring.w_rel == 0)
        yield initial(self.motor.C.u == 0)
        yield initial(self.motor.La.i == 0)
        yield initial(self.controller.PI.x == 0)
