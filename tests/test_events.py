"""State events against closed forms: jumps, dry friction that sticks, and runs that events end."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from library_bench import joined
from scipy.integrate import solve_ivp

import cartpend_dae
from cartpend_dae import (
    Component,
    ModelError,
    Param,
    SolverError,
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
    terminate,
    time,
    var,
    when,
)
from cartpend_dae.library.translational import CoulombFriction, Fixed, Force, Mass

G = 9.81
TIGHT: dict[str, Any] = {"rtol": 1e-11, "atol": 1e-13}
PLUGINS: list[Any] = ["erk", "rosenbrock"]


class Ball(Component):
    """A ball that falls from `h_0` and keeps the share `e` of its speed at each bounce."""

    e: Param = param(unit="1", default=0.8)
    h_0: Param = param(unit="m", default=1.0)
    h = var(unit="m")
    v = var(unit="m/s")
    n = discrete(unit="1")
    hit = discrete(unit="s")

    def equations(self):
        yield der(self.h) == self.v
        yield der(self.v) == -G
        yield initial(self.h == self.h_0)
        yield initial(self.v == 0)
        yield when(self.h < 0, reinit(self.v, -self.e * self.v), assign(self.n, self.n + 1), assign(self.hit, time()))


def bounces(e, h_0, n):
    """Return the times of the first n bounces."""
    first = np.sqrt(2 * h_0 / G)
    return first + 2 * first * np.concatenate([[0.0], np.cumsum(e ** np.arange(1, n))])


# --- jumps


@pytest.mark.parametrize("method", PLUGINS)
def test_a_ball_bounces_at_the_times_of_the_book(method):
    hits = bounces(0.8, 1.0, 8)
    times = np.concatenate([[0.0], 0.5 * (hits[:-1] + hits[1:])])
    result = simulate(Ball(), times=times, method=method, **TIGHT)
    np.testing.assert_array_equal(result["n"], np.arange(8))
    # a part in 1e10 of the duration
    np.testing.assert_allclose(result["hit"][1:], hits[:-1], rtol=0, atol=1e-10 * times[-1])
    # half way between two bounces it is at the top: v^2/2g
    np.testing.assert_allclose(result["h"][1:], G / 8 * np.diff(hits) ** 2, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", PLUGINS)
def test_a_bounce_at_an_output_time_happens_once(method):
    hits = bounces(1.0, 1.0, 6)
    result = simulate(Ball(e=1.0), times=np.concatenate([[0.0], hits]), method=method, **TIGHT)
    assert abs(result["n"] - np.arange(7)).max() <= 1  # rounding decides whether the bounce or the output is first
    np.testing.assert_allclose(result["h"][1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(abs(result["v"][1:]), np.sqrt(2 * G), rtol=1e-10)


@pytest.mark.parametrize("h_0", [1.0, 1.0 + 1e-15], ids=["same", "one rounding apart"])
def test_two_balls_that_land_together_both_bounce(h_0):
    result = simulate(joined(a=Ball(e=0.9), b=Ball(e=0.5, h_0=h_0)), 0.9, **TIGHT)
    hits = bounces(0.5, 1.0, 2)
    assert result["a.n"][-1] == 1 and result["b.n"][-1] == 2 - (hits[1] > 0.9)
    np.testing.assert_allclose([result["a.hit"][-1], bounces(0.9, 1.0, 1)[0]], hits[0], atol=1e-10)


def test_a_ball_that_comes_to_rest_ends_in_a_sentence_with_the_time():
    last = np.sqrt(2 / G) * (1 + 0.5) / (1 - 0.5)
    with pytest.raises(SolverError, match=r"events of `Ball` follow each other without end at") as caught:
        simulate(Ball(e=0.5), 3.0)
    found = float(str(caught.value).split("without end at ")[1].split(" s")[0])
    assert found == pytest.approx(last, abs=1e-5)  # the sentence gives six digits


class Geared(Component):
    """Two shafts on one gear; a stop on the fast one throws its speed back."""

    i: Param = param(unit="1", default=4.0)
    slow = var(unit="rad")
    fast = var(unit="rad")
    w_slow = var(unit="rad/s")
    w_fast = var(unit="rad/s")

    def equations(self):
        yield self.fast == self.i * self.slow
        yield self.w_slow == der(self.slow)
        yield self.w_fast == der(self.fast)
        yield der(self.w_slow) == 0
        yield initial(self.slow == 0)
        yield initial(self.w_slow == 1)
        yield when(self.fast > 2, reinit(self.w_fast, -self.w_fast / 2))


def test_a_jump_of_a_multiple_of_a_state_moves_the_state():
    result = simulate(Geared(), 2.0, points=21, **TIGHT)
    expected = np.where(result.time < 0.5, result.time, 0.5 - 0.5 * (result.time - 0.5))
    np.testing.assert_allclose(result["slow"], expected, atol=1e-10)
    np.testing.assert_allclose(result["fast"], 4 * expected, atol=1e-10)


def test_a_jump_of_what_is_no_state_names_it():
    class Fall(Component):
        """The force is no state: nothing keeps the value it jumps to."""

        m: Param = param(unit="kg", default=1.0)
        d: Param = param(unit="N.s/m", default=1.0)
        v_0: Param = param(unit="m/s", default=3.0)
        v = var(unit="m/s")
        f = var(unit="N")

        def equations(self):
            yield self.f == 3 - self.d * self.v * (1 + self.v**2 / self.v_0**2)
            yield self.m * der(self.v) == self.f
            yield when(self.v > 1, reinit(self.f, 0.0))

    with pytest.raises(ModelError, match=r"`reinit` in `Fall` names `f`, which is no state.*states are: `v`"):
        simulate(Fall(), 1.0)


# --- dry friction

F_C, C, M = 1.5, 60.0, 2.0


class Slider(Component):
    """A mass on a spring under dry friction and a push."""

    level: Param = param(unit="N", default=F_C)
    c: Param = param(unit="N/m", default=C)
    m: Param = param(unit="kg", default=M)
    push = signal("in", unit="N", default=0.0)
    s = var(unit="m")
    v = var(unit="m/s")
    mode = discrete(unit="1")

    def equations(self):
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.push - self.c * self.s - dry_friction(self.v, self.level, mode=self.mode)
        yield initial(self.s == 0)
        yield initial(self.v == 0)


def coulomb_decay(t, x_0):
    """Return place and speed: half cosines about +-F/c, and rest once the spring is weaker than the friction."""
    w, shift = np.sqrt(C / M), F_C / C
    half = np.pi / w
    s, v, start, k = np.full_like(t, np.nan), np.zeros_like(t), x_0, 0
    while abs(start) > shift:
        part = (t >= k * half) & (t <= (k + 1) * half)
        mid = shift * np.sign(start)
        s[part] = mid + (start - mid) * np.cos(w * (t[part] - k * half))
        v[part] = -w * (start - mid) * np.sin(w * (t[part] - k * half))
        start, k = 2 * mid - start, k + 1
    s[t >= k * half] = start
    return s, v, k * half


@pytest.mark.parametrize("method", ["adaptive", *PLUGINS])
def test_coulomb_damping_takes_4_f_over_k_a_cycle_and_ends_in_the_dead_zone(method):
    cycle = 2 * np.pi * np.sqrt(M / C)
    times = np.union1d(np.linspace(0, 6 * cycle, 301), cycle * np.arange(6))
    result = simulate(Slider(), times=times, start={"s": 0.53}, method=method, **TIGHT)
    s, v, end = coulomb_decay(times, 0.53)
    np.testing.assert_allclose(result["s"], s, rtol=0, atol=1e-8)
    np.testing.assert_allclose(result["v"], v, rtol=0, atol=1e-8)
    tops = result["s"][np.searchsorted(times, cycle * np.arange(6))]
    drops = -np.diff(tops[: int(end / cycle) + 1])
    assert drops.size >= 4
    np.testing.assert_allclose(drops, 4 * F_C / C, rtol=0, atol=1e-8)
    assert abs(result["s"][-1]) < F_C / C and np.all(result["v"][times > end + 1e-9] == 0)
    np.testing.assert_array_equal(np.unique(result["mode"]), [-1, 0, 1])


@pytest.mark.parametrize("method", ["adaptive", *PLUGINS])
def test_a_cart_under_99_percent_of_its_break_away_force_stays_for_a_thousand_seconds(method):
    push, cart, rail, ground = Force(), Mass(m=1.0), CoulombFriction(f_c=3.0), Fixed()
    joints = [
        (push.flange, cart.flange_a),
        (cart.flange_b, rail.flange_a),
        (rail.flange_b, ground.flange),
    ]
    model = joined(*joints, push=push, cart=cart, rail=rail, ground=ground)
    result = simulate(model, 1000.0, inputs={"push.f": 2.97}, method=method)
    assert abs(result["cart.v"]).max() < 1e-12
    assert abs(result["cart.s"]).max() < 1e-12


class Belt(Component):
    """A mass on a spring on a belt; the level falls with the slip speed from 2 `f_c` to `f_c`, and is `f_s` at rest."""

    m: Param = param(unit="kg", default=1.0)
    c: Param = param(unit="N/m", default=100.0)
    f_c: Param = param(unit="N", default=1.0)
    f_s: Param = param(unit="N", default=3.0)
    v_s: Param = param(unit="m/s", default=0.05)
    s = var(unit="m")
    v = var(unit="m/s")

    def equations(self):
        slip = self.v - 0.1
        level = self.f_c * (1 + ca.exp(-ca.fabs(slip) / self.v_s))
        yield der(self.s) == self.v
        yield self.m * der(self.v) == -self.c * self.s - dry_friction(slip, level, static=self.f_s)
        yield initial(self.s == 0)
        yield initial(self.v == 0.1)


def slip_stick(times):
    """Return place and speed by scipy: stuck until the spring reaches 3 N, slipping until the speed is the belt's."""
    s, v = np.zeros_like(times), np.zeros_like(times)

    def slips(_, x):
        return [x[1], -100 * x[0] + 1 + np.exp(-abs(x[1] - 0.1) / 0.05)]

    def catches(t, x):
        return x[1] - 0.1 if t > 1e-3 else -1.0

    catches.terminal, catches.direction = True, 1  # pyright: ignore[reportFunctionMemberAccess]
    t, s_0 = 0.0, 0.0
    while t < times[-1]:
        away = t + (0.03 - s_0) / 0.1
        part = (times >= t) & (times <= away)
        s[part], v[part] = s_0 + 0.1 * (times[part] - t), 0.1
        slip = solve_ivp(
            slips, (0, 2), [0.03, 0.1], "DOP853", events=catches, rtol=1e-13, atol=1e-15, dense_output=True
        )
        t = away + slip.t[-1]
        part = (times > away) & (times < t)
        s[part], v[part] = slip.sol(times[part] - away)
        s_0 = slip.y[0, -1]
    return s, v


