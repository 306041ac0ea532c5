"""What goes wrong between a quantity and its sensor, or between a command and its actuator; units as in `signals`.

At its default each block passes its input, y = u, exactly. So a delay is no lag whose time is 0, which has no slope
there: it takes away T_d times the smoothed rate of the input, (u - x)/T_f with T_f der(x) = u - x, and the lag T_f
grows with T_d from a floor T_0. That of a sensor is so short that nothing of a jump passes a longer delay at once.
"""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, clock_rate, der, initial, param, time, var
from cartpend_dae.library.laws import SHORTEST, beyond, grown_lag, wave
from cartpend_dae.library.signals import Block

# share of a step within which a value that is to have no slope is that value
FLAT = 1e-6


class SensorGain(Block):
    """Scale error of a sensor, y = (1 + e) u, which may fade with what is measured: y = u + e u/(1 + k u^2)."""

    e: Param = param(unit="1", default=0.0, min=-1, doc="relative error")
    k: Param = param(unit="1", default=0.0, min=0, doc="by how much it fades, in the inverse square of the unit of u")

    def equations(self) -> Statements:
        yield self.y == self.u + self.e * self.u / (1 + self.k * self.u**2)


class CurrentSensorError(Block):
    """Scale and zero of a current sensor, y = (1 + e) u + y_0."""

    e: Param = param(unit="1", default=0.0, min=-1, doc="relative error")
    y_0: Param = param(unit="1", default=0.0, doc="offset, in the unit of what is measured")

    def equations(self) -> Statements:
        yield self.y == (1 + self.e) * self.u + self.y_0


class SensorNonlinearity(Block):
    """Error per turn of a sensor, y = u + a_1_sin sin x + a_1_cos cos x + a_2_sin sin 2x + a_2_cos cos 2x, x = k u."""

    a_1_sin: Param = param(unit="1", default=0.0, doc="sine amplitude, once per turn, in the unit of u")
    a_1_cos: Param = param(unit="1", default=0.0, doc="cosine amplitude, once per turn")
    a_2_sin: Param = param(unit="1", default=0.0, doc="sine amplitude, twice per turn")
    a_2_cos: Param = param(unit="1", default=0.0, doc="cosine amplitude, twice per turn")
    k: Param = param(unit="1", default=1.0, min=0, doc="angle of the sensor per input; 1 where u is that angle")

    def equations(self) -> Statements:
        angle = self.k * self.u
        once, twice = wave(angle, self.a_1_sin, self.a_1_cos), wave(2 * angle, self.a_2_sin, self.a_2_cos)
        yield self.y == self.u + once + twice


class SensorDelay(Block):
    """Lag or dead time of a sensor, y = u - T_d (u - x)/T_f, T_f der(x) = u - x, T_f near T_d/k.

    k = 1 is the lag 1/(1 + T_d s) of first order, as of a filter; k = 2 is the Pade approximation of exp(-T_d s), for
    a value that comes late as it was; n equal lags in a row are k = 2 n/(n + 1) to the second order of s. The lag grows
    from a floor T_0, so that from a delay of twice the floor on, less than 1 % of a jump passes it at once. T_d = 0 is
    none at all.
    """

    x = var(unit="1", doc="state of the lag")
    T_d: Param = param(unit="s", default=0.0, min=0, doc="delay")
    k: Param = param(unit="1", default=1.0, min=1, max=2, doc="delay in units of the lag")
    T_0: Param = param(unit="s", default=SHORTEST, min=0, doc="floor of the lag", is_shortest_time=True)

    def equations(self) -> Statements:
        T_f = grown_lag(self.T_d / self.k, self.T_0)
        yield T_f * der(self.x) == self.u - self.x
        yield initial(self.x == self.u, fixed=False)
        yield self.y == self.u - self.T_d * (self.u - self.x) / T_f


class SensorQuantization(Block):
    """Steps of a sensor that may lose counts, y = u + e (q round(u/q) - u), and y_l more from t_l on.

    e = 1 is an encoder with steps of q, e = 0 is exact. `d` says where it goes from one step to the next: 0 rounds to
    the nearest, 1/2 cuts off towards 0. The slope of y by u is 1, the mean one: a step has none, and nothing could be
    fitted through it. For simulation with each step as an event see `sampled.Quantizer`.
    """

    e: Param = param(unit="1", default=0.0, min=0, max=1, doc="share of the rounding")
    q: Param = param(unit="1", default=0.001, min=0, doc="step, in the unit of u")
    d: Param = param(unit="1", default=0.0, min=0, max=0.5, doc="share of a step that is cut off")
    y_l: Param = param(unit="1", default=0.0, doc="what lost counts add, in the unit of u")
    t_l: Param = param(unit="s", default=0.0, doc="time at which they are lost")

    def equations(self) -> Statements:
        rounded = self.q * ca.floor(self.u / self.q - self.d * ca.sign(self.u) + 0.5)
        flat = self.q * FLAT * ca.floor(self.u / (self.q * FLAT) + 0.5)  # u itself, without its slope
        lost = ca.if_else(time() >= self.t_l, self.y_l, 0)
        yield self.y == self.u + self.e * (rounded - flat) + lost


