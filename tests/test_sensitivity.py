"""Exact derivatives through events, against differences of simulations and closed forms."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from test_events import Ball, bounces
from test_identify import Slide

from cartpend_dae import (
    Component,
    ModelError,
    Param,
    assemble,
    assign,
    connect,
    der,
    discrete,
    dry_friction,
    if_else,
    initial,
    param,
    sample,
    simulate,
    time,
    unknown,
    var,
    when,
)
from cartpend_dae.library import translational
from cartpend_dae.sensitivity import gradient, sensitivities

TIGHT: dict[str, Any] = {"rtol": 1e-11, "atol": 1e-13}
# relative step of the central differences. Their error is the third derivative times the square of the step, about
# 1e-10 here, and the error of the simulations, 1e-13 to 1e-12, over the step: 1e-8 at most. 1e-7 leaves room for
# derivatives that grow along the run
STEP, TOLERANCE = 1e-5, 1e-7


def check(model, names, times, outputs, *, start=None, method="adaptive", **options):
    """Compare the slopes with central differences of simulations, and the adjoint with the slopes."""
    system, begin = assemble(model), dict(start or {})
    own = {q.name: q.value for q in system.parameters}
    found = sensitivities(system, names, times=times, outputs=outputs, start=begin, method=method, **options, **TIGHT)

    def run(name, change):
        values, starts = {}, dict(begin)
        (starts if name in begin else values)[name] = (begin | own | begin)[name] + change
        result = simulate(
            system, times=times, start=starts, parameters=values, method=method, inputs=options.get("inputs"), **TIGHT
        )
        return np.array([result[output] for output in outputs]).T

    for k, name in enumerate(names):
        step = STEP * (abs((own | begin)[name]) or 1.0)
        differences = (run(name, step) - run(name, -step)) / (2 * step)
        scale = np.abs(differences).max(axis=0) + 1e-3
        np.testing.assert_array_less(np.abs(found.slopes[:, :, k] - differences) / scale, TOLERANCE, err_msg=name)
    weights = np.random.default_rng(1).standard_normal(found.values.shape)
    back = gradient(
        system, names, times=times, outputs=outputs, weights=weights, start=begin, method=method, **options, **TIGHT
    )
    forward = np.einsum("ky,kyn->n", weights, found.slopes)
    # both differentiate the same steps: they differ by rounding, magnified where large terms cancel
    np.testing.assert_allclose(back.slopes, forward, rtol=1e-9, atol=1e-11 * np.abs(found.slopes).sum())
    assert back.value == pytest.approx(np.sum(weights * found.values), rel=1e-12)
    return found


class Oscillator(Component):
    """A mass on a spring, released at `s_0`."""

    w: Param = param(unit="rad/s", default=2.0)
    s_0: Param = param(unit="m", default=0.3)
    s = var(unit="m")
    v = var(unit="m/s")

    def equations(self):
        yield der(self.s) == self.v
        yield der(self.v) == -(self.w**2) * self.s
        yield initial(self.s == self.s_0)
        yield initial(self.v == 0)


@pytest.mark.parametrize("method", ["erk", "rosenbrock"])
def test_an_oscillator_has_the_derivatives_of_its_closed_form(method):
    times, w, s_0 = np.linspace(0.0, 5.0, 26), 2.0, 0.3
    options: dict[str, Any] = {"times": times, "outputs": ["s"], "method": method, **TIGHT}
    found = sensitivities(Oscillator(), ["w", "s_0"], **options)
    # the tolerance of the integrator, over some radians
    np.testing.assert_allclose(found.values[:, 0], s_0 * np.cos(w * times), atol=1e-9)
    np.testing.assert_allclose(found.slopes[:, 0, 0], -s_0 * times * np.sin(w * times), atol=1e-9)
    np.testing.assert_allclose(found.slopes[:, 0, 1], np.cos(w * times), atol=1e-9)
    speed = sensitivities(Oscillator(), ["v", "w"], start={"v": 0.1}, **options)
    np.testing.assert_allclose(speed.slopes[:, 0, 0], np.sin(w * times) / w, atol=1e-9)


@pytest.mark.parametrize("method", ["erk", "rosenbrock"])
def test_a_bouncing_ball_has_the_derivatives_of_its_closed_form(method):
    first = bounces(0.8, 1.0, 4)
    times = np.concatenate([[0.0], 0.5 * (first[:-1] + first[1:])])
    found = check(Ball(), ["e", "h_0"], times, ["h", "v", "hit"], method=method)
    # the n-th bounce is at t_1 (1 + 2 (e + ... + e^(n - 1))), t_1 = sqrt(2 h_0 / g)
    powers = np.cumsum([0.0, *(n * 0.8 ** (n - 1) for n in range(1, 3))])
    np.testing.assert_allclose(found.slopes[1:, 2, 0], 2 * first[0] * powers, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.slopes[1:, 2, 1], first[:-1] / 2, rtol=1e-9)


@pytest.mark.parametrize("hold", ["function", "foh", "zoh"])
def test_a_mass_that_sticks_and_breaks_away_has_exact_derivatives(hold):
    times = np.linspace(0.0, 10.0, 101)
    push: Any = lambda t: 5 * ca.sin(2 * np.pi * 0.4 * t)  # noqa: E731
    if hold != "function":
        push = (times, 5 * np.sin(2 * np.pi * 0.4 * times), hold)
    names = ["mass.m", "rail.d", "rail.f_c", "mass.v"]
    found = check(Slide(), names, times, ["mass.s", "mass.v"], inputs={"force.f": push}, start={"mass.v": 0.3})
    stuck = np.abs(found.values[:, 1]) < 1e-12
    assert 0.09 < np.mean(stuck) < 0.2
    # what sticks has no speed, whatever the parameters are
    np.testing.assert_allclose(found.slopes[stuck, 1], 0.0, atol=1e-12)


class Belt(Component):
    """A mass on a belt that moves, held by a spring: it sticks and slips."""

    m: Param = param(unit="kg", default=1.0)
    c: Param = param(unit="N/m", default=10.0)
    f_c: Param = param(unit="N", default=2.0)
    peak: Param = param(unit="1", default=1.5)
    v_b: Param = param(unit="m/s", default=0.3)
    s = var(unit="m")
    v = var(unit="m/s")
    f = var(unit="N")

    def equations(self):
        yield der(self.s) == self.v
        yield self.m * der(self.v) == -self.c * self.s - self.f
        yield self.f == dry_friction(self.v - self.v_b, self.f_c, static=self.peak * self.f_c)
        yield initial(self.s == 0)
        yield initial(self.v == self.v_b)


@pytest.mark.parametrize("method", ["erk", "rosenbrock"])
def test_stick_slip_on_a_belt_has_exact_derivatives(method):
    times = np.linspace(0.0, 9.0, 41)
    found = check(Belt(), ["m", "c", "f_c", "peak", "v_b"], times, ["s", "v", "f"], method=method)
    stuck = np.abs(found.values[:, 1] - 0.3) < 1e-12
    assert 0.2 < np.mean(stuck) < 0.8
    # stuck it has the speed of the belt, and the friction is what the spring asks for
    np.testing.assert_allclose(found.slopes[stuck, 1], np.tile([0, 0, 0, 0, 1.0], (stuck.sum(), 1)), atol=1e-9)


class Servo(Component):
    """A lag under a sampled controller whose instants depend on parameters."""

    period: Param = param(unit="s", default=0.13)
    offset: Param = param(unit="s", default=0.05)
    k: Param = param(unit="1", default=3.0)
    v = var(unit="1")
    u = discrete(unit="1")

    def equations(self):
        yield der(self.v) == (self.u - self.v) / 1.0
        yield initial(self.v == 0.1 * self.k)
        yield when(sample(self.period, self.offset), assign(self.u, self.k * (1 - self.v)))


def test_what_a_clock_samples_is_differentiated_by_its_period():
    check(Servo(), ["period", "offset", "k"], np.linspace(0.0, 1.97, 23), ["v", "u"])


class Late(Component):
    """A lag with a step at `t_0`, which is known before a run unless it is differentiated by `t_0`."""

    t_0: Param = param(unit="s", default=0.33)
    k: Param = param(unit="1", default=3.0)
    v = var(unit="1")

    def equations(self):
        yield der(self.v) == if_else(time() < self.t_0, 0, 1) - self.k * self.v
        yield initial(self.v == 0)


def test_an_event_of_time_is_differentiated_by_its_time():
    times = np.linspace(0.0, 1.0, 8)
    found = sensitivities(Late(), ["t_0"], times=times, outputs=["v"], **TIGHT)
    expected = np.where(times > 0.33, -np.exp(-3 * (times - 0.33)), 0.0)
    np.testing.assert_allclose(found.slopes[:, 0, 0], expected, atol=1e-9)  # the tolerance of the integrator


class Loop(Component):
    """An oscillator with an algebraic loop that an event changes, and a start that is the root of an equation."""

    a: Param = param(unit="1", default=0.7)
    b: Param = param(unit="1", default=0.9)
    v = var(unit="1")
    w = var(unit="1")
    z = var(unit="1")

    def equations(self):
        yield self.z + self.a * self.z**3 == self.v + if_else(self.v < self.b, 0.0, 0.3)
        yield der(self.v) == self.w
        yield der(self.w) == -self.z - 0.1 * self.w
        yield initial(self.v**2 == 2 * self.a)
        yield initial(self.w == self.z * self.b)


def test_algebraic_variables_and_a_nonlinear_start_are_differentiated():
    check(Loop(), ["a", "b"], np.linspace(0.0, 7.0, 23), ["v", "w", "z"])


class Loaded(Component):
    """A spring whose free length is found by a start at rest."""

    c: Param = param(unit="N/m", default=10.0)
    m: Param = param(unit="kg", default=1.5)
    g: Param = param(unit="N", default=3.0)
    s_0: Param = param(unit="m", default=unknown(0.3))
    s = var(unit="m")
    v = var(unit="m/s")

    def equations(self):
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.g - self.c * (self.s - self.s_0)
        yield initial(self.s == 1.0)
        yield initial(self.v == 0.2)
        yield initial(self.m * der(self.v) == 0.5 * self.g)


def test_a_parameter_that_the_start_finds_is_carried_along():
    check(Loaded(), ["c", "m", "g"], np.linspace(0.0, 3.0, 11), ["s", "v"], method="erk")


class Pair(Component):
    """Two balls that fall beside each other."""

    h_0: Param = param(unit="m", default=1.0)

    def __post_init__(self) -> None:
        self.a, self.b = Ball(), Ball(h_0=self.h_0)


def test_events_that_meet_but_are_two_are_refused():
    """CasADi gives the instant of one to both: the second ball would have the derivatives of the first."""
    options: dict[str, Any] = {"times": [0.0, 0.3, 0.6], "outputs": ["a.h", "b.h"]}
    with pytest.raises(ModelError, match=r"at 0\.451524 s events of `a` and `b` meet"):
        sensitivities(Pair(), ["a.h_0"], **options)
    check(Pair(h_0=1.1), ["a.h_0", "h_0"], np.array([0.0, 0.3, 0.6]), ["a.h", "b.h"])


class Chain(Component):
    """Two frictions on one motion stop at one instant: one event, not two."""

    def __post_init__(self) -> None:
        self.mass, self.ground = translational.Mass(m=1.0), translational.Fixed()
        self.first, self.second = translational.CoulombFriction(f_c=1.0), translational.CoulombFriction(f_c=0.5)

    def equations(self):
        yield connect(self.mass.flange_b, self.first.flange_b, self.second.flange_b)
        yield connect(self.ground.flange, self.first.flange_a, self.second.flange_a)


def test_two_frictions_on_one_motion_are_one_event():
    times = np.linspace(0.0, 1.0, 8)
    found = check(
        Chain(), ["first.f_c", "second.f_c", "mass.m"], times, ["mass.s"], start={"mass.s": 0.0, "mass.v": 1.0}
    )
    # it stops after m v^2 / (2 F)
    np.testing.assert_allclose(found.slopes[-1, 0], [-0.5 / 1.5**2, -0.5 / 1.5**2, 0.5 / 1.5], atol=1e-9)


@pytest.mark.parametrize(
    ("names", "more", "sentence"),
    [
        (["x"], {}, r"no parameter `x`"),
        (["h"], {}, r"`h` is a variable of Ball without a start value: give `start=\{'h': \.\.\.\}`"),
        (["e", "e"], {}, r"A name stands twice among the parameters: `e`, `e`\."),
        (["e"], {"outputs": ["y"]}, r"no variable `y`"),
        (["e"], {"method": "cvodes"}, r"`cvodes` does not differentiate through events: choose `adaptive`, `erk` or"),
        (["e"], {"method": "best"}, r"There is no method 'best'"),
    ],
)
def test_what_cannot_be_differentiated_is_said(names, more, sentence):
    with pytest.raises(ModelError, match=sentence):
        sensitivities(Ball(), names, **({"times": [0.0, 1.0], "outputs": ["h"]} | more))


def test_a_parameter_found_by_the_start_is_refused():
    with pytest.raises(ModelError, match=r"`s_0` is found by the start of Loaded"):
        sensitivities(Loaded(), ["s_0"], times=[0.0, 1.0], outputs=["s"])


def test_weights_have_the_shape_of_the_outputs():
    with pytest.raises(ModelError, match=r"`weights` must have a row for each time.*\(2, 1\), not \(1,\)"):
        gradient(Ball(), ["e"], times=[0.0, 1.0], outputs=["h"], weights=np.ones(1))


class Pulses(Component):
    """A lag with a pulse in each period."""

    period: Param = param(unit="s", default=0.5)
    v = var(unit="1")

    def equations(self):
        share = time() / self.period
        yield der(self.v) == if_else(share - ca.floor(share) < 0.3, 1, 0) - self.v
        yield initial(self.v == 0)


def test_a_pulse_that_repeats_itself_is_not_differentiated_by_its_period():
    with pytest.raises(ModelError, match=r"the condition in `Pulses` jumps, where it repeats itself.*`period`"):
        sensitivities(Pulses(), ["period"], times=[0.0, 2.0], outputs=["v"])
