"""Units against published conversions, the laws of their algebra, and what cannot be read."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartpend_dae.errors import ModelError
from cartpend_dae.units import (
    BASE_UNITS,
    Unit,
    derivative,
    divide,
    format_unit,
    from_si,
    multiply,
    parse,
    power,
    same_dimension,
    to_si,
)

exponents = st.fractions(min_value=-4, max_value=4, max_denominator=6)
dimensions = st.tuples(*[exponents] * len(BASE_UNITS))
# Powers of two, so that products and quotients of factors are exact and the laws hold to the last bit.
units = st.builds(Unit, dimensions, st.integers(-20, 20).map(lambda power_of_two: 2.0**power_of_two))

# One rounding per arithmetic operation, and the definitions need at most ten.
ROUNDING = 1e-14


@pytest.mark.parametrize(
    ("value", "unit", "si_value", "si_unit"),
    [
        (1.0, "rpm", math.pi / 30, "rad/s"),
        (1.0, "rev/min", math.pi / 30, "rad/s"),
        (180.0, "deg", math.pi, "rad"),
        (1.0, "deg/s", math.pi / 180, "rad/s"),
        (1.0, "lb", 0.45359237, "kg"),
        (1.0, "lbf", 4.4482216152605, "N"),
        (1.0, "in", 0.0254, "m"),
        (12.0, "in", 0.3048, "m"),
        (1.0, "ft", 0.3048, "m"),
        (1.0, "lbf.in", 0.1129848290276167, "N.m"),
        (1.0, "min", 60.0, "s"),
        (1.0, "h", 3600.0, "s"),
        (36.0, "km/h", 10.0, "m/s"),
        (25.0, "degC", 298.15, "K"),
        (1.0, "bar", 1e5, "Pa"),
        (1.0, "hPa", 100.0, "Pa"),
        (3.0, "%", 0.03, "1"),
        (5.0, "mm", 0.005, "m"),
        (5.0, "um", 5e-6, "m"),
        (2.0, "mm2", 2e-6, "m2"),
        (2.0, "g.cm2", 2e-7, "kg.m2"),
        (7.0, "mN.m", 0.007, "N.m"),
        (2.2, "kOhm", 2200.0, "Ohm"),
        (47.0, "uF", 47e-6, "A.s/V"),
        (1.5, "mH", 1.5e-3, "V.s/A"),
        (1.0, "daN", 10.0, "N"),
        (1.0, "kN", 1e3, "kg.m/s2"),
        (1.0, "mrad", 1e-3, "rad"),
        (1.0, "kHz", 1e3, "1/s"),
    ],
)
def test_published_conversions_hold_both_ways(value, unit, si_value, si_unit):
    assert parse(si_unit).factor == 1.0
    assert to_si(value, unit, si_unit) == pytest.approx(si_value, rel=ROUNDING)
    assert from_si(si_value, unit, si_unit) == pytest.approx(value, rel=ROUNDING)


@pytest.mark.parametrize(("per_rpm", "torque_constant"), [(0.0178, 0.170), (0.00924, 0.0882)])
def test_the_motors_of_the_rig_have_one_constant(per_rpm, torque_constant):
    # The data sheet states both constants to three digits.
    assert to_si(per_rpm, "V/rpm", "V.s/rad") == pytest.approx(torque_constant, rel=5e-3)
    assert same_dimension("V.s/rad", "N.m/A")


@pytest.mark.parametrize(
    ("text", "powers"),
    [
        ("N.m/rad", {"kg": 1, "m": 2, "s": -2, "rad": -1}),
        ("kg.m2", {"kg": 1, "m": 2}),
        ("1/s2", {"s": -2}),
        ("N.s/m", {"kg": 1, "s": -1}),
        ("V.s/rad", {"kg": 1, "m": 2, "s": -2, "A": -1, "rad": -1}),
        ("rad", {"rad": 1}),
        ("1", {}),
        ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("m/s2", {"m": 1, "s": -2}),
        ("N.m/(rad/s)", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("J/(kg.K)", {"m": 2, "s": -2, "K": -1}),
        ("kg-1.m+2", {"kg": -1, "m": 2}),
        ("V/Hz^(1/2)", {"kg": 1, "m": 2, "s": Fraction(-5, 2), "A": -1}),
        (" Ohm ", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("T.m2", {"kg": 1, "m": 2, "s": -2, "A": -1}),
    ],
)
def test_a_unit_string_has_its_exponents(text, powers):
    assert parse(text) == Unit(tuple(Fraction(powers.get(base, 0)) for base in BASE_UNITS))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("N.m/rda", r"`N\.m/rda` cannot be read: `rda` is not a known unit\. Did you mean `rad`\?"),
        ("Nm", r"`Nm` is not a known unit\. Did you mean `N\.m`\?"),
        ("°", r"Did you mean `deg`\?"),
        ("µm", r"Did you mean `um`\?"),
        ("RPM", r"Did you mean `rpm`\?"),
        ("px", r"`px` is not a known unit\.$"),
        ("kmin", r"`kmin` is not a known unit"),
        ("kkg", r"`kkg` is not a known unit"),
        ("", r"a symbol is missing\. A number without a unit has the unit `1`"),
        ("N./m", r"a symbol is missing"),
        ("V s", r"`V s` is not a symbol with an exponent\. Write for example `N\.m/rad`"),
        ("m^2", r"`m\^2` is not a symbol with an exponent\. .* `m/s2`"),
        ("m^(1/0)", r"`m\^\(1/0\)` is not a symbol with an exponent"),
        ("m/1", r"`1` is not a symbol"),
        ("m/s/s", r"it divides twice\. Put the denominator in parentheses"),
        ("J/kg.K", r"ambiguous\. Did you mean `J/\(kg\.K\)`"),
        ("N.m/(rad/s", r"the parentheses of `N\.m/\(rad/s` do not match"),
        ("m)(s", r"the parentheses of `m\)\(s` do not match"),
        ("W/degC", r"`degC` has an offset, so it stands only alone\. Write `K` for a difference"),
        ("degC2", r"`degC` has an offset"),
        ("Tm99", r"exponents are too large"),
        ("1/fm99", r"exponents are too large"),
    ],
)
def test_what_cannot_be_read_is_named(text, message):
    with pytest.raises(ModelError, match=message):
        parse(text)


@given(st.text("kgmsANr1/.()^-2 %°", max_size=12))
def test_any_text_is_a_unit_or_a_model_error(text):
    try:
        assert isinstance(parse(text), Unit)
    except ModelError as error:
        assert f"`{text}`" in str(error)


@given(units, units, units)
def test_units_form_a_commutative_group(a, b, c):
    assert multiply(a, b) == multiply(b, a)
    assert multiply(multiply(a, b), c) == multiply(a, multiply(b, c))
    assert multiply(a, "1") == a
    assert divide(a, a) == parse("1")
    assert divide(multiply(a, b), b) == a


@given(units, st.integers(-3, 3), st.integers(-3, 3))
def test_powers_add_up(unit, m, n):
    assert multiply(power(unit, m), power(unit, n)) == power(unit, m + n)
    assert power(power(unit, m), n) == power(unit, m * n)


@given(units)
def test_a_root_undoes_its_power_and_float_exponents_are_exact(unit):
    # libm's pow is right to one unit in the last place for roots.
    for root, whole in ((1 / 3, 3), (0.5, 2)):
        back = power(power(unit, whole), root)
        assert back.dimension == unit.dimension
        assert back.factor == pytest.approx(unit.factor, rel=ROUNDING)


@given(dimensions)
def test_si_units_survive_writing_and_reading(dimension):
    assert parse(format_unit(Unit(dimension))) == Unit(dimension)


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("kg.m/s2", "N"),
        ("N.m/rad", "N.m/rad"),
        ("J", "N.m"),
        ("kg.m2", "kg.m2"),
        ("m/s", "m/s"),
        ("rad/s2", "rad/s2"),
        ("m/(s.K)", "m/(s.K)"),
        ("1/s", "1/s"),
        ("rad/rad", "1"),
        ("m^(1/2)", "m^(1/2)"),
        ("rev/min", "rpm"),
        ("mm", "mm"),
        ("degC", "degC"),
    ],
)
def test_units_are_written_with_their_usual_names(text, written):
    assert str(parse(text)) == written
    assert parse(written) == parse(text)


def test_a_scale_without_a_name_is_a_number():
    assert format_unit(multiply("in", "kg")) == "0.0254 kg.m"


@pytest.mark.parametrize(
    ("unit", "rate"), [("rad", "rad/s"), ("m/s", "m/s2"), ("degC", "K/s"), ("V.s", "V"), ("1", "1/s")]
)
def test_a_derivative_is_per_second(unit, rate):
    assert derivative(unit) == parse(rate)


def test_radians_do_not_count_but_scales_and_all_else_do():
    assert same_dimension("m.rad/s", "m/s")
    assert same_dimension("deg", "1")
    assert same_dimension("degC", "K")
    assert not same_dimension("N.m", "N")
    assert parse("N.m/rad") != parse("N.m")


def test_a_lost_square_in_a_gear_reflection_is_found():
    # An inertia seen through a rack of r metres per radian is J / r2; J / r is not a mass.
    rack = "m/rad"
    assert same_dimension(divide("kg.m2", power(rack, 2)), "kg")
    assert not same_dimension(divide("kg.m2", rack), "kg")


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=1),
    st.sampled_from(["deg", "rpm", "degC", "lbf.in", "km/h", "%", "uF"]),
    st.booleans(),
)
def test_conversion_and_its_inverse_cancel(values, unit, difference):
    array = np.array(values)
    back = from_si(to_si(array, unit, difference=difference), unit, difference=difference)
    # The offset of degC costs digits of values near zero: 1e-16 of 273 K.
    np.testing.assert_allclose(back, array, rtol=ROUNDING, atol=1e-12)


def test_a_standard_deviation_has_no_offset():
    assert to_si(0.5, "degC", "K", difference=True) == 0.5
    assert from_si(0.5, "degC", "K", difference=True) == 0.5


def test_integers_and_grids_convert_and_keep_their_shape():
    counts = np.arange(6).reshape(2, 3)
    np.testing.assert_allclose(to_si(counts, "mm"), counts / 1000, rtol=ROUNDING)


@pytest.mark.parametrize("convert", [to_si, from_si])
@pytest.mark.parametrize(
    ("unit", "expected", "message"),
    [
        ("deg", "m", r"`deg` does not measure what is expected, a quantity in `m`\. It could be `cm`"),
        ("kg", "N", r"`kg` does not measure what is expected, a quantity in `N`\. It could be `N`, `kN`"),
        ("m", "kg.A", r"a quantity in `kg\.A`\.$"),
        ("Hz", "rad/s", r"Between `Hz` and the expected `rad/s` a factor of 2 pi would be lost"),
        ("rpm", "Hz", r"factor of 2 pi would be lost.* Write `rev/s`, `rpm` or `rad/s`"),
        ("1/min", "rad/s", r"factor of 2 pi would be lost"),
    ],
)
def test_a_wrong_quantity_is_refused(convert, unit, expected, message):
    with pytest.raises(ModelError, match=message):
        convert(1.0, unit, expected)


@pytest.mark.parametrize(("unit", "expected"), [("1/s", "rad/s"), ("rpm", "1/s"), ("Hz", "1/s"), ("deg", "1")])
def test_a_rate_that_cannot_mean_turns_is_accepted(unit, expected):
    assert to_si(1.0, unit, expected) == parse(unit).factor
