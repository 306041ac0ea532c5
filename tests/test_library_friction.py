"""Bearings, brakes, clutches and lossy gears against closed forms: when they stop, stick and break loose."""

import casadi as ca
import numpy as np
import pytest
from library_bench import CLOSE, joined, run

from cartpend_dae.language import Component, Param, der, dry_friction, initial, param, time, var
from cartpend_dae.library import rotational as r
from cartpend_dae.library import rotational_friction as f
from cartpend_dae.library import rotational_losses, signals, translational_losses
from cartpend_dae.library import rotational_parts as parts
from cartpend_dae.library import rotational_sources as sources
from cartpend_dae.library import translational as t

ROWS = ((0.0, 0.4), (1.0, 0.6))


def shaft(friction, *, torque=None, **signal_sources):
    """An inertia of 0.5 kg.m2 with a friction, driven by a signal; `friction` may be pressed by another."""
    body = r.Inertia(J=0.5)
    parts, joints = {"body": body, "friction": friction}, [(body.flange_b, friction.flange_a)]
    if torque is not None:
        drive = r.Torque()
        parts |= {"drive": drive, "torque": torque}
        joints += [(drive.flange, body.flange_a), (torque.y, drive.tau)]
    if press := signal_sources.get("press"):
        parts["press"] = press
        joints.append((press.y, friction.f_normalized))
    return joined(*joints, **parts)


@pytest.mark.parametrize("w_0", [3.0, -3.0])
def test_a_shaft_in_a_bearing_with_a_table_stops_when_the_closed_form_says_and_stays(w_0):
    result = run(shaft(f.TableBearing(tau_pos=ROWS)), 6.0, start={"body.phi": 0.0, "body.w": w_0})
    # J w' = -(0.4 + 0.2 w), also beyond the last row
    stop = 0.5 / 0.2 * np.log1p(0.2 * abs(w_0) / 0.4)
    closed = np.maximum(np.exp(-0.4 * result.time) * (abs(w_0) + 2.0) - 2.0, 0.0) * np.sign(w_0)
    assert result["body.w"] == pytest.approx(closed, abs=CLOSE)
    stands = result.time > stop
    assert np.all(result["body.w"][stands] == 0)
    assert np.array_equal(result["friction.mode"], np.where(stands, 0, np.sign(w_0)))


def test_a_table_may_count_in_units_of_its_own():
    per_minute = 2 * np.pi / 60
    rows = tuple((w / per_minute, tau * 1e3) for w, tau in ROWS)
    bearings = f.TableBearing(tau_pos=ROWS), f.TableBearing(tau_pos=rows, w_unit=per_minute, tau_unit=1e-3)
    one, other = (run(shaft(bearing), 4.0, start={"body.phi": 0.0, "body.w": 3.0}) for bearing in bearings)
    assert one["body.phi"] == pytest.approx(other["body.phi"], abs=CLOSE)


def test_what_sticks_breaks_loose_at_the_peak_and_then_feels_less():
    ramp = signals.Ramp(height=2.0, duration=2.0)
    bearing = f.TableBearing(tau_pos=((0.0, 0.4),), peak=1.5)
    result = run(shaft(bearing, torque=ramp), 2.0, start={"body.phi": 0.0, "body.w": 0.0})
    since = np.maximum(result.time - 0.6, 0)
    # J w' = t - 0.4 from t = 0.6 s on
    assert result["body.w"] == pytest.approx((since**2 / 2 + 0.2 * since) / 0.5, abs=CLOSE)


@pytest.mark.parametrize(("amplitude", "moves"), [(0.99, False), (1.25, True)])
def test_two_bearings_on_one_shaft_hold_together(amplitude, moves):
    model = shaft(f.TableBearing(tau_pos=((0.0, 0.3),)), torque=signals.Sine(amplitude=amplitude, f=0.25))
    second = model.attach("second", f.TableBearing(tau_pos=((0.0, 0.7),)))
    model.joints += joined((model.body.flange_b, second.flange_b)).joints
    result = run(model, 1.0, start={"body.phi": 0.0, "body.w": 0.0})
    loose = np.arcsin(1 / amplitude) / (np.pi / 2) if moves else 1.0
    t, w = np.maximum(result.time, loose), np.pi / 2
    closed = (amplitude / w * (np.cos(w * loose) - np.cos(w * t)) - (t - loose)) / 0.5
    assert result["body.w"] == pytest.approx(closed, abs=CLOSE)


