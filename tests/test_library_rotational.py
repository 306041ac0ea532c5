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
from scipy.special import ellipj, ellipk

from cartpend_dae import assemble
from cartpend_dae.library import rotational as r
from cartpend_dae.library import translational as t

DOMAIN = Domain(r, "Inertia", "J", "phi", "w", "tau", "BearingFriction")
G = 9.81


@pytest.mark.parametrize("motion", MOTIONS, ids=str)
def test_motion_under_one_element_is_the_closed_form(motion):
    check_motion_under_one_element(DOMAIN, motion)


@pytest.mark.parametrize("motion", MOTIONS, ids=str)
def test_elements_store_or_dissipate_and_keep_the_angular_momentum(motion):
    check_power_and_momentum_between_two_bodies(DOMAIN, motion)


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_with_its_parameter_at_zero_is_absent(effect):
    check_effect_of_parameter_zero_is_none(DOMAIN, effect)


@pytest.mark.parametrize(
    "element", [r.CoulombFriction(tau_c=0.75), r.BearingFriction(tau_c=0.75)], ids=["effect", "bearing"]
)
def test_amplitude_under_coulomb_friction_falls_linearly(element):
    check_coulomb_damped_oscillation(DOMAIN, element)


def rod_on_bearing(rod, bearing):
    ground = r.Fixed()
    return joined(
        (ground.flange, bearing.flange_a),
        (bearing.flange_b, rod.flange),
        ground=ground,
        bearing=bearing,
        rod=rod,
    )


@pytest.mark.parametrize("phi0", [0.01, 1.0, 2.0, 3.0])
def test_pendulum_swings_as_the_elliptic_functions_say(phi0):
    m, length = 0.1719, 0.86
    k2 = np.sin(phi0 / 2) ** 2
    w0 = np.sqrt(1.5 * G / length)  # a slender rod: J = m l^2/3, its weight acts at l/2
    period = 4 * ellipk(k2) / w0
    swing = run(
        rod_on_bearing(r.SlenderRod(m=m, l=length), r.BearingFriction()),
        period,
        start={"bearing.phi": phi0, "bearing.w": 0.0},
    )
    _, cn, dn, _ = ellipj(w0 * swing.time, k2)
    expected = 2 * np.arcsin(np.sin(phi0 / 2) * cn / dn)
    # Near the upper rest position errors grow as exp(w0 t), some 50 times at phi0 = 3.
    np.testing.assert_allclose(swing["bearing.phi"], expected, rtol=0, atol=50 * CLOSE)
    assert swing["rod.phi"][-1] == pytest.approx(phi0, abs=50 * CLOSE)
    # No bearing friction: J w^2/2 - m g l/2 cos phi stays.
    energy = m * length**2 / 6 * swing["rod.w"] ** 2 - m * G * length / 2 * np.cos(swing["rod.phi"])
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=CLOSE)


def test_small_swings_take_the_time_of_the_harmonic_oscillator():
    length, phi0 = 0.86, 0.01
    period = 2 * np.pi * np.sqrt(2 * length / (3 * G))
    swing = run(
        rod_on_bearing(r.SlenderRod(m=1.0, l=length), r.BearingFriction()),
        period,
        start={"rod.phi": phi0, "rod.w": 0.0},
    )
    # The period grows by phi0^2/16, so the phase of sin is off by 2 pi phi0^2/16 at most.
    atol = phi0 * 2 * np.pi * phi0**2 / 16 + CLOSE * phi0
    np.testing.assert_allclose(swing["rod.phi"], phi0 * np.cos(2 * np.pi / period * swing.time), rtol=0, atol=atol)


def test_a_rod_held_aside_needs_the_torque_of_its_weight():
    rod, motor = r.SlenderRod(m=0.3, l=0.5, g=1.62), r.Torque()
    weight = 0.3 * 1.62 * 0.5 / 2 * np.sin(0.7)
    result = run(
        joined((motor.flange, rod.flange), motor=motor, rod=rod),
        2.0,
        inputs={"motor.tau": weight},
        start={"rod.phi": 0.7, "rod.w": 0.0},
    )
    np.testing.assert_allclose(result["rod.phi"], 0.7, rtol=0, atol=CLOSE)


def test_bearing_friction_stops_the_pendulum_where_its_weight_no_longer_moves_it():
    rod, bearing = r.SlenderRod(m=0.1719, l=0.86), r.BearingFriction(d=0.02, tau_c=0.05)
    result = run(rod_on_bearing(rod, bearing), 10.0, start={"rod.phi": 0.5, "rod.w": 0.0})
    np.testing.assert_allclose(result["rod.w"][-50:], 0.0, atol=CLOSE)
    weight = 0.1719 * G * 0.86 / 2 * np.sin(result["rod.phi"][-1])
    assert abs(weight) <= 0.05
    np.testing.assert_allclose(result["bearing.tau"][-50:], -weight, rtol=0, atol=CLOSE)


