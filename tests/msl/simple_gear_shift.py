"""A planetary gear with two speeds: its ring is held by a brake, or coupled to the sun by a clutch."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_friction, rotational_parts, rotational_sources, signals

SPEC = "Modelica.Mechanics.Rotational.Examples.SimpleGearShift"
EVENTS = (0.5, 2.0, 2.1)


class SimpleGearShift(Component):
    """A planetary gear with two speeds: its ring is held by a brake, or coupled to the sun by a clutch."""

    def __post_init__(self) -> None:
        self.torqueStep = rotational_sources.TorqueStep(start_time=0.5, step_torque=20.0)
        self.engine = rotational.Inertia(J=1.0)
        self.idealPlanetary = rotational_parts.IdealPlanetary(ratio=1.5)
        self.load = rotational.Inertia(J=10.0)
        self.quadraticSpeedDependentTorque = rotational_sources.QuadraticSpeedDependentTorque(
            torque_direction=True, w_nominal=10.471975511966, tau_nominal=-20.0
        )
        self.clutch = rotational_friction.Clutch(mu_pos=((0.0, 0.5),), cgeo=2.0, fn_max=100.0)
        self.brake = rotational_friction.Brake(mu_pos=((0.0, 0.5),), cgeo=2.0, fn_max=100.0)
        self.feedback = signals.Feedback()
        self.const1 = signals.Constant(k=1.0)
        self.ramp = signals.Ramp(height=1.0, start_time=2.0, duration=0.1)

    def equations(self) -> Statements:
        yield connect(self.torqueStep.flange, self.engine.flange_a)
        yield connect(self.quadraticSpeedDependentTorque.flange, self.load.flange_b)
        yield connect(self.feedback.y, self.brake.f_normalized)
        yield connect(self.engine.flange_b, self.idealPlanetary.sun)
        yield connect(self.idealPlanetary.sun, self.clutch.flange_a)
        yield connect(self.idealPlanetary.ring, self.clutch.flange_b)
        yield connect(self.idealPlanetary.ring, self.brake.flange_a)
        yield connect(self.idealPlanetary.carrier, self.load.flange_a)
        yield connect(self.const1.y, self.feedback.u1)
        yield connect(self.feedback.u2, self.clutch.f_normalized)
        yield connect(self.ramp.y, self.clutch.f_normalized)
        yield initial(self.load.phi == 0.0)
        yield initial(self.load.w == 0.0)
        yield initial(self.clutch.phi_rel == 0.0)
        yield initial(self.clutch.w_rel == 0.0)
