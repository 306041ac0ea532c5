"""Drives of robot axes: the position controller in cascade, and the DC motor with analog current control."""

from cartpend_dae.language import Component, Param, Statements, connect, param, port, signal, var
from cartpend_dae.library import rotational
from cartpend_dae.library.controllers import PI
from cartpend_dae.library.electrical import EMF, Capacitor, Ground, Inductor, Resistor, VoltageSource
from cartpend_dae.library.electrical_sources import CurrentSensor, IdealOpAmp
from cartpend_dae.library.signals import Gain


class PositionCascade(Component):
    """P control of an angle around PI control of the speed, y = ks (PI.x + error), der(PI.x) = error/Ts.

    error = ratio w_ref + kp (ratio phi_ref - phi) - w; phi and w are those of the motor, the references those of the
    load behind a gear of that ratio.
    """

    phi_ref = signal("in", unit="rad", doc="wanted angle of the load")
    w_ref = signal("in", unit="rad/s", doc="wanted speed of the load")
    phi = signal("in", unit="rad", doc="angle of the motor")
    w = signal("in", unit="rad/s", doc="speed of the motor")
    y = signal("out", unit="A", doc="wanted current of the motor")
    error = var(unit="rad/s", doc="error of the speed")
    kp: Param = param(unit="1/s", min=0, doc="gain of the angle")
    ks: Param = param(unit="A.s/rad", min=0, doc="gain of the speed")
    Ts: Param = param(unit="s", min=0, doc="integral time of the speed")
    ratio: Param = param(unit="1", default=1.0, doc="turns of the motor per turn of the load")

    def __post_init__(self) -> None:
        self.PI = PI(k=self.ks, T=self.Ts)

    def equations(self) -> Statements:
        yield self.error == self.ratio * self.w_ref + self.kp * (self.ratio * self.phi_ref - self.phi) - self.w
        yield connect(self.error, self.PI.u)
        yield self.y == self.PI.y


class CurrentControlledMotor(Component):
    """DC motor with a current controller of operational amplifiers, J der(w_mechanical) = k i + tau_flange.

    A difference amplifier gives i - i_ref in volts, an integrator 10 Ohm C der(v_C) = i - i_ref, and a power stage
    -5 v_C to the armature: La der(i) = -5 v_C - Ra i - k w_mechanical, with Ra = 250 Ohm. The bandwidth w of the
    current control and its damping D give La = Ra/(2 D w) and C = D/(Ra w).
    """

    flange = port(rotational.Flange, doc="shaft")
    i_ref = signal("in", unit="A", doc="wanted current")
    phi_mechanical = signal("out", unit="rad", doc="angle of the shaft")
    w_mechanical = signal("out", unit="rad/s", doc="speed of the shaft")
    J: Param = param(unit="kg.m2", min=0, doc="moment of inertia of the rotor")
    k: Param = param(unit="N.m/A", doc="torque constant")
    w: Param = param(unit="rad/s", min=0, doc="bandwidth of the current control")
    D: Param = param(unit="1", min=0, doc="damping ratio of the current control")
    Ra: Param = param(unit="Ohm", default=250.0, min=0, doc="resistance of the armature")

    def __post_init__(self) -> None:
        self.wanted, self.measured, self.ground = VoltageSource(), VoltageSource(), Ground()
        self.as_volt, self.wanted_as_volt = Gain(k=1.0), Gain(k=1.0)
        self.difference, self.integrator, self.power = IdealOpAmp(), IdealOpAmp(), IdealOpAmp()
        self.R_measured, self.R_zero = Resistor(R=100.0), Resistor(R=100.0)
        self.R_wanted, self.R_back = Resistor(R=100.0), Resistor(R=100.0)
        self.R_integrator, self.C = Resistor(R=10.0), Capacitor(C=self.D / (self.Ra * self.w))
        self.R_low, self.R_high = Resistor(R=50.0), Resistor(R=200.0)
        self.ra, self.La = Resistor(R=self.Ra), Inductor(L=self.Ra / (2 * self.D * self.w))
        self.emf, self.sensor, self.rotor = EMF(k=self.k), CurrentSensor(), rotational.Inertia(J=self.J)

    def equations(self) -> Statements:
        yield self.phi_mechanical == self.rotor.phi
        yield self.w_mechanical == self.rotor.w
        yield from self._controller()
        yield connect(self.power.p2, self.ra.pin_p)
        yield connect(self.ra.pin_n, self.La.pin_p)
        yield connect(self.La.pin_n, self.emf.pin_p)
        yield connect(self.emf.pin_n, self.sensor.pin_p)
        yield connect(self.emf.flange, self.rotor.flange_a)
        yield connect(self.rotor.flange_b, self.flange)

    def _controller(self) -> Statements:
        difference, integrator, power = self.difference, self.integrator, self.power
        yield connect(self.sensor.i, self.as_volt.u)
        yield connect(self.i_ref, self.wanted_as_volt.u)
        yield connect(self.as_volt.y, self.measured.u)
        yield connect(self.wanted_as_volt.y, self.wanted.u)
        yield connect(self.measured.pin_p, self.R_measured.pin_p)
        yield connect(self.R_measured.pin_n, self.R_zero.pin_p, difference.p1)
        yield connect(self.wanted.pin_p, self.R_wanted.pin_p)
        yield connect(self.R_wanted.pin_n, self.R_back.pin_p, difference.n1)
        yield connect(difference.p2, self.R_back.pin_n, self.R_integrator.pin_p)
        yield connect(self.R_integrator.pin_n, self.C.pin_p, integrator.n1)
        yield connect(integrator.p2, self.C.pin_n, power.p1)
        yield connect(power.n1, self.R_low.pin_p, self.R_high.pin_p)
        yield connect(power.p2, self.R_high.pin_n)
        grounded = [part.pin_n for part in (self.measured, self.wanted, self.R_zero, self.R_low, self.sensor)]
        yield connect(self.ground.pin, *grounded, integrator.p1, *(amp.n2 for amp in (difference, integrator, power)))
