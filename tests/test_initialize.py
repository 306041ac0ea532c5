"""Start values: which of them counts, through factors, and what contradicts what."""

import re

import numpy as np
import pytest
from library_bench import held, joined

from cartpend_dae import Component, ModelError, Param, SolverError, Statements, der, initial, param, simulate, time, var
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.translational import Mass, Spring


class Decay(Component):
    """x' = -x, with a guess of 1 by its declaration, and what else a test says."""

    x = var(unit="1", start=1.0)

    def equations(self):
        yield der(self.x) == -self.x
        yield from self.conditions()

    def conditions(self) -> Statements:
        yield from ()


class Fixed(Decay):
    def conditions(self):
        yield initial(self.x == 3)


class Guessed(Decay):
    def conditions(self):
        yield initial(self.x == 2, fixed=False)


class Both(Decay):
    def conditions(self):
        yield initial(self.x == 2, fixed=False)
        yield initial(self.x == 3)


def first(model, name, **options):
    return float(simulate(model, 1.0, points=2, **options)[name][0])


# --- priorities


@pytest.mark.parametrize(
    ("model", "start", "expected"),
    [
        (Decay(), {}, 1.0),
        (Guessed(), {}, 2.0),
        (Fixed(), {}, 3.0),
        (Both(), {}, 3.0),
        (Decay(), {"x": 5.0}, 5.0),
        (Both(), {"x": 5.0}, 5.0),
    ],
    ids=["declared", "guess", "fixed", "fixed before guess", "caller", "caller before fixed"],
)
def test_the_caller_overrules_what_is_fixed_and_that_what_is_guessed(model, start, expected):
    assert first(model, "x", start=start) == pytest.approx(expected, rel=1e-15)


def test_without_any_word_a_model_starts_at_zero_and_at_rest():
    model = held(translational, Mass(m=1.0), spring=Spring(c=1.0))
    assert abs(simulate(model, 1.0, points=3).values).max() == 0


def test_what_one_start_leaves_free_the_next_takes():
    """The caller fixes the sum, the model fixes nothing, the guesses share: x = 4 - y with y guessed 1."""

    class Pair(Component):
        x = var(unit="1")
        y = var(unit="1", start=1.0)
        total = var(unit="1")

        def equations(self):
            yield der(self.x) == 0
            yield der(self.y) == 0
            yield self.total == self.x + self.y

    assert first(Pair(), "x", start={"total": 4.0}) == pytest.approx(3.0, rel=1e-15)
    assert first(Pair(), "y", start={"total": 4.0, "x": 4.0}) == pytest.approx(0.0, abs=1e-15)


# --- values that are not states


def test_a_start_counts_through_gears_and_sprockets():
    shaft, wheel, load = rotational.Inertia(J=1.0), rotational.Sprocket(r=-0.1), Mass(m=3.0)
    model = joined(
        (shaft.flange_b, wheel.flange_R), (wheel.flange_T, load.flange_a), shaft=shaft, wheel=wheel, load=load
    )
    for start in ({"load.s": 0.4, "load.v": -2.0}, {"shaft.phi": -4.0, "shaft.w": 20.0}):
        result = simulate(model, 1.0, points=2, start=start)
        assert result["load.s"][0] == pytest.approx(0.4, rel=1e-15)
        assert result["shaft.w"][0] == pytest.approx(20.0, rel=1e-15)


def test_a_start_counts_through_offsets():
    body, rod, wall = Mass(m=1.0), translational.Rod(L=2.0), translational.Fixed(s0=5.0)
    spring = Spring(c=1.0)
    model = joined(
        (wall.flange, spring.flange_a),
        (spring.flange_b, rod.flange_a),
        (rod.flange_b, body.flange_a),
        body=body,
        rod=rod,
        wall=wall,
        spring=spring,
    )
    assert first(model, "body.s", start={"rod.flange_a.s": 6.0}) == pytest.approx(8.0, rel=1e-15)
    assert first(model, "body.s", start={"spring.s_rel": 0.5}) == pytest.approx(7.5, rel=1e-15)
    assert first(model, "body.s", start={"spring.f": 0.5}) == pytest.approx(7.5, rel=1e-15)


def test_an_acceleration_at_the_start_places_an_oscillator():
    model = held(translational, Mass(m=2.0), spring=Spring(c=50.0))
    assert first(model, "body.s", start={"body.a": -2.5}) == pytest.approx(0.1, rel=1e-14)


def test_an_initial_equation_of_derivatives_finds_the_rest_position():
    """At rest under gravity a spring is stretched by m g/c."""

    class Hanging(Component):
        s = var(unit="m")
        g: Param = param(unit="m/s2", default=9.81)
        m: Param = param(unit="kg", default=2.0)
        c: Param = param(unit="N/m", default=50.0)

        def equations(self):
            yield self.m * der(der(self.s)) == self.m * self.g - self.c * self.s
            yield initial(der(self.s) == 0)
            yield initial(der(der(self.s)) == 0)

    result = simulate(Hanging(), 2.0)
    # It stays: default atol 1e-10 through some tens of steps.
    np.testing.assert_allclose(result["s"], 2.0 * 9.81 / 50.0, rtol=1e-8)
    heavier = simulate(Hanging(), 2.0, parameters={"g": 5.0})
    np.testing.assert_allclose(heavier["s"], 2.0 * 5.0 / 50.0, rtol=1e-8)


