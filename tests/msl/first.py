"""A sine torque moves two inertias that a gear joins, and a third through a spring."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, signals

SPEC = "Modelica.Mechanics.Rotational.Examples.First"


class First(Component):
    """A sine torque moves two inertias that a gear joins, and a third through a spring."""

    def __post_init__(self) -> None:
        self.fixed = rotational.Fixed()
        self.torque = rotational.Torque(use_support=True)
        self.inertia1 = rotational.Inertia(J=0.1)
        self.idealGear = rotational.IdealGear(use_support=True, ratio=10.0)
        self.inertia2 = rotational.Inertia(J=2.0)
        self.spring = rotational.Spring(c=10000.0)
        self.inertia3 = rotational.Inertia(J=2.0)
        self.damper = rotational.Damper(d=10.0)
        self.sine = signals.Sine(amplitude=10.0, f=5.0)

    def equations(self) -> Statements:
        yield connect(self.inertia1.flange_b, self.idealGear.flange_a)
        yield connect(self.idealGear.flange_b, self.inertia2.flange_a)
        yield connect(self.inertia2.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.inertia3.flange_a)
        yield connect(self.damper.flange_a, self.inertia2.flange_b)
        yield connect(self.damper.flange_b, self.fixed.flange)
        yield connect(self.sine.y, self.torque.tau)
        yield connect(self.torque.support, self.fixed.flange)
        yield connect(self.idealGear.support, self.fixed.flange)
        yield connect(self.torque.flange, self.inertia1.flange_a)
        yield initial(self.inertia2.phi == 0.0)
        yield initial(self.inertia2.w == 0.0)
        yield initial(self.spring.phi_rel == 0.0)
        yield initial(self.inertia3.w == 0.0)
