"""Trivial equations disappear, with all derivatives, and what is left moves as before."""

from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library_bench import joined

from cartpend_dae import Component, Param, StructureError, assemble, der, param, signal, simulate, time, var
from cartpend_dae.alias import alias
from cartpend_dae.flatten import flatten
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.rotational import IdealGear, Inertia, Sprocket, Torque

EXACT: dict[str, Any] = {"rtol": 1e-13, "atol": 1e-13}
"""A handful of operations on numbers near 1: rounding only."""


def scalars(equations, *names, **parameters):
    members: dict[str, Any] = {name: var(unit="1") for name in names}
    members |= {name: param(unit="1", default=value) for name, value in parameters.items()}
    members["__annotations__"] = dict.fromkeys(parameters, Param)
    members["equations"] = equations
    return type("Scalars", (Component,), members)()


def run(equations, *names, start=None, stop=1.0, **parameters):
    return simulate(scalars(equations, *names, **parameters), stop, points=5, start=start or {})


# --- one equation at a time: x follows x' = -x from 1, and y is bound to it

TRIVIAL = {
    "y = x": (lambda m: m.y == m.x, 1.0, 0.0),
    "x = y": (lambda m: m.x == m.y, 1.0, 0.0),
    "y = -x": (lambda m: m.y == -m.x, -1.0, 0.0),
    "x + y = 0": (lambda m: m.x + m.y == 0, -1.0, 0.0),
    "y = 2 x": (lambda m: m.y == 2 * m.x, 2.0, 0.0),
    "x = 2 y": (lambda m: m.x == 2 * m.y, 0.5, 0.0),
    "3 y - x/3 = 0": (lambda m: 3 * m.y - m.x / 3 == 0, 1 / 9, 0.0),
    "y = k x": (lambda m: m.y == m.k * m.x, 5.0, 0.0),
    "x = k y": (lambda m: m.x == m.k * m.y, 0.2, 0.0),
    "k y = (k + 1) x": (lambda m: m.k * m.y == (m.k + 1) * m.x, 1.2, 0.0),
    "y = x + 3": (lambda m: m.y == m.x + 3, 1.0, 3.0),
    "y = k - x": (lambda m: m.y == m.k - m.x, -1.0, 5.0),
    "y + (k - k) = x": (lambda m: m.y + (m.k - m.k) == m.x, 1.0, 0.0),
}


@pytest.mark.parametrize("name", TRIVIAL)
def test_a_multiple_of_a_variable_is_eliminated_and_still_available(name):
    statement, factor, offset = TRIVIAL[name]

    def equations(self):
        yield der(self.x) == -self.x
        yield statement(self)
        yield self.z == der(self.y)

    model = scalars(equations, "x", "y", "z", k=5.0)
    system = assemble(model)
    assert len(system.states) == 1
    assert system.algebraics == ()
    result = simulate(model, 1.0, points=5, start={"x": 1.0})
    np.testing.assert_allclose(result["y"], factor * result["x"] + offset, **EXACT)
    np.testing.assert_allclose(result["z"], -factor * result["x"], **EXACT)
    # Default rtol 1e-8, some tens of steps.
    np.testing.assert_allclose(result["x"], np.exp(-result.time), rtol=1e-6)


@pytest.mark.parametrize("name", TRIVIAL)
def test_a_start_value_of_an_eliminated_variable_counts_with_its_factor(name):
    statement, factor, offset = TRIVIAL[name]

    def equations(self):
        yield der(self.x) == -self.x
        yield statement(self)

    result = run(equations, "x", "y", start={"y": 0.7}, k=5.0)
    np.testing.assert_allclose(result["x"][0], (0.7 - offset) / factor, **EXACT)


def test_a_parameter_in_a_factor_stays_free():
    def equations(self):
        yield der(self.x) == -self.x
        yield self.y == self.k * self.x

    model = assemble(scalars(equations, "x", "y", k=5.0))
    for k in (5.0, -2.0):
        result = simulate(model, 1.0, points=3, start={"x": 1.0}, parameters={"k": k})
        np.testing.assert_allclose(result["y"], k * result["x"], **EXACT)


