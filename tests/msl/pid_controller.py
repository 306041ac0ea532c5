"""Speed control of two inertias joined by a spring, with limited torque; starts in steady state under load."""

from cartpend_dae.language import Component, Statements, connect, der, initial
from cartpend_dae.library import controllers, rotational, rotational_sources, signals

SPEC = "Modelica.Blocks.Examples.PID_Controller"


class PidController(Component):
    """Speed control of two inertias joined by a spring, with limited torque; starts in steady state under load."""

    def __post_init__(self) -> None:
        self.PI = controllers.LimPID(Ni=0.1, k=100.0, Ti=0.1, y_max=12.0, y_min=-12.0)
        self.inertia1 = rotational.Inertia(J=1.0)
        self.torque = rotational.Torque()
        self.spring = rotational.SpringDamper(c=10000.0, d=100.0)
        self.inertia2 = rotational.Inertia(J=2.0)
        self.kinematicPTP = controllers.KinematicPTP(start_time=0.5, deltaq=1.5707963267949, qd_max=1.0, qdd_max=1.0)
        self.integrator = signals.Integrator()
        self.speedSensor = rotational.SpeedSensor()
        self.loadTorque = rotational_sources.ConstantTorque(tau_constant=10.0)

    def equations(self) -> Statements:
        yield connect(self.spring.flange_b, self.inertia2.flange_a)
        yield connect(self.inertia1.flange_b, self.spring.flange_a)
        yield connect(self.torque.flange, self.inertia1.flange_a)
        yield connect(self.kinematicPTP.y, self.integrator.u)
        yield connect(self.speedSensor.flange, self.inertia1.flange_b)
        yield connect(self.loadTorque.flange, self.inertia2.flange_b)
        yield connect(self.PI.y, self.torque.tau)
        yield connect(self.speedSensor.w, self.PI.u_m)
        yield connect(self.integrator.y, self.PI.u_s)
        yield initial(self.inertia1.phi == 0.0)
        yield initial(self.inertia1.a == 0.0)
        yield initial(self.spring.w_rel == 0.0)
        yield initial(der(self.spring.w_rel) == 0)
        yield initial(self.PI.correction == 0)
        yield initial(self.integrator.y == 0)
