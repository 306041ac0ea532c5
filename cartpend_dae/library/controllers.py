"""Controllers, transfer functions and the reference motions that they follow; units as in `signals`."""

from collections.abc import Mapping, Sequence
from typing import Literal

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, connect, param, signal, time, var
from cartpend_dae.language import der as rate
from cartpend_dae.library.signals import Block, Derivative, Gain, Integrator, Source
from cartpend_dae.quantities import Expression
from cartpend_dae.switching import both, if_else


class PI(Block):
    """PI controller, y = k (x + u), der(x) = u/T."""

    x = var(unit="1", doc="integral of the input over T")
    k: Param = param(unit="1", default=1.0, doc="gain")
    T: Param = param(unit="s", min=0, doc="integral time")

    def equations(self) -> Statements:
        yield rate(self.x) == self.u / self.T
        yield self.y == self.k * (self.x + self.u)


class PID(Block):
    """PID controller, y = k (u + I.y + D.y), I.y = integral of u/Ti, D.y = Td Nd (u - x)/Td, der(x) = (u - x) Nd/Td."""

    k: Param = param(unit="1", default=1.0, doc="gain")
    Ti: Param = param(unit="s", min=0, doc="integral time")
    Td: Param = param(unit="s", min=0, doc="derivative time")
    Nd: Param = param(unit="1", default=10.0, min=0, doc="the derivative acts up to the frequency Nd/Td")

    def __post_init__(self) -> None:
        self.I = Integrator(k=1 / self.Ti)
        self.D = Derivative(k=self.Td, T=self.Td / self.Nd)

    def equations(self) -> Statements:
        yield connect(self.u, self.I.u, self.D.u)
        yield self.y == self.k * (self.u + self.I.y + self.D.y)


class LimPID(Component):
    """PI or PID controller with limited output, y = raw between y_min and y_max, raw = k (P + I.y + D.y) + k_ff u_ff.

    P = wp u_s - u_m; D.y is the derivative of wd u_s - u_m through the lag Td/Nd, with `controller_type` "PID" only.
    The integral is held back at the limits: der(I.y) = (u_s - u_m + (y - raw)/(k Ni))/Ti.
    """

    u_s = signal("in", unit="1", doc="set point")
    u_m = signal("in", unit="1", doc="measurement")
    u_ff = signal("in", unit="1", default=0.0, doc="feed-forward")
    y = signal("out", unit="1", doc="output")
    raw = var(unit="1", doc="output without limits")
    correction = var(unit="1", doc="input of the integrator")
    controller_type: Literal["PI", "PID"] = "PI"
    k: Param = param(unit="1", default=1.0, doc="gain")
    Ti: Param = param(unit="s", min=0, doc="integral time")
    Td: Param = param(unit="s", default=0.1, min=0, doc="derivative time")
    y_max: Param = param(unit="1", doc="upper limit")
    y_min: Param = param(unit="1", doc="lower limit")
    wp: Param = param(unit="1", default=1.0, min=0, doc="weight of the set point in P")
    wd: Param = param(unit="1", default=0.0, min=0, doc="weight of the set point in D")
    Ni: Param = param(unit="1", default=0.9, min=0, doc="Ni Ti is the time in which the integral follows a limit")
    Nd: Param = param(unit="1", default=10.0, min=0, doc="the derivative acts up to the frequency Nd/Td")
    k_ff: Param = param(unit="1", default=1.0, doc="gain of the feed-forward")

    def __post_init__(self) -> None:
        self.I = Integrator(k=1 / self.Ti)
        self.D = WeightedDerivative(wd=self.wd, Td=self.Td, Nd=self.Nd) if self.controller_type == "PID" else None

    def equations(self) -> Statements:
        proportional = self.wp * self.u_s - self.u_m
        if self.D is None:
            yield self.raw == self.k * (proportional + self.I.y) + self.k_ff * self.u_ff
        else:
            yield connect(self.u_s, self.D.u_s)
            yield connect(self.u_m, self.D.u_m)
            yield self.raw == self.k * (proportional + self.I.y + self.D.y) + self.k_ff * self.u_ff
        yield self.y == ca.fmin(ca.fmax(self.raw, self.y_min), self.y_max)
        yield self.correction == self.u_s - self.u_m + (self.y - self.raw) / (self.k * self.Ni)
        yield connect(self.correction, self.I.u)


