"""Wheels that are not round: angle errors of gears and sprockets, without loss.

    flange_a [==wheel==] flange_b      phi_b = phi_a - p(phi_a),  tau_a + (1 - p'(phi_a)) tau_b = 0

Flange a is on the side of the gear that is left ideal. The torque has the same factor as the speed, so that no power
is lost. To first order in p this is the wheel with the radius r (1 + p').
"""

from math import pi

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, param, port
from cartpend_dae.library.laws import wave
from cartpend_dae.library.rotational import Flange


class UnevenWheel(Component):
    """Two shaft ends whose angles differ by a function of one of them; base of kinematic errors."""

    flange_a = port(Flange, doc="side of the ideal gear")
    flange_b = port(Flange, doc="the other side")

    def differing_by(self, error: ca.SX, slope: ca.SX) -> Statements:
        """Let flange b lag behind by an angle error, whose derivative by the angle is `slope`."""
        yield self.flange_b.phi == self.flange_a.phi - error
        yield self.flange_a.tau + (1 - slope) * self.flange_b.tau == 0


class Eccentricity(UnevenWheel):
    """Eccentric wheel, r = r_0 (1 + e_cos cos(n phi) - e_sin sin(n phi)), phi = phi_a: phi_b = phi_a - p.

    p' = r/r_0 - 1, and both angles are 0 together.
    """

    e_sin: Param = param(unit="1", default=0.0, min=-0.5, max=0.5, doc="sine part of the eccentricity")
    e_cos: Param = param(unit="1", default=0.0, min=-0.5, max=0.5, doc="cosine part of the eccentricity")
    n: Param = param(unit="1", default=1.0, min=0, doc="turns of the wheel per turn of flange a")

    def equations(self) -> Statements:
        phi = self.n * self.flange_a.phi
        error = (self.e_cos * ca.sin(phi) + self.e_sin * (ca.cos(phi) - 1)) / self.n
        yield from self.differing_by(error, wave(phi, -self.e_sin, self.e_cos))


class ChainPolygon(UnevenWheel):
    """Chain that lies on a sprocket as a polygon, r = r_0 (1 + e (cos(a)/m - 1)), m = sin(pi/N) N/pi.

    a runs from -pi/N to pi/N over each of the N teeth; e = 1 is the ideal polygon, e = 0 a circle.
    phi_b = phi_a - p, p' = r/r_0 - 1, a = phi - (2 pi/N) (floor(phi N/(2 pi)) + 1/2), phi = phi_a + psi 2 pi/N.
    Both angles are 0 together.
    """

    e: Param = param(unit="1", default=0.0, doc="share of the ideal polygon")
    N: Param = param(unit="1", default=15.0, min=3, doc="number of teeth")
    psi: Param = param(unit="1", default=0.0, doc="where the first tooth begins before the angle 0, in pitches")

    def equations(self) -> Statements:
        pitch, mean = 2 * pi / self.N, ca.sin(pi / self.N) * self.N / pi
        teeth = self.flange_a.phi / pitch + self.psi
        a, at_zero = (pitch * (count - ca.floor(count) - 0.5) for count in (teeth, self.psi))
        error = ca.sin(a) / mean - a - (ca.sin(at_zero) / mean - at_zero)
        yield from self.differing_by(self.e * error, self.e * (ca.cos(a) / mean - 1))