@pytest.mark.parametrize("method", PLUGINS)
def test_stick_slip_on_a_belt_with_a_static_level_of_its_own(method):
    times = np.linspace(0, 3.0, 601)
    s, v = slip_stick(times)
    result = simulate(Belt(), times=times, method=method, **TIGHT)
    # some five cycles at a tolerance of 1e-11; the speed changes by 2 m/s2 or so, the times agree to 1e-8
    np.testing.assert_allclose(result["s"], s, rtol=0, atol=1e-8)
    np.testing.assert_allclose(result["v"], v, rtol=0, atol=1e-7)


class Pair(Component):
    """Two free bodies that rub on each other."""

    f_c: Param = param(unit="N", default=3.0)
    m: Param = param(unit="kg", default=1.0)
    v = var(unit="m/s")
    w = var(unit="m/s")
    mode = discrete(unit="1")

    def equations(self):
        f = dry_friction(self.v - self.w, self.f_c, mode=self.mode)
        yield self.m * der(self.v) == -f
        yield 2 * self.m * der(self.w) == f
        yield initial(self.v == 4.0)
        yield initial(self.w == 1.0)


@pytest.mark.parametrize("method", PLUGINS)
def test_bodies_that_rub_on_each_other_reach_the_speed_of_their_momentum(method):
    result = simulate(Pair(), 2.0, points=41, method=method, **TIGHT)
    # slip 3 m/s, falling by 3/1 + 3/2 m/s2: together from 2/3 s on, at (4 + 2)/3 m/s
    left = np.maximum(3 - 4.5 * result.time, 0)
    np.testing.assert_allclose(result["v"] - result["w"], left, atol=1e-11)
    np.testing.assert_allclose(result["v"] + 2 * result["w"], 6.0, atol=1e-11)
    np.testing.assert_array_equal(result["mode"], np.where(left > 0, 1, 0))


