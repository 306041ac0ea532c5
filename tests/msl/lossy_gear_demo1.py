"""Two inertias joined by a gear whose mesh loses half the power."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_friction, signals

SPEC = "Modelica.Mechanics.Rotational.Examples.LossyGearDemo1"
EVENTS = ()


class LossyGearDemo1(Component):
    """Two inertias joined by a gear whose mesh loses half the power."""

    def __post_init__(self) -> None:
        self.gear = rotational_friction.LossyGear(loss_table=((0.0, 0.5, 0.5, 0.0, 0.0),), use_support=True, ratio=2.0)
        self.Inertia1 = rotational.Inertia(J=1.0)
        self.Inertia2 = rotational.Inertia(J=1.5)
        self.torque1 = rotational.Torque(use_support=True)
        self.torque2 = rotational.Torque(use_support=True)
        self.DriveSine = signals.Sine(amplitude=10.0, f=1.0)
        self.load = signals.Ramp(height=5.0, offset=-10.0, duration=2.0)
        self.fixed = rotational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.Inertia1.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.Inertia2.flange_a)
        yield connect(self.torque1.flange, self.Inertia1.flange_a)
        yield connect(self.torque2.flange, self.Inertia2.flange_b)
        yield connect(self.DriveSine.y, self.torque1.tau)
        yield connect(self.load.y, self.torque2.tau)
        yield connect(self.fixed.flange, self.gear.support)
        yield connect(self.fixed.flange, self.torque1.support)
        yield connect(self.fixed.flange, self.torque2.support)
        yield initial(self.Inertia2.phi == 0.0)
        yield initial(self.Inertia2.w == 0.0)
