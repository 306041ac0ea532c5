"""Directed signals: sources with an output y, and blocks from an input u to an output y.

Their unit is "1": a signal carries the number in SI units of whatever it is connected to.
"""

from math import pi

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, param, signal, time


class Source(Component):
    """A signal of time alone; base of sources."""

    y = signal("out", unit="1", doc="output")


class Block(Component):
    """One input and one output; base of blocks."""

    u = signal("in", unit="1", doc="input")
    y = signal("out", unit="1", doc="output")


class TwoInputs(Component):
    """Two inputs and one output; base of blocks."""

    u1 = signal("in", unit="1", doc="first input")
    u2 = signal("in", unit="1", doc="second input")
    y = signal("out", unit="1", doc="output")


class Constant(Source):
    """Constant, y = k."""

    k: Param = param(unit="1", doc="value")

    def equations(self) -> Statements:
        yield self.y == self.k


class Step(Source):
    """Step, y = offset, and offset + height from start_time on."""

    height: Param = param(unit="1", doc="height of the step")
    offset: Param = param(unit="1", default=0.0, doc="value before the step")
    start_time: Param = param(unit="s", default=0.0, doc="time of the step")

    def equations(self) -> Statements:
        yield self.y == self.offset + ca.if_else(time() >= self.start_time, self.height, 0)


class Ramp(Source):
    """Ramp, y = offset + height x, where x runs from 0 to 1 between start_time and start_time + duration."""

    height: Param = param(unit="1", doc="height of the ramp")
    duration: Param = param(unit="s", min=0, doc="how long the ramp takes")
    offset: Param = param(unit="1", default=0.0, doc="value before the ramp")
    start_time: Param = param(unit="s", default=0.0, doc="time at which the ramp starts")

    def equations(self) -> Statements:
        x = (time() - self.start_time) / self.duration
        yield self.y == self.offset + self.height * ca.fmin(ca.fmax(x, 0), 1)


class Sine(Source):
    """Sine, y = offset + amplitude sin(2 pi f (t - start_time) + phase), and y = offset before start_time."""

    amplitude: Param = param(unit="1", doc="amplitude")
    f: Param = param(unit="Hz", min=0, doc="frequency")
    phase: Param = param(unit="rad", default=0.0, doc="phase at start_time")
    offset: Param = param(unit="1", default=0.0, doc="mean value")
    start_time: Param = param(unit="s", default=0.0, doc="time at which the sine starts")

    def equations(self) -> Statements:
        wave = self.amplitude * ca.sin(2 * pi * self.f * (time() - self.start_time) + self.phase)
        yield self.y == self.offset + ca.if_else(time() >= self.start_time, wave, 0)


class Gain(Block):
    """Gain, y = k u."""

    k: Param = param(unit="1", doc="gain")

    def equations(self) -> Statements:
        yield self.y == self.k * self.u


class Add(TwoInputs):
    """Sum, y = u1 + u2."""

    def equations(self) -> Statements:
        yield self.y == self.u1 + self.u2


class Feedback(TwoInputs):
    """Control error, y = u1 - u2."""

    def equations(self) -> Statements:
        yield self.y == self.u1 - self.u2


class Limiter(Block):
    """Limiter, y = u between y_min and y_max, and the nearer of the two outside."""

    y_max: Param = param(unit="1", doc="upper limit")
    y_min: Param = param(unit="1", doc="lower limit")

    def equations(self) -> Statements:
        yield self.y == ca.fmin(ca.fmax(self.u, self.y_min), self.y_max)


class FirstOrder(Block):
    """First-order lag, T der(y) = k u - y."""

    k: Param = param(unit="1", default=1.0, doc="gain")
    T: Param = param(unit="s", min=0, doc="time constant")

    def equations(self) -> Statements:
        yield self.T * der(self.y) == self.k * self.u - self.y


class Integrator(Block):
    """Integrator, der(y) = k u."""

    k: Param = param(unit="1/s", default=1.0, doc="gain")

    def equations(self) -> Statements:
        yield der(self.y) == self.k * self.u


class SensorOffset(Block):
    """Offset of a sensor, y = u + y_0."""

    y_0: Param = param(unit="1", default=0.0, doc="offset, in the unit of what is measured")

    def equations(self) -> Statements:
        yield self.y == self.u + self.y_0