class Stack(Component):
    """A block on a block on the ground; a force that rises by 1 N/s pulls the upper one."""

    f: Param = param(unit="N", default=1.0)
    m: Param = param(unit="kg", default=1.0)
    rate: Param = param(unit="N/s", default=1.0)
    v_1 = var(unit="m/s")
    v_2 = var(unit="m/s")
    low = discrete(unit="1")
    up = discrete(unit="1")
    at_low = discrete(unit="s")
    at_up = discrete(unit="s")

    def equations(self):
        ground = dry_friction(self.v_1, 2 * self.f, mode=self.low)
        between = dry_friction(self.v_2 - self.v_1, 5 * self.f, mode=self.up)
        yield 3 * self.m * der(self.v_1) == between - ground
        yield self.m * der(self.v_2) == self.rate * time() - between
        yield when(self.low > 0.5, assign(self.at_low, time()))
        yield when(self.up > 0.5, assign(self.at_up, time()))


@pytest.mark.parametrize("method", PLUGINS)
def test_blocks_that_stick_together_are_released_one_after_the_other(method):
    result = simulate(Stack(), 16.0, points=81, method=method, **TIGHT)
    # both move from 2 N on with (F - 2)/4; the friction between is F - (F - 2)/4 = 5 at F = 6
    assert result["at_low"][-1] == pytest.approx(2.0, abs=1e-7)
    assert result["at_up"][-1] == pytest.approx(6.0, abs=1e-7)
    t = result.time
    together = np.clip(t - 2, 0, 4) ** 2 / 8
    late = np.maximum(t - 6, 0)
    np.testing.assert_allclose(result["v_1"], together + late, atol=1e-7)
    np.testing.assert_allclose(result["v_2"], together + late + late**2 / 2, atol=1e-7)