@pytest.mark.parametrize("support", [False, True])
def test_a_brake_is_free_until_it_is_pressed_and_its_housing_takes_the_torque(support):
    brake = f.Brake(mu_pos=((0.0, 0.5),), cgeo=0.2, fn_max=30.0, use_support=support)
    model = shaft(brake, press=signals.Step(height=1.0, start_time=0.5))
    if support:
        model.attach("ground", ground := r.Fixed())
        model.joints += joined((ground.flange, brake.support)).joints
    result = run(model, 2.0, start={"body.phi": 0.0, "body.w": 4.0})
    closed = 4.0 - np.clip(result.time - 0.5, 0, 2 / 3) * 6.0
    assert result["body.w"] == pytest.approx(closed, abs=CLOSE)
    modes = np.select([result.time < 0.5, result.time < 0.5 + 2 / 3], [2, 1], 0)
    apart = np.abs(result.time - 0.5) > 1e-9  # at the step itself the brake is about to grip
    assert np.array_equal(result["friction.mode"][apart], modes[apart])


def test_held_samples_press_a_brake_at_their_times():
    brake = f.Brake(mu_pos=((0.0, 0.5),), cgeo=0.2, fn_max=30.0)
    samples = (np.array([0.0, 0.305, 0.905]), np.array([0.0, 1.0, 0.0]), "zoh")
    inputs = {"friction.f_normalized": samples}
    result = run(shaft(brake), 1.0, start={"body.phi": 0.0, "body.w": 9.0}, inputs=inputs)
    assert result["body.w"] == pytest.approx(9.0 - 6.0 * np.clip(result.time - 0.305, 0, 0.6), abs=CLOSE)


def coupled(clutch, J_1, J_2, **others):
    one, two = r.Inertia(J=J_1), r.Inertia(J=J_2)
    joints = [(one.flange_b, clutch.flange_a), (clutch.flange_b, two.flange_a)]
    if press := others.get("press"):
        joints.append((press.y, clutch.f_normalized))
    return joined(*joints, one=one, two=two, clutch=clutch, **others)


def test_a_clutch_brings_two_inertias_to_their_common_speed_at_the_exact_time():
    clutch = f.Clutch(mu_pos=((0.0, 0.4),), cgeo=0.5, fn_max=25.0)
    model = coupled(clutch, 0.5, 2.0, press=signals.Step(height=1.0, start_time=0.2))
    start = {"one.phi": 0.0, "one.w": 10.0, "two.phi": 0.0, "two.w": -5.0}
    result = run(model, 2.0, start=start)
    # torque 5 N.m, so that w_rel falls by 5 (1/0.5 + 1/2) rad/s in a second: 15 rad/s in 1.2 s
    angular_momentum = 0.5 * result["one.w"] + 2.0 * result["two.w"]
    assert angular_momentum == pytest.approx(np.full_like(result.time, -5.0), abs=CLOSE)
    assert result["clutch.w_rel"] == pytest.approx(
        np.minimum(-15 + 12.5 * np.maximum(result.time - 0.2, 0), 0), abs=CLOSE
    )
    joined_up = result.time > 1.4 + 1e-9
    assert result["one.w"][joined_up] == pytest.approx(np.full(joined_up.sum(), -2.0), abs=CLOSE)
    energy = (0.5 * result["one.w"] ** 2 + 2.0 * result["two.w"] ** 2) / 2
    reduced = 0.5 * 2.0 / 2.5
    assert energy[0] - energy[-1] == pytest.approx(reduced * 15**2 / 2, abs=CLOSE)
    assert set(result["clutch.mode"]) == {2, -1, 0}


def test_a_freewheel_overruns_one_way_and_carries_the_other_way():
    clutch = f.OneWayClutch(mu_pos=((0.0, 0.5),), peak=2.0, fn_max=1.0)
    still, push = signals.Constant(k=0.0), signals.Sine(amplitude=3.0, f=0.5)
    drive = r.Torque()
    model = coupled(clutch, 0.5, 1.0, press=still, drive=drive, push=push)
    model.joints += joined((push.y, drive.tau), (drive.flange, model.one.flange_a)).joints
    start = dict.fromkeys(["one.phi", "one.w", "two.phi", "two.w"], 0.0)
    result = run(model, 2.0, start=start)
    t, w = result.time, np.pi
    together = 3.0 / w * (1 - np.cos(w * t)) / 1.5
    # the second inertia keeps the largest speed, while the first slows down and comes back at t = 2 s
    assert result["two.w"] == pytest.approx(np.where(t < 1, together, 6 / w / 1.5), abs=1e-3)
    assert result["one.w"] == pytest.approx(
        np.where(t < 1, together, 6 / w / 1.5 - 3 / w * (1 + np.cos(w * t)) / 0.5), abs=1e-3
    )
    assert np.all(result["clutch.w_rel"] >= -CLOSE)
    assert np.array_equal(result["clutch.stuck"], (t < 1 + 1e-4).astype(float))


