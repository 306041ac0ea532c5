"""The gears between one motor of the rig and the chain, with inertias that follow from their geometry."""

from math import pi

import casadi as ca

from cartpend_dae import Component, Param, Statements, connect, param, port
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.rotational import IdealGear, Inertia, Sprocket


def disk(radius: ca.SX, thickness: ca.SX, density: ca.SX) -> Inertia:
    """Return a solid disk that turns about its axis, J = m r^2/2 with m = rho pi r^2 t.

    Parameters
    ----------
    radius, thickness
        Geometry [m].
    density
        Density [kg/m3].
    """
    return Inertia(J=density * pi * radius**2 * thickness * radius**2 / 2)


class GearStage(Component):
    """Gear 3 drives gear 2, which shares its shaft with the hub and gear 1, which moves the chain.

        flange_R --[gear_3]--mesh--[gear_2]--[hub]--[gear_1]--sprocket-- flange_T

    r_3 phi_3 = r_2 phi_1 and s = r_1 phi_1. The gears are disks of thickness t; gear 3 is of aluminium (density
    rho_3), the others of steel (rho_1). All numbers are those of the published study.
    """

    flange_R = port(rotational.Flange, doc="shaft of the motor")
    flange_T = port(translational.Flange, doc="chain")
    r_1: Param = param(unit="m", default=0.0164, min=0, doc="radius of gear 1, on the chain")
    t_1: Param = param(unit="m", default=0.00414, min=0, doc="thickness of gear 1")
    r_2: Param = param(unit="m", default=0.0252, min=0, doc="radius of gear 2, in the mesh")
    t_2: Param = param(unit="m", default=0.00419, min=0, doc="thickness of gear 2")
    r_h: Param = param(unit="m", default=0.0376, min=0, doc="radius of the hub")
    t_h: Param = param(unit="m", default=0.0222, min=0, doc="thickness of the hub")
    r_3: Param = param(unit="m", default=0.0181, min=0, doc="radius of gear 3, on the motor")
    t_3: Param = param(unit="m", default=0.00945, min=0, doc="thickness of gear 3")
    rho_1: Param = param(unit="kg/m3", default=7860.0, min=0, doc="density of gears 1 and 2 and of the hub")
    rho_3: Param = param(unit="kg/m3", default=2767.97, min=0, doc="density of gear 3")

    def __post_init__(self) -> None:
        self.gear_3 = disk(self.r_3, self.t_3, self.rho_3)
        self.mesh = IdealGear(ratio=self.r_2 / self.r_3)
        self.gear_2 = disk(self.r_2, self.t_2, self.rho_1)
        self.hub = disk(self.r_h, self.t_h, self.rho_1)
        self.gear_1 = disk(self.r_1, self.t_1, self.rho_1)
        self.sprocket = Sprocket(r=self.r_1)

    def equations(self) -> Statements:
        yield connect(self.flange_R, self.gear_3.flange_a)
        yield connect(self.gear_3.flange_b, self.mesh.flange_a)
        yield connect(self.mesh.flange_b, self.gear_2.flange_a)
        yield connect(self.gear_2.flange_b, self.hub.flange_a)
        yield connect(self.hub.flange_b, self.gear_1.flange_a)
        yield connect(self.gear_1.flange_b, self.sprocket.flange_R)
        yield connect(self.sprocket.flange_T, self.flange_T)
