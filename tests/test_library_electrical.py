from itertools import pairwise

import numpy as np
import pytest
from library_bench import CLOSE, joined, run
from scipy.linalg import expm

from cartpend_dae import assemble
from cartpend_dae.library import electrical as e
from cartpend_dae.library import rotational as r


def loop(**parts):
    """The first part drives the others, which follow it in series; its negative pin is grounded."""
    source, *others = parts.values()
    ground = e.Ground()
    joints = [(a.pin_n, b.pin_p) for a, b in pairwise(others)]
    ends = [(source.pin_p, others[0].pin_p), (others[-1].pin_n, source.pin_n, ground.pin)]
    return joined(*joints, *ends, **parts, ground=ground)


def test_step_response_of_resistor_and_inductor():
    model = loop(source=e.ConstantVoltage(V=12.0), resistor=e.Resistor(R=3.0), inductor=e.Inductor(L=0.6))
    result = run(model, 1.0, start={"inductor.i": 0.0})
    decay = np.exp(-result.time / 0.2)
    np.testing.assert_allclose(result["inductor.i"], 4.0 * (1 - decay), rtol=0, atol=CLOSE * 4)
    np.testing.assert_allclose(result["inductor.u"], 12.0 * decay, rtol=0, atol=CLOSE * 12)
    # Power balance at each instant, rounding only: what the source gives, the elements take.
    total = sum(result[f"{name}.u"] * result[f"{name}.i"] for name in ("source", "resistor", "inductor"))
    np.testing.assert_allclose(total, 0.0, atol=1e-12 * 48)
    np.testing.assert_allclose(result["source.i"], -result["inductor.i"], rtol=1e-12)  # a source gives: i < 0
    np.testing.assert_allclose(result["ground.pin.i"], 0.0, atol=1e-12)  # one ground carries nothing


def test_charging_a_capacitor_from_a_voltage_signal():
    model = loop(source=e.VoltageSource(), resistor=e.Resistor(R=1e3), capacitor=e.Capacitor(C=2e-4))
    result = run(model, 1.0, inputs={"source.u": 5.0}, start={"capacitor.u": -1.0})
    expected = 5.0 - 6.0 * np.exp(-result.time / 0.2)
    np.testing.assert_allclose(result["capacitor.u"], expected, rtol=0, atol=CLOSE * 6)
    np.testing.assert_allclose(result["capacitor.i"], (5.0 - expected) / 1e3, rtol=0, atol=CLOSE * 6e-3)


def test_oscillation_of_capacitor_and_inductor_keeps_its_energy():
    model = loop(capacitor=e.Capacitor(C=0.02), inductor=e.Inductor(L=0.5))
    result = run(model, 2.0, start={"inductor.i": 0.0, "capacitor.u": 3.0})
    w = 10.0  # 1/sqrt(L C)
    np.testing.assert_allclose(result["capacitor.u"], 3.0 * np.cos(w * result.time), rtol=0, atol=CLOSE * 3)
    np.testing.assert_allclose(result["inductor.i"], 3.0 / 5.0 * np.sin(w * result.time), rtol=0, atol=CLOSE)
    energy = 0.5 / 2 * result["inductor.i"] ** 2 + 0.02 / 2 * result["capacitor.u"] ** 2
    np.testing.assert_allclose(energy, 0.09, rtol=10 * CLOSE)  # 20 rad of phase


def motor_bench(motor, J, d):
    supply, load, drag, ground = e.Amplifier(gain=2.0), r.Inertia(J=J), r.Damper(d=d), r.Fixed()
    return joined(
        (supply.pin_p, motor.pin_p),
        (supply.pin_n, motor.pin_n),
        (motor.shaft, load.flange_a),
        (load.flange_b, drag.flange_b),
        (drag.flange_a, ground.flange),
        supply=supply,
        motor=motor,
        load=load,
        drag=drag,
        ground=ground,
    )


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_motor_without_inductance_approaches_its_steady_speed(direction):
    R, k, J, d, u = 0.739, 0.17, 0.01, 0.002, 12.0 * direction
    result = run(
        motor_bench(e.DCMotor(R=R, k=k), J, d), 2.0, inputs={"supply.u": u / 2}, start={"load.w": 0.0}
    )
    steady, rate = k * u / (R * d + k**2), (d + k**2 / R) / J
    np.testing.assert_allclose(
        result["load.w"], steady * -np.expm1(-rate * result.time), rtol=0, atol=CLOSE * 70
    )
    assert result["load.w"][-1] == pytest.approx(steady, abs=70 * np.exp(-2 * rate) + 70 * CLOSE)
    np.testing.assert_allclose(result["motor.i"], (u - k * result["load.w"]) / R, rtol=0, atol=1e-12 * 16)
    np.testing.assert_allclose(result["supply.v"], u, rtol=1e-15)
    np.testing.assert_allclose(result["supply.i"], result["motor.i"], rtol=1e-12, atol=1e-12)


