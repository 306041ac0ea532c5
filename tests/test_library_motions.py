"""Sources of torque, force and motion, and parts without mass, against closed forms."""

import numpy as np
import pytest
from library_bench import CLOSE, joined, run
from scipy.integrate import solve_ivp
from scipy.signal import lti, step

from cartpend_dae.library import rotational as r
from cartpend_dae.library import rotational_parts as rp
from cartpend_dae.library import rotational_sources as rs
from cartpend_dae.library import signals as s
from cartpend_dae.library import thermal
from cartpend_dae.library import translational as t
from cartpend_dae.library import translational_parts as tp
from cartpend_dae.library import translational_sources as ts

KINDS = {
    # module of bodies, of sources and of parts; body; position, speed, effort; nouns of the effort and of two ends
    "rotation": (r, rs, rp, lambda: r.Inertia(J=2.0), "phi", "w", "tau", "Torque", "torque"),
    "translation": (t, ts, tp, lambda: t.Mass(m=2.0), "s", "v", "f", "Force", "force"),
}
both = pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
INERTIA = 2.0


def driven(source, body, **signal):
    """The source at flange a of the body, with a block at its input."""
    joints = [(source.flange, body.flange_a)]
    joints += [(block.y, getattr(source, name)) for name, block in signal.items()]
    return joined(*joints, source=source, body=body, **{f"block_{name}": block for name, block in signal.items()})


@both
def test_constant_and_step_accelerate(kind):
    _, sources, _, make, _x, v, f, Noun, noun = kind
    constant = getattr(sources, f"Constant{Noun}")(**{f"{f}_constant": 3.0})
    result = run(driven(constant, make()), 2.0)
    np.testing.assert_allclose(result[f"body.{v}"], 3.0 / INERTIA * result.time, atol=CLOSE)
    late = getattr(sources, f"{Noun}Step")(**{f"step_{noun}": 3.0, f"offset_{noun}": -1.0, "start_time": 0.5})
    result = run(driven(late, make()), 2.0)
    time = result.time
    expected = (-time + 3.0 * np.maximum(time - 0.5, 0)) / INERTIA
    np.testing.assert_allclose(result[f"body.{v}"], expected, atol=CLOSE)


@both
def test_an_effort_between_two_bodies_keeps_their_momentum(kind):
    _, sources, _, make, _x, v, f, Noun, _ = kind
    between, one, two, push = getattr(sources, {"Torque": "Torque2", "Force": "Force2"}[Noun])(), make(), make(), s.Sine
    source = push(amplitude=2.0, f=0.5)
    joints = [(one.flange_b, between.flange_a), (between.flange_b, two.flange_a), (source.y, getattr(between, f))]
    result = run(joined(*joints, one=one, two=two, between=between, source=source), 2.0)
    expected = 2.0 / INERTIA / np.pi * (1 - np.cos(np.pi * result.time))  # b is accelerated, a is pushed back
    np.testing.assert_allclose(result[f"two.{v}"], expected, atol=CLOSE)
    np.testing.assert_allclose(result[f"one.{v}"], -expected, atol=CLOSE)


@both
@pytest.mark.parametrize("one_way", [True, False])
@pytest.mark.parametrize("v0", [1.5, -1.5])
def test_load_that_is_linear_in_the_speed(kind, one_way, v0):
    _, sources, _, make, x, v, f, Noun, noun = kind
    load = getattr(sources, f"LinearSpeedDependent{Noun}")(
        **{f"{f}_nominal": -4.0, f"{v}_nominal": 2.0, f"{noun}_direction": one_way}
    )
    result = run(driven(load, make()), 2.0, start={f"body.{v}": v0, f"body.{x}": 0.0})
    rate = 4.0 / 2.0 / INERTIA * (np.sign(v0) if one_way else 1)  # in one direction it drives what runs backward
    np.testing.assert_allclose(result[f"body.{v}"], v0 * np.exp(-rate * result.time), rtol=10 * CLOSE)


