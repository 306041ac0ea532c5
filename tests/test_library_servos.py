"""The drive of a robot axis: its circuit of amplifiers is the linear system that it stands for."""

import numpy as np
import pytest
from library_bench import CLOSE, joined, run
from scipy.linalg import expm

from cartpend_dae.library import servos


def test_the_circuit_of_amplifiers_controls_the_current_as_its_three_equations_say():
    motor = servos.CurrentControlledMotor(J=0.0013, k=1.1616, w=5500.0, D=0.6)
    start = {"motor.rotor.phi": 0.0, "motor.rotor.w": 20.0, "motor.C.u": 0.0, "motor.La.i": 0.0}
    result = run(joined(motor=motor), 0.004, start=start, inputs={"motor.i_ref": 2.0}, rtol=1e-10)
    La, C = 250 / (2 * 0.6 * 5500), 0.6 / (250 * 5500)
    # C v_C' = (i - i_ref)/10, La i' = -5 v_C - 250 i - k w, J w' = k i; the last column carries i_ref = 2 A
    A = np.array(
        [
            [0, 1 / (10 * C), 0, -2 / (10 * C)],
            [-5 / La, -250 / La, -1.1616 / La, 0],
            [0, 1.1616 / 0.0013, 0, 0],
            [0, 0, 0, 0],
        ]
    )
    closed = np.array([expm(A * t) @ [0, 0, 20.0, 1] for t in result.time])
    for name, column in (("C.u", closed[:, 0]), ("La.i", closed[:, 1]), ("w_mechanical", closed[:, 2])):
        assert result[f"motor.{name}"] == pytest.approx(column, abs=CLOSE * np.ptp(column))


def test_the_cascade_has_its_gains_in_each_path():
    cascade = servos.PositionCascade(kp=5.0, ks=0.5, Ts=0.05, ratio=210.0)
    inputs = {"cascade.phi_ref": 0.01, "cascade.w_ref": 0.02, "cascade.phi": 0.4, "cascade.w": 3.0}
    result = run(joined(cascade=cascade), 1.0, start={"cascade.PI.x": 0.0}, inputs=inputs)
    error = 210 * 0.02 + 5 * (210 * 0.01 - 0.4) - 3.0
    assert result["cascade.y"] == pytest.approx(0.5 * error * (1 + result.time / 0.05), abs=CLOSE)
