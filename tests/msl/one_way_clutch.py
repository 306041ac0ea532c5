"""Two inertias and a one-way clutch between them that is pressed now and then."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_friction, signals

SPEC = "Modelica.Mechanics.Rotational.Examples.OneWayClutch"
EVENTS = (0.3, 0.95, 1.6)


class OneWayClutch(Component):
    """Two inertias and a one-way clutch between them that is pressed now and then."""

    def __post_init__(self) -> None:
        self.inertiaIn = rotational.Inertia(J=1.0)
        self.inertiaOut = rotational.Inertia(J=1.0)
        self.oneWayClutch = rotational_friction.OneWayClutch(mu_pos=((0.0, 0.5),), peak=25.0, fn_max=3.0)
        self.torque = rotational.Torque()
        self.signalTorque = signals.Sine(amplitude=10.0, f=3.0)
        self.signalEngagement = signals.Pulse(amplitude=1.0, start_time=0.3, period=1.3)

    def equations(self) -> Statements:
        yield connect(self.torque.flange, self.inertiaIn.flange_a)
        yield connect(self.signalTorque.y, self.torque.tau)
        yield connect(self.inertiaIn.flange_b, self.oneWayClutch.flange_a)
        yield connect(self.oneWayClutch.flange_b, self.inertiaOut.flange_a)
        yield connect(self.signalEngagement.y, self.oneWayClutch.f_normalized)
        yield initial(self.inertiaIn.phi == 0.0)
        yield initial(self.inertiaIn.w == -0.5)
        yield initial(self.inertiaOut.phi == 0.0)
        yield initial(self.inertiaOut.w == 0.0)
