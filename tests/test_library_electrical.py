from itertools import pairwise

import numpy as np
import pytest
from library_bench import CLOSE, joined, run
from scipy.linalg import expm

from cartpend_dae import assemble
from cartpend_dae.library import electrical as e
from cartpend_dae.library import electrical_sources as es
from cartpend_dae.library import rotational as r
from cartpend_dae.library import signals as s


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
    result = run(motor_bench(e.DCMotor(R=R, k=k), J, d), 2.0, inputs={"supply.u": u / 2}, start={"load.w": 0.0})
    steady, rate = k * u / (R * d + k**2), (d + k**2 / R) / J
    np.testing.assert_allclose(result["load.w"], steady * -np.expm1(-rate * result.time), rtol=0, atol=CLOSE * 70)
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
    np.testing.assert_allclose(result["supply.v"] * result["supply.i"], R * i**2 + d * w**2 + stored, atol=1e-10)


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
    joints = [tuple(getattr(motor, end) if isinstance(end, str) else end for end in joint) for joint in terminals]
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


def across(source, **options):
    """A source of voltage over a resistor of 4 ohms, a current meter between and a voltmeter beside."""
    resistor, ammeter, voltmeter = e.Resistor(R=4.0), es.CurrentSensor(), es.VoltageSensor()
    lag, ground = s.FirstOrder(T=0.1), e.Ground()  # a state, so that there is something to integrate
    joints = [(source.pin_p, ammeter.pin_p, voltmeter.pin_p), (ammeter.pin_n, resistor.pin_p)]
    joints += [(resistor.pin_n, source.pin_n, voltmeter.pin_n, ground.pin), (voltmeter.u, lag.u)]
    parts = {"source": source, "resistor": resistor, "ammeter": ammeter, "voltmeter": voltmeter, "lag": lag}
    return run(joined(*joints, **parts, ground=ground), 2.0, **options)


@pytest.mark.parametrize(
    ("source", "voltage"),
    [
        (es.StepVoltage(V=3.0, offset=-1.0, start_time=0.495), lambda x: np.where(x < 0.495, -1.0, 2.0)),
        (
            es.RampVoltage(V=3.0, duration=0.7, offset=-1.0, start_time=0.495),
            lambda x: np.interp(x, [0.495, 1.195], [-1.0, 2.0]),
        ),
        (
            es.SineVoltage(V=3.0, f=2.0, phase=0.3, offset=-1.0, start_time=0.495),
            lambda x: np.where(x < 0.495, -1.0, -1.0 + 3.0 * np.sin(4 * np.pi * (x - 0.495) + 0.3)),
        ),
        (es.VoltageSourceWithResistance(V=3.0, R=2.0), lambda x: np.full_like(x, 2.0)),
        (es.ConstantCurrent(I=-0.5), lambda x: np.full_like(x, 2.0)),
    ],
    ids=lambda x: type(x).__name__,
)
def test_source_and_meters_over_a_resistor(source, voltage):
    result = across(source)
    np.testing.assert_allclose(result["voltmeter.u"], voltage(result.time), atol=1e-12)
    np.testing.assert_allclose(result["ammeter.i"], voltage(result.time) / 4.0, atol=1e-12)
    np.testing.assert_allclose(result["source.pin_p.i"], -result["ammeter.i"], atol=1e-12)


def test_current_given_by_a_signal_charges_a_capacitor():
    source, wave, store, ground = es.CurrentSource(), s.Sine(amplitude=2.0, f=0.5), e.Capacitor(C=0.1), e.Ground()
    leak = es.Conductor(G=0.0)
    joints = [(source.pin_n, store.pin_p, leak.pin_p), (source.pin_p, store.pin_n, leak.pin_n, ground.pin)]
    model = joined(*joints, (wave.y, source.i), source=source, wave=wave, store=store, leak=leak, ground=ground)
    result = run(model, 2.0, start={"store.u": 1.0})
    expected = 1.0 + 2.0 / 0.1 / np.pi * (1 - np.cos(np.pi * result.time))
    np.testing.assert_allclose(result["store.u"], expected, atol=20 * CLOSE)


