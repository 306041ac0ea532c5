"""Current control of a DC motor through a lag."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import (
    controllers,
    electrical,
    electrical_sources,
    machines,
    rotational,
    rotational_sources,
    signals,
)

SPEC = "Modelica.Electrical.Machines.Examples.DCMachines.DCPM_CurrentControlled"


class DcpmCurrentControlled(Component):
    """Current control of a DC motor through a lag."""

    def __post_init__(self) -> None:
        self.step = signals.Step(height=100.0, start_time=0.1)
        self.signalVoltage = electrical.VoltageSource()
        self.ground = electrical.Ground()
        self.loadInertia = rotational.Inertia(J=0.15)
        self.loadTorque = rotational_sources.QuadraticSpeedDependentTorque(
            torque_direction=False, tau_nominal=-63.661977236758, w_nominal=149.22565104552
        )
        self.currentSensor = electrical_sources.CurrentSensor()
        self.speedSensor = rotational.SpeedSensor()
        self.firstOrder = signals.FirstOrder(T=0.001)
        self.PID = controllers.LimPID(k=0.75, Ti=0.03, y_max=100.0, k_ff=0.63661977236758, y_min=-100.0)
        self.dcpm = machines.DCPermanentMagnet(
            Va_nominal=100.0, Ia_nominal=100.0, w_nominal=149.22565104552, Ra=0.05, La=0.0015, Jr=0.15
        )

    def equations(self) -> Statements:
        yield connect(self.signalVoltage.pin_n, self.ground.pin)
        yield connect(self.loadInertia.flange_b, self.loadTorque.flange)
        yield connect(self.dcpm.flange, self.loadInertia.flange_a)
        yield connect(self.dcpm.pin_an, self.ground.pin)
        yield connect(self.signalVoltage.pin_p, self.currentSensor.pin_p)
        yield connect(self.currentSensor.pin_n, self.dcpm.pin_ap)
        yield connect(self.dcpm.flange, self.speedSensor.flange)
        yield connect(self.firstOrder.y, self.signalVoltage.u)
        yield connect(self.PID.y, self.firstOrder.u)
        yield connect(self.step.y, self.PID.u_s)
        yield connect(self.currentSensor.i, self.PID.u_m)
        yield connect(self.speedSensor.w, self.PID.u_ff)
        yield initial(self.dcpm.phi_mechanical == 0.0)
        yield initial(self.dcpm.w_mechanical == 0.0)
        yield initial(self.dcpm.ia == 0.0)
        yield initial(self.PID.I.y == 0)
        yield initial(self.firstOrder.y == 0)
