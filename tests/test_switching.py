"""Conditions, discrete variables and sampled laws against what they mean."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from library_bench import joined

from cartpend_dae import (
    Component,
    Param,
    SolverError,
    assign,
    both,
    connect,
    der,
    discrete,
    dry_friction,
    either,
    if_else,
    initial,
    noevent,
    param,
    pre,
    reinit,
    sample,
    signal,
    simulate,
    time,
    var,
    when,
)

TIGHT: dict[str, Any] = {"rtol": 1e-11, "atol": 1e-13}
PLUGINS: list[Any] = ["erk", "rosenbrock"]


class Ramp(Component):
    """x = t, as a state, so that its events are state events; `law` adds what a test asks for."""

    x = var(unit="1")

    def equations(self):
        yield der(self.x) == 1.0
        yield initial(self.x == 0)
        yield from self.law()

    def law(self):
        yield from ()


def ramp(law, **members):
    """A ramp whose law is a function of it."""
    return type("Ramp", (Ramp,), {"law": law, **members})()


def counting(condition, **members):
    """A ramp that counts how often a condition of it becomes true, and notes when."""
    counters = {"n": discrete(unit="1"), "at": discrete(unit="s")}
    return ramp(lambda self: counted(self, condition(self)), **counters, **members)


def counted(self, condition):
    yield when(condition, assign(self.n, self.n + 1), assign(self.at, time()))


# --- conditions


@pytest.mark.parametrize(
    ("condition", "value"),
    [
        (lambda x: x > 1, 1.0),
        (lambda x: x >= 1, 1.0),
        (lambda x: ca.logic_not(x < 1), 1.0),
        (lambda x: both(x > 0.5, x > 1), 1.0),
        (lambda x: either(x > 2, x > 1, x > 1.5), 1.0),
        (lambda x: (x - 0.4) ** 2 > 0.36, 1.0),
        (lambda x: ca.sin(x) < 0, np.pi),
        (lambda x: ca.fabs(x - 2) < 0.75, 1.25),
    ],
)
@pytest.mark.parametrize("method", PLUGINS)
def test_when_acts_where_its_condition_becomes_true(condition, value, method):
    result = simulate(counting(lambda self: condition(self.x)), 4.0, points=41, method=method, **TIGHT)
    clear = abs(result.time - value) > 1e-9
    np.testing.assert_array_equal(result["n"][clear], (result.time > value)[clear])
    assert result["at"][-1] == pytest.approx(value, abs=1e-10 * 4)


@pytest.mark.parametrize("condition", [lambda x: x < 1, lambda x: x <= 0, lambda x: x >= 0, lambda x: x > -1])
def test_what_is_true_at_the_start_does_not_become_true(condition):
    result = simulate(counting(lambda self: condition(self.x)), 3.0)
    assert result["n"].max() == 0


def test_less_and_not_more_differ_where_the_sides_are_equal():
    def law(self):
        yield self.less == if_else(self.still < 1, 1.0, 0.0)
        yield self.at_most == if_else(self.still <= 1, 1.0, 0.0)
        yield self.more == if_else(self.still > 1, 1.0, 0.0)
        yield self.at_least == if_else(self.still >= 1, 1.0, 0.0)
        yield der(self.still) == 0.0
        yield initial(self.still == 1.0)

    names = ["less", "at_most", "more", "at_least"]
    result = simulate(ramp(law, **{name: var(unit="1") for name in [*names, "still"]}), 1.0)
    assert [result[name][-1] for name in names] == [0, 1, 0, 1]


@pytest.mark.parametrize("method", PLUGINS)
def test_both_directions_of_a_crossing_are_counted(method):
    """sin t crosses 1/2 upward at pi/6 and downward at 5 pi/6, in each turn."""

    def law(self):
        yield der(self.c) == -self.s
        yield der(self.s) == self.c
        yield initial(self.c == 1)
        yield initial(self.s == 0)
        yield when(self.s > 0.5, assign(self.n, self.n + 1))
        yield when(self.s < 0.5, assign(self.down, self.down + 1))

    members = {"c": var(unit="1"), "s": var(unit="1"), "n": discrete(unit="1"), "down": discrete(unit="1")}
    result = simulate(ramp(law, **members), 60.0, points=601, method=method)
    t = result.time
    np.testing.assert_array_equal(result["n"], np.floor((t - np.pi / 6) / (2 * np.pi)) + 1)
    np.testing.assert_array_equal(result["down"], np.floor((t - 5 * np.pi / 6) / (2 * np.pi)) + 1)


def test_nested_choices_make_the_pieces_of_a_curve():
    def law(self):
        inner = if_else(self.x < 2, 1.0, if_else(self.x < 3, -2.0, 0.5))
        yield der(self.y) == if_else(self.x < 1, 0.0, inner)
        yield initial(self.y == 0)

    result = simulate(ramp(law, y=var(unit="1")), 4.0, points=33, **TIGHT)
    expected = np.interp(result.time, [0, 1, 2, 3, 4], [0, 0, 1, -1, -0.5])
    np.testing.assert_allclose(result["y"], expected, atol=1e-10)


def test_a_choice_without_events_has_the_values_of_one_with_them():
    def law(self):
        yield self.y == if_else(noevent(self.x > 1), (self.x - 1) ** 3, 0.0)
        yield self.z == if_else(self.x > 1, (self.x - 1) ** 3, 0.0)
        yield der(self.n_y) == self.y
        yield initial(self.n_y == 0)

    result = simulate(ramp(law, y=var(unit="1"), z=var(unit="1"), n_y=var(unit="1")), 2.0, **TIGHT)
    np.testing.assert_allclose(result["y"], result["z"], atol=1e-12)
    assert result["n_y"][-1] == pytest.approx(0.25, abs=1e-8)


@pytest.mark.parametrize("rising", [True, False])
def test_a_relation_on_an_algebraic_variable(rising):
    """y + y^3 = x: y passes 1 where x passes 2."""

    def law(self):
        x = self.x if rising else 4 - self.x
        yield self.y + self.y**3 == x
        yield from counted(self, self.y > 1 if rising else self.y < 1)

    result = simulate(
        ramp(law, y=var(unit="1", start=1.0), n=discrete(unit="1"), at=discrete(unit="s")), 3.0, points=31, **TIGHT
    )
    assert result["n"][-1] == 1
    assert result["at"][-1] == pytest.approx(2.0, abs=1e-9)


# --- discrete variables


class Room(Component):
    """A room that loses heat, and a heater between two thresholds."""

    theta = var(unit="1")
    on = discrete(unit="1", start=1.0)
    n = discrete(unit="1")

    def equations(self):
        yield der(self.theta) == -self.theta + 2 * self.on
        yield initial(self.theta == 0)
        yield when(self.theta > 1.2, assign(self.on, 0.0), assign(self.n, self.n + 1))
        yield when(self.theta < 0.8, assign(self.on, 1.0), assign(self.n, self.n + 1))


@pytest.mark.parametrize("method", PLUGINS)
def test_a_thermostat_switches_between_its_thresholds(method):
    result = simulate(Room(), 10.0, points=501, method=method, **TIGHT)
    switches = [np.log(2 / 0.8)]  # 2 - 2 e^-t = 1.2
    while switches[-1] < 10:
        # cooling from 1.2 to 0.8; heating from 0.8 to 1.2, both toward their ends
        switches.append(switches[-1] + np.log(1.2 / 0.8))
    n = np.searchsorted(switches, result.time)
    np.testing.assert_array_equal(result["n"], n)
    np.testing.assert_array_equal(result["on"], (n + 1) % 2)
    inside = result.time > switches[0]
    assert result["theta"][inside].min() > 0.8 - 1e-9 and result["theta"].max() < 1.2 + 1e-9


def test_actions_read_the_values_before_the_event():
    """Two variables change places: each takes the value that the other had."""

    def law(self):
        yield when(self.x > 1, assign(self.a, pre(self.b)), assign(self.b, self.a), reinit(self.x, self.x + self.b))

    members = {"a": discrete(unit="1", start=3.0), "b": discrete(unit="1", start=5.0)}
    result = simulate(ramp(law, **members), 2.0, **TIGHT)
    assert (result["a"][-1], result["b"][-1]) == (5, 3)
    assert result["x"][-1] == pytest.approx(2.0 + 5.0, abs=1e-10)


def test_one_event_sets_off_the_next_at_the_same_instant():
    def law(self):
        yield when(self.x > 1, assign(self.n, 1.0))
        yield when(self.n > 0.5, assign(self.second, 2.0))
        yield when(self.second > 1.5, assign(self.at, time()), reinit(self.x, 10.0))

    result = simulate(ramp(law, second=discrete(unit="1"), n=discrete(unit="1"), at=discrete(unit="s")), 2.0, **TIGHT)
    assert result["at"][-1] == pytest.approx(1.0, abs=1e-10)
    assert result["x"][-1] == pytest.approx(11.0, abs=1e-10)


class Machine(Component):
    """Idle, filling, done: a machine of modes, decided anew at every event."""

    x = var(unit="1")
    mode = discrete(unit="1")

    def equations(self):
        filling, done = self.mode == 1, self.mode == 2
        yield der(self.x) == if_else(both(self.mode > 0.5, self.mode < 1.5), 2.0, 0.0)
        yield initial(self.x == 0)
        start = if_else(time() > 1, 1.0, 0.0)
        full = if_else(self.x > 1, 2.0, 1.0)
        yield assign(self.mode, ca.if_else(filling, full, ca.if_else(done, 2.0, start)))


def test_a_machine_of_modes_goes_from_one_to_the_next():
    result = simulate(Machine(), 3.0, points=61, **TIGHT)
    np.testing.assert_allclose(result["x"], np.clip(2 * (result.time - 1), 0, 1), atol=1e-9)
    off = (abs(result.time - 1) > 1e-9) & (abs(result.time - 1.5) > 1e-9)
    np.testing.assert_array_equal(result["mode"][off], np.select([result.time < 1, result.time < 1.5], [0, 1], 2)[off])


class Counter(Component):
    """Counts ticks and shows their number."""

    y = signal("out", unit="1")
    n = discrete(unit="1")

    def equations(self):
        yield self.y == self.n
        yield when(sample(0.5, 0.25), assign(self.n, self.n + 1))


class Follower(Component):
    """A state that integrates a signal."""

    u = signal("in", unit="1")
    x = var(unit="s")

    def equations(self):
        yield der(self.x) == self.u
        yield initial(self.x == 0)


def test_a_discrete_variable_drives_a_signal():
    counter, follower = Counter(), Follower()
    bench = joined(counter=counter, follower=follower)
    bench.joints = [connect(counter.y, follower.u)]
    result = simulate(bench, 3.0, points=61, **TIGHT)
    ticks = 0.25 + 0.5 * np.arange(6)
    expected = np.maximum(result.time[:, None] - ticks, 0).sum(axis=1)
    np.testing.assert_allclose(result["follower.x"], expected, atol=1e-9)


# --- sampled laws


class Servo(Component):
    """A body with viscous drag under a sampled proportional and integral law."""

    T: Param = param(unit="s", default=0.1)
    v = var(unit="1")
    u = discrete(unit="1")
    total = discrete(unit="1")

    def equations(self):
        yield der(self.v) == -self.v + self.u
        yield initial(self.v == 0)
        error = 1 - self.v
        yield when(sample(self.T), assign(self.total, self.total + error), assign(self.u, 2 * error + 0.3 * self.total))


@pytest.mark.parametrize("method", ["adaptive", *PLUGINS])
def test_a_sampled_controller_follows_its_difference_equation(method):
    n, decay = 100, np.exp(-0.1)
    v, u, total, expected = 0.0, 0.0, 0.0, []
    for _ in range(n):
        u, total = 2 * (1 - v) + 0.3 * total, total + 1 - v
        expected.append((v, u, total))
        v = decay * v + (1 - decay) * u
    # 0.05 s after each tick the state is half way of its exponential
    times = np.concatenate([[0.0], 0.1 * np.arange(n) + 0.05])
    result = simulate(Servo(), times=times, method=method, **TIGHT)
    v, u, total = np.array(expected).T
    half = np.exp(-0.05)
    np.testing.assert_allclose(result["u"][1:], u, atol=1e-9)
    np.testing.assert_allclose(result["total"][1:], total, atol=1e-9)
    np.testing.assert_allclose(result["v"][1:], half * v + (1 - half) * u, atol=1e-9)


class Clocks(Component):
    """Two clocks that tick together every 0.6 s: both act, on the values before."""

    x = var(unit="1")
    a = discrete(unit="1")
    b = discrete(unit="1")
    sum = discrete(unit="1")

    def equations(self):
        yield der(self.x) == 0.0
        yield when(sample(0.2), assign(self.a, self.a + 1))
        yield when(sample(0.3), assign(self.b, self.b + 1))
        yield when(both(sample(0.2), sample(0.3)), assign(self.sum, self.a + self.b))


@pytest.mark.parametrize("method", PLUGINS)
def test_clocks_of_two_periods_tick_together_where_their_times_agree(method):
    times = np.concatenate([[0.0], np.arange(0.05, 6, 0.1)])
    result = simulate(Clocks(), times=times, method=method)
    ticks_a, ticks_b = np.floor(times / 0.2 + 1e-9) + 1, np.floor(times / 0.3 + 1e-9) + 1
    np.testing.assert_array_equal(result["a"], ticks_a)
    np.testing.assert_array_equal(result["b"], ticks_b)
    together = np.floor(times / 0.6 + 1e-9)
    np.testing.assert_array_equal(result["sum"], 3 * together + 2 * together)


class Rig(Component):
    """A cart with dry friction under a sampled position controller that is too weak for the last bit of the way."""

    m: Param = param(unit="kg", default=1.0)
    c: Param = param(unit="N/m", default=40.0)
    d: Param = param(unit="N.s/m", default=8.0)
    f_c: Param = param(unit="N", default=2.0)
    s = var(unit="m")
    v = var(unit="m/s")
    u = discrete(unit="N")
    mode = discrete(unit="1")

    def equations(self):
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.u - dry_friction(self.v, self.f_c, mode=self.mode)
        yield initial(self.s == 0)
        yield initial(self.v == 0)
        yield when(sample(0.01), assign(self.u, self.c * (1 - self.s) - self.d * self.v))


def rig_by_hand(n):
    """Step by step in closed form: between ticks the acceleration is constant up to a stop."""
    s, v, h, found = 0.0, 0.0, 0.01, []
    for _ in range(n):
        u, left = 40 * (1 - s) - 8 * v, h
        found.append((s, v, u))
        while left > 0:
            way = np.sign(v) or (np.sign(u) if abs(u) > 2 else 0.0)
            if way == 0:
                break
            a = u - 2 * way
            part = min(left, -v / a) if a * way < 0 else left
            s, v, left = s + v * part + a * part**2 / 2, v + a * part, left - part
            if part < h and left > 0:
                v = 0.0
    return np.array(found)


@pytest.mark.parametrize("method", ["adaptive", *PLUGINS])
def test_a_sampled_controller_drives_a_cart_until_it_sticks(method):
    expected = rig_by_hand(300)
    result = simulate(Rig(), times=0.01 * np.arange(300), method=method, **TIGHT)
    np.testing.assert_allclose(result["s"], expected[:, 0], atol=1e-8)
    np.testing.assert_allclose(result["v"], expected[:, 1], atol=1e-8)
    assert result["mode"][-1] == 0 and result["v"][-1] == 0
    assert 0 < abs(1 - result["s"][-1]) < 2 / 40  # where the controller is weaker than the friction


def test_two_thresholds_that_cross_end_in_a_sentence_with_the_time_and_the_component():
    """The heater goes off above 0.8 and on below 1.2: between them each makes the other one act."""

    class Wrong(Component):
        x = var(unit="1")
        on = discrete(unit="1", start=1.0)

        def equations(self):
            yield der(self.x) == 1.0
            yield initial(self.x == 0)
            yield when(both(self.x > 0.8, self.on > 0.5), assign(self.on, 0.0))
            yield when(both(self.x < 1.2, self.on < 0.5), assign(self.on, 1.0))

    with pytest.raises(SolverError, match=r"at 0\.8 s the decisions of `heater` go round in circles"):
        simulate(joined(heater=Wrong()), 3.0)


def test_a_clock_keeps_its_time_for_a_long_time():
    """A sum of 6,000 periods drifts by rounding, and once met an output time so that no event told the tick."""
    result = simulate(Clocks(), times=0.1 * np.arange(6001), method="erk")
    k = np.arange(6001)
    np.testing.assert_array_equal(result["a"], k // 2 + 1)
    np.testing.assert_array_equal(result["b"], k // 3 + 1)
