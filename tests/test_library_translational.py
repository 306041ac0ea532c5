import numpy as np
import pytest
from library_bench import (
    CLOSE,
    EFFECTS,
    MOTIONS,
    Domain,
    check_coulomb_damped_oscillation,
    check_effect_of_parameter_zero_is_none,
    check_motion_under_one_element,
    check_power_and_momentum_between_two_bodies,
    held,
    joined,
    oscillation,
    run,
)

from cartpend_dae.library import translational as t

DOMAIN = Domain(t, "Mass", "m", "s", "v", "f", "RailFriction")


@pytest.mark.parametrize("motion", MOTIONS, ids=str)
def test_motion_under_one_element_is_the_closed_form(motion):
    check_motion_under_one_element(DOMAIN, motion)


@pytest.mark.parametrize("motion", MOTIONS, ids=str)
def test_elements_store_or_dissipate_and_keep_the_momentum(motion):
    check_power_and_momentum_between_two_bodies(DOMAIN, motion)


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_with_its_parameter_at_zero_is_absent(effect):
    check_effect_of_parameter_zero_is_none(DOMAIN, effect)


@pytest.mark.parametrize("element", [t.CoulombFriction(f_c=0.75), t.RailFriction(f_c=0.75)], ids=["effect", "rail"])
def test_amplitude_under_coulomb_friction_falls_linearly(element):
    check_coulomb_damped_oscillation(DOMAIN, element)


def test_free_fall():
    mass, weight = t.Mass(m=2.0), t.Force()
    model = joined((mass.flange_a, weight.flange), mass=mass, weight=weight)
    fall = run(model, 1.5, inputs={"weight.f": -2.0 * 9.81}, start={"mass.s": 10.0, "mass.v": 3.0})
    # A parabola is integrated exactly but for rounding and the error control: CLOSE of some ten metres.
    np.testing.assert_allclose(fall["mass.s"], 10 + 3 * fall.time - 9.81 / 2 * fall.time**2, rtol=CLOSE)
    np.testing.assert_allclose(fall["mass.v"], 3 - 9.81 * fall.time, rtol=0, atol=10 * CLOSE)
    np.testing.assert_allclose(fall["mass.a"], -9.81, rtol=1e-12)  # no integration: rounding


def test_static_friction_holds_a_load_below_its_level_and_slips_above():
    mass, force, rail = t.Mass(m=2.0), t.Force(), t.RailFriction(f_c=4.0)
    model = held(t, mass, rail=rail)
    model.force = force
    model.joints += joined((force.flange, mass.flange_a)).joints
    start = {"body.s": 0.0, "body.v": 0.0}
    stuck = run(model, 1.0, inputs={"force.f": 3.0}, start=start)
    np.testing.assert_allclose(stuck["body.s"], 0.0, atol=1e-12)  # exact sticking: no creep, rounding only
    np.testing.assert_allclose(stuck["rail.f"], 3.0, rtol=1e-9)
    slipping = run(model, 1.0, inputs={"force.f": 5.0}, start=start)
    np.testing.assert_allclose(slipping["body.s"], (5.0 - 4.0) / (2 * 2.0) * slipping.time**2, atol=CLOSE)


def test_drive_accelerates_by_its_gain_and_reacts_on_the_ground():
    mass, drive = t.Mass(m=95.0), t.Drive(k=35.15)
    model = joined((mass.flange_a, drive.flange), mass=mass, drive=drive)
    result = run(model, 1.0, inputs={"drive.u": -2.0}, start={"mass.s": 0.0, "mass.v": 0.0})
    np.testing.assert_allclose(result["mass.v"], -2.0 * 35.15 / 95.0 * result.time, atol=CLOSE)
    np.testing.assert_allclose(result["drive.f"], -70.3, rtol=1e-12)  # rounding
    np.testing.assert_allclose(result["drive.flange.f"], 70.3, rtol=1e-12)


def test_a_fixed_point_sets_where_a_spring_is_at_rest():
    mass, spring, ground = t.Mass(m=2.0), t.Spring(c=50.0, s_rel0=0.3), t.Fixed(s0=1.0)
    model = joined(
        (ground.flange, spring.flange_a),
        (spring.flange_b, mass.flange_a),
        mass=mass,
        spring=spring,
        ground=ground,
    )
    result = run(model, 2.0, start={"mass.s": 1.4, "mass.v": 0.0})
    expected = oscillation(2.0, 1.4, 0.0, result.time, 50.0, x_rel0=1.3)
    np.testing.assert_allclose(result["mass.s"], expected, atol=CLOSE)
    # The ground carries what the spring pulls: flows point into the component.
    np.testing.assert_allclose(result["ground.flange.f"], result["spring.f"], rtol=1e-12, atol=1e-12)


def test_bodies_on_a_rod_move_as_one_and_the_sensors_read_what_is_true():
    left, right, rod, force = t.Mass(m=2.0), t.Mass(m=3.0), t.Rod(L=0.4), t.Force()
    cut, position, speed = t.ForceSensor(), t.PositionSensor(), t.SpeedSensor()
    model = joined(
        (force.flange, left.flange_a),
        (left.flange_b, rod.flange_a),
        (rod.flange_b, cut.flange_a),
        (cut.flange_b, right.flange_a, position.flange, speed.flange),
        left=left,
        right=right,
        rod=rod,
        force=force,
        cut=cut,
        position=position,
        speed=speed,
    )
    result = run(model, 2.0, inputs={"force.f": 10.0}, start={"left.s": 0.1, "left.v": -0.5})
    expected = 0.1 - 0.5 * result.time + 10.0 / (2 * 5.0) * result.time**2
    np.testing.assert_allclose(result["left.s"], expected, atol=CLOSE)
    np.testing.assert_allclose(result["rod.s"], expected + 0.2, atol=CLOSE)
    np.testing.assert_allclose(result["position.s"], expected + 0.4, atol=CLOSE)
    np.testing.assert_allclose(result["speed.v"], -0.5 + 2.0 * result.time, atol=CLOSE)
    # What is passed on accelerates the right body alone, 3 kg of 5 kg: rounding only.
    np.testing.assert_allclose(result["cut.f"], 10.0 * 3.0 / 5.0, rtol=1e-12)
    np.testing.assert_allclose(result["right.flange_a.f"], result["cut.f"], rtol=1e-12)
