"""Jumps at known times: of sources, and of inputs. Each is hit exactly, by every integrator, and decides on events."""

import numpy as np
import pytest
from library_bench import joined

from cartpend_dae import ModelError, Param, Statements, assemble, describe_start, param, simulate
from cartpend_dae.continuous import without_events
from cartpend_dae.library import electrical as e
from cartpend_dae.library import electrical_sources as es
from cartpend_dae.library import signals as s
from cartpend_dae.library import translational as t
from cartpend_dae.library import translational_sources as ts

GATE = ((0.1, 0.0), (0.1, 1.0), (0.15, 1.0), (0.15, 0.0))
ALL = ["adaptive", "cvodes", "idas", "erk", "rosenbrock"]


def integrated(source):
    sink = s.Integrator()
    return joined((source.y, sink.u), source=source, sink=sink)


def lagged(source, T=0.1):
    lag = s.FirstOrder(T=T)
    return joined((source.y, lag.u), source=source, lag=lag)


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("period", [0.6, 0.013])
def test_the_area_of_pulses_is_exact(method, period):
    """Offset -1/2 and height 2 for a quarter of each period: on average 0 after whole periods."""
    model = integrated(s.Pulse(amplitude=2.0, width=25.0, period=period, offset=-0.5, start_time=0.1234))
    times = [0.0, 0.1234, 0.1234 + 0.1 * period, 0.1234 + 3 * period, 0.1234 + 7.2 * period]
    result = simulate(model, times=times, start={"sink.y": 0.0}, method=method)
    expected = -0.5 * 0.1234 + period * np.array([0.15, 0.0, 2.0 * 0.2 - 0.5 * 0.2])
    np.testing.assert_allclose(result["sink.y"][2:], expected, rtol=0, atol=1e-13)  # rounding: it is constant between


@pytest.mark.parametrize("method", ALL)
def test_a_step_meets_an_integrator_in_full_swing(method):
    """From 1, towards 0 until 0.495 s, and towards 30 from there on."""
    model = lagged(s.Step(height=30.0, start_time=0.495))
    result = simulate(model, 2.0, points=201, start={"lag.y": 1.0}, method=method)
    past = np.maximum(result.time - 0.495, 0)
    expected = np.exp(-result.time / 0.1) - 30 * np.expm1(-past / 0.1)
    np.testing.assert_allclose(result["lag.y"], expected, rtol=0, atol=3e-5)  # 1e-6 of 30: tolerance 1e-8 per step


@pytest.mark.parametrize("method", ALL)
def test_held_samples_drive_a_smooth_motion(method):
    times = np.linspace(0.0, 2.0, 101)
    values = 3.0 * np.sin(7.0 * times)
    lag = s.FirstOrder(T=0.1)
    model = joined(lag=lag)
    result = simulate(
        model, 2.0, points=201, start={"lag.y": 0.0}, method=method, inputs={"lag.u": (times, values, "zoh")}
    )
    y = [0.0]
    for u in values[:-1]:
        y.append(u + (y[-1] - u) * np.exp(-0.02 / 0.1))
    np.testing.assert_allclose(result["lag.y"][::2], y, rtol=0, atol=1e-6)


@pytest.mark.parametrize("start_time", [0.5, 0.4951])
@pytest.mark.parametrize("as_input", [False, True], ids=["source", "input"])
def test_a_jump_of_force_breaks_what_sticks_loose(start_time, as_input):
    """3 N against 1 N of friction at 1 kg: 2 m/s2 from the jump on."""
    mass, friction, wall = t.Mass(m=1.0), t.CoulombFriction(f_c=1.0), t.Fixed()
    push = t.Force() if as_input else ts.ForceStep(step_force=3.0, start_time=start_time)
    joints = [(push.flange, mass.flange_a), (mass.flange_b, friction.flange_b), (wall.flange, friction.flange_a)]
    model = joined(*joints, push=push, mass=mass, friction=friction, wall=wall)
    inputs = {"push.f": ([0.0, start_time], [0.0, 3.0], "zoh")} if as_input else {}
    result = simulate(model, 2.0, points=201, start={"mass.s": 0.0, "mass.v": 0.0}, inputs=inputs)
    expected = 2.0 * np.maximum(result.time - start_time, 0.0)
    np.testing.assert_allclose(result["mass.v"], expected, rtol=0, atol=1e-12)  # a constant acceleration: rounding


class Lamp(e.OnePort):
    """A resistor that grows with its current, u = R i + b i^3."""

    R: Param = param(unit="Ohm", doc="cold resistance")
    b: Param = param(unit="V/A3", doc="growth")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.u == self.R * self.i + self.b * self.i**3


