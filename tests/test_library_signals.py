import numpy as np
import pytest
from library_bench import CLOSE, joined, run
from scipy.integrate import cumulative_trapezoid

from cartpend_dae.library import signals as s
from cartpend_dae.library import translational as t


def response(source, block, duration=2.0, **options):
    return run(joined((source.y, block.u), source=source, block=block), duration, **options)


SOURCES = [
    (s.Constant(k=-1.5), lambda t: np.full_like(t, -1.5)),
    (s.Step(height=2.0, offset=-0.5, start_time=0.495), lambda t: np.where(t >= 0.495, 1.5, -0.5)),
    (
        s.Ramp(height=-2.0, duration=0.5, offset=1.0, start_time=0.3),
        lambda t: np.interp(t, [0.3, 0.8], [1.0, -1.0]),
    ),
    (
        s.Sine(amplitude=0.7, f=1.5, phase=0.4, offset=0.2, start_time=0.295),
        lambda t: 0.2 + np.where(t >= 0.295, 0.7 * np.sin(3 * np.pi * (t - 0.295) + 0.4), 0.0),
    ),
    (
        s.ExpSine(amplitude=0.7, f=1.5, d=2.0, phase=0.4, offset=0.2, start_time=0.295),
        lambda t: (
            0.2 + np.where(t >= 0.295, 0.7 * np.exp(-2 * (t - 0.295)) * np.sin(3 * np.pi * (t - 0.295) + 0.4), 0.0)
        ),
    ),
    (
        s.Pulse(amplitude=2.0, width=25.0, period=0.6, offset=-0.5, start_time=0.305),
        lambda t: -0.5 + np.where((t >= 0.305) & ((t - 0.305) % 0.6 < 0.15), 2.0, 0.0),
    ),
    (
        s.TimeTable(table=((0.1, 1.0), (0.5, 2.0), (0.795, 0.0), (0.795, 1.5), (1.2, -1.0))),
        lambda t: np.where(
            t < 0.795, np.interp(t, [0.1, 0.5, 0.795], [1.0, 2.0, 0.0]), np.interp(t, [0.795, 1.2], [1.5, -1.0])
        ),
    ),
]


@pytest.mark.parametrize(("source", "expected"), SOURCES, ids=lambda x: type(x).__name__)
def test_source_is_its_formula(source, expected):
    result = response(source, s.Integrator(), start={"block.y": 0.0})
    np.testing.assert_allclose(result["source.y"], expected(result.time), rtol=0, atol=1e-12)  # no integration


@pytest.mark.parametrize(("source", "expected"), SOURCES, ids=lambda x: type(x).__name__)
def test_integrator_is_the_area_below_its_input(source, expected):
    result = response(source, s.Integrator(k=2.0), start={"block.y": 0.3})
    fine = np.linspace(0.0, 2.0, 400001)  # trapezia of 5 us: 1e-5 across a jump of 2 at worst
    area = np.interp(result.time, fine, cumulative_trapezoid(expected(fine), fine, initial=0.0))
    np.testing.assert_allclose(result["block.y"], 0.3 + 2.0 * area, rtol=0, atol=3e-5)  # twice the trapezia's error


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        (s.Gain(k=-3.0), lambda u: -3.0 * u),
        (s.Limiter(y_max=0.5, y_min=-0.2), lambda u: np.clip(u, -0.2, 0.5)),
        (s.SensorOffset(y_0=0.25), lambda u: u + 0.25),
        (s.SensorOffset(), lambda u: u),
    ],
    ids=["gain", "limiter", "offset", "no offset"],
)
def test_block_is_its_formula_at_each_instant(block, expected):
    source, sink = s.Sine(amplitude=1.0, f=1.0), s.Integrator()
    model = joined((source.y, block.u), (block.y, sink.u), source=source, block=block, sink=sink)
    result = run(model, 1.0, start={"sink.y": 0.0})
    np.testing.assert_allclose(result["block.y"], expected(result["source.y"]), rtol=0, atol=1e-12)  # rounding


