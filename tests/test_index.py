"""Constraints are differentiated, and of what they tie together those variables become states that a model wants."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from library_bench import CLOSE, joined
from scipy.special import ellipj, ellipk

from cartpend_dae import Component, StructureError, assemble, der, initial, simulate, var
from cartpend_dae.library import rotational as r
from cartpend_dae.library import rotational_parts as rp
from cartpend_dae.library import rotational_sources as rs
from cartpend_dae.library import signals as s
from cartpend_dae.library import translational as t
from cartpend_dae.quantities import StateSelect


def scalars(equations, **hints: StateSelect):
    """A component of variables without unit; each name says how gladly it is a state."""
    members: dict[str, Any] = {name: var(unit="1", state_select=hint) for name, hint in hints.items()}
    return type("Scalars", (Component,), members | {"equations": equations})()


def three_on_a_line(self):
    """Points x1 + x2 + 2 x3 = 1 with masses 1, 2, 3 and springs to the origin, held together by the force f."""
    for k, (x, v) in enumerate(((self.x1, self.v1), (self.x2, self.v2), (self.x3, self.v3)), start=1):
        yield der(x) == v
        yield k * der(v) == -k * (k + 1) * x + (2 if k == 3 else 1) * self.f
    yield self.x1 + self.x2 + 2 * self.x3 == 1
    yield initial(self.x1 == 0.7)
    yield initial(self.x2 == -0.4)
    yield initial(self.v1 == 0.3)
    yield initial(self.v2 == 0.1)


NAMES = ("x1", "v1", "x2", "v2", "x3", "v3", "f")


def points(**hints: StateSelect):
    return scalars(three_on_a_line, **(dict.fromkeys(NAMES, "default") | hints))


def least_squares_motion(times):
    """The same in two minimal coordinates that are none of the three: a basis of the null space of (1, 1, 2)."""
    n = np.array([1.0, 1.0, 2.0])
    basis = np.linalg.svd(n[None])[2][1:].T
    M, K = np.diag([1.0, 2.0, 3.0]), np.diag([2.0, 6.0, 12.0])
    offset = n / (n @ n)
    m, k, force = basis.T @ M @ basis, basis.T @ K @ basis, -basis.T @ K @ offset
    rest = np.linalg.solve(k, force)
    values, modes = np.linalg.eig(np.linalg.solve(m, k))
    w = np.sqrt(values)
    x0 = np.array([0.7, -0.4, (1 - 0.7 + 0.4) / 2])
    v0 = np.array([0.3, 0.1, -0.2])
    a = np.linalg.solve(modes, basis.T @ (x0 - offset) - rest)
    b = np.linalg.solve(modes, basis.T @ v0) / w
    q = rest[:, None] + modes @ (a[:, None] * np.cos(np.outer(w, times)) + b[:, None] * np.sin(np.outer(w, times)))
    return offset[:, None] + basis @ q


@pytest.mark.parametrize(
    ("hints", "rejected"),
    [
        ({"x1": "avoid", "v1": "avoid"}, 1),
        ({"x2": "never", "v2": "never"}, 2),
        ({"x3": "avoid"}, 3),
        ({"v2": "avoid"}, 2),
        ({"x1": "prefer", "x2": "prefer"}, 3),
        ({"v2": "prefer", "v3": "prefer"}, 1),
        ({"x1": "always", "x3": "always"}, 2),
        ({"x1": "always", "v1": "always", "x2": "never", "x3": "prefer"}, 2),
        ({"x1": "avoid", "v1": "avoid", "x2": "never", "x3": "always"}, 2),
    ],
)
def test_hints_choose_the_states_and_nothing_else(hints, rejected):
    system = assemble(points(**hints))
    assert set(system.states) == {f"{kind}{k}" for kind in "xv" for k in (1, 2, 3) if k != rejected}
    assert dict(system.dummies).keys() == {f"x{rejected}", f"v{rejected}"}
    assert system.differentiated == (("Scalars: equation 7", 2),)
    result = simulate(system, 10.0, points=101, rtol=1e-9)
    # Local errors of 1e-9 over a few hundred steps.
    for name, exact in zip(("x1", "x2", "x3"), least_squares_motion(result.time), strict=True):
        np.testing.assert_allclose(result[name], exact, atol=CLOSE, err_msg=name)


def test_without_hints_it_moves_in_the_same_way():
    result = simulate(points(), 10.0, points=101, rtol=1e-9)
    np.testing.assert_allclose(result["x2"], least_squares_motion(result.time)[1], atol=CLOSE)


def test_a_variable_that_is_always_a_state_is_differentiated_for_it():
    """y = x1 - x2 stands in no derivative; two free decays in its terms."""

    def equations(self):
        yield der(self.x1) == -self.x1
        yield der(self.x2) == -3 * self.x2
        yield self.y == self.x1 - self.x2
        yield initial(self.x1 == 1)
        yield initial(self.x2 == 0.5)

    system = assemble(scalars(equations, x1="default", x2="default", y="always"))
    assert "y" in system.states
    assert len(system.states) == 2
    result = simulate(system, 2.0, points=11)
    np.testing.assert_allclose(result["y"], np.exp(-result.time) - 0.5 * np.exp(-3 * result.time), atol=CLOSE)


@pytest.mark.parametrize("wanted", ["w", "v", "x"])
def test_the_wanted_one_of_equal_variables_gives_its_name_to_the_state(wanted):
    def equations(self):
        yield self.x == 2 * self.v
        yield self.w == -self.v
        yield der(self.v) == -self.v

    hints: dict[str, StateSelect] = dict.fromkeys("xvw", "default")
    assert assemble(scalars(equations, **(hints | {wanted: "prefer"}))).states == (wanted,)
    assert assemble(scalars(equations, **(hints | {"v": "avoid", wanted: "always"}))).states == (wanted,)


def sentence_of(equations, **hints: StateSelect) -> str:
    with pytest.raises(StructureError) as caught:
        assemble(scalars(equations, **hints))
    return str(caught.value)


def test_always_is_refused_where_a_constraint_gives_one_of_its_variables():
    hints: dict[str, StateSelect] = dict.fromkeys(("x1", "x2", "x3"), "always")
    text = sentence_of(three_on_a_line, **(dict.fromkeys(NAMES, "default") | hints))
    assert 'declared `state_select="always"` cannot be a state: `x3`, because Scalars: equation 7 gives it' in text


def test_always_is_refused_for_what_is_constant_or_follows_from_time():
    def equations(self):
        yield self.c == 3
        yield der(self.x) == -self.x

    assert "`c`, because it is constant" in sentence_of(equations, c="always", x="default")

    def forced(self):
        yield self.c == ca.sin(self.x) * self.x
        yield self.x * self.x * self.x == 8 + self.x

    text = sentence_of(forced, c="always", x="default")
    assert "`c`, because" in text


def test_never_is_refused_where_nothing_else_gives_the_variable():
    def equations(self):
        yield der(self.x) == -self.x + self.y
        yield der(self.y) == -self.y

    text = sentence_of(equations, x="never", y="never")
    assert 'declared `state_select="never"` remains a state: `x`, because no constraint' in text
    assert "`y`, because no constraint" in text


def pendulum(self):
    """A unit mass on a unit rod, from a right angle."""
    yield der(self.x) == self.u
    yield der(self.y) == self.v
    yield der(self.u) == -self.f * self.x
    yield der(self.v) == -self.f * self.y - 9.81
    yield self.x**2 + self.y**2 == 1
    yield initial(self.x == 1)
    yield initial(self.v == 0)


def test_never_is_refused_where_the_coefficients_change_along_the_motion():
    text = sentence_of(pendulum, x="never", y="default", u="default", v="default", f="default")
    assert "`x`, because the only constraints that hold it" in text
    assert "change along the motion" in text


def test_always_and_never_for_one_variable_contradict_each_other():
    def equations(self):
        yield self.x == -2 * self.y
        yield der(self.y) == -self.y

    text = sentence_of(equations, x="always", y="never")
    assert "`x` must always and `y` never be a state, but they are one but for a factor" in text


def test_another_word_is_refused():
    with pytest.raises(ValueError, match=r"`state_select` of a variable is one of `never`, .*, not 'often'\."):
        var(unit="1", state_select="often")  # type: ignore[arg-type]


# --- high index


@pytest.mark.slow
def test_a_pendulum_in_cartesian_coordinates_keeps_its_length_for_a_thousand_seconds():
    """Nothing may choose x or y as the state for ever; both are, and the length is kept."""
    names: dict[str, StateSelect] = dict.fromkeys(("x", "y", "u", "v", "f"), "default")
    system = assemble(scalars(pendulum, **names))
    assert system.invariants.numel() == 2
    result = simulate(system, 1000.0, points=10001, rtol=1e-8)
    np.testing.assert_allclose(np.hypot(result["x"], result["y"]), 1.0, rtol=0, atol=1e-6)
    energy = (result["u"] ** 2 + result["v"] ** 2) / 2 + 9.81 * result["y"]
    # from a right angle it is 0; two hundred thousand steps with errors of 1e-8
    np.testing.assert_allclose(energy, 0.0, atol=2e-2)


def test_a_pendulum_in_cartesian_coordinates_is_jacobis_elliptic_function():
    names: dict[str, StateSelect] = dict.fromkeys(("x", "y", "u", "v", "f"), "default")
    result = simulate(scalars(pendulum, **names), 5.0, points=101, rtol=1e-10, atol=1e-12)
    k = np.sin(np.pi / 4)
    sine = k * ellipj(np.sqrt(9.81) * result.time + ellipk(k**2), k**2)[0]  # of half the angle
    np.testing.assert_allclose(result["y"], 2 * sine**2 - 1, atol=CLOSE)


def test_a_planetary_gear_between_three_inertias_has_two_degrees_of_freedom():
    gear, sun, carrier, ring = rp.IdealPlanetary(ratio=2.0), r.Inertia(J=0.1), r.Inertia(J=1.0), r.Inertia(J=0.5)
    push = r.Torque()
    joints = [(push.flange, sun.flange_a), (sun.flange_b, gear.sun)]
    joints += [(gear.carrier, carrier.flange_a), (gear.ring, ring.flange_a)]
    model = joined(*joints, gear=gear, sun=sun, carrier=carrier, ring=ring, push=push)
    system = assemble(model)
    assert len(system.states) == 4
    assert system.algebraics == ()
    result = simulate(system, 2.0, points=5, inputs={"push.tau": 1.0})
    # accelerations from the constraint 3 w_c = w_s + 2 w_r and one torque in the gear
    J, n = np.diag([0.1, 1.0, 0.5]), np.array([1.0, -3.0, 2.0])
    a = np.linalg.solve(np.block([[J, -n[:, None]], [n[None], np.zeros((1, 1))]]), [1.0, 0.0, 0.0, 0.0])[:3]
    for name, expected in zip(("sun", "carrier", "ring"), a, strict=True):
        np.testing.assert_allclose(result[f"{name}.w"], expected * result.time, atol=CLOSE)


def two_shafts(**more: Component):
    one, two, spring = r.Inertia(J=1.0), r.Inertia(J=2.0), r.SpringDamper(c=20.0, d=0.5)
    joints = [(one.flange_b, spring.flange_a), (spring.flange_b, two.flange_a)]
    joints += [(one.flange_b, part.flange_a) for part in more.values()]  # type: ignore[attr-defined]
    joints += [(part.flange_b, two.flange_a) for part in more.values()]  # type: ignore[attr-defined]
    return joined(*joints, one=one, two=two, spring=spring, **more)


def test_relative_states_are_states_and_change_nothing():
    plain, asked = assemble(two_shafts()), assemble(two_shafts(relative=rp.RelativeStates()))
    assert {"relative.phi_rel", "relative.w_rel"} < set(asked.states)
    assert len(asked.states) == len(plain.states) == 4
    start = {"one.phi": 0.0, "one.w": 1.0, "two.phi": 0.5, "two.w": 0.0}
    runs = [simulate(system, 10.0, points=101, start=start, rtol=1e-10) for system in (plain, asked)]
    for name in ("one.phi", "two.phi", "spring.tau", "one.w"):
        np.testing.assert_allclose(runs[0][name], runs[1][name], atol=CLOSE)


def test_a_shaft_driven_at_an_exact_speed_through_gear_and_rack_has_only_its_angle_as_state():
    source, wave, gear, wheel, cart = (
        rs.Speed(exact=True),
        s.Sine(amplitude=2.0, f=0.5),
        r.IdealGear(ratio=4.0),
        r.Sprocket(r=0.1),
        t.Mass(m=3.0),
    )
    joints = [(wave.y, source.w_ref), (source.flange, gear.flange_a), (gear.flange_b, wheel.flange_R)]
    joints += [(wheel.flange_T, cart.flange_a)]
    system = assemble(joined(*joints, source=source, wave=wave, gear=gear, wheel=wheel, cart=cart))
    assert len(system.states) == 1
    result = simulate(system, 2.0, points=41)
    v = 2.0 / 4.0 * 0.1 * np.sin(np.pi * result.time)
    np.testing.assert_allclose(result["cart.v"], v, atol=1e-12)
    a = 2.0 / 4.0 * 0.1 * np.pi * np.cos(np.pi * result.time)
    np.testing.assert_allclose(result["source.flange.tau"], -3.0 * a * 0.1 / 4.0, atol=1e-11)
