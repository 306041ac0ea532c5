"""Losses and delays follow what passes through them at once, against closed forms."""

import numpy as np
import pytest
from library_bench import joined, run

from cartpend_dae import simulate
from cartpend_dae.effects import insert
from cartpend_dae.library import electrical, signal_errors
from cartpend_dae.library import rotational as r
from cartpend_dae.library import signals as s
from cartpend_dae.library.electrical_losses import BrushDrop, SupplySag
from cartpend_dae.library.electrical_sources import StepVoltage
from cartpend_dae.library.rotational_friction import LossyGear
from cartpend_dae.library.rotational_links import GearLoss, LoadDependentFriction
from cartpend_dae.library.rotational_losses import IronLoss
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


@pytest.mark.parametrize("method", ["adaptive", "rk4"])
def test_friction_that_grows_with_a_load_it_changes_follows_it_on_short_steps_and_on_long_ones(method):
    """Of the torque T on the second of two wheels with friction between, T(1 - mu) - tau_c moves J1 + (1 - mu) J2."""
    source, drive, extra = s.Step(height=2.0, offset=1.0, start_time=0.5), r.Torque(), r.BearingFriction(tau_c=0.1)
    first, link, second = r.Inertia(J=0.5), LoadDependentFriction(tau_c=0.2, mu=0.3), r.Inertia(J=0.8)
    model = joined(
        (source.y, drive.tau),
        (drive.flange, second.flange_b),
        (second.flange_a, link.flange_b),
        (link.flange_a, first.flange_b),
        (first.flange_a, extra.flange_b),
        (extra.flange_a, (ground := r.Fixed()).flange),
        source=source,
        drive=drive,
        extra=extra,
        first=first,
        link=link,
        second=second,
        ground=ground,
    )
    found = run(model, 1.0, start={"first.phi": 0.0, "first.w": 1.0}, method=method, step=0.01)
    slow, fast = ((torque * 0.7 - 0.2 - 0.1) / (0.5 + 0.7 * 0.8) for torque in (1.0, 3.0))
    expected = 1.0 + slow * np.minimum(found.time, 0.5) + fast * np.maximum(found.time - 0.5, 0.0)
    late = 0.3 * 1.3 * 5e-4 / (0.5 + 0.7 * 0.8)  # mu, how much more load, by the lag, over the inertia
    # a sixth of the step of 10 ms before the jump sees what comes after it, with the friction from before
    jump = 0.01 / 6 * 2.0 / (0.5 + 0.8)
    np.testing.assert_allclose(found["first.w"], expected, atol=late + (jump if method == "rk4" else 1e-8))


def test_a_lossy_gear_goes_with_friction_elsewhere_that_grows_with_its_load():
    """Each takes its share of what reaches it."""
    drive, load = r.Torque(), LoadDependentFriction(mu=0.25)
    gear, wheel = LossyGear(loss_table=((0.0, 0.8, 0.8, 0.0, 0.0),), ratio=4.0), r.Inertia(J=2.0)
    source, rotor = s.Constant(k=3.0), r.Inertia(J=0.1)
    model = joined(
        (source.y, drive.tau),
        (drive.flange, rotor.flange_a),
        (rotor.flange_b, gear.flange_a),
        (gear.flange_b, load.flange_b),
        (load.flange_a, wheel.flange_a),
        source=source,
        drive=drive,
        rotor=rotor,
        gear=gear,
        load=load,
        wheel=wheel,
    )
    found = run(model, 1.0, start={"wheel.phi": 0.0, "wheel.w": 1.0})
    # 4 * 0.8 of the torque behind the rotor reach the second friction, 0.75 of that the wheel
    share = 4 * 0.8 * 0.75
    speed = 1.0 + found.time * share * 3.0 / (2.0 + share * 4 * 0.1)
    np.testing.assert_allclose(found["wheel.w"], speed, atol=1e-4)  # its load has a lag of 0.5 ms at the start


@pytest.mark.parametrize("delay", [0.05, 0.0015625])  # the floor of the lag is 0.5 ms
def test_nothing_of_a_jump_passes_a_sensor_that_lags_at_once_and_on_average_it_comes_late_by_the_delay(delay):
    """Of a lag of three times the floor 5 % of each jump of a current passed at once, which hid it (seed 1115)."""
    source, late = s.Step(height=1.0, start_time=0.1), signal_errors.SensorDelay(T_d=delay)
    times = np.concatenate([np.linspace(0.0, 0.09, 10), 0.1 + np.geomspace(1e-6, 1.0, 4001)])
    model = joined((source.y, late.u), source=source, late=late)
    found = simulate(model, times=times, rtol=1e-9)
    y = found["late.y"]
    assert np.all(np.abs(y[:10]) < 1e-12) and abs(y[10]) < 1e-3
    # the area above the response to a step is the mean delay
    assert np.trapezoid(1 - y[10:], times[10:]) == pytest.approx(delay, rel=2e-3)


