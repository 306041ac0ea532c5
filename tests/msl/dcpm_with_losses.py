"""Two DC motors, an ideal one and one with all its losses, run up against fans."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import electrical, machines, rotational, rotational_sources, signals

SPEC = "Modelica.Electrical.Machines.Examples.DCMachines.DCPM_withLosses"


class DcpmWithLosses(Component):
    """Two DC motors, an ideal one and one with all its losses, run up against fans."""

    def __post_init__(self) -> None:
        self.ramp = signals.Ramp(height=100.0, start_time=0.2, duration=0.8)
        self.signalVoltage = electrical.VoltageSource()
        self.ground = electrical.Ground()
        self.loadInertia1 = rotational.Inertia(J=0.15)
        self.loadTorque1 = rotational_sources.QuadraticSpeedDependentTorque(
            torque_direction=False, tau_nominal=-63.66, w_nominal=149.22565104552
        )
        self.loadInertia2 = rotational.Inertia(J=0.15)
        self.loadTorque2 = rotational_sources.QuadraticSpeedDependentTorque(
            torque_direction=False, tau_nominal=-61.3, w_nominal=148.44025288212
        )
        self.dcpm1 = machines.DCPermanentMagnet(
            Va_nominal=100.0, Ia_nominal=100.0, w_nominal=149.22565104552, Ra=0.05, La=0.0015, Jr=0.15
        )
        self.dcpm2 = machines.DCPermanentMagnet(
            Va_nominal=100.0,
            Ia_nominal=100.0,
            w_nominal=148.44025288212,
            Ra=0.03864,
            alpha20a=0.00392,
            Ta_nominal=368.15,
            Ta_operational=368.15,
            La=0.0015,
            Jr=0.15,
            friction_P=100.0,
            core_P=200.0,
            stray_P=50.0,
            brush_V=0.5,
        )

    def equations(self) -> Statements:
        yield connect(self.ramp.y, self.signalVoltage.u)
        yield connect(self.signalVoltage.pin_n, self.ground.pin)
        yield connect(self.loadInertia1.flange_b, self.loadTorque1.flange)
        yield connect(self.dcpm1.flange, self.loadInertia1.flange_a)
        yield connect(self.loadInertia2.flange_b, self.loadTorque2.flange)
        yield connect(self.dcpm2.flange, self.loadInertia2.flange_a)
        yield connect(self.signalVoltage.pin_p, self.dcpm1.pin_ap)
        yield connect(self.signalVoltage.pin_p, self.dcpm2.pin_ap)
        yield connect(self.signalVoltage.pin_n, self.dcpm1.pin_an)
        yield connect(self.signalVoltage.pin_n, self.dcpm2.pin_an)
        yield initial(self.dcpm1.phi_mechanical == 0.0)
        yield initial(self.dcpm1.w_mechanical == 0.0)
        yield initial(self.dcpm1.ia == 0.0)
        yield initial(self.dcpm2.phi_mechanical == 0.0)
        yield initial(self.dcpm2.w_mechanical == 0.0)
        yield initial(self.dcpm2.ia == 0.0)
