"""Losses and delays follow what passes through them at once, against closed forms."""

import numpy as np
import pytest
from library_bench import joined, run

from cartpend_dae import simulate
from cartpend_dae.effects import insert
from cartpend_dae.library import electrical, signal_errors
from cartpend_dae.library import rotational as r
from cartpend_dae.library import signals as s
from cartpend_dae.library.electrical_losses import BrushDrop
from cartpend_dae.library.electrical_sources import StepVoltage
from cartpend_dae.library.rotational_links import GearLoss
from models.driven_cart import DrivenCart


@pytest.mark.parametrize(("torque", "passed"), [(2.0, 2.0 * 0.8), (-2.0, -2.0 / 0.8)])
def test_a_gear_loses_the_same_share_of_what_drives_it_either_way(torque, passed):
    """Driven, the wheel has 80 % of the torque; where it drives, it gives so much that 80 % of that arrive."""
    source, drive = s.Constant(k=torque), r.Torque()
    gear, wheel = GearLoss(e=0.2), r.Inertia(J=0.5)
    model = joined(
        (source.y, drive.tau),
        (drive.flange, gear.flange_b),
        (gear.flange_a, wheel.flange_a),
        source=source,
        drive=drive,
        gear=gear,
        wheel=wheel,
    )
    found = run(model, 1.0, start={"wheel.phi": 0.0, "wheel.w": 10.0})
    np.testing.assert_allclose(found["wheel.w"], 10 + passed / 0.5 * found.time, rtol=1e-6)


def test_nothing_of_a_jump_passes_a_sensor_that_lags_at_once_and_on_average_it_comes_late_by_the_delay():
    source, late = s.Step(height=1.0, start_time=0.1), signal_errors.SensorDelay(T_d=0.05)
    times = np.concatenate([np.linspace(0.0, 0.09, 10), 0.1 + np.linspace(1e-6, 1.0, 4001)])
    model = joined((source.y, late.u), source=source, late=late)
    found = simulate(model, times=times, rtol=1e-9)
    y = found["late.y"]
    assert np.all(np.abs(y[:10]) < 1e-12) and abs(y[10]) < 1e-3
    # the area above the response to a step is the mean delay
    assert np.trapezoid(1 - y[10:], times[10:]) == pytest.approx(0.05, rel=2e-3)


def test_brushes_drop_their_voltage_in_the_moment_in_which_the_current_jumps():
    supply, ground = StepVoltage(V=-3.0, offset=2.0, start_time=0.5), electrical.Ground()
    brushes, resistor = BrushDrop(V_b=0.8, i_b=0.3), electrical.Resistor(R=0.7)
    model = joined(
        (supply.pin_p, brushes.pin_p),
        (brushes.pin_n, resistor.pin_p),
        (resistor.pin_n, supply.pin_n, ground.pin),
        supply=supply,
        ground=ground,
        brushes=brushes,
        resistor=resistor,
    )
    i = simulate(model, times=np.array([0.0, 0.5 - 1e-9, 0.5 + 1e-9, 1.0]))["resistor.i"]
    np.testing.assert_allclose(0.7 * i + 0.8 * np.tanh(i / 0.3), [2.0, 2.0, -1.0, -1.0], atol=1e-8)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 0.01}], ids=["adaptive", "fixed steps"])
def test_a_saturated_machine_draws_at_each_moment_what_its_voltage_and_speed_ask_for(options):
    """R i + k w/(1 + e i^2) = u: on fixed steps too the algebraic variables are those of the moment, not of a stage."""
    model = insert(DrivenCart(), "magnetic_saturation", "motor.emf.k", e=0.01)
    time = np.linspace(0.0, 1.0, 101)
    u = np.where(time < 0.5, 6.0, -4.0)
    found = simulate(model, 1.0, points=101, inputs={"amplifier.u": (time, u)}, **options)
    i, w = found["motor.i"], found["motor.emf.w"]
    np.testing.assert_allclose(0.739 * i + 0.170 * w / (1 + 0.01 * i**2), u, atol=1e-6)
