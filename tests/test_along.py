"""Many times at once give what CasADi gives for one after the other."""

import casadi as ca
import numpy as np
import pytest

from cartpend_dae.along import OPERATIONS, along, pays_along

ONE, TWO = ca.SX.sym("a"), ca.SX.sym("b")
EXPRESSIONS = {
    "sum": ONE + TWO - 2 * ONE * TWO / (3 - TWO),
    "signs": -ONE + ca.fabs(TWO) + ca.sign(ONE) + ca.copysign(ONE, TWO),
    "powers": ca.sqrt(ca.fabs(ONE)) + ONE**3 + ca.fabs(ONE) ** TWO + TWO**2 + 1 / (4 + ONE) + ca.hypot(ONE, TWO),
    "exponentials": ca.exp(ONE) + ca.log(4 + TWO) + ca.expm1(ONE) + ca.log1p(TWO**2) + ca.erf(ONE),
    "angles": ca.sin(ONE) + ca.cos(TWO) + ca.tan(ONE) + ca.asin(TWO / 9) + ca.acos(ONE / 9) + ca.atan2(ONE, TWO),
    "hyperbolic": ca.sinh(ONE) + ca.cosh(TWO) + ca.tanh(ONE) + ca.asinh(TWO) + ca.acosh(2 + ONE**2) + ca.atanh(TWO / 9),
    "whole numbers": ca.floor(ONE) + ca.ceil(TWO) + ca.fmod(ONE, 0.7) + ca.atan(TWO),
    "bounds": ca.fmin(ONE, TWO) - ca.fmax(ONE, 0.5),
    "conditions": ca.if_else(ONE > TWO, ONE, -TWO) + (ONE <= 0) - (ONE == TWO) - (TWO != 0) - ca.logic_not(ONE >= 1),
    "logic": ca.logic_and(ONE > 0, TWO > 0) - ca.logic_or(ONE > 1, TWO > 1),
    "division by zero under a condition": ca.if_else(ONE > 0, 1 / ca.fmax(ONE, 0), 7.0),
    "twice": ca.sin(ONE) + ca.sin(ONE),
    "constant": ca.SX(4.0),
    "a parameter alone": 2 * TWO,
}


def function_of(expression):
    return ca.Function("f", [ONE, TWO], [expression])


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_each_operation_is_that_of_casadi(name):
    function = function_of(EXPRESSIONS[name])
    a, b = np.meshgrid([-2.5, -1.0, -0.3, 0.0, 0.4, 1.0, 2.5], [-2.0, 0.0, 0.4, 1.0, 2.2])
    a, b = np.tile(a.ravel(), 200), np.tile(b.ravel(), 200)  # more than are handled together
    assert pays_along(function, a.size)
    expected = [float(function(*pair)) for pair in zip(a[:35], b[:35], strict=True)]
    # numpy and the C library round the last digit of a sine differently
    found = along(function, [a[None, :], b[None, :]], a.size)
    np.testing.assert_allclose(found, [expected * 200], rtol=1e-13, atol=1e-15)


def test_what_does_not_change_is_given_once():
    function = ca.Function("f", [ONE, TWO], [ca.vertcat(ONE * TWO, TWO, ca.SX(1, 1), 3)])
    a = np.linspace(0, 1, 5000)
    found = along(function, [a[None, :], np.array([2.0])], a.size)
    np.testing.assert_array_equal(found, [2 * a, np.full(5000, 2.0), np.full(5000, 3.0)])


def test_few_times_and_unknown_operations_are_left_to_casadi():
    assert not pays_along(function_of(ONE + TWO), 1)
    assert not pays_along(function_of(ca.remainder(ONE, TWO)), 10_000)
    symbol = ca.MX.sym("x")
    assert not pays_along(ca.Function("f", [symbol], [ca.sin(symbol)]), 10_000)


def test_every_operation_is_covered_here():
    used = {
        function_of(expression).instruction_id(k)
        for expression in EXPRESSIONS.values()
        for k in range(function_of(expression).n_instructions())
    }
    # CasADi writes an assignment only into functions of matrices, and a variable exponent covers the constant one
    assert set(OPERATIONS) - used <= {ca.OP_ASSIGN, ca.OP_CONSTPOW, ca.OP_POW}
