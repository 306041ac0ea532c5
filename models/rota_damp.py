"""Experiment 1 of the published study: a rod pendulum released on a cart that is held."""

from cartpend_dae import Component, Statements, connect, initial
from cartpend_dae.library import translational
from cartpend_dae.library.planar import HangingRod
from cartpend_dae.library.rotational import BearingFriction, Fixed


class RotaDamp(Component):
    """Rod pendulum in a bearing on the ground, J der(w) + d w + tau_c sgn w + m g (l/2) sin phi = 0, J = m l^2/3.

    `bearing.phi` is 0 where the rod hangs; it is released at rest at -0.351 rad. Its pivot is held by the base.
    Without `tau_c` [N.m] the bearing has no dry friction.
    """

    tau_c: float = 0.0

    def __post_init__(self) -> None:
        self.base, self.ground = translational.Fixed(), Fixed()
        self.bearing = BearingFriction(d=0.0375, tau_c=self.tau_c)
        self.rod = HangingRod(m=0.1719, l=0.86, g=9.81)

    def equations(self) -> Statements:
        yield connect(self.base.flange, self.rod.pivot)
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.shaft)
        yield initial(self.bearing.phi == -0.351)
        yield initial(self.bearing.w == 0)
