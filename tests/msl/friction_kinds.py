"""Bearing friction, brake, clutch and one-way clutch, each driven by a sine."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_friction, signals

SPEC = "ModelicaTest.Rotational.TestFriction"
EVENTS = (0.5,)


class FrictionKinds(Component):
    """Bearing friction, brake, clutch and one-way clutch, each driven by a sine."""

    def __post_init__(self) -> None:
        self.inertia = rotational.Inertia(J=1.0)
        self.bearingFriction = rotational_friction.TableBearing(tau_pos=((0.0, 1.0),))
        self.torque = rotational.Torque()
        self.sine = signals.Sine(amplitude=10.0, f=1.0)
        self.inertia1 = rotational.Inertia(J=1.0)
        self.torque1 = rotational.Torque()
        self.sine1 = signals.Sine(amplitude=10.0, f=1.0)
        self.brake = rotational_friction.Brake(mu_pos=((0.0, 0.5),), fn_max=1.0)
        self.step = signals.Step(height=100.0, start_time=0.5)
        self.inertia2 = rotational.Inertia(J=1.0)
        self.torque2 = rotational.Torque()
        self.sine2 = signals.Sine(amplitude=10.0, f=1.0)
        self.clutch = rotational_friction.Clutch(mu_pos=((0.0, 0.5),), fn_max=1.0)
        self.inertia3 = rotational.Inertia(J=1.0)
        self.step1 = signals.Step(height=100.0, start_time=0.5)
        self.inertia4 = rotational.Inertia(J=1.0)
        self.torque3 = rotational.Torque()
        self.sine3 = signals.Sine(amplitude=10.0, f=1.0)
        self.inertia5 = rotational.Inertia(J=1.0)
        self.step2 = signals.Step(height=100.0, start_time=0.5)
        self.oneWayClutch = rotational_friction.OneWayClutch(mu_pos=((0.0, 0.5),), fn_max=1.0)

    def equations(self) -> Statements:
        yield connect(self.inertia.flange_b, self.bearingFriction.flange_a)
        yield connect(self.torque.flange, self.inertia.flange_a)
        yield connect(self.sine.y, self.torque.tau)
        yield connect(self.torque1.flange, self.inertia1.flange_a)
        yield connect(self.sine1.y, self.torque1.tau)
        yield connect(self.inertia1.flange_b, self.brake.flange_a)
        yield connect(self.step.y, self.brake.f_normalized)
        yield connect(self.torque2.flange, self.inertia2.flange_a)
        yield connect(self.sine2.y, self.torque2.tau)
        yield connect(self.inertia2.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.inertia3.flange_a)
        yield connect(self.step1.y, self.clutch.f_normalized)
        yield connect(self.torque3.flange, self.inertia4.flange_a)
        yield connect(self.sine3.y, self.torque3.tau)
        yield connect(self.step2.y, self.oneWayClutch.f_normalized)
        yield connect(self.oneWayClutch.flange_b, self.inertia4.flange_b)
        yield connect(self.oneWayClutch.flange_a, self.inertia5.flange_a)
        yield initial(self.inertia.phi == 0.0)
        yield initial(self.inertia.w == 0.0)
        yield initial(self.inertia1.phi == 0.0)
        yield initial(self.inertia1.w == 0.0)
        yield initial(self.inertia2.phi == 0.0)
        yield initial(self.inertia2.w == 0.0)
        yield initial(self.clutch.phi_rel == 0.0)
        yield initial(self.clutch.w_rel == 0.0)
        yield initial(self.inertia4.phi == 0.0)
        yield initial(self.inertia4.w == 0.0)
        yield initial(self.oneWayClutch.phi_rel == 0.0)
        yield initial(self.oneWayClutch.w_rel == 0.0)
