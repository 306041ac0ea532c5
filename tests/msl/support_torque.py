"""A bearing that a sine of torque just fails to break loose."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_friction, signals

SPEC = "ModelicaTest.Rotational.ForUsersGuide.SupportTorque1"
EVENTS = ()


class SupportTorque(Component):
    """A bearing that a sine of torque just fails to break loose."""

    def __post_init__(self) -> None:
        self.sine2 = signals.Sine(amplitude=1.0, f=1.0)
        self.torque2 = rotational.Torque(use_support=True)
        self.fixed1 = rotational.Fixed()
        self.inertia3 = rotational.Inertia(J=1.0)
        self.idealGear2 = rotational.IdealGear(use_support=True, ratio=1.0)
        self.inertia4 = rotational.Inertia(J=1.0)
        self.bearingFriction1 = rotational_friction.TableBearing(tau_pos=((0.0, 1.0),), use_support=True)

    def equations(self) -> Statements:
        yield connect(self.sine2.y, self.torque2.tau)
        yield connect(self.torque2.support, self.fixed1.flange)
        yield connect(self.torque2.flange, self.inertia3.flange_a)
        yield connect(self.fixed1.flange, self.idealGear2.support)
        yield connect(self.inertia3.flange_b, self.idealGear2.flange_a)
        yield connect(self.idealGear2.flange_b, self.bearingFriction1.flange_a)
        yield connect(self.bearingFriction1.flange_b, self.inertia4.flange_a)
        yield connect(self.fixed1.flange, self.bearingFriction1.support)
        yield initial(self.inertia3.phi == 0.0)
        yield initial(self.inertia3.w == 0.0)
