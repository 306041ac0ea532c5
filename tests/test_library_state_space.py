"""Linear systems given by matrices, against scipy."""

import numpy as np
import pytest
from library_bench import joined, run
from scipy.linalg import expm
from scipy.signal import StateSpace as Reference
from scipy.signal import lsim, tf2ss

from cartpend_dae import assemble, simulate
from cartpend_dae.library import signals as s
from cartpend_dae.library.controllers import TransferFunction
from cartpend_dae.library.state_space import StateSpace

A = [[-0.5, 2.0, 0.0], [-2.0, -0.5, 1.0], [0.0, 0.0, -3.0]]
B = [[1.0, 0.0], [0.0, 0.0], [0.5, -2.0]]
C = [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]
D = [[0.0, 0.3], [0.0, 0.0]]
TIMES = np.linspace(0.0, 3.0, 301)


def driven(plant, **options):
    sine, ramp = s.Sine(amplitude=2.0, f=0.5), s.Ramp(height=1.5, duration=3.0)
    joints = [(sine.y, plant.u[0].u), (ramp.y, plant.u[1].u)]
    return run(joined(*joints, sine=sine, ramp=ramp, plant=plant), 3.0, times=TIMES, **options)


@pytest.mark.parametrize("array", [np.array, lambda m: m], ids=["arrays", "lists"])
def test_two_inputs_and_two_outputs_move_as_those_of_scipy(array):
    plant = StateSpace(A=array(A), B=array(B), C=array(C), D=array(D))
    result = driven(plant, start={"plant.x[1].y": 0.7})
    fine = np.linspace(0.0, 3.0, 60001)
    inputs = np.column_stack([2.0 * np.sin(np.pi * fine), 0.5 * fine])
    _, outputs, states = lsim(Reference(A, B, C, D), inputs, fine, [0.0, 0.7, 0.0])
    for name, expected in (("y", outputs), ("x", states)):
        for k, column in enumerate(expected.T):
            # Linear interpolation of the inputs in steps of 50 us leaves some 1e-9.
            np.testing.assert_allclose(result[f"plant.{name}[{k}].y"], column[::200], atol=1e-7, err_msg=f"{name}{k}")


def test_without_inputs_it_is_the_matrix_exponential():
    plant = StateSpace(A=A, B=np.zeros((3, 0)), C=C)
    start = {f"plant.x[{k}].y": value for k, value in enumerate((1.0, -2.0, 0.5))}
    result = simulate(joined(plant=plant), 1.0, start=start)
    expected = np.array(C) @ expm(np.array(A)) @ [1.0, -2.0, 0.5]
    assert [result[f"plant.y[{k}].y"][-1] for k in range(2)] == pytest.approx(expected.tolist(), abs=1e-7)


def test_without_states_it_is_a_matrix_of_gains():
    plant = StateSpace(A=np.zeros((0, 0)), B=np.zeros((0, 2)), C=np.zeros((1, 0)), D=[[2.0, -3.0]])
    result = driven(plant)
    expected = 4.0 * np.sin(np.pi * TIMES) - 1.5 * TIMES
    np.testing.assert_allclose(result["plant.y[0].y"], expected, atol=1e-12)


def test_it_is_the_transfer_function_that_scipy_makes_of_it():
    numerator, denominator = (1.0, 3.0), (0.5, 2.0, 4.0)
    plant = StateSpace(**dict(zip("ABCD", tf2ss(numerator, denominator), strict=True)))
    other, source = TransferFunction(b=numerator, a=denominator), s.Sine(amplitude=2.0, f=1.0)
    model = joined((source.y, plant.u[0].u, other.u), source=source, plant=plant, other=other)
    result = run(model, 3.0, times=TIMES)
    np.testing.assert_allclose(result["plant.y[0].y"], result["other.y"], atol=1e-7)  # ten times the tolerance


def test_its_states_are_the_states_and_nothing_is_iterated():
    system = assemble(joined(plant=StateSpace(A=A, B=B, C=C, D=D)))
    assert system.states == ("plant.x[0].y", "plant.x[1].y", "plant.x[2].y")
    assert not system.algebraics
    assert system.inputs == ("plant.u[0].u", "plant.u[1].u")


@pytest.mark.parametrize(
    ("matrices", "words"),
    [
        ({"A": A, "B": [[1.0]], "C": C}, "do not fit together: A 3 by 3, B 1 by 1, C 2 by 3, D 2 by 1"),
        ({"A": [[1.0], [2.0, 3.0]], "B": B, "C": C}, "are matrices of numbers"),
        ({"A": [1.0], "B": [1.0], "C": [1.0]}, "matrices of finite numbers"),
        ({"A": [[float("nan")]], "B": [[1.0]], "C": [[1.0]]}, "matrices of finite numbers"),
    ],
)
def test_matrices_that_do_not_fit_are_refused(matrices, words):
    with pytest.raises(ValueError, match=words):
        StateSpace(**matrices)
