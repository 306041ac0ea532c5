"""Units of equations: what is consistent passes, and what is not is named with both its dimensions."""

import re
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Any

import casadi as ca
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from test_library_balance import COMPONENTS, label, make

from cartpend_dae import Component, ModelError, Param, connect, der, dry_friction, initial, param, signal, time, var
from cartpend_dae.dimensions import check_dimensions
from cartpend_dae.flatten import flatten
from cartpend_dae.library import signals
from cartpend_dae.library.rotational import Inertia
from cartpend_dae.library.translational import Fixed, Force, Mass, PositionSensor, SpeedSensor
from cartpend_dae.study import load_model
from cartpend_dae.study_schema import ModelReference
from cartpend_dae.units import BASE_UNITS, divide, multiply, parse, power

MODELS = sorted((Path(__file__).resolve().parent.parent / "models").glob("*.py"))


def findings(model: Component) -> list[str]:
    """The findings of a model that is not consistent, one a line."""
    with pytest.raises(ModelError, match="is not consistent in its units:\n") as caught:
        check_dimensions(flatten(model))
    return [line.removeprefix("  - ") for line in str(caught.value).splitlines()[1:]]


def only_finding(model: Component) -> str:
    (finding,) = findings(model)
    return finding


# What we ship


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_models_are_consistent(path):
    check_dimensions(flatten(load_model(ModelReference(path=path))))


def test_the_position_loop_is_consistent_though_its_blocks_carry_metres_and_volts():
    path = next(path for path in MODELS if path.stem == "emps")
    check_dimensions(flatten(load_model(ModelReference(path=path, arguments={"controlled": True}))))


@pytest.mark.parametrize("value", [0.5, 0.0])
@pytest.mark.parametrize("cls", COMPONENTS, ids=label)
def test_library_is_consistent(cls, value):
    check_dimensions(flatten(make(cls, value)))


# The published slip


class Reflected(Component):
    """Mass and damping of a cart with its drive: the study's LinearDamp, reflected by the power of `reflection`."""

    reflection: float
    v = var(unit="m/s")
    m = var(unit="kg")
    d = var(unit="N.s/m")
    m_c: Param = param(unit="kg", default=4.609)
    b: Param = param(unit="N.s/m", default=48.0)
    r_1: Param = param(unit="m", default=0.0164)
    r_2: Param = param(unit="m", default=0.0252)
    r_3: Param = param(unit="m", default=0.0181)
    I_1: Param = param(unit="kg.m2", default=3.698e-6)
    I_s: Param = param(unit="kg.m2", default=5.687e-4)
    I_3: Param = param(unit="kg.m2", default=4.406e-6)
    J: Param = param(unit="kg.m2", default=3.39e-4)
    c: Param = param(unit="N.m.s/rad", default=2.8e-6)

    def equations(self):
        ratio = self.r_2 / (self.r_1 * self.r_3)
        n = self.reflection
        yield self.m == self.m_c + 2 * (self.I_1 + self.I_s) / self.r_1**n + (2 * self.I_3 + self.J) * ratio**n
        yield self.d == self.c * ratio**n + self.b
        yield self.m * der(self.v) + self.d * self.v == 0


def test_the_published_reflection_without_squares_is_refused():
    """Inertias reflected by r instead of r^2 give kg.m, and dampings N.s: neither is a mass or a damping."""

    class Rig(Component):
        def __post_init__(self):
            self.cart = Reflected(reflection=1)

    mass, damping = findings(Rig())
    assert mass.startswith("cart: equation 1 (Reflected): ")
    assert "`cart.m_c` is in `kg`, but" in mass and mass.endswith("in `kg.m`.")
    assert "cart.I_1" in mass and "cart.r_1" in mass
    assert damping.startswith("cart: equation 2 (Reflected): ")
    assert "in `kg.m/s`, but `cart.b` in `N.s/m`" in damping


def test_the_reflection_with_squares_is_accepted():
    check_dimensions(flatten(Reflected(reflection=2)))


