"""What drives or brakes a shaft: torques that depend on time or speed, and prescribed motions.

Positive torque accelerates the shaft at `flange`; the housing takes the reaction (see `rotational.Driven`).
A motion is prescribed against the housing. Where its signal is a function of time alone, an exact one may
drive an inertia: the structural analysis differentiates the signal.
"""

from math import pi

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, initial, param, port, signal, time, var
from cartpend_dae.library.rotational import Driven, Flange
from cartpend_dae.library.thermal import HeatPort
from cartpend_dae.switching import if_else

# Bessel low pass of second order with -3 dB at the critical frequency: damping and frequency coefficients.
BESSEL_A, BESSEL_B = 1.3617, 0.6180


class Torque2(Component):
    """Torque between two shafts, tau_b = -tau, tau_a = tau: positive accelerates flange b against flange a."""

    flange_a = port(Flange, doc="left shaft end")
    flange_b = port(Flange, doc="right shaft end")
    tau = signal("in", unit="N.m", doc="driving torque")

    def equations(self) -> Statements:
        yield self.flange_a.tau == self.tau
        yield self.flange_b.tau == -self.tau


class ConstantTorque(Driven):
    """Constant driving torque, tau_flange = -tau_constant."""

    tau_constant: Param = param(unit="N.m", doc="driving torque")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.flange.tau == -self.tau_constant


class Weight(Driven):
    """Torque of a weight on an arm, tau_flange = tau_g sin phi, tau_g = m g l; phi = 0 is hanging."""

    phi = var(unit="rad", doc="angle against the housing, 0 = hanging")
    tau_g: Param = param(unit="N.m", min=0, doc="torque of the weight where the arm is horizontal")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.phi == self.flange.phi - self.support.phi
        yield self.flange.tau == self.tau_g * ca.sin(self.phi)


class TorqueStep(Driven):
    """Driving torque tau = offset_torque, plus step_torque from start_time on; tau_flange = -tau."""

    tau = var(unit="N.m", doc="driving torque")
    step_torque: Param = param(unit="N.m", doc="height of the step")
    offset_torque: Param = param(unit="N.m", default=0.0, doc="torque before the step")
    start_time: Param = param(unit="s", default=0.0, doc="time of the step")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.offset_torque + if_else(time() >= self.start_time, self.step_torque, 0)
        yield self.flange.tau == -self.tau


class SpeedDependent(Driven):
    """A driving torque that depends on the speed against the housing; base of loads and brakes."""

    w = var(unit="rad/s", doc="speed against the housing")
    tau = var(unit="N.m", doc="accelerating torque")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.w == der(self.flange.phi - self.support.phi if self.use_support else self.flange.phi)
        yield self.flange.tau == -self.tau


class LinearSpeedDependentTorque(SpeedDependent):
    """Torque proportional to the speed, tau = tau_nominal w/w_nominal, a load for negative tau_nominal.

    With `torque_direction` True it acts in one direction, tau = tau_nominal |w/w_nominal|.
    """

    torque_direction: bool = True
    tau_nominal: Param = param(unit="N.m", doc="torque at nominal speed; negative for a load")
    w_nominal: Param = param(unit="rad/s", min=0, doc="nominal speed")

    def equations(self) -> Statements:
        yield from super().equations()
        z = self.w / self.w_nominal
        yield self.tau == self.tau_nominal * (ca.fabs(z) if self.torque_direction else z)


class QuadraticSpeedDependentTorque(SpeedDependent):
    """Torque with the square of the speed, tau = tau_nominal z |z|, z = w/w_nominal, a load for negative tau_nominal.

    With `torque_direction` True it acts in one direction, tau = tau_nominal z^2.
    """

    torque_direction: bool = True
    tau_nominal: Param = param(unit="N.m", doc="torque at nominal speed; negative for a load")
    w_nominal: Param = param(unit="rad/s", min=0, doc="nominal speed")

    def equations(self) -> Statements:
        yield from super().equations()
        z = self.w / self.w_nominal
        yield self.tau == self.tau_nominal * z * (z if self.torque_direction else ca.fabs(z))


