"""Calls of functions on memory that numpy owns."""

import casadi as ca
import numpy as np
import pytest

from cartpend_dae.calls import called

x, y = ca.SX.sym("x", 2, 3), ca.SX.sym("y", 2)
BOTH = ca.Function("both", [x, y], [x * ca.repmat(y, 1, 3), ca.sum2(x) - y])


@pytest.mark.parametrize("order", ["C", "F"])
def test_matrices_go_in_and_come_out_in_their_shapes_whatever_their_order(order):
    a, b = np.asarray(np.arange(6.0).reshape(2, 3), order=order), np.array([2.0, -1.0])
    product, rest = called(BOTH, {0: a, 1: b}, [0, 1])
    assert product.tolist() == (a * b[:, None]).tolist()
    assert rest.tolist() == (a.sum(axis=1) - b)[:, None].tolist()


def test_what_is_left_out_is_zero_and_only_what_is_wanted_comes_back():
    (rest,) = called(BOTH, {1: np.array([2.0, -1.0])}, [1])
    assert rest.ravel().tolist() == [-2.0, 1.0]


def test_results_stay_when_the_function_is_called_again():
    first, second = (called(BOTH, {0: np.full((2, 3), k), 1: np.ones(2)}, [0])[0] for k in (1.0, 2.0))
    assert first.max() == 1.0
    assert second.min() == 2.0


def test_a_function_that_fails_is_an_error():
    root = ca.rootfinder("root", "newton", {"x": x[0], "p": y[0], "g": x[0] ** 2 + 1 + y[0] ** 2}, {"max_iter": 3})
    with pytest.raises(RuntimeError):
        called(root, {0: np.array([1.0]), 1: np.array([1.0])}, [0])
