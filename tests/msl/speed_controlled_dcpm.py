"""A DC servo: battery, averaged converter, current control, speed control with a filter before it, load step."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import (
    controllers,
    converters,
    electrical,
    electrical_sources,
    machines,
    rotational,
    rotational_sources,
    signals,
)

SPEC = "Modelica.Electrical.Machines.Examples.ControlledDCDrives.SpeedControlledDCPM"
PARTIAL = True
RENAMED = {
    "armatureInverter.vDCFilter.y": "armatureInverter.v_dc_filter.y",
    "armatureInverter.iMotFilter.y": "armatureInverter.i_mot_filter.y",
    "armatureInverter.vMotFilter.y": "armatureInverter.v_mot_filter.y",
    "armatureInverter.iDCFilter.y": "armatureInverter.i_dc_filter.y",
    "armatureInverter.idealDcDc.deadTime.y": "armatureInverter.dc_dc.dead_time.y",
    "armatureInverter.idealDcDc.powerController.y": "armatureInverter.dc_dc.i_bat",
}


class SpeedControlledDcpm(Component):
    """A DC servo: battery, averaged converter, current control, speed control with a filter before it, load step."""

    def __post_init__(self) -> None:
        self.step = signals.Step(height=149.22565104552, start_time=0.2)
        self.preFilter = signals.FirstOrder(T=0.01)
        self.slewRateLimiter = signals.RateLimiter(rising=318.30988618379, falling=-318.30988618379)
        self.speedController = controllers.LimitedPI(k=60.0, Ti=0.01, y_max=95.492965855137)
        self.tau2i = signals.Gain(k=1.5707963267949)
        self.currentController = controllers.LimitedPI(k=0.6, Ti=0.03, k_ff=0.63661977236758, variable_limit=True)
        self.source = electrical_sources.VoltageSourceWithResistance(V=120.0, R=0.06)
        self.ground = electrical.Ground()
        self.groundMotor = electrical.Ground()
        self.armatureInverter = converters.AveragedInverter(Td=0.00025, Tmf=0.001)
        self.dcpm = machines.DCPermanentMagnet(
            Va_nominal=100.0, Ia_nominal=100.0, w_nominal=149.22565104552, Ra=0.05, La=0.0015, Jr=0.15
        )
        self.speedSensor = rotational.SpeedSensor()
        self.loadInertia = rotational.Inertia(J=0.15)
        self.loadTorqueStep = rotational_sources.TorqueStep(start_time=0.8, step_torque=-63.661977236758)

    def equations(self) -> Statements:
        yield connect(self.step.y, self.preFilter.u)
        yield connect(self.step.y, self.slewRateLimiter.u)
        yield connect(self.preFilter.y, self.speedController.u)
        yield connect(self.speedSensor.w, self.speedController.u_m)
        yield connect(self.speedController.y, self.tau2i.u)
        yield connect(self.tau2i.y, self.currentController.u)
        yield connect(self.armatureInverter.i_mot, self.currentController.u_m)
        yield connect(self.speedSensor.w, self.currentController.u_ff)
        yield connect(self.armatureInverter.v_dc, self.currentController.limit)
        yield connect(self.currentController.y, self.armatureInverter.v_ref)
        yield connect(self.source.pin_p, self.armatureInverter.battery_p)
        yield connect(self.source.pin_n, self.armatureInverter.battery_n)
        yield connect(self.source.pin_n, self.ground.pin)
        yield connect(self.armatureInverter.motor_p, self.dcpm.pin_ap)
        yield connect(self.armatureInverter.motor_n, self.dcpm.pin_an)
        yield connect(self.armatureInverter.motor_n, self.groundMotor.pin)
        yield connect(self.dcpm.flange, self.loadInertia.flange_a)
        yield connect(self.dcpm.flange, self.speedSensor.flange)
        yield connect(self.loadInertia.flange_b, self.loadTorqueStep.flange)
        yield initial(self.dcpm.phi_mechanical == 0.0)
        yield initial(self.dcpm.w_mechanical == 0.0)
        yield initial(self.dcpm.ia == 0.0)
        yield initial(self.armatureInverter.v_dc_filter.y == 120.0)
        yield initial(self.armatureInverter.i_dc_filter.y == 0.0)
        yield initial(self.armatureInverter.v_mot_filter.y == 0.0)
        yield initial(self.armatureInverter.i_mot_filter.y == 0.0)
        yield initial(self.armatureInverter.dc_dc.dead_time.y == 0.0)
        yield initial(self.armatureInverter.dc_dc.i_bat == 0.0)
        yield initial(self.preFilter.y == 0.0)
        yield initial(self.slewRateLimiter.y == 0.0)
        yield initial(self.currentController.raw == 0.0)
        yield initial(self.speedController.raw == 0.0)
