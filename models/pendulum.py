"""A pendulum seen by a camera, in a bearing without friction; the data are those of `oscillator.py`'s authors."""

from cartpend_dae import Component, Statements, connect, initial
from cartpend_dae.library.rotational import BearingFriction, Fixed, Inertia
from cartpend_dae.library.rotational_sources import Weight


class Pendulum(Component):
    """Pendulum of unit inertia, J der(w) + d w + tau_g sin phi = 0; no friction unless `bearing.d` is set.

    `bearing.phi` is 0 where it hangs. Its mass was not recorded: what the motion tells are tau_g/J and d/J.
    """

    def __post_init__(self) -> None:
        self.ground = Fixed()
        self.bearing = BearingFriction()
        self.arm = Inertia(J=1.0)
        self.weight = Weight(tau_g=1.0)

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.arm.flange_a, self.weight.flange)
        yield initial(self.bearing.phi == 0.5)
        yield initial(self.bearing.w == 0)
