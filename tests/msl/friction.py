"""A driven inertia, a clutch, and an inertia on a spring that a brake stops."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_friction, signals

SPEC = "Modelica.Mechanics.Rotational.Examples.Friction"
EVENTS = (0.5,)


class Friction(Component):
    """A driven inertia, a clutch, and an inertia on a spring that a brake stops."""

    def __post_init__(self) -> None:
        self.torque = rotational.Torque(use_support=True)
        self.inertia3 = rotational.Inertia(J=1.0)
        self.clutch = rotational_friction.Clutch(mu_pos=((0.0, 0.5),), fn_max=160.0)
        self.inertia2 = rotational.Inertia(J=0.05)
        self.spring = rotational.SpringDamper(c=160.0, d=1.0)
        self.inertia1 = rotational.Inertia(J=1.0)
        self.brake = rotational_friction.Brake(mu_pos=((0.0, 0.5),), use_support=True, fn_max=1600.0)
        self.const = signals.Constant(k=1.0)
        self.step = signals.Step(height=1.0, start_time=0.5)
        self.step2 = signals.Step(height=-1.0, offset=1.0, start_time=0.5)
        self.sine = signals.Sine(amplitude=200.0, f=15.91549430919)
        self.product = signals.Product()
        self.fixed = rotational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.torque.flange, self.inertia3.flange_a)
        yield connect(self.inertia3.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.inertia2.flange_a)
        yield connect(self.inertia2.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.brake.flange_a)
        yield connect(self.brake.flange_b, self.inertia1.flange_a)
        yield connect(self.sine.y, self.product.u1)
        yield connect(self.step2.y, self.product.u2)
        yield connect(self.product.y, self.torque.tau)
        yield connect(self.const.y, self.clutch.f_normalized)
        yield connect(self.step.y, self.brake.f_normalized)
        yield connect(self.torque.support, self.fixed.flange)
        yield connect(self.brake.support, self.fixed.flange)
        yield initial(self.inertia3.phi == 0.0)
        yield initial(self.inertia3.w == 100.0)
        yield initial(self.inertia2.phi == 0.0)
        yield initial(self.inertia2.w == 90.0)
        yield initial(self.inertia1.phi == 0.0)
        yield initial(self.inertia1.w == 90.0)