def test_a_nonlinear_initial_equation_is_solved_from_the_guess():
    """x^2 = 4 has two roots; the declared guess 1 leads to the positive one."""

    class Root(Decay):
        def conditions(self):
            yield initial(self.x**2 == 4)

    assert first(Root(), "x") == pytest.approx(2.0, rel=1e-14)


class TwoRoots(Component):
    """y^2 + y/10 = 4.2 has the roots 2 and -2.1; the declared guess is the second."""

    x = var(unit="1")
    y = var(unit="1", start=-2.0)

    def equations(self):
        yield self.y**2 + 0.1 * self.y == 4.2 + self.x
        yield der(self.x) == -self.x


def test_an_algebraic_variable_starts_at_the_root_near_its_guess():
    assert first(TwoRoots(), "y") == pytest.approx(-2.1, rel=1e-12)


def test_an_initial_equation_may_speak_of_time_and_parameters():
    class Late(Decay):
        k: Param = param(unit="1", default=2.0)

        def conditions(self):
            yield initial(self.x == self.k * time())

    result = simulate(Late(), times=[3.0, 4.0])
    assert result["x"][0] == pytest.approx(6.0, rel=1e-15)


def test_inputs_at_the_start_count():
    """A massless node between a spring and a force stands where they balance, from the first instant."""
    node, push, wall, spring = (
        translational.PositionSensor(),
        translational.Force(),
        translational.Fixed(),
        Spring(c=4.0),
    )
    model = joined(
        (wall.flange, spring.flange_a),
        (spring.flange_b, push.flange, node.flange),
        node=node,
        push=push,
        wall=wall,
        spring=spring,
    )
    result = simulate(model, 1.0, points=5, inputs={"push.f": lambda t: 2.0 + t})
    np.testing.assert_allclose(result["node.s"], (2.0 + result.time) / 4.0, rtol=1e-14)


# --- contradictions


def test_contradictory_starts_of_the_caller_are_named_with_the_gap():
    model = held(translational, Mass(m=1.0), spring=Spring(c=1.0))
    sentence = "start of `spring.s_rel` misses by 1. In use already: start of `body.s`. Drop one of them."
    with pytest.raises(SolverError, match=re.escape(sentence)):
        simulate(model, 1.0, start={"body.s": 1.0, "spring.s_rel": 2.0})


def test_consistent_starts_of_the_same_thing_are_welcome():
    model = held(translational, Mass(m=1.0), spring=Spring(c=1.0))
    start = {"body.s": 0.5, "spring.s_rel": 0.5, "spring.f": 0.5, "body.flange_b.s": 0.5}
    assert first(model, "body.s", start=start) == 0.5


def test_a_start_of_what_is_constant_is_refused():
    model = held(translational, Mass(m=1.0), spring=Spring(c=1.0))
    with pytest.raises(SolverError, match=re.escape("start of `ground.flange.s` misses by 1")):
        simulate(model, 1.0, start={"ground.flange.s": 1.0})


def test_contradictory_initial_equations_name_both():
    class Torn(Decay):
        def conditions(self):
            yield initial(self.x == 3)
            yield initial(self.x == 4)

    with pytest.raises(
        SolverError,
        match=r"Torn: initial equation 3 for `x` misses by 1. In use already: Torn: initial equation 2 for `x`",
    ):
        simulate(Torn(), 1.0)


def test_contradictory_guesses_are_no_error_and_the_first_counts():
    class Vague(Decay):
        def conditions(self):
            yield initial(self.x == 3, fixed=False)
            yield initial(self.x == 4, fixed=False)

    assert first(Vague(), "x") == pytest.approx(3.0, rel=1e-15)


def test_a_start_of_one_variable_does_not_hide_a_contradiction_elsewhere():
    class Torn(Decay):
        def conditions(self):
            yield initial(self.x == 3)
            yield initial(self.x == 4)

    with pytest.raises(SolverError, match=r"initial equation 3 for `torn\.x` misses by 1"):
        simulate(joined(torn=Torn(), other=Decay()), 1.0, start={"other.x": 2.0})


def test_an_impossible_start_is_refused():
    class Impossible(Decay):
        def conditions(self):
            yield initial(self.x**2 == -4)

    with pytest.raises(SolverError, match=r"Impossible: .* misses by"):
        simulate(Impossible(), 1.0)


def test_a_start_that_is_no_number_is_refused():
    with pytest.raises(SolverError, match="give no finite numbers"):
        simulate(Decay(), 1.0, start={"x": float("nan")})


def test_an_unknown_start_offers_the_nearest_names():
    model = held(translational, Mass(m=1.0), spring=Spring(c=1.0))
    with pytest.raises(ModelError, match=re.escape("Bench has no variable `bdy.s`; did you mean `body.s`")):
        simulate(model, 1.0, start={"bdy.s": 1.0})