class ClockDrift(Block):
    """Clock that runs wrong, y = u + (e t + t_0) (u - x)/T_0, T_0 der(x) = u - x: about u at (1 + e) t + t_0."""

    x = var(unit="1", doc="input, smoothed")
    e: Param = param(unit="1", default=0.0, min=-0.5, max=0.5, doc="relative error of the rate")
    t_0: Param = param(unit="s", default=0.0, doc="error at the start")
    T_0: Param = param(unit="s", default=0.005, min=0, doc="lag with which the rate of u is formed")

    def equations(self) -> Statements:
        yield self.T_0 * der(self.x) == self.u - self.x
        yield initial(self.x == self.u, fixed=False)
        yield self.y == self.u + (self.e * time() + self.t_0) * (self.u - self.x) / self.T_0


class RecorderClock(Component):
    """Clock of a recorder that runs wrong, t = (1 + e) t_s: (1 + e) s pass in the model, when 1 s does in its records.

    It stands anywhere in a model, joined to nothing, for all records and inputs at once; what is sampled keeps its own
    periods.
    """

    e: Param = param(unit="1", default=0.0, min=-0.5, max=0.5, doc="relative error of the rate")

    def equations(self) -> Statements:
        clock_rate(1 + self.e)
        yield from ()


class InputOffset(Block):
    """Offset of an amplifier, y = u + u_0."""

    u_0: Param = param(unit="1", default=0.0, doc="offset, in the unit of u")

    def equations(self) -> Statements:
        yield self.y == self.u + self.u_0


class InputGain(Block):
    """Gain error of an amplifier, y = (1 + e) u."""

    e: Param = param(unit="1", default=0.0, min=-1, doc="relative error")

    def equations(self) -> Statements:
        yield self.y == (1 + self.e) * self.u


class DeadZone(Block):
    """Dead zone, y = 0 between -u_neg and u_pos, else u - u_pos or u + u_neg."""

    u_pos: Param = param(unit="1", default=0.0, min=0, doc="upper end, in the unit of u")
    u_neg: Param = param(unit="1", default=0.0, min=0, doc="lower end, as a positive number")

    def equations(self) -> Statements:
        yield self.y == beyond(self.u, -self.u_neg, self.u_pos)


class Saturation(Block):
    """Saturation, y = u - e r, r = what u exceeds -u_max to u_max: e = 1 is a limit, e < 1 a softer one, e = 0 none."""

    e: Param = param(unit="1", default=0.0, min=0, max=1, doc="share that is cut off")
    u_max: Param = param(unit="1", default=5.0, min=0, doc="limit, in the unit of u")

    def equations(self) -> Statements:
        yield self.y == self.u - self.e * beyond(self.u, -self.u_max, self.u_max)


class RateLimit(Block):
    """Slew rate, y = u + e (x - u), der(x) = (u - x)/T_0 between -r and r: e = 1 follows no faster than r."""

    x = var(unit="1", doc="input that is followed no faster than r")
    e: Param = param(unit="1", default=0.0, min=0, max=1, doc="share of the limit")
    r: Param = param(unit="1", default=20.0, min=0, doc="largest slope, in the unit of u per second")
    T_0: Param = param(unit="s", default=0.005, min=0, doc="lag below the limit")

    def equations(self) -> Statements:
        yield der(self.x) == ca.fmin(ca.fmax((self.u - self.x) / self.T_0, -self.r), self.r)
        yield initial(self.x == self.u, fixed=False)
        yield self.y == self.u + self.e * (self.x - self.u)


class InputDelay(Block):
    """Dead time, y = u - T_d (u - x)/T_f, T_f der(x) = u - x, T_f near T_d/k: (1 - (T_d - T_f) s)/(1 + T_f s).

    k = 2 is the Pade approximation of exp(-T_d s), for delays of several samples. k = 1 is a lag, for those far shorter
    than one: an input that is held changes after a sample then, and not with it. The lag grows from a floor T_0, so
    that from a delay of twice the floor on, less than 1 % of a jump passes k = 1 at once; T_d = 0 is no delay at all.
    At the start x = b u.
    """

    x = var(unit="1", doc="state of the approximation")
    T_d: Param = param(unit="s", default=0.0, min=0, doc="delay")
    k: Param = param(unit="1", default=1.0, min=1, max=2, doc="delay in units of the lag")
    b: Param = param(unit="1", default=1.0, min=0, max=1, doc="share of the first u that stood there before the start")
    T_0: Param = param(unit="s", default=SHORTEST / 10, min=0, doc="floor of the lag", is_shortest_time=True)

    def equations(self) -> Statements:
        T_f = grown_lag(self.T_d / self.k, self.T_0)
        yield T_f * der(self.x) == self.u - self.x
        yield initial(self.x == self.b * self.u, fixed=False)
        yield self.y == self.u - self.T_d * (self.u - self.x) / T_f