@both
@pytest.mark.parametrize("v0", [1.5, -0.4])
def test_load_that_is_quadratic_in_the_speed_in_one_direction(kind, v0):
    _, sources, _, make, x, v, f, Noun, _noun = kind
    load = getattr(sources, f"QuadraticSpeedDependent{Noun}")(**{f"{f}_nominal": -4.0, f"{v}_nominal": 2.0})
    result = run(driven(load, make()), 2.0, start={f"body.{v}": v0, f"body.{x}": 0.0})
    b = 4.0 / 2.0**2 / INERTIA
    np.testing.assert_allclose(result[f"body.{v}"], v0 / (1 + b * v0 * result.time), rtol=10 * CLOSE)


def test_torque_with_the_sign_of_the_speed():
    load = rs.SignTorque(tau_nominal=-1.0, w0=10.0)
    result = run(driven(load, r.Inertia(J=2.0)), 2.0, start={"body.w": 0.5, "body.phi": 0.0})
    # d(w)/dt = -tanh(w/0.2)/2, so sinh(w/0.2) decays with the rate 1/(2*0.2)
    expected = 0.2 * np.arcsinh(np.sinh(0.5 / 0.2) * np.exp(-result.time / 0.4))
    np.testing.assert_allclose(result["body.w"], expected, atol=CLOSE)


