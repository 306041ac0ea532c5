"""Sampled control: a clock, and blocks that act at its ticks; units as in `signals`.

    clock.y ----+-----------+----------+
                |           |          |
    u -> SampleAndHold -> PI, ... -> SampleAndHold -> y

Connect the output of one `Clock` to the input `clock` of all blocks of a controller. At a tick each output has its new
value at once, whatever number of blocks stands before it; between ticks it is held. So only what is read between ticks
needs a `SampleAndHold` behind the blocks that compute continuously (`signals.Feedback`, `signals.Gain` ...), and a loop
of such blocks needs a `UnitDelay`.
"""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, discrete, param, signal
from cartpend_dae.library.signals import Block
from cartpend_dae.switching import assign, if_else, sample, when


class Clock(Component):
    """Clock, y = 1 at the instants offset + k period, k = 0, 1, 2 and so on, and y = 0 otherwise."""

    y = signal("out", unit="1", doc="1 at a tick")
    period: Param = param(unit="s", min=0, doc="time between two ticks")
    offset: Param = param(unit="s", default=0.0, doc="time of the first tick")

    def equations(self) -> Statements:
        yield self.y == sample(self.period, self.offset)


class Sampled(Block):
    """A block whose output changes at the ticks of a clock; base of sampled blocks."""

    clock = signal("in", unit="1", doc="1 at a tick; the output of a `Clock`")
    held = discrete(unit="1", doc="output since the last tick")

    def output(self, value: ca.SX) -> Statements:
        """Yield: y is the value at a tick, and is held in between."""
        yield self.y == ca.if_else(self.clock, value, self.held)
        yield when(self.clock, assign(self.held, value))


class SampleAndHold(Sampled):
    """Sample and hold, y = u at each tick, held until the next; 0 before the first."""

    def equations(self) -> Statements:
        yield from self.output(self.u)


class UnitDelay(Sampled):
    """Delay by one tick, y = u at the tick before; y_start at the first."""

    last = discrete(unit="1", doc="input at the last tick")
    ticks = discrete(unit="1", doc="number of ticks so far")
    y_start: Param = param(unit="1", default=0.0, doc="output at the first tick")

    def equations(self) -> Statements:
        yield from self.output(ca.if_else(self.ticks > 0, self.last, self.y_start))
        yield when(self.clock, assign(self.last, self.u), assign(self.ticks, self.ticks + 1))


class PI(Sampled):
    """Sampled PI controller, at each tick x = x_before + u Ts/T, y = k (x + u); held in between."""

    x = discrete(unit="1", doc="sum of the inputs times Ts/T")
    k: Param = param(unit="1", default=1.0, doc="gain")
    T: Param = param(unit="s", min=0, doc="integral time")
    Ts: Param = param(unit="s", min=0, doc="period of the clock")

    def equations(self) -> Statements:
        x = self.x + self.u * self.Ts / self.T
        yield from self.output(self.k * (x + self.u))
        yield when(self.clock, assign(self.x, x))


class Quantizer(Block):
    """Whole steps, y = resolution n with n the whole number nearest to u/resolution: an encoder or a converter.

    Each step is an event at u = (n +- 1/2) resolution.
    """

    n = discrete(unit="1", doc="number of steps")
    resolution: Param = param(unit="1", min=0, doc="height of a step, in the unit of u")

    def equations(self) -> Statements:
        nearest = ca.floor(self.u / self.resolution + 0.5)
        # at the event itself rounding decides which number is nearest, so one step is taken in any case
        down = if_else(self.u < (self.n - 0.5) * self.resolution, ca.fmin(nearest, self.n - 1), self.n)
        yield assign(self.n, if_else(self.u > (self.n + 0.5) * self.resolution, ca.fmax(nearest, self.n + 1), down))
        yield self.y == self.resolution * self.n
