"""A DC motor runs up on a ramp of the voltage and is then loaded by a step."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import electrical, machines, rotational, rotational_sources, signals

SPEC = "Modelica.Electrical.Machines.Examples.DCMachines.DCPM_Start"


class DcpmStart(Component):
    """A DC motor runs up on a ramp of the voltage and is then loaded by a step."""

    def __post_init__(self) -> None:
        self.ramp = signals.Ramp(height=100.0, start_time=0.2, duration=0.8)
        self.signalVoltage = electrical.VoltageSource()
        self.ground = electrical.Ground()
        self.loadInertia = rotational.Inertia(J=0.15)
        self.loadTorqueStep = rotational_sources.TorqueStep(start_time=1.5, step_torque=-63.66)
        self.dcpm = machines.DCPermanentMagnet(
            Va_nominal=100.0, Ia_nominal=100.0, w_nominal=149.22565104552, Ra=0.05, La=0.0015, Jr=0.15
        )

    def equations(self) -> Statements:
        yield connect(self.ramp.y, self.signalVoltage.u)
        yield connect(self.signalVoltage.pin_p, self.dcpm.pin_ap)
        yield connect(self.signalVoltage.pin_n, self.ground.pin)
        yield connect(self.dcpm.pin_an, self.signalVoltage.pin_n)
        yield connect(self.loadInertia.flange_b, self.loadTorqueStep.flange)
        yield connect(self.dcpm.flange, self.loadInertia.flange_a)
        yield initial(self.dcpm.phi_mechanical == 0.0)
        yield initial(self.dcpm.w_mechanical == 0.0)
        yield initial(self.dcpm.ia == 0.0)