@pytest.mark.parametrize("method", ["adaptive", "idas", "rosenbrock"])
def test_an_algebraic_loop_jumps_with_its_source(method):
    """At the time of the step itself, 6 V = i R + b i^3 + i R2 gives 1 A; a coil stands beside R2."""
    source, lamp, coil, ground = (
        es.StepVoltage(V=6.0, start_time=0.5),
        Lamp(R=2.0, b=1.0),
        e.Inductor(L=0.3),
        e.Ground(),
    )
    shunt = e.Resistor(R=3.0)
    joints = [(source.pin_p, lamp.pin_p), (lamp.pin_n, coil.pin_p, shunt.pin_p)]
    joints += [(coil.pin_n, shunt.pin_n, source.pin_n, ground.pin)]
    model = joined(*joints, source=source, lamp=lamp, coil=coil, ground=ground, shunt=shunt)
    assert assemble(model).algebraics
    result = simulate(model, times=[0.0, 0.25, 0.5, 0.5 + 1e-7], start={"coil.i": 0.0}, method=method)
    np.testing.assert_allclose(result["lamp.i"], [0.0, 0.0, 1.0, 1.0], rtol=0, atol=1e-5)  # di/dt < 10 A/s at 1e-7 s


def test_models_with_time_events_only_may_use_cvodes_and_the_fixed_step():
    model = lagged(s.Pulse(amplitude=1.0, period=0.5))
    exact = simulate(model, 2.0, start={"lag.y": 0.0}, rtol=1e-10, method="cvodes")
    chosen = simulate(model, 2.0, start={"lag.y": 0.0}, rtol=1e-10)
    fixed = simulate(model, times=exact.time, start={"lag.y": 0.0}, method="rk4", step=1e-3)
    np.testing.assert_array_equal(chosen["lag.y"], exact["lag.y"])
    # rk4 steps over the jumps, and its middle may miss a step's end: 1/3 of a step of 1e-3 s at 10/s
    np.testing.assert_allclose(fixed["lag.y"], exact["lag.y"], rtol=0, atol=5e-3)


def test_what_steps_over_events_sees_the_relations_where_they_stand():
    system = assemble(lagged(s.Step(height=2.0, start_time=0.7)))
    assert system.hybrid.relation_places == ("source",)
    assert without_events(system, "A test").hybrid.is_empty


def test_the_start_of_a_model_with_events_is_described():
    report = describe_start(lagged(s.Step(height=2.0, start_time=0.7)), steady=True, time=1.0)
    assert [(value.name, value.value) for value in report.values] == [("lag.y", pytest.approx(2.0, rel=1e-9))]


def test_a_source_that_repeats_itself_too_often_is_refused():
    with pytest.raises(ModelError, match=r"a source repeats itself 1e\+09 times from 0 s to 1 s, and 100000 at most"):
        simulate(integrated(s.Pulse(amplitude=1.0, period=1e-9)), 1.0, start={"sink.y": 0.0})


def test_thyristor_waits_for_its_gate_and_blocks_at_the_end_of_the_half_wave():
    """On from the gate at 0.1 s to 0.5 s of a wave of 1 Hz, and not again, as the gate is fired once."""
    wave, thyristor, load = es.SineVoltage(V=10.0, f=1.0), e.IdealThyristor(Ron=1e-3, Goff=1e-6), e.Resistor(R=2.0)
    gate, meter, lag, ground = s.TimeTable(table=GATE), es.VoltageSensor(), s.FirstOrder(T=0.1), e.Ground()
    joints = [(wave.pin_p, thyristor.pin_p), (thyristor.pin_n, load.pin_p, meter.pin_p), (gate.y, thyristor.fire)]
    joints += [(load.pin_n, wave.pin_n, meter.pin_n, ground.pin), (meter.u, lag.u)]
    parts = {"wave": wave, "thyristor": thyristor, "load": load, "ground": ground, "gate": gate}
    result = simulate(joined(*joints, **parts, lag=lag, meter=meter), 1.5, points=301, start={"lag.y": 0.0})
    volts, time = 10.0 * np.sin(2 * np.pi * result.time), result.time
    on = (time > 0.1 + 1e-9) & (time < 0.5 - 1e-9)
    off = (time < 0.1 - 1e-9) | (time > 0.5 + 1e-9)
    np.testing.assert_allclose(result["load.i"][on], volts[on] / 2.001, rtol=1e-9)
    np.testing.assert_allclose(result["load.i"][off], volts[off] / (2.0 + 1e6), rtol=1e-9, atol=1e-15)