def test_the_slip_is_refused_where_a_parameter_is_set():
    class Rig(Component):
        r_1: Param = param(unit="m", default=0.0164)
        I_s: Param = param(unit="kg.m2", default=5.687e-4)

        def __post_init__(self):
            self.mass = Mass(m=self.I_s / self.r_1)
            self.wheel = Inertia(J=self.mass.m * self.r_1**2)

    finding = only_finding(Rig())
    assert finding == "what `mass.m` is set to: `mass.m` is in `kg`, but `(I_s/r_1)` in `kg.m`."


# Rules


class Pool(Component):
    """One equation, `y` in m, of parameters in the base units, an angle and a number."""

    y = var(unit="m")
    kg: Param = param(unit="kg", default=2.0)
    m: Param = param(unit="m", default=3.0)
    s: Param = param(unit="s", default=5.0)
    A: Param = param(unit="A", default=7.0)
    K: Param = param(unit="K", default=11.0)
    cd: Param = param(unit="cd", default=17.0)
    phi: Param = param(unit="rad", default=0.3)
    n: Param = param(unit="1", default=13.0)

    law: Callable[[Any], ca.SX]

    def equations(self):
        yield self.y == self.law(self)


ACCEPTED = {
    "a literal in a sum": lambda p: p.m + 0.1,
    "a literal factor": lambda p: 2 * p.m / 3,
    "a literal limit": lambda p: ca.fmin(ca.fmax(p.m, 0), 1),
    "a limit": lambda p: ca.fmin(p.m, p.m * p.n),
    "an angle is a number": lambda p: p.m * (ca.sin(p.phi + p.n) + p.phi),
    "a root": lambda p: ca.sqrt(p.m**2 + p.y**2) + ca.hypot(p.m, p.y),
    "a fractional power": lambda p: (p.m**1.5) ** (2 / 3) + p.m**0.5 * p.y**0.5,
    "a power of numbers": lambda p: p.m * (p.y / p.m) ** p.n,
    "a literal to a power": lambda p: p.m * 2**p.n,
    "an angle between lengths": lambda p: p.m * ca.atan2(p.y, p.m),
    "a choice": lambda p: ca.if_else(time() > p.s, p.m, 2 * p.y),
    "a choice of a literal": lambda p: ca.if_else(time() > 2, 0.3, p.m),
    "a condition of two": lambda p: ca.if_else(ca.logic_and(p.s > 1, p.kg < 2), p.m, 0),
    "signs and sizes": lambda p: p.m * ca.sign(p.kg) + ca.fabs(p.y) + ca.floor(p.m),
    "a decay": lambda p: p.m * ca.exp(-time() / p.s) * ca.tanh(p.y / p.m) + ca.copysign(p.m, p.kg),
    "a reciprocal": lambda p: 1 / (1 / p.m) + p.m * p.s / p.s,
    "a derivative": lambda p: p.s * der(p.y) + p.s**2 * der(der(p.y)),
    "a derivative of a product": lambda p: der(p.y**2) * p.s / p.m,
    "a rest": lambda p: ca.fmod(p.y, p.m),
}


@pytest.mark.parametrize("law", ACCEPTED.values(), ids=ACCEPTED)
def test_consistent_equation_is_accepted(law):
    check_dimensions(flatten(Pool(law=law)))