def test_constants_spread_and_their_derivatives_vanish():
    def equations(self):
        yield self.a == 2
        yield self.b == 3 * self.a + self.k
        yield self.c == der(self.b)
        yield self.d + self.b + self.c == 0

    result = run(equations, "a", "b", "c", "d", k=1.0)
    assert assemble(scalars(equations, "a", "b", "c", "d", k=1.0)).remaining == ()
    for name, value in {"a": 2.0, "b": 7.0, "c": 0.0, "d": -7.0}.items():
        assert result[name].tolist() == [value] * 5


def test_a_constant_zero_in_a_sum_makes_an_alias():
    def equations(self):
        yield self.a + self.b + self.c == 0
        yield self.b == 0
        yield der(self.a) == self.c

    system = assemble(scalars(equations, "a", "b", "c"))
    assert len(system.remaining) == 1
    result = run(equations, "a", "b", "c", start={"a": 1.0})
    np.testing.assert_allclose(result["a"], np.exp(-result.time), rtol=1e-6)


def test_a_variable_that_is_the_derivative_of_another_is_its_chain():
    def equations(self):
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.a == -self.s

    system = assemble(scalars(equations, "s", "v", "a"))
    assert system.states == ("s", "v")
    result = run(equations, "s", "v", "a", start={"s": 1.0}, stop=3.0)
    np.testing.assert_allclose(result["v"], -np.sin(result.time), atol=1e-6)


def test_what_varies_with_time_or_input_is_no_alias():
    class Scaled(Component):
        u = signal("in", unit="1")
        x = var(unit="1")
        y = var(unit="1")

        def equations(self):
            yield self.x == self.u
            yield self.y == (1 + time()) * self.x

    system = assemble(Scaled())
    assert system.eliminated == ("x = u",)
    result = simulate(Scaled(), 1.0, points=3, inputs={"u": lambda t: t})
    np.testing.assert_allclose(result["y"], (1 + result.time) * result.time, **EXACT)


def test_inputs_are_never_eliminated():
    class Through(Component):
        u = signal("in", unit="1")
        y = signal("out", unit="1")

        def equations(self):
            yield self.u == -2 * self.y

    assert assemble(Through()).inputs == ("u",)
    assert simulate(Through(), 1.0, points=2, inputs={"u": 3.0})["y"].tolist() == [-1.5, -1.5]


# --- redundant and contradictory constraints


def test_contradicting_constants_are_named_with_the_numbers():
    def equations(self):
        yield self.a == self.b
        yield self.b == self.a + 1

    with pytest.raises(StructureError, match=r"Scalars: equation 2 contradicts the other equations: .* reads -?1 = 0"):
        assemble(scalars(equations, "a", "b"))


def test_two_walls_at_different_places_joined_rigidly_contradict():
    left, right = translational.Fixed(s0=0.0), translational.Fixed(s0=0.5)
    with pytest.raises(StructureError, match=r"contradicts .* reads -?0.5 = 0. Two constraints fix the same"):
        assemble(joined((left.flange, right.flange), left=left, right=right))


def test_a_constraint_given_twice_leaves_its_force_undetermined():
    left, right = translational.Fixed(), translational.Fixed()
    model = joined((left.flange, right.flange), left=left, right=right)
    assert len(alias(flatten(model)).redundant) == 1
    with pytest.raises(
        StructureError, match=r"structurally singular\. Likely cause: .* No equation gives: `(left|right).flange.f`"
    ):
        assemble(model)


def test_a_constraint_given_twice_is_named():
    left, right = translational.Fixed(), translational.Fixed()
    with pytest.raises(StructureError, match=r"twice .*: `left` \(Fixed\), `right` \(Fixed\) hold the same position"):
        assemble(joined((left.flange, right.flange), left=left, right=right))


def test_decimal_factors_that_agree_to_rounding_are_the_same_constraint():
    def equations(self):
        yield self.a == 0.1 * self.b
        yield self.b == 3 * self.c
        yield self.a == 0.3 * self.c

    aliased = alias(flatten(scalars(equations, "a", "b", "c")))
    assert len(aliased.redundant) == 1


