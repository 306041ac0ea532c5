"""Two inertias joined by a gear with losses, and a bearing with friction."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_friction, signals

SPEC = "Modelica.Mechanics.Rotational.Examples.LossyGearDemo2"
EVENTS = ()


class LossyGearDemo2(Component):
    """Two inertias joined by a gear with losses, and a bearing with friction."""

    def __post_init__(self) -> None:
        self.gear = rotational_friction.LossyGear(loss_table=((0.0, 0.5, 0.5, 0.0, 0.0),), use_support=True, ratio=2.0)
        self.Inertia1 = rotational.Inertia(J=1.0)
        self.Inertia2 = rotational.Inertia(J=1.5)
        self.torque1 = rotational.Torque(use_support=True)
        self.torque2 = rotational.Torque(use_support=True)
        self.DriveSine = signals.Sine(amplitude=10.0, f=1.0)
        self.load = signals.Ramp(height=5.0, offset=-10.0, duration=2.0)
        self.bearingFriction = rotational_friction.TableBearing(tau_pos=((0.0, 0.5), (1.0, 1.0)), use_support=True)
        self.fixed = rotational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.torque2.flange, self.Inertia2.flange_b)
        yield connect(self.Inertia2.flange_a, self.gear.flange_b)
        yield connect(self.gear.flange_a, self.Inertia1.flange_b)
        yield connect(self.Inertia1.flange_a, self.bearingFriction.flange_b)
        yield connect(self.bearingFriction.flange_a, self.torque1.flange)
        yield connect(self.DriveSine.y, self.torque1.tau)
        yield connect(self.load.y, self.torque2.tau)
        yield connect(self.gear.support, self.fixed.flange)
        yield connect(self.fixed.flange, self.torque2.support)
        yield connect(self.fixed.flange, self.bearingFriction.support)
        yield connect(self.torque1.support, self.fixed.flange)
        yield initial(self.Inertia2.phi == 0.0)
        yield initial(self.Inertia2.w == 0.0)
