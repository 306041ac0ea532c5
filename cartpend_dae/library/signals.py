"""Directed signals: sources with an output y, and blocks from an input u to an output y.

Their unit is "1": a signal carries the number in SI units of whatever it is connected to. Where a source jumps or bends
is an event in time, which the simulation hits exactly.
"""

from itertools import pairwise
from math import pi

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, der, param, signal, time, var
from cartpend_dae.switching import both, if_else


def _check_table(name: str, table: tuple[tuple[float, float], ...], *, jumps: bool) -> None:
    """Refuse an empty table, and one whose first column falls, or stands still where no jump is allowed."""
    steps = [second[0] - first[0] for first, second in pairwise(table)]
    if not table or min(steps, default=1.0) < 0 or (not jumps and min(steps, default=1.0) == 0):
        order = "not fall" if jumps else "rise"
        raise ValueError(f"{name}: `table` needs rows of two numbers whose first column must {order}, not {table!r}.")


def rise(elapsed: ca.SX, duration: ca.SX) -> ca.SX:
    """Return what is 0 before `elapsed` [s] is 0, then rises to 1 within `duration` [s] and stays there."""
    return if_else(elapsed < duration, if_else(elapsed >= 0, elapsed / duration, 0), 1)


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
        yield self.y == self.offset + if_else(time() >= self.start_time, self.height, 0)


class Ramp(Source):
    """Ramp, y = offset + height x, where x runs from 0 to 1 between start_time and start_time + duration."""

    height: Param = param(unit="1", doc="height of the ramp")
    duration: Param = param(unit="s", min=0, doc="how long the ramp takes")
    offset: Param = param(unit="1", default=0.0, doc="value before the ramp")
    start_time: Param = param(unit="s", default=0.0, doc="time at which the ramp starts")

    def equations(self) -> Statements:
        yield self.y == self.offset + self.height * rise(time() - self.start_time, self.duration)


class Sine(Source):
    """Sine, y = offset + amplitude sin(2 pi f (t - start_time) + phase), and y = offset before start_time."""

    amplitude: Param = param(unit="1", doc="amplitude")
    f: Param = param(unit="Hz", min=0, doc="frequency")
    phase: Param = param(unit="rad", default=0.0, doc="phase at start_time")
    offset: Param = param(unit="1", default=0.0, doc="mean value")
    start_time: Param = param(unit="s", default=0.0, doc="time at which the sine starts")

    def equations(self) -> Statements:
        wave = self.amplitude * ca.sin(2 * pi * self.f * (time() - self.start_time) + self.phase)
        yield self.y == self.offset + if_else(time() >= self.start_time, wave, 0)


class ExpSine(Source):
    """Damped sine, y = offset + amplitude exp(-d x) sin(2 pi f x + phase), x = t - start_time; y = offset before."""

    amplitude: Param = param(unit="1", doc="amplitude at start_time")
    f: Param = param(unit="Hz", min=0, doc="frequency")
    d: Param = param(unit="1/s", doc="rate of decay")
    phase: Param = param(unit="rad", default=0.0, doc="phase at start_time")
    offset: Param = param(unit="1", default=0.0, doc="mean value")
    start_time: Param = param(unit="s", default=0.0, doc="time at which the sine starts")

    def equations(self) -> Statements:
        x = time() - self.start_time
        wave = self.amplitude * ca.exp(-self.d * x) * ca.sin(2 * pi * self.f * x + self.phase)
        yield self.y == self.offset + if_else(x >= 0, wave, 0)


class Pulse(Source):
    """Pulses, y = offset + amplitude during the first `width` percent of each period from start_time on."""

    amplitude: Param = param(unit="1", doc="height of the pulses")
    width: Param = param(unit="1", default=50.0, min=0, max=100, doc="duration of a pulse in percent of the period")
    period: Param = param(unit="s", min=0, doc="time between two pulses")
    offset: Param = param(unit="1", default=0.0, doc="value between the pulses")
    start_time: Param = param(unit="s", default=0.0, doc="time of the first pulse")

    def equations(self) -> Statements:
        cycles = (time() - self.start_time) / self.period
        high = both(cycles >= 0, cycles - ca.floor(cycles) < self.width / 100)
        yield self.y == self.offset + if_else(high, self.amplitude, 0)


