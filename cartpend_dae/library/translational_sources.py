"""What drives or brakes a body on a line: forces that depend on time or speed, and prescribed motions.

Positive force accelerates the body at `flange`; the housing takes the reaction. A motion is prescribed against
the housing. Where its signal is a function of time alone, an exact one may drive a mass: the structural analysis
differentiates the signal.
"""

from math import pi

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, initial, param, port, signal, time, var
from cartpend_dae.library.rotational_sources import BESSEL_A, BESSEL_B
from cartpend_dae.library.thermal import HeatPort
from cartpend_dae.library.translational import Flange
from cartpend_dae.switching import both, if_else


class Driven(Component):
    """A driven point and the housing that takes the reaction; base of sources.

    The housing is the ground, unless `use_support` is True: then it is `support`, which must be connected.
    """

    flange = port(Flange, doc="the driven point")
    support = port(Flange, doc="housing, if use_support is True")
    use_support: bool = False

    def equations(self) -> Statements:
        if self.use_support:
            yield self.flange.f + self.support.f == 0
        else:
            yield self.support.s == 0


class Force2(Component):
    """Force between two points, f_b = -f, f_a = f: positive accelerates flange b against flange a."""

    flange_a = port(Flange, doc="left point")
    flange_b = port(Flange, doc="right point")
    f = signal("in", unit="N", doc="driving force")

    def equations(self) -> Statements:
        yield self.flange_a.f == self.f
        yield self.flange_b.f == -self.f


class ConstantForce(Driven):
    """Constant driving force, f_flange = -f_constant."""

    f_constant: Param = param(unit="N", doc="driving force")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.flange.f == -self.f_constant


class ForceStep(Driven):
    """Driving force f = offset_force, plus step_force from start_time on; f_flange = -f."""

    f = var(unit="N", doc="driving force")
    step_force: Param = param(unit="N", doc="height of the step")
    offset_force: Param = param(unit="N", default=0.0, doc="force before the step")
    start_time: Param = param(unit="s", default=0.0, doc="time of the step")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.offset_force + if_else(time() >= self.start_time, self.step_force, 0)
        yield self.flange.f == -self.f


class SpeedDependent(Driven):
    """A driving force that depends on the speed against the housing; base of loads and brakes."""

    v = var(unit="m/s", doc="speed against the housing")
    f = var(unit="N", doc="accelerating force")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.v == der(self.flange.s - self.support.s if self.use_support else self.flange.s)
        yield self.flange.f == -self.f


class LinearSpeedDependentForce(SpeedDependent):
    """Force proportional to the speed, f = f_nominal v/v_nominal, a load for negative f_nominal.

    With `force_direction` True it acts in one direction, f = f_nominal |v/v_nominal|.
    """

    force_direction: bool = True
    f_nominal: Param = param(unit="N", doc="force at nominal speed; negative for a load")
    v_nominal: Param = param(unit="m/s", min=0, doc="nominal speed")

    def equations(self) -> Statements:
        yield from super().equations()
        z = self.v / self.v_nominal
        yield self.f == self.f_nominal * (ca.fabs(z) if self.force_direction else z)


class QuadraticSpeedDependentForce(SpeedDependent):
    """Force with the square of the speed, f = f_nominal z |z|, z = v/v_nominal, a load for negative f_nominal.

    With `force_direction` True it acts in one direction, f = f_nominal z^2.
    """

    force_direction: bool = True
    f_nominal: Param = param(unit="N", doc="force at nominal speed; negative for a load")
    v_nominal: Param = param(unit="m/s", min=0, doc="nominal speed")

    def equations(self) -> Statements:
        yield from super().equations()
        z = self.v / self.v_nominal
        yield self.f == self.f_nominal * z * (z if self.force_direction else ca.fabs(z))


class EddyCurrentForce(SpeedDependent):
    """Eddy current brake, f = -2 f_nominal z/(1 + z^2), z = v/(v_nominal (1 + alpha20 (T - T_ref))).

    The loss -f v leaves as heat: Q = f v at the heat port.
    """

    heat_port = port(HeatPort, doc="brake rail")
    loss_power = var(unit="W", doc="heat produced")
    f_nominal: Param = param(unit="N", min=0, doc="largest braking force")
    v_nominal: Param = param(unit="m/s", min=0, doc="speed of the largest force at T_ref")
    alpha20: Param = param(unit="1/K", default=0.0, doc="temperature coefficient of the rail's resistance")
    T_ref: Param = param(unit="K", default=293.15, min=0, doc="reference temperature")

    def equations(self) -> Statements:
        yield from super().equations()
        z = self.v / (self.v_nominal * (1 + self.alpha20 * (self.heat_port.T - self.T_ref)))
        yield self.f == -2 * self.f_nominal * z / (1 + z**2)
        yield self.loss_power == -self.f * self.v
        yield self.heat_port.Q + self.loss_power == 0


class Moved(Driven):
    """A point whose position against the housing is prescribed; base of motions."""

    s = var(unit="m", doc="position against the housing")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.s == (self.flange.s - self.support.s if self.use_support else self.flange.s)


class Position(Moved):
    """Position given by a signal, der(v) = wc ((s_ref - s) wc - 1.3617 v)/0.6180, wc = 2 pi f_crit.

    That is a Bessel low pass of second order, starting at s = s_ref. With `exact` True it is s = s_ref.
    """

    s_ref = signal("in", unit="m", doc="wanted position")
    v = var(unit="m/s", doc="speed against the housing")
    exact: bool = False
    f_crit: Param = param(unit="Hz", default=50.0, min=0, doc="critical frequency of the filter")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.v == der(self.s)
        if self.exact:
            yield self.s == self.s_ref
            return
        wc = 2 * pi * self.f_crit
        yield der(self.v) == ((self.s_ref - self.s) * wc - BESSEL_A * self.v) * wc / BESSEL_B
        yield initial(self.s == self.s_ref)


class Speed(Moved):
    """Speed given by a signal through a first-order lag, der(v) = (v_ref - v) wc, wc = 2 pi f_crit.

    It starts at v = v_ref, s = 0. With `exact` True it is v = v_ref.
    """

    v_ref = signal("in", unit="m/s", doc="wanted speed")
    v = var(unit="m/s", doc="speed against the housing")
    exact: bool = False
    f_crit: Param = param(unit="Hz", default=50.0, min=0, doc="critical frequency of the filter")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.v == der(self.s)
        yield initial(self.s == 0)
        if self.exact:
            yield self.v == self.v_ref
            return
        yield der(self.v) == (self.v_ref - self.v) * 2 * pi * self.f_crit
        yield initial(self.v == self.v_ref)


class Accelerate(Moved):
    """Acceleration given by a signal, der(der(s)) = a_ref, from rest at s = 0."""

    a_ref = signal("in", unit="m/s2", doc="wanted acceleration")
    v = var(unit="m/s", doc="speed against the housing")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.v == der(self.s)
        yield der(self.v) == self.a_ref
        yield initial(self.s == 0)
        yield initial(self.v == 0)


class Push(Component):
    """A push, flange.f = -f while t_0 <= time < t_0 + T, and 0 before and after."""

    flange = port(Flange, doc="where it acts")
    f: Param = param(unit="N", default=0.0, doc="force")
    t_0: Param = param(unit="s", default=0.0, doc="when it begins")
    T: Param = param(unit="s", default=0.1, doc="how long it lasts")

    def equations(self) -> Statements:
        yield self.flange.f == -if_else(both(time() >= self.t_0, time() < self.t_0 + self.T), self.f, 0.0)
