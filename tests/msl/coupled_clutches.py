"""Four inertias in a row that three clutches couple one after the other."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_friction, signals

SPEC = "Modelica.Mechanics.Rotational.Examples.CoupledClutches"
EVENTS = (0.4, 0.9)


class CoupledClutches(Component):
    """Four inertias in a row that three clutches couple one after the other."""

    def __post_init__(self) -> None:
        self.J1 = rotational.Inertia(J=1.0)
        self.torque = rotational.Torque(use_support=True)
        self.clutch1 = rotational_friction.Clutch(mu_pos=((0.0, 0.5),), peak=1.1, fn_max=20.0)
        self.sin1 = signals.Sine(amplitude=10.0, f=5.0)
        self.step1 = signals.Step(height=1.0, start_time=0.4)
        self.J2 = rotational.Inertia(J=1.0)
        self.clutch2 = rotational_friction.Clutch(mu_pos=((0.0, 0.5),), peak=1.1, fn_max=20.0)
        self.J3 = rotational.Inertia(J=1.0)
        self.clutch3 = rotational_friction.Clutch(mu_pos=((0.0, 0.5),), peak=1.1, fn_max=20.0)
        self.J4 = rotational.Inertia(J=1.0)
        self.sin2 = signals.Sine(amplitude=1.0, phase=1.5707963267949, f=0.2)
        self.step2 = signals.Step(height=1.0, start_time=0.9)
        self.fixed = rotational.Fixed()

    def equations(self) -> Statements:
        yield connect(self.torque.flange, self.J1.flange_a)
        yield connect(self.J1.flange_b, self.clutch1.flange_a)
        yield connect(self.clutch1.flange_b, self.J2.flange_a)
        yield connect(self.J2.flange_b, self.clutch2.flange_a)
        yield connect(self.clutch2.flange_b, self.J3.flange_a)
        yield connect(self.J3.flange_b, self.clutch3.flange_a)
        yield connect(self.clutch3.flange_b, self.J4.flange_a)
        yield connect(self.sin1.y, self.torque.tau)
        yield connect(self.sin2.y, self.clutch1.f_normalized)
        yield connect(self.step1.y, self.clutch2.f_normalized)
        yield connect(self.step2.y, self.clutch3.f_normalized)
        yield connect(self.fixed.flange, self.torque.support)
        yield initial(self.J1.phi == 0.0)
        yield initial(self.J1.w == 10.0)
        yield initial(self.J2.phi == 0.0)
        yield initial(self.J2.w == 0.0)
        yield initial(self.J3.phi == 0.0)
        yield initial(self.J3.w == 0.0)
        yield initial(self.J4.phi == 0.0)
        yield initial(self.J4.w == 0.0)
