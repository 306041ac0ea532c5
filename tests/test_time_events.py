"""Events that time alone decides: hit exactly, at output times and between, and by the fast integrators."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from library_bench import joined

from cartpend_dae import (
    Component,
    ModelError,
    Param,
    assemble,
    assign,
    der,
    discrete,
    dry_friction,
    if_else,
    initial,
    param,
    reinit,
    signal,
    simulate,
    time,
    var,
    when,
)
from cartpend_dae.dae import parameter_vector
from cartpend_dae.inputs import driven_inputs, jumps_of
from cartpend_dae.time_events import with_time_events

TIGHT: dict[str, Any] = {"rtol": 1e-11, "atol": 1e-13}


class Step(Component):
    """A first-order lag of a step at `at`."""

    at: Param = param(unit="s", default=0.7)
    x = var(unit="1")

    def equations(self):
        yield der(self.x) == if_else(time() > self.at, 1.0, 0.0) - self.x
        yield initial(self.x == 0)


@pytest.mark.parametrize("method", ["adaptive", "cvodes", "erk", "rosenbrock"])
@pytest.mark.parametrize("times", [[0, 0.2, 0.5, 1, 2, 3], [0, 0.7, 1, 3], [0, 3.0]], ids=["between", "at", "alone"])
def test_a_step_is_hit_exactly_wherever_the_outputs_are(method, times):
    result = simulate(Step(), times=times, method=method, rtol=1e-9, atol=1e-11)
    expected = np.where(result.time > 0.7, 1 - np.exp(0.7 - result.time), 0)
    # a step missed by one step of the integrator would be off by some 1e-2; the multistep methods add up 1e-9
    np.testing.assert_allclose(result["x"], expected, atol=1e-7)


class Implicit(Component):
    """A lag of a step at 0.7 s whose rate solves a cubic equation."""

    x = var(unit="1")
    y = var(unit="1")

    def equations(self):
        yield self.y + self.y**3 / 10 == if_else(time() > 0.7, 1.0, 0.0) - self.x
        yield der(self.x) == self.y
        yield initial(self.x == 0)


@pytest.mark.parametrize("times", [[0, 3.0], [0, 0.5, 0.9, 3.0], np.linspace(0, 3, 201)])
def test_algebraic_variables_may_jump_with_time(times):
    """From y_0 of y_0 + y_0^3/10 = 1 on: t = ln(y_0/y) + 3/20 (y_0^2 - y^2)."""
    result = simulate(Implicit(), times=times, **TIGHT)
    y_0 = np.roots([0.1, 0, 1, -1]).real[-1]
    y, late = result["y"][-1], result.time > 0.71
    assert np.log(y_0 / y) + 0.15 * (y_0**2 - y**2) == pytest.approx(2.3, abs=1e-7)
    np.testing.assert_allclose(result["x"][late], (1 - result["y"] - result["y"] ** 3 / 10)[late], atol=1e-8)


def test_a_time_that_is_a_parameter_moves_with_it():
    result = simulate(Step(), 3.0, parameters={"at": 1.3}, **TIGHT)
    expected = np.where(result.time > 1.3, 1 - np.exp(1.3 - result.time), 0)
    np.testing.assert_allclose(result["x"], expected, atol=1e-8)


def test_a_relation_of_time_becomes_an_input_and_a_point_of_the_grid():
    system = assemble(Step())
    grid = np.array([0.0, 0.5, 1.0])
    driven = driven_inputs({}, grid)
    new, fine, inputs = with_time_events(system, parameter_vector(system), grid, driven)
    np.testing.assert_array_equal(fine, [0, 0.5, 0.7, 1.0])
    assert new.hybrid.is_empty and len(new.inputs) == 1
    # the symbol is 1 while 0.7 < t, however the comparison is written
    assert abs(np.diff(inputs.left[0])).tolist() == [0, 1]
    np.testing.assert_array_equal(jumps_of(inputs, fine), [0, 0, 1])


class Window(Component):
    """A push between two times on a body that dry friction holds."""

    m: Param = param(unit="kg", default=1.0)
    f_c: Param = param(unit="N", default=1.5)
    push: Param = param(unit="N", default=5.0)
    v = var(unit="m/s")
    mode = discrete(unit="1")

    def equations(self):
        push = self.push * if_else(time() > 1, if_else(time() > 2, 0.0, 1.0), 0.0)
        yield self.m * der(self.v) == push - dry_friction(self.v, self.f_c, mode=self.mode)
        yield initial(self.v == 0)


@pytest.mark.parametrize("method", ["adaptive", "erk", "rosenbrock"])
@pytest.mark.parametrize("points", [41, 38], ids=["at output times", "between them"])
def test_a_push_at_a_time_breaks_a_stuck_body_away(method, points):
    """3.5 m/s2 for a second, then 1.5 m/s2 less until rest at 2 + 3.5/1.5 s."""
    result = simulate(Window(), 5.0, points=points, method=method, **TIGHT)
    t, stop = result.time, 2 + 3.5 / 1.5
    expected = np.select([t < 1, t < 2, t < stop], [0, 3.5 * (t - 1), 3.5 - 1.5 * (t - 2)], 0)
    np.testing.assert_allclose(result["v"], expected, atol=1e-9)
    np.testing.assert_array_equal(result["mode"], (t >= 1) & (t < stop))


class Pushed(Component):
    """The same body under an input."""

    m: Param = param(unit="kg", default=1.0)
    f_c: Param = param(unit="N", default=1.5)
    push = signal("in", unit="N")
    v = var(unit="m/s")
    n = discrete(unit="1")

    def equations(self):
        yield self.m * der(self.v) == self.push - dry_friction(self.v, self.f_c)
        yield initial(self.v == 0)
        yield when(self.push > 3, assign(self.n, self.n + 1))


@pytest.mark.parametrize("method", ["adaptive", "erk", "rosenbrock"])
def test_an_input_that_jumps_is_an_event(method):
    held: Any = ([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 5.0, 0.0, -1.4, 4.0], "zoh")
    result = simulate(Pushed(), 4.5, points=46, inputs={"push": held}, method=method, **TIGHT)
    t = result.time
    # after 2 s: 1.5 m/s2 of friction; from 3 s on 1.4 more: 2 m/s falls to 0 by 3 + 2/2.9 s
    parts = [0 * t, 3.5 * (t - 1), 3.5 - 1.5 * (t - 2), np.maximum(2 - 2.9 * (t - 3), 0), 2.5 * (t - 4)]
    expected = np.select([t < 1, t < 2, t < 3, t < 4], parts[:4], parts[4])
    np.testing.assert_allclose(result["v"], expected, atol=1e-9)
    np.testing.assert_array_equal(result["n"], (t > 1 - 1e-9).astype(float) + (t > 4 - 1e-9))


class Kick(Component):
    """A body that is kicked at fixed times, one of them twice."""

    v = var(unit="m/s")
    n = discrete(unit="1")
    last = discrete(unit="s")

    def equations(self):
        yield der(self.v) == 0.0
        yield initial(self.v == 0)
        kick = (reinit(self.v, self.v + 1), assign(self.n, self.n + 1), assign(self.last, time()))
        yield when(time() > 0.3, *kick)
        yield when(time() >= 1.1, *kick)


@pytest.mark.parametrize("times", [[0, 0.2, 0.4, 1.0, 1.2], [0, 0.3, 1.1, 1.2]], ids=["between", "at"])
def test_when_at_a_time_acts_once_at_that_time(times):
    result = simulate(Kick(), times=times)
    expected = (result.time >= 0.3).astype(float) + (result.time >= 1.1)
    np.testing.assert_array_equal(result["n"], expected)
    np.testing.assert_allclose(result["v"], expected, atol=1e-12)
    np.testing.assert_allclose(result["last"], np.select([expected == 1, expected == 2], [0.3, 1.1], 0), atol=1e-12)


def test_a_time_that_a_state_decides_is_found_all_the_same():
    class Late(Component):
        x = var(unit="s")
        at = discrete(unit="s")

        def equations(self):
            yield der(self.x) == -0.5
            yield initial(self.x == 2)
            yield when(time() > self.x, assign(self.at, time()))

    result = simulate(Late(), 3.0, **TIGHT)
    assert result["at"][-1] == pytest.approx(4 / 3, abs=1e-10)


def test_a_model_of_time_events_alone_keeps_the_fast_integrators():
    """Only state events need `erk` or `rosenbrock`."""
    simulate(Step(), 1.0, method="cvodes")
    with pytest.raises(ModelError, match="Method `cvodes` cannot locate the events of the model"):
        simulate(joined(kick=Kick()), 1.0, method="cvodes")


def test_a_pulse_train_of_a_sine_in_time_is_a_state_event_of_the_same_precision():
    class Pulse(Component):
        w: Param = param(unit="rad/s", default=2 * np.pi)
        x = var(unit="1")

        def equations(self):
            yield der(self.x) == if_else(ca.sin(self.w * time()) > 0, 1.0, -1.0)
            yield initial(self.x == 0)

    result = simulate(Pulse(), 10.0, points=401, **TIGHT)
    phase = result.time % 1
    np.testing.assert_allclose(result["x"], np.minimum(phase, 1 - phase), atol=1e-9)