# --- chains joined through derivatives


def test_rigidly_joined_masses_are_one_mass():
    masses = [translational.Mass(m=float(m)) for m in (1, 2, 3, 4)]
    push = translational.Force()
    joints = [(a.flange_b, b.flange_a) for a, b in pairwise(masses)]
    model = joined(*joints, (push.flange, masses[0].flange_a), push=push, **{f"m{i}": m for i, m in enumerate(masses)})
    assert len(assemble(model).states) == 2
    result = simulate(model, 1.0, points=3, inputs={"push.f": 20.0})
    for i, passed in enumerate((20.0, 18.0, 14.0, 8.0)):
        np.testing.assert_allclose(result[f"m{i}.a"], 2.0, **EXACT)
        np.testing.assert_allclose(result[f"m{i}.flange_a.f"], passed, **EXACT)


def test_a_sprocket_turns_inertia_to_mass():
    """A mass m on a chain of radius r is the inertia m r^2 at the shaft, and J/r^2 the mass on the chain."""
    shaft, wheel, load = Inertia(J=0.02), Sprocket(r=-0.1), translational.Mass(m=3.0)
    torque = Torque()
    model = joined(
        (torque.flange, shaft.flange_a),
        (shaft.flange_b, wheel.flange_R),
        (wheel.flange_T, load.flange_a),
        torque=torque,
        shaft=shaft,
        wheel=wheel,
        load=load,
    )
    assert len(assemble(model).states) == 2
    result = simulate(model, 1.0, points=3, inputs={"torque.tau": 0.25}, start={"load.s": 0.4})
    np.testing.assert_allclose(result["shaft.a"], 0.25 / (0.02 + 3.0 * 0.1**2), **EXACT)
    np.testing.assert_allclose(result["load.v"], -0.1 * result["shaft.w"], **EXACT)
    np.testing.assert_allclose(result["load.s"], -0.1 * result["shaft.phi"], **EXACT)
    np.testing.assert_allclose(result["load.s"][0], 0.4, **EXACT)


def locked_gear():
    a, b, gear, torque = Inertia(J=1.0), Inertia(J=2.0), IdealGear(ratio=0.0), Torque()
    model = joined(
        (torque.flange, a.flange_a),
        (a.flange_b, gear.flange_a),
        (gear.flange_b, b.flange_a),
        torque=torque,
        a=a,
        b=b,
        gear=gear,
    )
    return simulate(model, 1.0, points=3, inputs={"torque.tau": 2.0}, start={"b.w": 3.0})


def test_a_gear_of_ratio_zero_locks_one_shaft_and_frees_the_other():
    result = locked_gear()
    assert result["a.a"].tolist() == [0, 0, 0]
    np.testing.assert_allclose(result["b.w"], 3.0, **EXACT)


def test_a_gear_of_ratio_zero_carries_the_torque_that_locks_it():
    np.testing.assert_allclose(locked_gear()["gear.flange_a.tau"], 2.0, **EXACT)


def test_the_ratio_of_a_gear_can_be_changed_after_assembly():
    a, b, gear = Inertia(J=1.0), Inertia(J=2.0), IdealGear(ratio=3.0)
    system = assemble(joined((a.flange_b, gear.flange_a), (gear.flange_b, b.flange_a), a=a, b=b, gear=gear))
    for ratio in (3.0, -0.5):
        result = simulate(system, 1.0, points=2, start={"a.w": 6.0}, parameters={"gear.ratio": ratio})
        np.testing.assert_allclose(result["b.w"], 6.0 / ratio, **EXACT)


ratios = st.fractions(Fraction(-4), Fraction(4), max_denominator=7).filter(lambda r: abs(r) >= Fraction(1, 7))


@st.composite
def trees(draw):
    """Random trees of inertias: each with its parent, the ratio of the gear to it (or none), and how it stands."""
    n = draw(st.integers(1, 7))
    links = [(draw(st.integers(0, i - 1)), draw(st.none() | ratios), draw(st.booleans())) for i in range(1, n)]
    inertias = [draw(st.integers(1, 9)) for _ in range(n)]
    return inertias, links, draw(st.integers(0, n - 1))