class TimeTable(Source):
    """Points joined by lines, y = y_k + (y_l - y_k) (t - t_k)/(t_l - t_k); rows (t, y), of equal times a jump.

    Before the first row and after the last, y holds.
    """

    table: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        _check_table(type(self).__name__, self.table, jumps=True)

    def equations(self) -> Statements:
        value = ca.SX(float(self.table[0][1]))
        for (t_k, y_k), (t_l, y_l) in pairwise(self.table):
            if t_l > t_k:
                value = if_else(time() >= t_k, y_k + (y_l - y_k) * (time() - t_k) / (t_l - t_k), value)
        t_last, y_last = self.table[-1]
        yield self.y == if_else(time() >= t_last, y_last, value)


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


class Product(TwoInputs):
    """Product, y = u1 u2."""

    def equations(self) -> Statements:
        yield self.y == self.u1 * self.u2


class Table1D(Block):
    """Points joined by lines, y = y_k + (y_l - y_k) (u - u_k)/(u_l - u_k); outside the first or last line goes on."""

    table: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        _check_table(type(self).__name__, self.table, jumps=False)

    def equations(self) -> Statements:
        lines = [y_k + (y_l - y_k) / (u_l - u_k) * (self.u - u_k) for (u_k, y_k), (u_l, y_l) in pairwise(self.table)]
        value = lines[0] if lines else ca.SX(float(self.table[0][1]))
        for (u_k, _), line in zip(self.table[1:], lines[1:], strict=False):
            value = ca.if_else(self.u >= u_k, line, value)
        yield self.y == value


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


class Der(Block):
    """Derivative, y = der(u)."""

    def equations(self) -> Statements:
        yield self.y == der(self.u)


class Derivative(Block):
    """Derivative through a lag, y = k (u - x)/T, T der(x) = u - x."""

    x = var(unit="1", doc="state of the lag")
    k: Param = param(unit="s", default=1.0, doc="gain")
    T: Param = param(unit="s", min=0, doc="time constant")

    def equations(self) -> Statements:
        yield self.T * der(self.x) == self.u - self.x
        yield self.y == self.k * (self.u - self.x) / self.T


class SecondOrder(Block):
    """Second-order lag, der(der(y))/w^2 + 2 D der(y)/w + y = k u."""

    yd = var(unit="1/s", doc="derivative of the output")
    k: Param = param(unit="1", default=1.0, doc="gain")
    w: Param = param(unit="rad/s", min=0, doc="natural frequency")
    D: Param = param(unit="1", min=0, doc="damping ratio")

    def equations(self) -> Statements:
        yield self.yd == der(self.y)
        yield der(self.yd) == self.w * (self.w * (self.k * self.u - self.y) - 2 * self.D * self.yd)


class RateLimiter(Block):
    """Rate limiter, der(y) = (u - y)/Td between `falling` and `rising`, and the nearer of the two outside."""

    rising: Param = param(unit="1", min=0, doc="steepest slope upwards, in the unit of y per second")
    falling: Param = param(unit="1", max=0, doc="steepest slope downwards, in the unit of y per second")
    Td: Param = param(unit="s", default=0.001, min=0, doc="lag between the limits")

    def equations(self) -> Statements:
        yield der(self.y) == ca.fmin(ca.fmax((self.u - self.y) / self.Td, self.falling), self.rising)


class SensorOffset(Block):
    """Offset of a sensor, y = u + y_0."""

    y_0: Param = param(unit="1", default=0.0, doc="offset, in the unit of what is measured")

    def equations(self) -> Statements:
        yield self.y == self.u + self.y_0