def test_operational_amplifier_inverts_and_integrates():
    source, amplifier, ground = es.SineVoltage(V=1.0, f=1.0), es.IdealOpAmp(), e.Ground()
    before, back = e.Resistor(R=1e3), e.Capacitor(C=1e-3)
    joints = [(source.pin_p, before.pin_p), (before.pin_n, back.pin_p, amplifier.n1), (back.pin_n, amplifier.p2)]
    joints += [(source.pin_n, amplifier.p1, amplifier.n2, ground.pin)]
    parts = {"source": source, "amplifier": amplifier, "ground": ground, "before": before, "back": back}
    result = run(joined(*joints, **parts), 2.0, start={"back.u": 0.0})
    expected = -(1 - np.cos(2 * np.pi * result.time)) / (2 * np.pi)  # R C = 1 s
    np.testing.assert_allclose(result["amplifier.v2"], expected, atol=CLOSE)


def test_brushes_are_a_resistance_and_then_a_constant_drop():
    ramp, brush = es.RampVoltage(V=8.0, offset=-4.0, duration=2.0), es.Brush(V=0.5, I_linear=0.2)
    resistor, ground, coil = e.Resistor(R=2.0), e.Ground(), s.FirstOrder(T=0.1)
    meter = es.VoltageSensor()
    joints = [(ramp.pin_p, brush.pin_p, meter.pin_p), (brush.pin_n, resistor.pin_p, meter.pin_n), (meter.u, coil.u)]
    joints += [(resistor.pin_n, ramp.pin_n, ground.pin)]
    parts = {"ramp": ramp, "brush": brush, "resistor": resistor, "ground": ground, "coil": coil, "meter": meter}
    result = run(joined(*joints, **parts), 2.0)
    volts = -4.0 + 4.0 * result.time
    drop = np.clip(volts * 2.5 / 4.5, -0.5, 0.5)  # 2.5 ohms of the brush in line with 2 ohms, up to 0.2 A
    np.testing.assert_allclose(result["meter.u"], drop, atol=1e-9)
    np.testing.assert_allclose(result["brush.i"], (volts - drop) / 2.0, atol=1e-9)


def test_diode_lets_one_half_of_the_wave_pass():
    wave, diode = es.SineVoltage(V=3.0, f=1.0), e.IdealDiode(Ron=0.5, Goff=0.01, Vknee=0.7)
    load, meter, ground, lag = e.Resistor(R=2.0), es.VoltageSensor(), e.Ground(), s.FirstOrder(T=0.1)
    joints = [(wave.pin_p, diode.pin_p), (diode.pin_n, load.pin_p, meter.pin_p), (meter.u, lag.u)]
    joints += [(load.pin_n, wave.pin_n, meter.pin_n, ground.pin)]
    parts = {"wave": wave, "diode": diode, "load": load, "meter": meter, "ground": ground, "lag": lag}
    # The knee is no event: with an absolute tolerance far below its currents, steps across it would get too short.
    result = run(joined(*joints, **parts), 2.0, atol=1e-8)
    volts = 3.0 * np.sin(2 * np.pi * result.time)
    closed = volts * 2.0 / (2.0 + 100.0)  # a divider of 100 ohms above the load
    opened = (volts - 0.7 + 0.5 * 0.01 * 0.7) * 2.0 / (2.0 + 0.5)
    expected = np.where(volts - closed < 0.7, closed, opened)
    np.testing.assert_allclose(result["load.u"], expected, atol=1e-8)


def test_switch_charges_a_capacitor_and_then_lets_it_leak():
    battery, switch, store = e.ConstantVoltage(V=5.0), e.IdealSwitch(Ron=10.0, Goff=1e-3), e.Capacitor(C=0.02)
    control, ground = s.Step(height=-1.0, offset=1.0, start_time=0.5), e.Ground()
    joints = [(battery.pin_p, switch.pin_p), (switch.pin_n, store.pin_p), (control.y, switch.control)]
    joints += [(store.pin_n, battery.pin_n, ground.pin)]
    parts = {"battery": battery, "switch": switch, "store": store, "control": control, "ground": ground}
    result = run(joined(*joints, **parts), 2.0, start={"store.u": 0.0})
    time = result.time
    missing = 5.0 * np.exp(-np.minimum(time, 0.5) / 0.2) * np.exp(-np.maximum(time - 0.5, 0) / 20.0)
    np.testing.assert_allclose(result["store.u"], 5.0 - missing, atol=10 * CLOSE)