@both
def test_eddy_current_brake_turns_motion_into_heat(kind):
    _, sources, _, make, x, v, f, Noun, _ = kind
    parameters = {f"{f}_nominal": 6.0, f"{v}_nominal": 2.0, "alpha20": 0.01, "T_ref": 290.0}
    brake, body, disc = getattr(sources, f"EddyCurrent{Noun}")(**parameters), make(), thermal.HeatCapacitor(C=0.5)
    joints = [(brake.flange, body.flange_a), (brake.heat_port, disc.port)]
    model = joined(*joints, brake=brake, body=body, disc=disc)
    result = run(model, 3.0, start={f"body.{v}": 5.0, f"body.{x}": 0.0, "disc.T": 300.0})

    def rates(_, state):
        z = state[0] / (2.0 * (1 + 0.01 * (state[1] - 290.0)))
        effort = 2 * 6.0 * z / (1 + z**2)
        return [-effort / INERTIA, effort * state[0] / 0.5]

    other = solve_ivp(rates, (0, 3), [5.0, 300.0], t_eval=result.time, rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(result[f"body.{v}"], other[0], atol=CLOSE)
    np.testing.assert_allclose(result["disc.T"], other[1], atol=100 * CLOSE)  # of some hundred kelvin
    energy = INERTIA / 2 * result[f"body.{v}"] ** 2 + 0.5 * (result["disc.T"] - 300.0)
    np.testing.assert_allclose(energy, energy[0], atol=100 * CLOSE)


@both
def test_exact_position_needs_the_effort_of_the_acceleration(kind):
    _, sources, _, make, x, v, f, _, _ = kind
    source, wave = sources.Position(exact=True), s.Sine(amplitude=0.3, f=0.5, phase=0.4)
    result = run(driven(source, make(), **{f"{x}_ref": wave}), 2.0)
    angle = np.pi * result.time + 0.4
    # No integration: the structural analysis differentiates the sine, so rounding only.
    np.testing.assert_allclose(result[f"body.{x}"], 0.3 * np.sin(angle), atol=1e-12)
    np.testing.assert_allclose(result[f"body.{v}"], 0.3 * np.pi * np.cos(angle), atol=1e-12)
    np.testing.assert_allclose(result[f"source.flange.{f}"], INERTIA * 0.3 * np.pi**2 * np.sin(angle), atol=1e-11)


@both
def test_exact_speed_needs_the_effort_of_the_acceleration(kind):
    _, sources, _, make, x, v, f, _, _ = kind
    source, wave = sources.Speed(exact=True), s.Sine(amplitude=0.3, f=0.5)
    result = run(driven(source, make(), **{f"{v}_ref": wave}), 2.0)
    angle = np.pi * result.time
    np.testing.assert_allclose(result[f"body.{v}"], 0.3 * np.sin(angle), atol=1e-12)
    np.testing.assert_allclose(result[f"body.{x}"], 0.3 / np.pi * (1 - np.cos(angle)), atol=CLOSE)
    np.testing.assert_allclose(result[f"source.flange.{f}"], -INERTIA * 0.3 * np.pi * np.cos(angle), atol=1e-11)


@both
def test_filtered_position_is_a_bessel_low_pass(kind):
    _, sources, _, make, x, _v, _f, _, _ = kind
    source, jump = sources.Position(f_crit=2.0), s.Step(height=0.5, offset=0.1, start_time=0.5)
    result = run(driven(source, make(), **{f"{x}_ref": jump}), 2.0)
    wc = 2 * np.pi * 2.0
    late = result.time >= 0.5
    _, answer = step(lti([1.0], [0.6180 / wc**2, 1.3617 / wc, 1.0]), T=result.time[late] - 0.5)
    np.testing.assert_allclose(result[f"body.{x}"][~late], 0.1, atol=CLOSE)
    np.testing.assert_allclose(result[f"body.{x}"][late], 0.1 + 0.5 * answer, atol=CLOSE)


@both
def test_filtered_speed_is_a_lag(kind):
    _, sources, _, make, _x, v, _f, _, _ = kind
    source, jump = sources.Speed(f_crit=2.0), s.Step(height=0.5, offset=0.1, start_time=0.5)
    result = run(driven(source, make(), **{f"{v}_ref": jump}), 2.0)
    late = np.maximum(result.time - 0.5, 0.0)
    np.testing.assert_allclose(result[f"body.{v}"], 0.1 - 0.5 * np.expm1(-4 * np.pi * late), atol=CLOSE)


@both
def test_given_acceleration_from_rest(kind):
    _, sources, _, make, x, _v, f, _, _ = kind
    source, constant = sources.Accelerate(), s.Constant(k=0.6)
    result = run(driven(source, make(), a_ref=constant), 2.0)
    np.testing.assert_allclose(result[f"body.{x}"], 0.3 * result.time**2, atol=CLOSE)
    np.testing.assert_allclose(result[f"source.flange.{f}"], -0.6 * INERTIA, atol=1e-12)


def test_constant_speed():
    result = run(driven(rs.ConstantSpeed(w_fixed=3.0), r.Inertia(J=2.0)), 2.0)
    np.testing.assert_allclose(result["body.phi"], 3.0 * result.time, atol=CLOSE)


@pytest.mark.parametrize(
    ("source", "signal"),
    [(rs.Torque2(), "tau"), (r.Torque(use_support=True), "tau"), (rs.Accelerate(use_support=True), "a_ref")],
    ids=lambda x: type(x).__name__ if not isinstance(x, str) else x,
)
def test_the_support_takes_the_reaction(source, signal):
    housing, body, constant = r.Inertia(J=3.0), r.Inertia(J=2.0), s.Constant(k=0.6)
    ends = (source.flange_a, source.flange_b) if isinstance(source, rs.Torque2) else (source.support, source.flange)
    joints = [(housing.flange_b, ends[0]), (ends[1], body.flange_a), (constant.y, getattr(source, signal))]
    result = run(joined(*joints, housing=housing, body=body, source=source, constant=constant), 2.0)
    # Free in space: what the one gains the other loses.
    np.testing.assert_allclose(3.0 * result["housing.w"] + 2.0 * result["body.w"], 0.0, atol=CLOSE)
    assert abs(result["body.w"][-1]) > 0.1


def test_the_housing_of_a_gear_takes_the_difference_of_the_torques():
    motor, load, housing, gear = (
        r.Inertia(J=0.1),
        r.Inertia(J=2.0),
        r.Inertia(J=5.0),
        r.IdealGear(ratio=4.0, use_support=True),
    )
    push = rs.ConstantTorque(tau_constant=1.5)
    joints = [(push.flange, motor.flange_a), (motor.flange_b, gear.flange_a), (gear.flange_b, load.flange_a)]
    joints += [(gear.support, housing.flange_a)]
    result = run(joined(*joints, motor=motor, load=load, housing=housing, gear=gear, push=push), 2.0)
    w_m, w_l, w_h = (result[f"{name}.w"] for name in ("motor", "load", "housing"))
    np.testing.assert_allclose(w_m - w_h, 4.0 * (w_l - w_h), atol=CLOSE)
    # The momentum that the ground gives, and the power that it gives.
    np.testing.assert_allclose(0.1 * w_m + 2.0 * w_l + 5.0 * w_h, 1.5 * result.time, atol=10 * CLOSE)
    work = 1.5 * result["motor.phi"] - 1.5 * result["motor.phi"][0]
    np.testing.assert_allclose((0.1 * w_m**2 + 2.0 * w_l**2 + 5.0 * w_h**2) / 2, work, atol=100 * CLOSE)


def test_wheel_on_housings_that_move():
    wheel = rp.IdealRollingWheel(radius=0.5, use_support_R=True, use_support_T=True)
    rotor, stator, cart, ground = r.Inertia(J=0.2), r.Inertia(J=0.7), t.Mass(m=3.0), t.Mass(m=4.0)
    push, constant = rs.Torque2(), s.Constant(k=1.0)
    joints = [(wheel.flange_R, rotor.flange_a), (wheel.support_R, stator.flange_a)]
    joints += [(wheel.flange_T, cart.flange_a), (wheel.support_T, ground.flange_a)]
    joints += [(push.flange_a, stator.flange_b), (push.flange_b, rotor.flange_b), (constant.y, push.tau)]
    parts = {"wheel": wheel, "rotor": rotor, "stator": stator, "cart": cart, "ground": ground, "push": push}
    result = run(joined(*joints, **parts, constant=constant), 2.0)
    slip = result["cart.v"] - result["ground.v"] - 0.5 * (result["rotor.w"] - result["stator.w"])
    np.testing.assert_allclose(slip, 0.0, atol=CLOSE)
    np.testing.assert_allclose(3.0 * result["cart.v"] + 4.0 * result["ground.v"], 0.0, atol=CLOSE)
    np.testing.assert_allclose(0.2 * result["rotor.w"] + 0.7 * result["stator.w"], 0.0, atol=CLOSE)
    # All the inertia as felt between rotor and stator: two bodies against each other, twice.
    felt = 1 / (1 / 0.2 + 1 / 0.7) + 0.5**2 / (1 / 3.0 + 1 / 4.0)
    np.testing.assert_allclose(result["rotor.w"] - result["stator.w"], result.time / felt, atol=CLOSE)


def test_planetary_gear_with_a_held_ring():
    gear, sun, load, held = rp.IdealPlanetary(ratio=3.0), r.Inertia(J=0.1), r.Inertia(J=2.0), r.Fixed()
    push = rs.ConstantTorque(tau_constant=1.0)
    joints = [(push.flange, sun.flange_a), (sun.flange_b, gear.sun), (gear.carrier, load.flange_a)]
    joints += [(gear.ring, held.flange)]
    result = run(joined(*joints, gear=gear, sun=sun, load=load, held=held, push=push), 2.0)
    # With the ring held it is a gear of 1 + ratio, and the ring holds ratio times the sun's torque.
    expected = result.time / (0.1 + 2.0 / 4.0**2)
    np.testing.assert_allclose(result["sun.w"], expected, atol=100 * CLOSE)
    np.testing.assert_allclose(result["load.w"], expected / 4.0, atol=100 * CLOSE)
    sun_torque = 1.0 - 0.1 * result["sun.a"]
    np.testing.assert_allclose(result["gear.ring.tau"], 3.0 * sun_torque, atol=1e-11)


@both
def test_relative_states_and_sensors_are_no_load(kind):
    bodies, _sources, parts, make, x, v, _f, Noun, _ = kind
    noun = {"Torque": "Angle", "Force": "Position"}[Noun]
    one, two, spring = make(), make(), bodies.Spring(c=30.0)
    relative, acceleration = parts.RelativeStates(), parts.AccelerationSensor()
    angle, speed, power = getattr(parts, f"Relative{noun}Sensor")(), parts.RelativeSpeedSensor(), parts.PowerSensor()
    joints = [(one.flange_b, relative.flange_a, angle.flange_a, speed.flange_a, power.flange_a, acceleration.flange)]
    joints += [(power.flange_b, spring.flange_a)]
    joints += [(spring.flange_b, two.flange_a, relative.flange_b, angle.flange_b, speed.flange_b)]
    named = {"one": one, "two": two, "spring": spring, "relative": relative, "angle": angle, "speed": speed}
    model = joined(*joints, **named, power=power, acceleration=acceleration)
    result = run(model, 2.0, start={f"one.{x}": 0.0, f"one.{v}": 0.0, f"two.{x}": 0.2, f"two.{v}": 0.0})
    w = np.sqrt(30.0 * 2 / INERTIA)
    expected = 0.2 * np.cos(w * result.time)
    for name in (f"relative.{x}_rel", f"angle.{x}_rel", f"spring.{x}_rel"):
        np.testing.assert_allclose(result[name], expected, atol=CLOSE)
    rate = -0.2 * w * np.sin(w * result.time)
    np.testing.assert_allclose(result[f"relative.{v}_rel"], rate, atol=10 * CLOSE)
    np.testing.assert_allclose(result[f"speed.{v}_rel"], rate, atol=10 * CLOSE)
    np.testing.assert_allclose(result["relative.a_rel"], -(w**2) * expected, atol=100 * CLOSE)
    np.testing.assert_allclose(result["acceleration.a"], result["one.a"], atol=1e-12)
    # The spring pulls body one forward; the power goes from it into the spring.
    given = -INERTIA * result["one.a"] * result[f"one.{v}"]
    np.testing.assert_allclose(result["power.power"], given, atol=1e-10)


@pytest.mark.parametrize("side", [1, -1])
def test_play_with_a_full_damper_pushes_until_the_pull_would_begin(side):
    J, c, d, b, middle, depth = 2.0, 50.0, 3.0, 0.2, 0.7, 0.05
    body, element, ground = r.Inertia(J=J), rp.ElastoBacklash2(c=c, d=d, b=b, phi_rel0=middle), r.Fixed()
    joints = [(ground.flange, element.flange_a), (element.flange_b, body.flange_a)]
    start = {"body.phi": middle + side * (b / 2 + depth), "body.w": 0.0}
    result = run(joined(*joints, body=body, element=element, ground=ground), 1.0, start=start)
    delta = d / (2 * J)
    w = np.sqrt(c / J - delta**2)

    def contact(time):
        fall = np.exp(-delta * time) * depth
        x = fall * (np.cos(w * time) + delta / w * np.sin(w * time))
        v = -fall * (w + delta**2 / w) * np.sin(w * time)
        return x, v

    fine = np.linspace(0.0, 1.0, 1000001)
    x, v = contact(fine)
    end = fine[np.argmax(c * x + d * v <= 0)]  # before the gap opens, as the damper pulls
    x, v = contact(np.minimum(result.time, end))
    np.testing.assert_allclose(
        side * (result["body.phi"] - middle), b / 2 + x + v * np.maximum(result.time - end, 0), atol=1e-5
    )
    assert 0 < end < 0.5


@pytest.mark.parametrize("n", [1.0, 1.5])
def test_one_sided_contact_gives_back_the_energy_that_its_spring_took(n):
    body, gap, ground = t.Mass(m=2.0), tp.ElastoGap(c=500.0, d=0.0, n=n, s_rel0=0.1), t.Fixed()
    joints = [(ground.flange, gap.flange_a), (gap.flange_b, body.flange_a)]
    start = {"body.s": 0.4, "body.v": -1.0}
    result = run(joined(*joints, body=body, gap=gap, ground=ground), 1.0, start=start)
    depth = np.maximum(0.1 - result["body.s"], 0.0)
    np.testing.assert_allclose(result["gap.f"], -500.0 * depth**n, atol=1e-9)
    energy = result["body.v"] ** 2 + 500.0 * depth ** (n + 1) / (n + 1)
    np.testing.assert_allclose(energy, 1.0, atol=10 * CLOSE)
    assert result["body.v"][-1] == pytest.approx(1.0, abs=10 * CLOSE)