def geared(gear, *, tau_1=0.0, tau_2=0.0):
    one, two = r.Inertia(J=0.2), r.Inertia(J=3.0)
    motor, load = sources.ConstantTorque(tau_constant=tau_1), sources.ConstantTorque(tau_constant=tau_2)
    joints = [(motor.flange, one.flange_a), (one.flange_b, gear.flange_a), (gear.flange_b, two.flange_a)]
    return joined(*joints, (two.flange_b, load.flange), one=one, two=two, motor=motor, load=load, gear=gear)


REST = {"two.phi": 0.0, "two.w": 0.0}
EFFICIENCIES = ((0.0, 0.8, 0.6, 0.1, 0.3),)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_lossy_gear_passes_power_with_the_efficiency_of_its_direction(sign):
    by_a = run(geared(f.LossyGear(loss_table=EFFICIENCIES, ratio=4.0), tau_1=2.0 * sign), 1.0, start=REST)
    # J1 a = 2 - tau_a, J2 a/i = i (0.8 tau_a - 0.1)
    a = (0.8 * 2.0 - 0.1) / (0.8 * 0.2 + 3.0 / 16)
    assert by_a["one.w"] == pytest.approx(sign * a * by_a.time, abs=CLOSE)
    by_b = run(geared(f.LossyGear(loss_table=EFFICIENCIES, ratio=4.0), tau_2=8.0 * sign), 1.0, start=REST)
    # tau_a = -J1 a, loss = (1 - 1/0.6) tau_a + 0.3, J2 a/i = 8 - i (loss - tau_a)
    a = (8.0 - 4 * 0.3) / (3.0 / 4 + 4 * 0.2 / 0.6)
    assert by_b["one.w"] == pytest.approx(sign * a * by_b.time, abs=CLOSE)
    assert by_a["gear.mode"][-1] == by_b["gear.mode"][-1] == sign


def test_a_gear_with_little_efficiency_holds_its_load_and_one_without_losses_is_ideal():
    holds = run(
        geared(f.LossyGear(loss_table=((0.0, 0.3, 0.2, 0.0, 0.0),), ratio=4.0), tau_1=0.5, tau_2=-6.0), 1.0, start=REST
    )
    # forward 0.3 * 0.5 * 4 < 6, backward 0.5 * 4 > 0.2 * 6: neither side moves the other
    assert np.all(holds["two.w"] == 0)
    assert np.all(holds["gear.mode"] == 0)
    ideal = run(
        geared(f.LossyGear(loss_table=((0.0, 1.0, 1.0, 0.0, 0.0),), ratio=4.0), tau_1=0.5, tau_2=-6.0), 1.0, start=REST
    )
    same = run(geared(r.IdealGear(ratio=4.0), tau_1=0.5, tau_2=-6.0), 1.0, start=REST)
    assert ideal["two.w"] == pytest.approx(same["two.w"], abs=CLOSE)
    assert np.all(ideal["gear.mode"] == 2)


@pytest.mark.parametrize("rows", [(), ((1.0, 0.5),), ((0.0, 0.5), (0.0, 0.6)), ((0.0, 0.5, 1.0),)])
def test_a_table_must_begin_at_rest_and_rise(rows):
    with pytest.raises(ValueError, match=r"TableBearing: `tau_pos` needs rows of 2 numbers .* begins at 0 and rises"):
        f.TableBearing(tau_pos=rows)


def test_a_gearbox_is_a_lossy_gear_and_play_in_series():
    values = {"c": 900.0, "d": 2.0, "b": 0.02}
    box = f.Gearbox(loss_table=EFFICIENCIES, ratio=4.0, **values)
    gear, play, end = f.LossyGear(loss_table=EFFICIENCIES, ratio=4.0), parts.ElastoBacklash(**values), r.Inertia(J=3.0)
    start = {"one.phi": 0.0, "one.w": 0.0, "two.phi": 0.0, "two.w": 0.0}
    whole = run(geared(box, tau_1=2.0), 0.5, start=start)
    motor, one = sources.ConstantTorque(tau_constant=2.0), r.Inertia(J=0.2)
    chain = joined(
        (motor.flange, one.flange_a),
        (one.flange_b, gear.flange_a),
        (gear.flange_b, play.flange_a),
        (play.flange_b, end.flange_a),
        motor=motor,
        one=one,
        gear=gear,
        play=play,
        two=end,
    )
    apart = run(chain, 0.5, start=start)
    assert whole["two.phi"] == pytest.approx(apart["two.phi"], abs=CLOSE)
    assert np.ptp(whole["gear.phi_rel"]) > 0.01  # the play was passed


