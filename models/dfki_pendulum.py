"""The torque-limited simple pendulum of the DFKI: a weight on an arm, driven directly by a motor.

References
----------
F. Wiebe et al., "Torque-limited simple pendulum: A toolkit for getting familiar with control algorithms in
underactuated robotics", JOSS 7 (2022) 3884, doi:10.21105/joss.03884.
"""

from cartpend_dae import Component, Statements, connect, initial
from cartpend_dae.library.rotational import BearingFriction, ConstantLoad, Fixed, Inertia, Torque
from cartpend_dae.library.rotational_sources import Weight


class DfkiPendulum(Component):
    """Pendulum with a motor on its bearing, J der(w) + d w + tau_c sgn w + tau_0 + tau_g sin phi = tau.

    `bearing.phi` is 0 where it hangs; `motor.tau` [N.m] drives it. Without `tau_c` [N.m] the bearing has no dry
    friction, without `tau_0` [N.m] the measured torque has no offset.
    """

    tau_c: float = 0.0
    tau_0: float | None = None

    def __post_init__(self) -> None:
        self.ground = Fixed()
        self.motor = Torque()
        self.bearing = BearingFriction(d=0.05, tau_c=self.tau_c)
        self.arm = Inertia(J=0.17)
        self.weight = Weight(tau_g=3.3)
        self.offset = None if self.tau_0 is None else ConstantLoad(tau_0=self.tau_0)

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.arm.flange_a, self.motor.flange, self.weight.flange)
        if self.offset is not None:
            yield connect(self.ground.flange, self.offset.flange_a)
            yield connect(self.offset.flange_b, self.arm.flange_b)
        yield initial(self.bearing.phi == 0)
        yield initial(self.bearing.w == 0)