REFUSED = {
    "m + s": (lambda p: p.m + p.s, "`m` is in `m`, but `s` in `s`"),
    "side": (lambda p: p.kg * p.m, "`y` is in `m`, but `(kg*m)` in `kg.m`"),
    "literal sum": (lambda p: p.s + 0.1, "`y` is in `m`, but `(s+0.1)` in `s`"),
    "sin": (lambda p: p.m * ca.sin(p.s), "`s` is in `s`, where a number or an angle is needed: `sin(s)`"),
    "exp": (lambda p: p.m * ca.exp(-p.m), "`(-m)` is in `m`, where a number"),
    "root": (lambda p: ca.sqrt(p.m * p.s), "`sqrt((m*s))` in `m^(1/2).s^(1/2)`"),
    "square": (lambda p: p.m**2, "`sq(m)` in `m2`"),
    "fraction": (lambda p: p.m**1.5, "in `m^(3/2)`"),
    "exponent": (lambda p: p.m * p.n**p.s, "where a number or an angle is needed: `pow(n,s)`"),
    "comparison": (lambda p: ca.if_else(time() > p.m, p.m, 0), "`time` in `s`"),
    "limit": (lambda p: ca.fmax(p.m, p.K), "`m` is in `m`, but `K` in `K`"),
    "choice": (lambda p: ca.if_else(p.s > 1, p.m, p.A), "in `A`"),
    "atan2": (lambda p: p.m * ca.atan2(p.m, p.s), "`m` is in `m`, but `s` in `s`"),
    "derivative": (lambda p: der(p.y), "`y` is in `m`, but `der(y)` in `m/s`"),
    "second": (lambda p: der(der(p.y)), "`der(der(y))` in `m/s2`"),
    "time": (lambda p: p.m * time(), "`(m*time)` in `m.s`"),
    "sign": (lambda p: ca.sign(p.m), "`sign(m)` a number or an angle"),
}


@pytest.mark.parametrize(("law", "words"), REFUSED.values(), ids=REFUSED)
def test_inconsistent_equation_is_refused_with_both_dimensions(law, words):
    finding = only_finding(Pool(law=law))
    assert finding.startswith("Pool: equation 1: ")
    assert words in finding


def test_all_findings_are_told_at_once_each_once():
    class Two(Component):
        def __post_init__(self):
            self.one = Pool(law=lambda p: (p.m + p.s) * ca.sin(p.kg))
            self.two = Pool(law=lambda p: p.m + p.K + p.A * p.m / p.A)

    one, other, two = findings(Two())
    assert "one: equation 1 (Pool)" in one and "sin(one.kg)" in one
    assert "`one.m` is in `m`, but `one.s` in `s`" in other
    assert "`two.m` is in `m`, but `two.K` in `K`" in two


def test_long_expressions_are_cut():
    finding = only_finding(Pool(law=lambda p: reduce(ca.SX.__add__, [p.s * (p.n + i) for i in range(90)])))
    assert len(finding) < 300
    assert " ...` in `s`" in finding


def test_initial_equations_are_checked():
    class Started(Component):
        def __post_init__(self):
            self.mass = Mass(m=1.0)

        def equations(self):
            yield initial(self.mass.s == 0.1)
            yield initial(self.mass.v == self.mass.s)

    assert only_finding(Started()) == (
        "Started: initial equation 2 for `mass.s`, `mass.v`: `mass.v` is in `m/s`, but `mass.s` in `m`."
    )


@pytest.mark.parametrize(
    ("unit_v", "unit_f", "words"),
    [
        ("m/s", "N", None),
        ("rad/s", "N.m", None),
        ("m", "N", "`(slide.v*slide.level)` in `N.m`"),
        ("m/s", "N.m", "`power` is in `W`"),
    ],
)
def test_dry_friction_takes_a_speed_and_a_level_that_give_a_power(unit_v, unit_f, words):
    class Slide(Component):
        v = var(unit=unit_v)
        f = var(unit=unit_f)
        level: Param = param(unit=unit_f, default=1.0)

        def equations(self):
            yield self.v == 0
            yield self.f == dry_friction(self.v, self.level, 2 * self.level)

    class Model(Component):
        def __post_init__(self):
            self.slide = Slide()

    if words is None:
        check_dimensions(flatten(Model()))
    else:
        finding = only_finding(Model())
        assert finding.startswith("slide: dry friction (Slide): ") and words in finding


def test_a_friction_force_has_the_unit_of_its_level():
    class Slide(Component):
        v = var(unit="m/s")
        f = var(unit="N.s/m")
        level: Param = param(unit="N", default=1.0)

        def equations(self):
            yield self.v == 0
            yield self.f == dry_friction(self.v, self.level)

    assert "`Slide.dry_friction` takes `N` from Slide: dry friction" in only_finding(Slide())