def test_a_sensor_may_come_late_as_it_was():
    """k = 2 is the Pade approximation: the phase of exp(-T s), 2 atan(w T/2) for w T, and its amplitude, 1."""
    source, late = s.Sine(amplitude=1.0, f=1.0), signal_errors.SensorDelay(T_d=0.05, k=2.0)
    model = joined((source.y, late.u), source=source, late=late)
    times = np.linspace(0.0, 3.0, 3001)
    w = 2 * np.pi
    phase = 2 * np.arctan(w * 0.05 / 2)
    found = simulate(model, times=times, rtol=1e-9)["late.y"]
    np.testing.assert_allclose(found[1000:], np.sin(w * times - phase)[1000:], atol=1e-5)
    assert phase == pytest.approx(w * 0.05, rel=0.01)


def current_through(part, V, offset, R):
    """Current through a part and a resistor, before and just after the voltage steps at 0.5 s."""
    source, ground = StepVoltage(V=V, offset=offset, start_time=0.5), electrical.Ground()
    resistor = electrical.Resistor(R=R)
    model = joined(
        (source.pin_p, part.pin_p),
        (part.pin_n, resistor.pin_p),
        (resistor.pin_n, source.pin_n, ground.pin),
        source=source,
        ground=ground,
        part=part,
        resistor=resistor,
    )
    return simulate(model, times=np.array([0.0, 0.5 - 1e-9, 0.5 + 1e-9, 1.0]))["resistor.i"]


def test_brushes_drop_their_voltage_in_the_moment_in_which_the_current_jumps():
    i = current_through(BrushDrop(V_b=0.8, i_b=0.3), V=-3.0, offset=2.0, R=0.7)
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


@pytest.mark.parametrize("n", [1, 3, 12])
def test_a_sensor_behind_several_lags_is_between_a_lag_and_one_that_comes_late_as_it_was(n):
    """Its phase is n atan(w T/n) to the second order of w T, and its amplitude (1 + (w T/n)^2)^(-n/2)."""
    source, late = s.Sine(amplitude=1.0, f=0.5), signal_errors.SensorDelay(T_d=0.05, k=2 * n / (n + 1))
    times = np.linspace(0.0, 6.0, 3001)
    found = simulate(joined((source.y, late.u), source=source, late=late), times=times, rtol=1e-9)["late.y"]
    w, lag = np.pi, np.pi * 0.05 / n
    chain = (1 + lag**2) ** (-n / 2) * np.sin(w * times - n * np.arctan(lag))
    assert np.max(np.abs(found - chain)[1000:]) < 1e-5 + 0.09 * (w * 0.05) ** 3 * (n > 1)


def test_the_scale_error_of_a_sensor_may_fade_with_what_is_measured():
    """Hidden so, on the rod under noise (reported seeds 1123 and 1126), it was taken for an error per turn."""
    source, sensor = s.Sine(amplitude=1.5, f=1.0), signal_errors.SensorGain(e=0.2, k=2.8)
    found = run(joined((source.y, sensor.u), source=source, sensor=sensor), 1.0)
    u = found["source.y"]
    np.testing.assert_allclose(found["sensor.y"], u * (1 + 0.2 / (1 + 2.8 * u**2)), rtol=1e-12, atol=1e-15)


def test_a_machine_coasts_under_the_excess_loss_of_its_iron_as_the_closed_form_says():
    """J dw/dt = -tau_e (w/w_1)^0.5, so that w^0.5 falls by tau_e/(2 J w_1^0.5) each second."""
    loss, rotor, ground = IronLoss(tau_e=0.3, w_1=2.0, w_0=1e-4), r.Inertia(J=0.5), r.Fixed()
    joints = ((ground.flange, loss.flange_a), (loss.flange_b, rotor.flange_b))
    found = run(joined(*joints, loss=loss, rotor=rotor, ground=ground), 5.0, start={"rotor.phi": 0.0, "rotor.w": 10.0})
    expected = (np.sqrt(10.0) - 0.3 / (2 * 0.5 * np.sqrt(2.0)) * found.time) ** 2
    np.testing.assert_allclose(found["rotor.w"], expected, rtol=1e-6)


@pytest.mark.parametrize("volts", [6.0, -6.0])
def test_a_supply_gives_way_the_more_the_more_it_carries(volts):
    """Behind it a resistor draws i of v = (R_s + R_i |i|) i + R i."""
    found = current_through(SupplySag(R_s=0.2, R_i=0.3), V=volts, offset=0.0, R=1.0)
    size = (-1.2 + np.sqrt(1.2**2 + 4 * 0.3 * abs(volts))) / (2 * 0.3)
    np.testing.assert_allclose(found, [0.0, 0.0, *[np.sign(volts) * size] * 2], atol=1e-9)
