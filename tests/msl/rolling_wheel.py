"""A torque step drives a wheel that moves a mass against the drag of air."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_parts, rotational_sources, translational, translational_sources

SPEC = "Modelica.Mechanics.Rotational.Examples.RollingWheel"


class RollingWheel(Component):
    """A torque step drives a wheel that moves a mass against the drag of air."""

    def __post_init__(self) -> None:
        self.idealRollingWheel = rotational_parts.IdealRollingWheel(radius=1.0)
        self.inertia = rotational.Inertia(J=1.0)
        self.torqueStep = rotational_sources.TorqueStep(start_time=0.1, step_torque=10.0)
        self.mass = translational.Mass(m=1.0)
        self.quadraticSpeedDependentForce = translational_sources.QuadraticSpeedDependentForce(
            force_direction=False, f_nominal=-10.0, v_nominal=5.0
        )

    def equations(self) -> Statements:
        yield connect(self.torqueStep.flange, self.inertia.flange_a)
        yield connect(self.inertia.flange_b, self.idealRollingWheel.flange_R)
        yield connect(self.idealRollingWheel.flange_T, self.mass.flange_a)
        yield connect(self.quadraticSpeedDependentForce.flange, self.mass.flange_b)
        yield initial(self.inertia.phi == 0.0)
        yield initial(self.inertia.w == 0.0)
