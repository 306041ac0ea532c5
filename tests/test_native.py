"""The engine in C against closed forms, against CasADi's integrators, and where it hands over to them."""

import logging
import shutil

import casadi as ca
import numpy as np
import pytest
from test_events import Ball, bounces

from cartpend_dae import (
    Component,
    Param,
    SolverError,
    assemble,
    assign,
    der,
    discrete,
    dry_friction,
    initial,
    param,
    sample,
    signal,
    simulate,
    time,
    var,
    when,
)
from cartpend_dae.native.model import native_model
from cartpend_dae.native.run import Settings, loaded

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="There is no C compiler here."
)
METHODS = ["erk", "rosenbrock"]
NO_START = (np.zeros(0), np.zeros(0), np.zeros(0))


class Driven(Component):
    """x'' = -w^2 x + w^2 sin(2 w t) with w = 1/s and x(0) = 1: non-autonomous, and solved by hand."""

    w: Param = param(unit="1/s", default=1.0)
    x = var(unit="1")
    v = var(unit="1")

    def equations(self):
        yield der(self.x) == self.w * self.v
        yield der(self.v) == self.w * (-self.x + ca.sin(2 * self.w * time()))
        yield initial(self.x == 1)
        yield initial(self.v == 0)


def driven(t):
    return np.cos(t) + 2 / 3 * np.sin(t) - np.sin(2 * t) / 3


class Implicit(Component):
    """x' = -w z with z + z^3 = x, w = 1/s: an algebraic variable that no formula gives."""

    w: Param = param(unit="1/s", default=1.0)
    x = var(unit="1")
    z = var(unit="1", start=0.7)

    def equations(self):
        yield der(self.x) == -self.w * self.z
        yield self.z + self.z**3 == self.x
        yield initial(self.x == 2)


def implicit_time(x):
    """Return when x is reached: t = integral of (1 + 3 z^2)/z dz from z to 1."""
    z = np.array([max(np.roots([1.0, 0.0, 1.0, -value]).real) for value in x])
    return -np.log(z) + 1.5 * (1 - z**2)


class Slider(Component):
    """A mass with dry friction on a spring: F = c (s_0 - s)."""

    m: Param = param(unit="kg", default=1.0)
    c: Param = param(unit="N/m", default=100.0)
    f_c: Param = param(unit="N", default=4.0)
    s = var(unit="m")
    v = var(unit="m/s")
    f = var(unit="N")

    def equations(self):
        yield der(self.s) == self.v
        yield self.m * der(self.v) == -self.c * self.s - self.f
        yield self.f == dry_friction(self.v, self.f_c)
        yield initial(self.s == 1)
        yield initial(self.v == 0)


class Counter(Component):
    """An input is integrated, and its integral held every 0.1 s; n counts the samples."""

    u = signal("in", unit="1", default=1.0)
    x = var(unit="s")
    held = discrete(unit="s")
    n = discrete(unit="1")

    def equations(self):
        yield der(self.x) == self.u
        yield initial(self.x == 0)
        yield when(sample(0.1), assign(self.held, self.x), assign(self.n, self.n + 1))


def run_by_engine(model, method, rtol, grid):
    """Run a model without events or inputs by the engine itself."""
    system = assemble(model)
    engine = loaded(system, None)
    assert engine is not None
    start = simulate(system, times=grid)
    x, z = np.array([start[name][0] for name in system.states]), np.array([start[n][0] for n in system.algebraics])
    settings = Settings(method, rtol, rtol, grid[-1])
    inputs = np.zeros((grid.size - 1, 1)), np.zeros(grid.size - 1)
    return engine.run(settings, (x, z, np.zeros(0), system.parameter_values), grid, inputs)


# --- steps


@pytest.mark.parametrize("method", METHODS)
def test_the_error_falls_with_the_fifth_power_of_the_step(method):
    grid = np.linspace(0.0, 10.0, 2)
    errors, steps = [], []
    for rtol in (1e-5, 1e-8):
        run = run_by_engine(Driven(), method, rtol, grid)
        errors.append(abs(run.x[0, -1] - driven(10.0)))
        steps.append(run.n_steps)
    order = np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0])
    assert 4.5 < order < 7
    assert errors[1] < 1e-7


@pytest.mark.parametrize("method", METHODS)
def test_output_times_between_steps_are_as_right_as_the_steps(method):
    grid = np.linspace(0.0, 10.0, 3001)
    run = run_by_engine(Driven(), method, 1e-8, grid)
    assert run.n_steps < 600  # far fewer than output times
    np.testing.assert_allclose(run.x[0], driven(grid), rtol=0, atol=3e-7)


def test_an_algebraic_variable_keeps_its_equation():
    run = run_by_engine(Implicit(), "rosenbrock", 1e-9, np.linspace(0.0, 3.0, 301))
    x, z = run.x[0], run.z[0]
    np.testing.assert_allclose(z + z**3, x, rtol=0, atol=1e-7)
    np.testing.assert_allclose(implicit_time(x), np.linspace(0.0, 3.0, 301), rtol=0, atol=1e-7)


