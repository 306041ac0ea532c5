"""What a line between two pins can lose, and factors that change the constants of a machine; signs as in `electrical`.

A factor stands in the law of another component: `splice.scale` multiplies one of its parameters by `y`.
"""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, param, signal, var
from cartpend_dae.library.electrical import Branch
from cartpend_dae.library.laws import wave


class SupplySag(Branch):
    """Line or supply with a resistance, v_p - v_n = (R_s + R_i |i|) i, which may grow with the current."""

    R_s: Param = param(unit="Ohm", default=0.0, min=0, doc="resistance")
    R_i: Param = param(unit="Ohm/A", default=0.0, min=0, doc="by how much the resistance grows with the current")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.pin_p.v - self.pin_n.v == (self.R_s + self.R_i * ca.fabs(self.i)) * self.i


class BrushDrop(Branch):
    """Brushes, v_p - v_n = V_b tanh(i/i_b): a voltage that depends on little but the direction of the current."""

    V_b: Param = param(unit="V", default=0.0, min=0, doc="voltage drop of both brushes")
    i_b: Param = param(unit="A", default=0.5, min=0, doc="current at which it has 76 % of the drop")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.pin_p.v - self.pin_n.v == self.V_b * ca.tanh(self.i / self.i_b)


class TorqueRipple(Component):
    """Torque ripple, y = 1 + a_sin sin(n phi) + a_cos cos(n phi): a factor for the constant of a machine.

    The same constant stands in the back-EMF, so that no power is lost.
    """

    phi = signal("in", unit="rad", doc="angle of the rotor")
    y = signal("out", unit="1", doc="factor")
    a_sin: Param = param(unit="1", default=0.0, min=-1, max=1, doc="sine amplitude")
    a_cos: Param = param(unit="1", default=0.0, min=-1, max=1, doc="cosine amplitude")
    n: Param = param(unit="1", default=12.0, min=0, doc="periods per turn")

    def equations(self) -> Statements:
        yield self.y == 1 + wave(self.n * self.phi, self.a_sin, self.a_cos)


class MagneticSaturation(Component):
    """Magnetic saturation, y = 1/(1 + e i^2): a factor for the constant of a machine.

    1/sqrt(e) is the current at which half of the constant is left.
    """

    i = signal("in", unit="A", doc="current")
    y = signal("out", unit="1", doc="factor")
    e: Param = param(unit="1/A2", default=0.0, min=0, doc="saturation, 1/i_s^2")

    def equations(self) -> Statements:
        yield self.y == 1 / (1 + self.e * self.i**2)


class WindingHeating(Component):
    """Winding that gets warm, y = 1 + e x, T_th der(x) = i^2 - x: a factor for its resistance.

    x is the temperature rise in units of a current squared, e = alpha R R_th the rise of the resistance for each of
    them, and T_th = R_th C_th. It starts cold.
    """

    i = signal("in", unit="A", doc="current")
    y = signal("out", unit="1", doc="factor")
    x = var(unit="A2", doc="square of the steady current that gives this temperature")
    e: Param = param(unit="1/A2", default=0.0, min=0, doc="relative rise of the resistance per square of the current")
    T_th: Param = param(unit="s", default=20.0, min=0, doc="thermal time constant")

    def equations(self) -> Statements:
        yield self.T_th * der(self.x) == self.i**2 - self.x
        yield self.y == 1 + self.e * self.x
