r"""Bodies that slide along a line and turn in the plane of that line and gravity.

    pivot ---o---> s      phi = 0 is hanging; positive phi moves the tip towards +s
              \
           phi \
               tip

Force on the pivot and torque on the shaft are positive into the body.
"""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, param, port, var
from cartpend_dae.library import rotational, translational


class HangingRod(Component):
    """Slender rod under gravity on a sliding pivot, S = m l/2 and J = m l^2/3, with the gravity g.

    pivot.f = m der(v) + S (cos phi der(w) - sin phi w^2), and
    shaft.tau = J der(w) + S cos phi der(v) + S g sin phi.
    The line of the pivot is level, and phi is measured against the vertical.
    """

    pivot = port(translational.Flange, doc="point of the rod that slides")
    shaft = port(rotational.Flange, doc="shaft of the rod at the pivot")
    s = var(unit="m", doc="position of the pivot")
    v = var(unit="m/s", doc="speed of the pivot")
    phi = var(unit="rad", doc="angle, 0 = hanging")
    w = var(unit="rad/s", doc="angular speed")
    m: Param = param(unit="kg", min=0, doc="mass")
    l: Param = param(unit="m", min=0, doc="length")  # noqa: E741 (the symbol of mechanics)
    g: Param = param(unit="m/s2", default=9.81, doc="acceleration of gravity")

    def equations(self) -> Statements:
        S, J = self.m * self.l / 2, self.m * self.l**2 / 3
        sin, cos = ca.sin(self.phi), ca.cos(self.phi)
        yield self.pivot.s == self.s
        yield self.shaft.phi == self.phi
        yield self.v == der(self.s)
        yield self.w == der(self.phi)
        yield self.pivot.f == self.m * der(self.v) + S * (cos * der(self.w) - sin * self.w**2)
        yield self.shaft.tau == J * der(self.w) + S * cos * der(self.v) + S * self.g * sin