class Clutch(Component):
    """A wheel braked while a window of time is open, and free outside of it."""

    J: Param = param(unit="kg.m2", default=1.0)
    drive: Param = param(unit="N.m", default=0.1)
    level: Param = param(unit="N.m", default=0.6)
    w = var(unit="rad/s")
    tau = var(unit="N.m")
    mode = discrete(unit="1")

    def equations(self):
        opens = if_else(time() > 1, if_else(time() > 2, 0.0, 1.0), 0.0) + if_else(time() > 4, 1.0, 0.0)
        yield self.tau == dry_friction(self.w, self.level * opens, mode=self.mode)
        yield self.J * der(self.w) == self.drive - self.tau
        yield initial(self.w == 0.0)


def test_a_friction_is_free_where_its_level_is_zero_and_says_so():
    times = np.linspace(0.05, 5.95, 60)
    result = simulate(Clutch(), times=np.concatenate([[0.0], times]), **TIGHT)
    t = times
    braked = 0.1 - 0.5 * (t - 1)
    expected = np.select(
        [t < 1, t < 1.2, t < 2, t < 4],
        [0.1 * t, braked, 0, 0.1 * (t - 2)],
        np.maximum(0.2 - 0.5 * (t - 4), 0),
    )
    np.testing.assert_allclose(result["w"][1:], expected, atol=1e-10)
    modes = np.select([t < 1, t < 1.2, t < 2, t < 4, t < 4.4], [2, 1, 0, 2, 1], 0)
    np.testing.assert_array_equal(result["mode"][1:], modes)