def test_the_torque_of_hard_play_jumps_at_the_contact_and_ends_where_it_would_pull():
    J, c, d, b, w_0 = 0.5, 800.0, 6.0, 0.2, -3.0
    play, ground, body = parts.ElastoBacklash2(c=c, d=d, b=b), r.Fixed(), r.Inertia(J=J)
    model = joined((ground.flange, play.flange_a), (play.flange_b, body.flange_a), ground=ground, play=play, body=body)
    result = run(model, 0.2, start={"body.phi": 0.0, "body.w": w_0})
    delta, hit = d / (2 * J), b / 2 / abs(w_0)
    w_d = np.sqrt(c / J - delta**2)
    # c x + d x' = 0 ends the contact
    ends = (np.pi + np.arctan(-d * w_d / (c - d * delta))) / w_d
    inside = np.clip(result.time - hit, 0, ends)
    speed = w_0 * np.exp(-delta * inside) * (np.cos(w_d * inside) - delta / w_d * np.sin(w_d * inside))
    assert hit + ends < 0.15
    assert result["body.w"] == pytest.approx(speed, abs=CLOSE)


class Ratchet(Component):
    """A unit mass that a pawl lets move forward only, m der(v) = -cos(pi t) - f."""

    m: Param = param(unit="kg", default=1.0, min=0)
    f_1: Param = param(unit="N", default=1.0)
    w: Param = param(unit="rad/s", default=np.pi)
    v = var(unit="m/s")

    def equations(self):
        hold = dry_friction(self.v, 0.0, f.BLOCKED)
        yield self.m * der(self.v) == -self.f_1 * ca.cos(self.w * time()) - hold
        yield initial(self.v == 0)


def test_what_is_held_on_one_side_only_leaves_as_soon_as_the_force_turns():
    result = run(Ratchet(), 1.4)
    closed = np.where(result.time < 0.5, 0, (1 - np.sin(np.pi * result.time)) / np.pi)
    assert result["v"] == pytest.approx(closed, abs=CLOSE)


@pytest.mark.parametrize("points", [7, 101, 501, 1501])
def test_a_brake_whose_pressure_fades_between_two_outputs_becomes_free_once(points):
    brake = f.Brake(mu_pos=((0.0, 0.5),), cgeo=0.2, fn_max=3.0)
    model = shaft(brake, press=signals.Sine(amplitude=1.0, f=0.2, phase=np.pi / 2))
    result = run(model, 1.5, start={"body.phi": 0.0, "body.w": 4.0}, points=points)
    # J w' = -0.3 cos(0.4 pi t) up to 1.25 s, where the pressure is cut off at zero
    since = np.minimum(result.time, 1.25)
    assert result["body.w"] == pytest.approx(4.0 - 0.3 / 0.5 * np.sin(0.4 * np.pi * since) / (0.4 * np.pi), abs=CLOSE)
    assert result.n_events == 1


@pytest.mark.parametrize("start", [0.4, -0.4])
@pytest.mark.parametrize("way", ["turning", "sliding"])
def test_what_creeps_slows_down_as_the_closed_form_says_and_never_sticks(way, start):
    if way == "turning":
        ground, body, film, speed = r.Fixed(), r.Inertia(J=0.02), rotational_losses.CreepingFriction(), "w"
        film.tau_c, film.w_r = 0.3, 0.05
    else:
        ground, body, film, speed = t.Fixed(), t.Mass(m=0.02), translational_losses.CreepingFriction(), "v"
        film.f_c, film.v_r = 0.3, 0.05
    ends = [(ground.flange, film.flange_a), (film.flange_b, body.flange_a)]
    model = joined(*ends, ground=ground, film=film, body=body)
    result = run(model, 0.05, start={f"body.{'phi' if way == 'turning' else 's'}": 0.0, f"body.{speed}": start})
    # m v' = -f tanh(v/v_r): sinh(v/v_r) falls as exp(-f t/(m v_r))
    closed = np.arcsinh(np.sinh(start / 0.05) * np.exp(-0.3 * result.time / (0.02 * 0.05))) * 0.05
    assert result[f"body.{speed}"] == pytest.approx(closed, abs=CLOSE)
    assert np.all(result[f"body.{speed}"] * start > 0)