@pytest.mark.parametrize(("block", "sign"), [(s.Add(), 1.0), (s.Feedback(), -1.0)], ids=["add", "feedback"])
def test_two_inputs_are_added_or_compared(block, sign):
    one, two, sink = s.Sine(amplitude=1.0, f=1.0), s.Ramp(height=2.0, duration=1.0), s.Integrator()
    model = joined((one.y, block.u1), (two.y, block.u2), (block.y, sink.u), one=one, two=two, block=block, sink=sink)
    result = run(model, 1.0, start={"sink.y": 0.0})
    np.testing.assert_allclose(result["block.y"], result["one.y"] + sign * result["two.y"], rtol=0, atol=1e-12)


def test_step_response_of_the_first_order_lag():
    result = response(s.Constant(k=2.0), s.FirstOrder(k=3.0, T=0.4), start={"block.y": 1.0})
    np.testing.assert_allclose(result["block.y"], 6.0 - 5.0 * np.exp(-result.time / 0.4), rtol=0, atol=CLOSE * 6)


def test_sine_through_the_first_order_lag_in_steady_state():
    w, T = 2 * np.pi, 0.1
    phase = -np.arctan(w * T)
    amplitude = 1 / np.hypot(1, w * T)
    result = response(s.Sine(amplitude=1.0, f=1.0), s.FirstOrder(T=T), start={"block.y": amplitude * np.sin(phase)})
    np.testing.assert_allclose(result["block.y"], amplitude * np.sin(w * result.time + phase), rtol=0, atol=CLOSE)


def test_integrator_around_feedback_approaches_its_set_point():
    target, compare, memory = s.Constant(k=0.7), s.Feedback(), s.Integrator(k=4.0)
    model = joined(
        (target.y, compare.u1),
        (compare.y, memory.u),
        (memory.y, compare.u2),
        target=target,
        compare=compare,
        memory=memory,
    )
    result = run(model, 1.0, start={"memory.y": 0.0})
    np.testing.assert_allclose(result["memory.y"], 0.7 * -np.expm1(-4.0 * result.time), rtol=0, atol=CLOSE)


def test_signals_drive_and_read_a_mass():
    push, force, mass = s.Constant(k=3.0), t.Force(), t.Mass(m=2.0)
    sensor, offset = t.PositionSensor(), s.SensorOffset(y_0=0.01)
    model = joined(
        (push.y, force.f),
        (force.flange, mass.flange_a),
        (mass.flange_b, sensor.flange),
        (sensor.s, offset.u),
        push=push,
        force=force,
        mass=mass,
        sensor=sensor,
        offset=offset,
    )
    result = run(model, 1.0, start={"mass.s": 0.0, "mass.v": 0.0})
    np.testing.assert_allclose(result["offset.y"], 0.01 + 0.75 * result.time**2, rtol=0, atol=CLOSE)


def test_table_goes_on_with_its_first_and_last_slope():
    table = s.Table1D(table=((0.0, 1.0), (1.0, 2.0), (2.0, 0.0)))
    result = response(s.Ramp(height=4.0, duration=2.0, offset=-1.0), table)
    x = result["source.y"]
    expected = np.where(x < 1.0, 1.0 + x, 2.0 - 2.0 * (x - 1.0))
    np.testing.assert_allclose(result["block.y"], expected, atol=1e-12)


def test_table_of_one_row_is_a_constant():
    result = response(s.Ramp(height=4.0, duration=2.0), s.Table1D(table=((0.0, 1.5),)))
    np.testing.assert_allclose(result["block.y"], 1.5, rtol=1e-15)


@pytest.mark.parametrize("table", [(), ((1.0, 0.0), (0.5, 1.0))])
@pytest.mark.parametrize("kind", [s.TimeTable, s.Table1D])
def test_table_out_of_order_is_refused(kind, table):
    with pytest.raises(ValueError, match=f"{kind.__name__}: `table` needs rows of two numbers"):
        kind(table=table)


def test_table_of_a_block_has_no_jumps():
    with pytest.raises(ValueError, match="whose first column must rise"):
        s.Table1D(table=((0.0, 0.0), (0.0, 1.0)))