@settings(max_examples=40)
@given(trees())
def test_any_rigid_network_of_inertias_is_one_inertia_reflected_through_its_gears(tree):
    """Torque tau at shaft k: acceleration tau / sum(J_i (w_i/w_k)^2), with exact fractions as the reference."""
    inertias, links, driven = tree
    shafts = [Inertia(J=float(J)) for J in inertias]
    torque = Torque()
    speeds = [Fraction(1)]
    joints = [(torque.flange, shafts[driven].flange_b)]
    parts: dict[str, Component] = {"torque": torque}
    for i, (parent, ratio, towards) in enumerate(links, start=1):
        if ratio is None:
            joints.append((shafts[parent].flange_b, shafts[i].flange_a))
            speeds.append(speeds[parent])
            continue
        gear = parts[f"gear{i}"] = IdealGear(ratio=float(ratio))
        ends = (gear.flange_a, gear.flange_b) if towards else (gear.flange_b, gear.flange_a)
        joints += [(shafts[parent].flange_b, ends[0]), (ends[1], shafts[i].flange_a)]
        speeds.append(speeds[parent] / ratio if towards else speeds[parent] * ratio)
    model = joined(*joints, **parts, **{f"shaft{i}": shaft for i, shaft in enumerate(shafts)})
    assert len(assemble(model).states) == 2
    result = simulate(model, times=[0.0, 1e-3], inputs={"torque.tau": 1.0}, method="rk4", step=1e-3)
    relative = [w / speeds[driven] for w in speeds]
    reflected = sum(J * r**2 for J, r in zip(inertias, relative, strict=True))
    for i, r in enumerate(relative):
        # At most six gears, some hundred operations without cancellation: rounding only.
        np.testing.assert_allclose(result[f"shaft{i}.a"], float(r / reflected), rtol=1e-12)


def test_a_rotational_and_a_translational_chain_share_one_state_pair():
    """Motor, gear, pinion, rack, cart: the inertial mass of a drive from its geometry alone."""
    rotor, gear, pinion, cart = Inertia(J=2e-5), IdealGear(ratio=12.5), Sprocket(r=0.02), translational.Mass(m=1.5)
    push = translational.Force()
    model = joined(
        (rotor.flange_b, gear.flange_a),
        (gear.flange_b, pinion.flange_R),
        (pinion.flange_T, cart.flange_a),
        (push.flange, cart.flange_b),
        rotor=rotor,
        gear=gear,
        pinion=pinion,
        cart=cart,
        push=push,
    )
    assert len(assemble(model).states) == 2
    result = simulate(model, 1.0, points=2, inputs={"push.f": 1.0})
    np.testing.assert_allclose(1 / result["cart.a"], 1.5 + 2e-5 * (12.5 / 0.02) ** 2, **EXACT)


def test_all_of_a_rotation_is_available_when_only_two_states_are_left():
    a, b, gear = Inertia(J=1.0), Inertia(J=2.0), IdealGear(ratio=3.0)
    spring, wall = rotational.Spring(c=18.0 + 2.0), rotational.Fixed()
    model = joined(
        (wall.flange, spring.flange_a),
        (spring.flange_b, b.flange_b),
        (a.flange_b, gear.flange_a),
        (gear.flange_b, b.flange_a),
        wall=wall,
        spring=spring,
        a=a,
        b=b,
        gear=gear,
    )
    w = np.sqrt(20.0 / (2.0 + 9.0 * 1.0))
    result = simulate(model, 5.0, points=21, start={"a.phi": 0.6}, rtol=1e-10, atol=1e-12)
    # Tolerance 1e-10 over a few hundred steps.
    np.testing.assert_allclose(result["b.phi"], 0.2 * np.cos(w * result.time), atol=1e-7)
    np.testing.assert_allclose(result["a.a"], -0.6 * w**2 * np.cos(w * result.time), atol=1e-6)