# --- runs that events end


class Relay(Component):
    """A state that a relay without hysteresis drives to zero, and cannot leave."""

    x = var(unit="1", start=1.0)
    on = discrete(unit="1", start=1.0)

    def equations(self):
        yield der(self.x) == if_else(self.x > 0, -1.0, 1.0)
        yield when(self.x < 0, assign(self.on, 1 - self.on))
        yield initial(self.x == 1)


@pytest.mark.parametrize("method", ["adaptive", *PLUGINS])
def test_a_relay_without_width_ends_in_a_sentence(method):
    with pytest.raises(SolverError, match=r"at 1 s the decisions of `relay` go round in circles.*two thresholds"):
        simulate(joined(relay=Relay()), 3.0, method=method)


def test_conditions_that_untrue_each_other_end_in_a_sentence():
    class Doubt(Component):
        """It is on while it is off."""

        x = var(unit="1")
        on = discrete(unit="1")

        def equations(self):
            yield der(self.x) == 1.0
            yield initial(self.x == 0)
            yield assign(self.on, if_else(self.x > 1, 1 - self.on, 0.0))

    with pytest.raises(SolverError, match=r"at 1 s the decisions of `doubt` go round in circles"):
        simulate(joined(doubt=Doubt()), 3.0)


def test_a_run_that_a_condition_ends_says_when_and_why():
    class Tank(Component):
        x = var(unit="m")

        def equations(self):
            yield der(self.x) == 0.5
            yield terminate(self.x > 1, "the tank is full.")

    with pytest.raises(SolverError, match=r"Bench ends at 2 s by `tank`: the tank is full\.$"):
        simulate(joined(tank=Tank()), 3.0)
    assert simulate(joined(tank=Tank()), 1.9)["tank.x"][-1] == pytest.approx(0.95)


# --- crossings that a step could pass over


class Fast(Component):
    """Counts the upward zero crossings of a fast sine beside a slow state."""

    w: Param = param(unit="rad/s", default=50.0)
    x = var(unit="1")
    n = discrete(unit="1")

    def equations(self):
        yield der(self.x) == -self.x
        yield initial(self.x == 1)
        yield when(ca.sin(self.w * time()) > 0, assign(self.n, self.n + 1))


@pytest.mark.parametrize("method", ["adaptive", *PLUGINS])
@pytest.mark.parametrize(("w", "stop"), [(50.0, 2.0), (50.0, 100.0)])
def test_no_fast_crossing_is_passed_over(method, w, stop):
    result = simulate(Fast(w=w), stop, points=201, method=method)
    np.testing.assert_array_equal(result["n"][1:], np.ceil(w * result.time[1:] / (2 * np.pi)))


def test_the_names_that_a_model_author_needs_are_public():
    names = "assign both discrete either if_else noevent pre reinit sample terminate when"
    assert set(names.split()) <= set(cartpend_dae.__all__)
    assert all(hasattr(cartpend_dae, name) for name in cartpend_dae.__all__)
    assert cartpend_dae.__all__ == sorted(cartpend_dae.__all__)


def test_a_comparison_by_equality_of_what_moves_is_refused():
    class Equal(Component):
        x = var(unit="s")
        y = signal("out", unit="1")

        def equations(self):
            yield der(self.x) == 1
            yield self.y == if_else(self.x == 1.0, 1, 0)

    with pytest.raises(ModelError, match=r"The condition `\(Equal.x==1\)` in `Equal` asks whether `Equal.x` equals"):
        simulate(Equal(), 2.0)


def test_a_discrete_variable_may_be_asked_for_its_value():
    class Gear(Component):
        x = var(unit="s")
        n = discrete(unit="1")
        y = signal("out", unit="1")

        def equations(self):
            yield der(self.x) == 1
            yield initial(self.x == 0)
            yield when(self.x > 0.5, assign(self.n, 2))
            yield self.y == if_else(self.n == 2, 7, 3)

    np.testing.assert_array_equal(simulate(Gear(), 1.0, points=5)["y"][[0, 1, 3, 4]], [3, 3, 7, 7])