@pytest.mark.parametrize(("unit", "other"), [("mm", "m"), ("deg", "rad"), ("degC", "K"), ("rpm", "rad/s"), ("uH", "H")])
def test_a_scaled_unit_inside_a_model_is_refused(unit, other):
    class Scaled(Component):
        x: Param = param(unit=unit, default=1.0)

    finding = only_finding(Scaled())
    assert f"`x` is declared in `{unit}`" in finding
    (written,) = re.findall("declare it in `(.*?)`", finding)
    assert parse(written) == parse(other)


def test_a_unit_that_does_not_exist_is_named_with_its_quantity():
    class Odd(Component):
        x: Param = param(unit="Nm", default=1.0)

    assert "`x`: The unit `Nm` cannot be read: `Nm` is not a known unit. Did you mean `N.m`?" in only_finding(Odd())


# Blocks


class Loop(Component):
    """A mass under a controller: force = gain (position - feedback)."""

    def __post_init__(self):
        self.mass, self.force = Mass(m=1.0), Force()
        self.position, self.speed = PositionSensor(), SpeedSensor()
        self.error, self.gain = signals.Feedback(), signals.Gain(k=2.0)

    def equations(self):
        yield connect(self.force.flange, self.position.flange, self.speed.flange, self.mass.flange_a)
        yield connect(self.position.s, self.error.u1)
        yield connect(self.error.y, self.gain.u)
        yield connect(self.gain.y, self.force.f)


def test_blocks_carry_any_unit():
    check_dimensions(flatten(Loop()))


def test_two_quantities_that_meet_in_a_block_are_compared():
    class Wrong(Loop):
        def equations(self):
            yield from super().equations()
            yield connect(self.speed.v, self.error.u2)

    finding = only_finding(Wrong())
    assert finding.startswith("error: equation 1 (Feedback): ")
    assert "in `m`" in finding and "in `m/s`" in finding
    assert "`error.u1` takes `m` from connection of error.u1, position.s" in finding
    assert "`error.u2` takes `m/s` from connection of error.u2, speed.v" in finding


def test_a_derivative_of_a_signal_has_its_unit_per_second():
    class Filtered(Loop):
        def __post_init__(self):
            super().__post_init__()
            self.lag = signals.FirstOrder(T=0.1)
            self.rate = Pool(law=lambda p: p.m + der(self.lag.y))

        def equations(self):
            yield from super().equations()
            yield connect(self.speed.v, self.lag.u)
            yield connect(self.lag.y, self.error.u2)

    assert any("der(lag.y)` in `m/s`" in finding for finding in findings(Filtered()))


def test_an_abstract_equation_is_no_business_of_units():
    class Decay(Component):
        x = var(unit="1")
        k: Param = param(unit="1", default=2.0)

        def equations(self):
            yield der(self.x) == -self.k * self.x

    check_dimensions(flatten(Decay()))


def test_a_number_outside_of_blocks_is_a_number():
    class Duty(Component):
        duty: Param = param(unit="1", default=0.5)

        def __post_init__(self):
            self.ground, self.mass = Fixed(s0=self.duty), Mass(m=1.0)

    assert only_finding(Duty()) == "what `ground.s0` is set to: `ground.s0` is in `m`, but `duty` a number or an angle."


def test_the_unit_any_takes_what_it_meets():
    class Sum(Component):
        u = signal("in", unit="any")
        v = signal("in", unit="any")
        y = signal("out", unit="any")

        def equations(self):
            yield self.y == self.u + self.v

    class Meeting(Component):
        def __post_init__(self):
            self.sum, self.mass = Sum(), Mass(m=1.0)
            self.position, self.speed = PositionSensor(), SpeedSensor()

        def equations(self):
            yield connect(self.position.flange, self.speed.flange, self.mass.flange_a)
            yield connect(self.position.s, self.sum.u)
            yield connect(self.speed.v, self.sum.v)

    check_dimensions(flatten(Sum()))
    assert only_finding(Meeting()).startswith("sum: equation 1 (Sum): `sum.u` is in `m`, but `sum.v` in `m/s`")


