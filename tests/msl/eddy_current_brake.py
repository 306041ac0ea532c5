"""An eddy current brake stops an inertia and heats itself."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_sources, thermal

SPEC = "Modelica.Mechanics.Rotational.Examples.EddyCurrentBrake"


class EddyCurrentBrake(Component):
    """An eddy current brake stops an inertia and heats itself."""

    def __post_init__(self) -> None:
        self.eddyCurrentTorque = rotational_sources.EddyCurrentTorque(
            tau_nominal=100.0, w_nominal=10.0, alpha20=0.00392
        )
        self.inertia = rotational.Inertia(J=1.0)
        self.heatCapacitor = thermal.HeatCapacitor(C=1.0)

    def equations(self) -> Statements:
        yield connect(self.eddyCurrentTorque.flange, self.inertia.flange_a)
        yield connect(self.eddyCurrentTorque.heat_port, self.heatCapacitor.port)
        yield initial(self.inertia.phi == 0.0)
        yield initial(self.inertia.w == 20.0)
        yield initial(self.heatCapacitor.T == 293.15)