def test_a_stiff_decay_takes_few_implicit_steps():
    class Stiff(Component):
        w: Param = param(unit="1/s", default=1.0)
        x = var(unit="1")

        def equations(self):
            yield der(self.x) == -1e6 * self.w * (self.x - ca.cos(self.w * time()))
            yield initial(self.x == 0)

    grid = np.linspace(0.0, 10.0, 11)
    run = run_by_engine(Stiff(), "rosenbrock", 1e-7, grid)
    assert run.n_steps < 400
    np.testing.assert_allclose(run.x[0, 1:], np.cos(grid[1:] - 1e-6), rtol=0, atol=1e-6)


# --- events


@pytest.mark.parametrize("method", METHODS)
def test_events_are_where_the_book_has_them(method):
    hits = bounces(0.8, 1.0, 8)
    times = np.concatenate([[0.0], 0.5 * (hits[:-1] + hits[1:])])
    result = simulate(Ball(), times=times, method=method, rtol=1e-11, atol=1e-13, compile=True)
    np.testing.assert_array_equal(result["n"], np.arange(8))
    np.testing.assert_allclose(result["hit"][1:], hits[:-1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_slider_comes_to_rest_as_the_book_says_and_stays(method):
    # the amplitude falls by 2 f_c/c each half cycle of pi s/10, from 1 m: 1, -0.92, 0.84, ... until within f_c/c; the
    # last turn is right at this limit
    times = np.arange(0, 16) * np.pi / 10
    result = simulate(Slider(), times=times, method=method, rtol=1e-11, atol=1e-13, compile=True)
    ends = np.array([(-1) ** k * (1 - 0.08 * k) for k in range(13)])
    np.testing.assert_allclose(result["s"][:13], ends, rtol=0, atol=1e-9)
    long = simulate(Slider(), 1000.0, points=101, method=method, compile=True)
    assert np.abs(long["v"][1:]).max() < 1e-12
    assert np.ptp(long["s"][1:]) == 0


def test_clocks_tick_exactly_and_outputs_at_their_times_hold_what_follows():
    result = simulate(Counter(), 10.0, points=1001, compile=True)
    plain = simulate(Counter(), 10.0, points=1001)
    np.testing.assert_array_equal(result["n"], plain["n"])
    np.testing.assert_allclose(result["held"], np.floor(np.arange(1001) / 10 + 1e-9) / 10, rtol=0, atol=1e-12)
    assert result.n_events == plain.n_events


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_inputs_are_followed_with_their_jumps_and_slopes(hold):
    knots = np.array([0.0, 0.33, 0.9, 1.7, 3.0])
    values = np.array([1.0, -2.0, 4.0, 0.5, 0.5])
    inputs = {"u": (knots, values, hold)}
    made, plain = (simulate(Counter(), 3.0, points=61, inputs=inputs, compile=c) for c in (True, False))
    for name in ("x", "held", "n", "u"):
        np.testing.assert_allclose(made[name], plain[name], rtol=0, atol=1e-8)
    waved = {"u": lambda t: ca.sin(3 * t)}
    result = simulate(Counter(), 3.0, points=61, inputs=waved, compile=True)
    np.testing.assert_allclose(result["x"], (1 - np.cos(3 * result.time)) / 3, rtol=0, atol=1e-7)


def test_the_engine_needs_no_output_times_in_its_library(tmp_path, monkeypatch):
    monkeypatch.setenv("CARTPEND_CACHE", str(tmp_path))
    system = assemble(Slider())
    for points in (11, 101, 1001):
        simulate(system, 1.0, points=points, compile=True, parameters={"c": 90.0 + points})
    assert len(list(tmp_path.iterdir())) == 1


# --- handing over


def test_without_a_compiler_the_result_is_the_same(monkeypatch, tmp_path):
    made = simulate(Slider(), 3.0, points=301, compile=True, rtol=1e-10, atol=1e-12)
    monkeypatch.setenv("CC", str(tmp_path / "none"))
    plain = simulate(Slider(), 3.0, points=301, compile=True, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(made["s"], plain["s"], rtol=0, atol=1e-9)


def test_a_run_that_fails_is_explained_as_without_the_engine(caplog):
    class Escape(Component):
        w: Param = param(unit="1/s", default=1.0)
        x = var(unit="1")

        def equations(self):
            yield der(self.x) == self.w * self.x**2
            yield initial(self.x == 1)

    with caplog.at_level(logging.INFO), pytest.raises(SolverError, match="At 1 s these change fastest: `x`"):
        simulate(Escape(), 2.0, compile=True)
    assert any("Escape: the engine in C stops with erk: " in m and m.endswith(" at 1 s") for m in caplog.messages)


def test_the_slopes_are_those_of_the_rates():
    system = assemble(Implicit())
    rates, slopes, *_ = native_model(system, None).functions
    rng = np.random.default_rng(0)
    y, p, w, h = rng.uniform(0.2, 1.0, 2), system.parameter_values, np.zeros(1), 1e-6
    jacobian, in_time = (np.asarray(value) for value in slopes(0.3, y, np.zeros(0), w, p))
    for k in range(2):
        step = np.eye(2)[k] * h
        found = (np.asarray(rates(0.3, y + step, [], w, p)) - np.asarray(rates(0.3, y - step, [], w, p))) / (2 * h)
        np.testing.assert_allclose(jacobian[:, [k]], found, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(in_time, 0)