def test_literals_of_a_table_carry_any_unit():
    """A line through (0, 0) and (1, 1) is folded to y = time: volts by seconds all the same."""

    class Ramped(Component):
        def __post_init__(self):
            self.table, self.force = signals.TimeTable(table=((0.0, 0.0), (1.0, 1.0))), Force()
            self.mass = Mass(m=1.0)

        def equations(self):
            yield connect(self.table.y, self.force.f)
            yield connect(self.force.flange, self.mass.flange_a)

    check_dimensions(flatten(Ramped()))


# Random expressions

NAMES = ("kg", "m", "s", "A", "K")
UNITS = {name: parse(name) for name in NAMES} | {"phi": parse("rad"), "n": parse("1")}


def converted(p, expression, unit, wanted):
    """The expression times powers of parameters that make it a quantity in `wanted`."""
    for name, have, want in zip(BASE_UNITS[:-1], unit.dimension, wanted.dimension, strict=False):
        if have != want:
            # The number keeps x/x from being folded to a literal, which would fit anything.
            expression = expression * (getattr(p, name) * p.n) ** float(want - have)
    return expression


def build(p, tree, spoil):
    """Make (expression, unit) of a tree; `spoil` counts down to the sum in which one term gets a factor too much."""
    kind, *rest = tree
    if kind == "leaf":
        return getattr(p, rest[0]), UNITS[rest[0]]
    if kind in ("sin", "exp", "tanh"):
        inner, unit = build(p, rest[0], spoil)
        return getattr(ca, kind)(converted(p, inner, unit, parse("1"))), parse("1")
    if kind == "power":
        inner, unit = build(p, rest[0], spoil)
        return inner ** rest[1], power(unit, rest[1])
    (a, unit_a), (b, unit_b) = (build(p, branch, spoil) for branch in rest)
    if kind == "times":
        return a * b * p.n, multiply(unit_a, unit_b)
    if kind == "over":
        return a / (b * p.n), divide(unit_a, unit_b)
    b = converted(p, b, unit_b, unit_a)
    spoil[0] -= 1
    if spoil[0] == 0:
        b = b * p.cd
    return {"plus": a + b, "least": ca.fmin(a, b), "choice": ca.if_else(p.s > 1, a, b)}[kind], unit_a


def trees(children):
    return st.one_of(
        st.tuples(st.sampled_from(["plus", "least", "choice", "times", "over"]), children, children),
        st.tuples(st.sampled_from(["sin", "exp", "tanh"]), children),
        st.tuples(st.just("power"), children, st.sampled_from([2, -1, 0.5, 1.5, 3])),
    )


def n_sums(tree):
    branches = [branch for branch in tree[1:] if isinstance(branch, tuple)]
    return (tree[0] in ("plus", "least", "choice")) + sum(map(n_sums, branches))


TREES = st.recursive(st.tuples(st.just("leaf"), st.sampled_from(sorted(UNITS))), trees, max_leaves=20)


class Drawn(Component):
    """An equation of a random tree, among sound ones."""

    tree: tuple
    spoil: int

    def __post_init__(self):
        self.before = Pool(law=lambda p: p.m)
        self.drawn = Pool(law=self.law)
        self.after = Pool(law=lambda p: 2 * p.m)

    def law(self, p):
        expression, unit = build(p, self.tree, [self.spoil])
        assume(all(abs(x) < 50 for x in unit.dimension))
        return converted(p, expression, unit, parse("m"))


@given(TREES)
def test_random_consistent_expressions_pass(tree):
    check_dimensions(flatten(Drawn(tree=tree, spoil=0)))


@given(TREES, st.data())
def test_one_wrong_factor_is_found_and_named(tree, data):
    count = n_sums(tree)
    assume(count > 0)
    finding = only_finding(Drawn(tree=tree, spoil=data.draw(st.integers(1, count))))
    assert finding.startswith("drawn: equation 1 (Pool): ")
    told = re.findall("(?:in `([^`]*)`|a number or an angle)", finding)[:2]
    one, other = (parse(unit or "1") for unit in told)
    assert divide(one, other).dimension in (parse("cd").dimension, parse("1/cd").dimension)
