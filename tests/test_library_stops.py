"""Hard stops and dry friction of a guide against closed forms."""

import numpy as np
import pytest
from library_bench import joined
from scipy.integrate import solve_ivp

from cartpend_dae import ModelError, simulate
from cartpend_dae.library import signals as s
from cartpend_dae.library import translational as t
from cartpend_dae.library import translational_friction as tf

FREE = {"F_prop": 0.0, "F_Coulomb": 0.0, "F_Stribeck": 0.0}


def pushed(body, source=None, **parts):
    source = s.Constant(k=0.0) if source is None else source
    force = t.Force()
    joints = [(source.y, force.f), (force.flange, body.flange_a)]
    return joined(*joints, source=source, force=force, body=body, **parts)


def folded(x, half):
    """Position of what flies with x and is reflected at -half and half."""
    return half - np.abs((x + half) % (4 * half) - 2 * half)


def test_between_elastic_stops_it_keeps_its_energy():
    body = tf.MassWithStopAndFriction(m=2.0, L=0.2, smin=-1.1, smax=1.1, e=1.0)
    result = simulate(pushed(body), 10.0, start={"body.s": 0.0, "body.v": 3.0})
    np.testing.assert_allclose(np.abs(result["body.v"]), 3.0, rtol=1e-12)  # nothing brakes: rounding
    np.testing.assert_allclose(result["body.s"], folded(3.0 * result.time, 1.0), rtol=0, atol=1e-9)
    assert np.abs(result["body.s"]).max() <= 1.0 + 1e-9  # as exact as events are located


def test_each_impact_takes_what_the_restitution_says():
    """From 0 with v = 3 between stops at -1 and 1: impacts at 1/3, then 2/(3 e^k) later each, until v < v_small."""
    e, v = 0.7, 3.0
    body = tf.MassWithStopAndFriction(m=2.0, smin=-1.0, smax=1.0, e=e)
    impacts = 1 / 3 + np.concatenate([[0.0], np.cumsum(2 / (v * e ** np.arange(1, 8)))])
    result = simulate(pushed(body), times=[0.0, *(impacts + 1e-3)], start={"body.s": 0.0, "body.v": v})
    expected = v * (-e) ** np.arange(1, 9)
    np.testing.assert_allclose(result["body.v"][1:], expected, rtol=1e-9)


def test_what_is_pushed_against_a_stop_rests_there_and_leaves_when_pulled():
    """Force 2 N for 2 s, then -2 N, m = 1 kg, stop at 1 m: arrives at 1 s, rests, leaves at 2 s."""
    source = s.TimeTable(table=((0.0, 2.0), (2.0, 2.0), (2.0, -2.0)))
    body = tf.MassWithStopAndFriction(m=1.0, smin=-10.0, smax=1.0)
    result = simulate(pushed(body, source), 3.0, start={"body.s": 0.0, "body.v": 0.0})
    time = result.time
    expected = np.where(time < 1.0, time**2, np.where(time < 2.0, 1.0, 1.0 - (time - 2.0) ** 2))
    np.testing.assert_allclose(result["body.s"], expected, rtol=0, atol=1e-8)
    rests = (time > 1.0) & (time < 2.0)
    np.testing.assert_array_equal(result["body.v"][rests], 0.0)
    np.testing.assert_allclose(result["body.f"][rests], 2.0, rtol=1e-12)
    assert set(np.round(result["body.mode"][rests])) == {0.0}


def test_a_bounce_under_a_steady_push_ends_at_the_stop():
    body = tf.MassWithStopAndFriction(m=1.0, smin=-10.0, smax=0.0, e=0.5, v_small=1e-2)
    result = simulate(pushed(body, s.Constant(k=9.81)), 3.0, start={"body.s": -1.0, "body.v": 0.0})
    first = np.sqrt(2 / 9.81)
    # flights of 2 v_k/g with v_k = v 0.5^k until v_k < 0.01
    speeds = np.sqrt(2 * 9.81) * 0.5 ** np.arange(1, 40)
    end = first + 2 / 9.81 * speeds[: np.flatnonzero(speeds / 0.5 <= 1e-2)[0]].sum()
    assert np.all(result["body.s"] <= 1e-9)
    np.testing.assert_array_equal(result["body.v"][result.time > end + 1e-6], 0.0)
    assert np.any(result["body.v"][(result.time > first) & (result.time < end)] != 0.0)


def test_stribeck_friction_brakes_as_its_equation_says():
    body = tf.MassWithStopAndFriction(m=1.5, F_prop=0.4, F_Coulomb=1.0, F_Stribeck=2.0, fexp=3.0)

    def slope(_, v):
        return -(0.4 * v + 1.0 + 2.0 * np.exp(-3.0 * v)) / 1.5

    def stops(_, v):
        return v[0]

    stops.terminal = True
    other = solve_ivp(slope, (0.0, 9.0), [4.0], rtol=1e-11, atol=1e-12, events=stops, dense_output=True)
    rest = other.t_events[0][0]
    result = simulate(pushed(body), 4.0, start={"body.s": 0.0, "body.v": 4.0})
    moving = result.time < rest
    np.testing.assert_allclose(result["body.v"][moving], other.sol(result.time[moving])[0], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(result["body.v"][result.time > rest + 1e-6], 0.0)


@pytest.mark.parametrize("peak", [1.0, 1.5])
def test_a_guide_holds_up_to_its_peak_and_then_slides_at_its_level(peak):
    """Ramp of 1 N/s against K(0) = 2 N: breaks away at t = 2 peak, then m v' = t - K(v)."""
    mass, guide = t.Mass(m=1.0), tf.SupportFriction(f_pos=((0.0, 2.0), (1.0, 1.0), (2.0, 3.0)), peak=peak)
    force, ramp = t.Force(), s.Ramp(height=4.0, duration=4.0)
    joints = [(ramp.y, force.f), (force.flange, mass.flange_a), (mass.flange_b, guide.flange_a)]
    model = joined(*joints, ramp=ramp, force=force, mass=mass, guide=guide)
    result = simulate(model, 4.0, start={"mass.s": 0.0, "mass.v": 0.0})
    other = solve_ivp(
        lambda time, v: time - np.interp(v, [0.0, 1.0, 2.0, 12.0], [2.0, 1.0, 3.0, 23.0]),
        (2.0 * peak, 4.0),
        [0.0],
        rtol=1e-10,
        atol=1e-12,
        dense_output=True,
    )
    stuck = result.time < 2.0 * peak
    np.testing.assert_array_equal(result["mass.v"][stuck], 0.0)
    slides = result.time > 2.0 * peak + 1e-3
    np.testing.assert_allclose(result["mass.v"][slides], other.sol(result.time[slides])[0], rtol=0, atol=1e-5)


def test_a_body_with_stops_that_something_else_moves_is_refused():
    wall, body = t.Fixed(), tf.MassWithStopAndFriction(m=1.0)
    model = joined((wall.flange, body.flange_a), wall=wall, body=body)
    with pytest.raises(ModelError, match=r"`reinit` in `body` names `body\.s`, which is no state"):
        simulate(model, 1.0)