class WeightedDerivative(Component):
    """Derivative part of a controller, y = Nd (wd u_s - u_m - x), der(x) = (wd u_s - u_m - x) Nd/Td."""

    u_s = signal("in", unit="1", doc="set point")
    u_m = signal("in", unit="1", doc="measurement")
    y = signal("out", unit="1", doc="output")
    x = var(unit="1", doc="state of the lag")
    wd: Param = param(unit="1", default=0.0, min=0, doc="weight of the set point")
    Td: Param = param(unit="s", min=0, doc="derivative time")
    Nd: Param = param(unit="1", default=10.0, min=0, doc="the derivative acts up to the frequency Nd/Td")

    def equations(self) -> Statements:
        error = self.wd * self.u_s - self.u_m - self.x
        yield self.Td * rate(self.x) == error * self.Nd
        yield self.y == self.Nd * error


class LimitedPI(Component):
    """PI controller with a limit, y = raw between -y_max and y_max, raw = k (e + integrator.y) + k_ff u_ff.

    e = u - u_m; the integral is held back at the limit: der(integrator.y) = (e - (raw - y)/k)/Ti.
    With `variable_limit` True the input `limit` takes the place of y_max.
    """

    u = signal("in", unit="1", doc="set point")
    u_m = signal("in", unit="1", doc="measurement")
    u_ff = signal("in", unit="1", default=0.0, doc="feed-forward")
    limit = signal("in", unit="1", default=0.0, doc="largest output, if variable_limit is True")
    y = signal("out", unit="1", doc="output")
    raw = var(unit="1", doc="output without limits")
    correction = var(unit="1", doc="input of the integrator")
    variable_limit: bool = False
    k: Param = param(unit="1", default=1.0, doc="gain")
    Ti: Param = param(unit="s", min=0, doc="integral time")
    k_ff: Param = param(unit="1", default=0.0, doc="gain of the feed-forward")
    y_max: Param = param(unit="1", default=1e60, min=0, doc="largest output")

    def __post_init__(self) -> None:
        self.integrator = Integrator(k=1 / self.Ti)

    def equations(self) -> Statements:
        error = self.u - self.u_m
        limit = self.limit if self.variable_limit else self.y_max
        yield self.raw == self.k * (error + self.integrator.y) + self.k_ff * self.u_ff
        yield self.y == ca.fmin(ca.fmax(self.raw, -limit), limit)
        yield self.correction == error - (self.raw - self.y) / self.k
        yield connect(self.correction, self.integrator.u)


class StateFeedback(Component):
    """State feedback, y = u_ff - (sum of all x[name].y), x[name].y = k x[name].u, with a gain k by name.

    The terminals are ``x["phi"].u`` for ``gains={"phi": 80.0}``; of a list of gains they are ``x[0].u`` and so on.
    The gains are parameters, `x[phi].k`, which `lqr` and `place` give.
    """

    u_ff = signal("in", unit="1", default=0.0, doc="feed-forward, or the set point times its gain")
    y = signal("out", unit="1", doc="output")
    gains: Mapping[str, Expression] | Sequence[Expression]

    def __post_init__(self) -> None:
        gains = dict(self.gains) if isinstance(self.gains, Mapping) else dict(enumerate(self.gains))
        bad = [name for name in gains if isinstance(name, str) and not name.isidentifier()]
        if bad or not gains:
            raise ValueError(
                f"StateFeedback: `gains` must hold a gain for each state, by short names such as `phi` or as a list, "
                f"not {bad or self.gains!r}."
            )
        self.x = {name: Gain(k=k) for name, k in gains.items()}

    def equations(self) -> Statements:
        yield self.y == self.u_ff - sum(terminal.y for terminal in self.x.values())