def test_motor_with_inductance_and_rotor_is_the_matrix_exponential():
    R, k, L, J_rotor, J_load, d, u = 0.739, 0.17, 0.02, 0.004, 0.006, 0.002, 12.0
    motor = e.DCMotor(R=R, k=k, L=L, J=J_rotor)
    result = run(
        motor_bench(motor, J_load, d),
        1.0,
        points=21,
        inputs={"supply.u": u / 2},
        start={"motor.i": 0.0, "load.w": 0.0},
    )
    J = J_rotor + J_load
    A = np.array([[-R / L, -k / L], [k / J, -d / J]])
    steady = np.linalg.solve(A, [-u / L, 0.0])
    expected = np.array([steady - expm(A * t) @ steady for t in result.time])
    np.testing.assert_allclose(result["motor.i"], expected[:, 0], rtol=0, atol=CLOSE * 10)
    np.testing.assert_allclose(result["load.w"], expected[:, 1], rtol=0, atol=CLOSE * 70)
    # The supply gives what heats, brakes, and goes into field and inertia: an identity, rounding only.
    i, w = result["motor.i"], result["load.w"]
    stored = i * result["motor.inductor.u"] + J * w * result["load.a"]
    np.testing.assert_allclose(
        result["supply.v"] * result["supply.i"], R * i**2 + d * w**2 + stored, atol=1e-10
    )


def test_emf_converts_without_loss():
    result = run(
        motor_bench(e.DCMotor(R=0.7, k=0.17, L=0.02), 0.01, 0.001),
        1.0,
        inputs={"supply.u": 3.0},
        start={"motor.i": 0.0, "load.w": 5.0},
    )
    electrical = result["motor.emf.u"] * result["motor.emf.i"]
    mechanical = result["motor.emf.flange.tau"] * result["motor.emf.w"]
    np.testing.assert_allclose(electrical + mechanical, 0.0, atol=1e-12 * 100)  # rounding of some ten watts


def test_a_part_that_is_set_to_zero_does_not_exist():
    assert assemble(motor_bench(e.DCMotor(R=1.0, k=0.1), 0.01, 0.0)).states == ("load.phi", "load.w")
    names = [v.name for v in assemble(motor_bench(e.DCMotor(R=1.0, k=0.1, L=0.1), 0.01, 0.0)).variables]
    assert "motor.inductor.u" in names
    assert "motor.rotor.w" not in names


def spinning_motor(*terminals, **parts):
    motor, load, ground = e.DCMotor(R=0.5, k=0.2), r.Inertia(J=0.01), e.Ground()
    joints = [
        tuple(getattr(motor, end) if isinstance(end, str) else end for end in joint) for joint in terminals
    ]
    return joined(
        (motor.shaft, load.flange_a),
        (motor.pin_n, ground.pin),
        *joints,
        motor=motor,
        load=load,
        ground=ground,
        **parts,
    )


def test_open_terminals_leave_the_motor_free():
    result = run(spinning_motor(), 1.0, start={"load.phi": 0.0, "load.w": 30.0})
    np.testing.assert_allclose(result["load.w"], 30.0, rtol=1e-12)  # nothing brakes: rounding
    np.testing.assert_allclose(result["motor.pin_p.v"], 0.2 * 30.0, rtol=1e-12)


def test_a_resistance_across_the_terminals_brakes_the_motor():
    brake = e.Resistor(R=1.5)
    model = spinning_motor(("pin_p", brake.pin_p), ("pin_n", brake.pin_n), brake=brake)
    result = run(model, 1.0, start={"load.phi": 0.0, "load.w": 30.0})
    rate = 0.2**2 / (0.5 + 1.5) / 0.01
    np.testing.assert_allclose(result["load.w"], 30.0 * np.exp(-rate * result.time), rtol=0, atol=30 * CLOSE)