def test_inertia_under_torque_and_the_sensors():
    left, right, motor = r.Inertia(J=0.2), r.Inertia(J=0.3), r.Torque()
    cut, angle, speed = r.TorqueSensor(), r.AngleSensor(), r.SpeedSensor()
    model = joined(
        (motor.flange, left.flange_a),
        (left.flange_b, cut.flange_a),
        (cut.flange_b, right.flange_a),
        (right.flange_b, angle.flange, speed.flange),
        left=left,
        right=right,
        motor=motor,
        cut=cut,
        angle=angle,
        speed=speed,
    )
    result = run(model, 2.0, inputs={"motor.tau": 4.0}, start={"left.phi": 0.1, "left.w": -0.5})
    np.testing.assert_allclose(result["angle.phi"], 0.1 - 0.5 * result.time + 4.0 * result.time**2, atol=CLOSE * 10)
    np.testing.assert_allclose(result["speed.w"], -0.5 + 8.0 * result.time, atol=CLOSE * 10)
    # What is passed on accelerates the right inertia alone, 0.3 of 0.5 kg m2: rounding only.
    np.testing.assert_allclose(result["cut.tau"], 4.0 * 0.3 / 0.5, rtol=1e-12)


def test_a_fixed_angle_sets_where_a_spring_is_at_rest():
    body, spring, ground = r.Inertia(J=2.0), r.Spring(c=50.0, phi_rel0=0.3), r.Fixed(phi0=1.0)
    model = joined(
        (ground.flange, spring.flange_a),
        (spring.flange_b, body.flange_a),
        body=body,
        spring=spring,
        ground=ground,
    )
    result = run(model, 2.0, start={"body.phi": 1.4, "body.w": 0.0})
    np.testing.assert_allclose(
        result["body.phi"], oscillation(2.0, 1.4, 0.0, result.time, 50.0, x_rel0=1.3), atol=CLOSE
    )


@pytest.mark.parametrize("ratio", [5.0, -0.2])
def test_gear_reflects_the_load_by_the_square_of_its_ratio(ratio):
    motor, rotor, gear, load = r.Torque(), r.Inertia(J=0.2), r.IdealGear(ratio=ratio), r.Inertia(J=3.0)
    model = joined(
        (motor.flange, rotor.flange_a),
        (rotor.flange_b, gear.flange_a),
        (gear.flange_b, load.flange_a),
        motor=motor,
        rotor=rotor,
        gear=gear,
        load=load,
    )
    result = run(model, 1.0, inputs={"motor.tau": 1.5}, start={"load.phi": 0.0, "load.w": 0.0})
    a = 1.5 / (0.2 + 3.0 / ratio**2)
    np.testing.assert_allclose(result["rotor.a"], a, rtol=1e-12)  # algebra: rounding only
    np.testing.assert_allclose(result["rotor.phi"], a / 2 * result.time**2, atol=CLOSE)
    np.testing.assert_allclose(result["load.phi"], a / 2 / ratio * result.time**2, atol=CLOSE)
    power = result["gear.flange_a.tau"] * result["rotor.w"] + result["gear.flange_b.tau"] * result["load.w"]
    np.testing.assert_allclose(power, 0.0, atol=1e-12)  # without loss: rounding only


@pytest.mark.parametrize(
    ("wheel", "ratio"),
    [(r.Sprocket(r=0.05), 20.0), (r.Sprocket(r=-0.05), -20.0), (r.IdealGearR2T(ratio=84.9), 84.9)],
    ids=["sprocket", "reversed sprocket", "gear"],
)
def test_rotation_becomes_translation_without_loss(wheel, ratio):
    motor, rotor, cart = r.Torque(), r.Inertia(J=0.002), t.Mass(m=4.609)
    model = joined(
        (motor.flange, rotor.flange_a),
        (rotor.flange_b, wheel.flange_R),
        (wheel.flange_T, cart.flange_a),
        motor=motor,
        rotor=rotor,
        wheel=wheel,
        cart=cart,
    )
    result = run(model, 1.0, inputs={"motor.tau": 0.5}, start={"cart.s": 0.0, "cart.v": 0.0})
    a = 0.5 * ratio / (4.609 + 0.002 * ratio**2)  # inertia reflected to the cart, in kg
    np.testing.assert_allclose(result["cart.a"], a, rtol=1e-12)
    np.testing.assert_allclose(result["cart.s"], a / 2 * result.time**2, atol=CLOSE)
    np.testing.assert_allclose(result["rotor.w"], ratio * a * result.time, rtol=0, atol=100 * CLOSE)  # up to 200 rad/s
    power = result["wheel.flange_R.tau"] * result["rotor.w"] + result["wheel.flange_T.f"] * result["cart.v"]
    np.testing.assert_allclose(power, 0.0, atol=1e-10)  # rounding of some ten watts


def test_dry_friction_exists_only_where_its_level_is_not_the_number_zero():
    assert r.BearingFriction(d=1.0).is_zero("tau_c")
    assert not r.BearingFriction(tau_c=0.1).is_zero("tau_c")

    def places(bearing):
        return assemble(held(r, r.Inertia(J=1.0), bearing=bearing)).frictions.places

    assert places(r.BearingFriction(d=1.0)) == ()
    assert places(r.BearingFriction(d=1.0, tau_c=0.1)) == ("bearing",)