class TransferFunction(Block):
    """Transfer function y = (b_0 s^m + ... + b_m)/(a_0 s^n + ... + a_n) u, m <= n; coefficients from the highest power.

    In controllable canonical form: y is a sum of the states `x[k].y`, which are the derivatives of one another.
    """

    highest = var(unit="1", doc="highest derivative of the canonical state")
    b: tuple[float, ...]
    a: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.b) > len(self.a) or not self.a or self.a[0] == 0:
            raise ValueError(
                f"TransferFunction: the numerator `b` must not have more coefficients than the denominator `a` "
                f"({len(self.b)} and {len(self.a)}), and `a[0]` must not be 0."
            )
        self.x = [Integrator() for _ in self.a[1:]]

    def equations(self) -> Statements:
        states = [self.highest, *(part.y for part in self.x)]
        b = (*(0.0 for _ in range(len(self.a) - len(self.b))), *self.b)
        yield self.u == sum(a * state for a, state in zip(self.a, states, strict=True))
        yield self.y == sum(b * state for b, state in zip(b, states, strict=True))
        for source, part in zip(states, self.x, strict=False):
            yield connect(source, part.u)


def _profile(distance: ca.SX, speed: ca.SX, acceleration: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the ends of the phases of speeding up, of constant speed and of slowing down [s]."""
    alone, ramp = ca.sqrt(ca.fabs(distance) / acceleration), speed / acceleration
    has_plateau = ramp < alone
    first = ca.if_else(has_plateau, ramp, alone)
    second = ca.if_else(has_plateau, ca.fabs(distance) / speed, alone)
    return first, second, first + second


class KinematicPTP(Source):
    """Acceleration of the fastest motion over deltaq, y = +-qdd_max or 0, speed at most qd_max, from start_time on."""

    deltaq: Param = param(unit="1", doc="distance")
    qd_max: Param = param(unit="1/s", min=0, doc="largest speed")
    qdd_max: Param = param(unit="1/s2", min=0, doc="largest acceleration")
    start_time: Param = param(unit="s", default=0.0, doc="start of the motion")

    def equations(self) -> Statements:
        first, second, third = _profile(self.deltaq, self.qd_max, self.qdd_max)
        t = time() - self.start_time
        up, down = if_else(both(t >= 0, t < first), 1, 0), if_else(both(t >= second, t < third), 1, 0)
        yield self.y == ca.sign(self.deltaq) * self.qdd_max * (up - down)


class KinematicPTP2(Component):
    """The fastest motion from q_begin to q_end with speed at most qd_max, acceleration qdd = +-qdd_max or 0.

    q and qd are its integrals, in closed form; it starts at start_time.
    """

    q = signal("out", unit="1", doc="position")
    qd = signal("out", unit="1/s", doc="speed")
    qdd = signal("out", unit="1/s2", doc="acceleration")
    q_begin: Param = param(unit="1", default=0.0, doc="first position")
    q_end: Param = param(unit="1", doc="last position")
    qd_max: Param = param(unit="1/s", min=0, doc="largest speed")
    qdd_max: Param = param(unit="1/s2", min=0, doc="largest acceleration")
    start_time: Param = param(unit="s", default=0.0, doc="start of the motion")

    def equations(self) -> Statements:
        distance = self.q_end - self.q_begin
        first, second, third = _profile(distance, self.qd_max, self.qdd_max)
        elapsed = time() - self.start_time
        t = ca.fmin(ca.fmax(elapsed, 0), third)
        up, cruise, down = ca.fmin(t, first), ca.fmin(ca.fmax(t - first, 0), second - first), ca.fmax(t - second, 0)
        way = up**2 / 2 + first * (cruise + down) - down**2 / 2
        speeding, slowing = both(elapsed >= 0, elapsed < first), both(elapsed >= second, elapsed < third)
        direction = ca.sign(distance) * self.qdd_max
        yield self.q == self.q_begin + direction * way
        yield self.qd == direction * (up - down)
        yield self.qdd == direction * (if_else(speeding, 1, 0) - if_else(slowing, 1, 0))