class SignTorque(SpeedDependent):
    """Torque with the sign of the speed, smooth: tau = tau_nominal (2/(1 + exp(-w/(0.01 w0))) - 1)."""

    tau_nominal: Param = param(unit="N.m", doc="torque at high speed; negative for a load")
    w0: Param = param(unit="rad/s", min=0, doc="the torque is full far above 0.01 w0")

    def equations(self) -> Statements:
        yield from super().equations()
        # 2/(1 + exp(-x)) - 1 without overflow at high speed
        yield self.tau == self.tau_nominal * ca.tanh(self.w / (0.02 * self.w0))


class EddyCurrentTorque(SpeedDependent):
    """Eddy current brake, tau = -2 tau_nominal z/(1 + z^2), z = w/(w_nominal (1 + alpha20 (T - T_ref))).

    The loss -tau w leaves as heat: Q = tau w at the heat port.
    """

    heat_port = port(HeatPort, doc="brake disc")
    loss_power = var(unit="W", doc="heat produced")
    tau_nominal: Param = param(unit="N.m", min=0, doc="largest braking torque")
    w_nominal: Param = param(unit="rad/s", min=0, doc="speed of the largest torque at T_ref")
    alpha20: Param = param(unit="1/K", default=0.0, doc="temperature coefficient of the disc's resistance")
    T_ref: Param = param(unit="K", default=293.15, min=0, doc="reference temperature")

    def equations(self) -> Statements:
        yield from super().equations()
        z = self.w / (self.w_nominal * (1 + self.alpha20 * (self.heat_port.T - self.T_ref)))
        yield self.tau == -2 * self.tau_nominal * z / (1 + z**2)
        yield self.loss_power == -self.tau * self.w
        yield self.heat_port.Q + self.loss_power == 0


class Moved(Driven):
    """A shaft end whose angle against the housing is prescribed; base of motions."""

    phi = var(unit="rad", doc="angle against the housing")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.phi == (self.flange.phi - self.support.phi if self.use_support else self.flange.phi)


class Position(Moved):
    """Angle given by a signal, der(w) = wc ((phi_ref - phi) wc - 1.3617 w)/0.6180, wc = 2 pi f_crit.

    That is a Bessel low pass of second order, starting at phi = phi_ref. With `exact` True it is phi = phi_ref.
    """

    phi_ref = signal("in", unit="rad", doc="wanted angle")
    w = var(unit="rad/s", doc="speed against the housing")
    exact: bool = False
    f_crit: Param = param(unit="Hz", default=50.0, min=0, doc="critical frequency of the filter")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.w == der(self.phi)
        if self.exact:
            yield self.phi == self.phi_ref
            return
        wc = 2 * pi * self.f_crit
        yield der(self.w) == ((self.phi_ref - self.phi) * wc - BESSEL_A * self.w) * wc / BESSEL_B
        yield initial(self.phi == self.phi_ref)


class Speed(Moved):
    """Speed given by a signal through a first-order lag, der(w) = (w_ref - w) wc, wc = 2 pi f_crit.

    It starts at w = w_ref, phi = 0. With `exact` True it is w = w_ref.
    """

    w_ref = signal("in", unit="rad/s", doc="wanted speed")
    w = var(unit="rad/s", doc="speed against the housing")
    exact: bool = False
    f_crit: Param = param(unit="Hz", default=50.0, min=0, doc="critical frequency of the filter")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.w == der(self.phi)
        yield initial(self.phi == 0)
        if self.exact:
            yield self.w == self.w_ref
            return
        yield der(self.w) == (self.w_ref - self.w) * 2 * pi * self.f_crit
        yield initial(self.w == self.w_ref)


class Accelerate(Moved):
    """Acceleration given by a signal, der(der(phi)) = a_ref, from rest at phi = 0."""

    a_ref = signal("in", unit="rad/s2", doc="wanted acceleration")
    w = var(unit="rad/s", doc="speed against the housing")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.w == der(self.phi)
        yield der(self.w) == self.a_ref
        yield initial(self.phi == 0)
        yield initial(self.w == 0)


class ConstantSpeed(Moved):
    """Constant speed, der(phi) = w_fixed, from phi = 0."""

    w_fixed: Param = param(unit="rad/s", doc="speed")

    def equations(self) -> Statements:
        yield from super().equations()
        yield der(self.phi) == self.w_fixed
        yield initial(self.phi == 0)
