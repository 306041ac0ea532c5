"""Frames, joints and bodies of the plane: textbook equations, what is conserved, and two formulations that agree."""

import numpy as np
import pytest
from library_bench import CLOSE, joined, run
from scipy.integrate import solve_ivp

from cartpend_dae.language import initial, unknown
from cartpend_dae.library import planar as p
from cartpend_dae.library import rotational as r
from cartpend_dae.library import translational as t

TIGHT = {"rtol": 1e-11, "atol": 1e-13}
M, ROD, LENGTH, G = 0.5, 0.1719, 0.86, 9.81


def cart_and_rod():
    """A cart on a level slider, and a hanging slender rod on a joint of the cart."""
    world, slider, joint = p.World(g=G), p.Prismatic(), p.Revolute()
    cart = p.Body(m=M, g=G)
    rod = p.Body(m=ROD, I=ROD * LENGTH**2 / 12, r_CM_y=-LENGTH / 2, g=G)
    joints = [(world.frame_b, slider.frame_a), (slider.frame_b, cart.frame_a, joint.frame_a)]
    joints += [(joint.frame_b, rod.frame_a)]
    return joined(*joints, world=world, slider=slider, joint=joint, cart=cart, rod=rod)


def test_cart_and_rod_from_joints_are_the_textbook_equations():
    start = {"slider.s": 0.1, "slider.v": -0.3, "joint.phi": 2.5, "joint.w": 1.0}
    result = run(cart_and_rod(), 10.0, points=1001, start=start, **TIGHT)
    S, J = ROD * LENGTH / 2, ROD * LENGTH**2 / 3

    def rates(_, state):
        _, phi, v, w = state
        mass = np.array([[M + ROD, S * np.cos(phi)], [S * np.cos(phi), J]])
        force = np.array([S * np.sin(phi) * w**2, -S * G * np.sin(phi)])
        return [v, w, *np.linalg.solve(mass, force)]

    other = solve_ivp(rates, (0, 10), [0.1, 2.5, -0.3, 1.0], "DOP853", result.time, rtol=1e-12, atol=1e-13).y
    for name, expected in zip(("slider.s", "joint.phi", "slider.v", "joint.w"), other, strict=True):
        # Local errors of 1e-11 over some thousand steps of a motion that doubles its errors each second or two.
        np.testing.assert_allclose(result[name], expected, atol=1e-6)


def test_cart_and_rod_from_joints_are_those_of_the_ready_made_rod():
    start = {"slider.s": 0.1, "slider.v": -0.3, "joint.phi": 2.5, "joint.w": 1.0}
    result = run(cart_and_rod(), 5.0, start=start, **TIGHT)
    cart, rod = t.Mass(m=M), p.HangingRod(m=ROD, l=LENGTH, g=G)
    start = {"cart.s": 0.1, "cart.v": -0.3, "rod.phi": 2.5, "rod.w": 1.0}
    same = run(joined((cart.flange_b, rod.pivot), cart=cart, rod=rod), 5.0, start=start, **TIGHT)
    np.testing.assert_allclose(result["joint.phi"], same["rod.phi"], atol=1e-8)
    np.testing.assert_allclose(result["slider.s"], same["cart.s"], atol=1e-8)


def test_axis_elements_act_like_those_on_a_line():
    """A spring on the slider and a damper on the joint, beside the one-dimensional models."""
    world, slider, cart, spring = p.World(), p.Prismatic(n=(0.6, 0.8)), p.Body(m=2.0, g=0.0), t.Spring(c=50.0)
    joints = [(world.frame_b, slider.frame_a), (slider.frame_b, cart.frame_a)]
    joints += [(slider.support, spring.flange_a), (spring.flange_b, slider.axis)]
    parts = {"world": world, "slider": slider, "cart": cart, "spring": spring}
    result = run(joined(*joints, **parts), 2.0, start={"slider.s": 0.1, "slider.v": 0.0})
    expected = 0.1 * np.cos(5.0 * result.time)
    np.testing.assert_allclose(result["slider.s"], expected, atol=CLOSE)
    np.testing.assert_allclose(result["cart.x"], 0.6 * expected, atol=CLOSE)
    np.testing.assert_allclose(result["cart.y"], 0.8 * expected, atol=CLOSE)

    world, joint, wheel, damper = p.World(), p.Revolute(), p.Body(m=1.0, I=2.0, g=0.0), r.Damper(d=3.0)
    joints = [(world.frame_b, joint.frame_a), (joint.frame_b, wheel.frame_a)]
    joints += [(joint.support, damper.flange_a), (damper.flange_b, joint.axis)]
    parts = {"world": world, "joint": joint, "wheel": wheel, "damper": damper}
    result = run(joined(*joints, **parts), 2.0, start={"joint.phi": 0.0, "joint.w": 0.7})
    np.testing.assert_allclose(result["joint.w"], 0.7 * np.exp(-1.5 * result.time), atol=CLOSE)
    np.testing.assert_allclose(result["joint.a"], -1.5 * result["joint.w"], atol=1e-12)


@pytest.mark.parametrize("axis", [(1.0, 0.0), (0.0, -1.0), (3.0, -4.0)])
def test_a_body_slides_down_its_axis(axis):
    world, slider, body = p.World(), p.Prismatic(n=axis), p.Body(m=2.0)
    joints = [(world.frame_b, slider.frame_a), (slider.frame_b, body.frame_a)]
    start = {"slider.s": 0.0, "slider.v": 0.0}
    result = run(joined(*joints, world=world, slider=slider, body=body), 2.0, start=start)
    down = -axis[1] / np.hypot(*axis)
    np.testing.assert_allclose(result["slider.s"], 9.80665 * down * result.time**2 / 2, atol=100 * CLOSE)
    # What the slider does not let go, the world holds.
    held = result["world.frame_b.f_y"] - (-2.0 * 9.80665 * (1 - down**2))
    np.testing.assert_allclose(held, 0.0, atol=1e-10)


def test_double_pendulum_of_bars_keeps_its_energy():
    world, one, two = p.World(), p.Revolute(), p.Revolute()
    upper = p.BodyShape(m=1.0, I=0.02, r_x=0.5, r_CM_x=0.25)
    bar, lower = p.FixedTranslation(r_x=0.1, r_y=-0.2), p.Body(m=0.7, I=0.01, r_CM_x=0.3)
    joints = [(world.frame_b, one.frame_a), (one.frame_b, upper.frame_a), (upper.frame_b, two.frame_a)]
    joints += [(two.frame_b, bar.frame_a), (bar.frame_b, lower.frame_a)]
    model = joined(*joints, world=world, one=one, two=two, upper=upper, bar=bar, lower=lower)
    start = {"one.phi": 0.3, "one.w": 0.0, "two.phi": 0.4, "two.w": -1.0}
    result = run(model, 10.0, start=start, **TIGHT)
    energy = 0.0
    for name, m, inertia in (("upper", 1.0, 0.02), ("lower", 0.7, 0.01)):
        kinetic = m / 2 * (result[f"{name}.v_x"] ** 2 + result[f"{name}.v_y"] ** 2)
        energy = energy + kinetic + inertia / 2 * result[f"{name}.w"] ** 2 + m * 9.80665 * result[f"{name}.y"]
    assert np.ptp(result["two.phi"]) > 3
    np.testing.assert_allclose(energy, energy[0], atol=1e-7)
    # Positions that the joints leave: the bars keep their lengths, from the angles alone.
    tip = 0.5 * np.cos(result["one.phi"]) + 0.1 * np.cos(total := result["one.phi"] + result["two.phi"])
    tip = tip + 0.2 * np.sin(total) + 0.3 * np.cos(total)
    np.testing.assert_allclose(result["lower.x"], tip, atol=1e-12)


@pytest.mark.parametrize("element", [p.SpringDamper(c=40.0, d=0.8, s_unstretched=0.4), None], ids=["one", "two"])
def test_two_bodies_on_a_spring_and_damper_keep_their_momenta(element):
    """Free in the plane: momentum and moment of momentum stay, and energy is lost in the damper alone."""
    one, two = p.Body(m=1.0, I=0.1, g=0.0), p.Body(m=2.0, I=0.2, g=0.0)
    links = [element] if element else [p.Spring(c=40.0, s_unstretched=0.4), p.Damper(d=0.8)]
    joints = [(one.frame_a, *(link.frame_a for link in links)), (two.frame_a, *(link.frame_b for link in links))]
    named = {f"link{i}": link for i, link in enumerate(links)}
    start = {"one.x": 0.0, "one.y": 0.0, "two.x": 0.7, "two.y": 0.0, "one.v_x": 0.0, "one.v_y": -0.5, "two.v_y": 0.6}
    start |= {"two.v_x": 0.1, "one.phi": 0.2, "one.w": 0.3, "two.phi": 0.0, "two.w": 0.0}
    result = run(joined(*joints, one=one, two=two, **named), 3.0, start=start, **TIGHT)
    bodies = (("one", 1.0, 0.1), ("two", 2.0, 0.2))
    for axis, total in (("x", 0.2), ("y", 0.7)):
        np.testing.assert_allclose(sum(m * result[f"{name}.v_{axis}"] for name, m, _ in bodies), total, atol=1e-9)
    spin = sum(
        m * (result[f"{n}.x"] * result[f"{n}.v_y"] - result[f"{n}.y"] * result[f"{n}.v_x"]) + i * result[f"{n}.w"]
        for n, m, i in bodies
    )
    np.testing.assert_allclose(spin, spin[0], atol=1e-9)
    np.testing.assert_allclose(result["one.w"], 0.3, atol=1e-9)  # the line goes through its centre
    length = np.hypot(result["two.x"] - result["one.x"], result["two.y"] - result["one.y"])
    np.testing.assert_allclose(result["link0.length"], length, atol=1e-12)
    speed = np.gradient(length, result.time, edge_order=2)
    pull = sum(result[f"{name}.f"] for name in named)
    expected = 40.0 * (length - 0.4) + 0.8 * speed
    np.testing.assert_allclose(pull[1:-1], expected[1:-1], atol=2e-2)  # central differences of 15 ms


def test_the_ground_holds_where_it_is():
    ground, body, link = p.Fixed(r_x=0.3, r_y=-0.4), p.Body(m=1.0, I=0.1), p.FixedTranslation(r_x=0.5)
    world, slider = p.World(), p.Revolute()
    joints = [(ground.frame_b, slider.frame_a), (slider.frame_b, link.frame_a), (link.frame_b, body.frame_a)]
    model = joined(*joints, ground=ground, body=body, link=link, world=world, slider=slider)
    result = run(model, 1.0, start={"slider.phi": -np.pi / 2, "slider.w": 0.0})  # hanging at rest
    np.testing.assert_allclose(result["body.x"], 0.3, atol=1e-12)
    np.testing.assert_allclose(result["body.y"], -0.9, atol=1e-12)
    np.testing.assert_allclose(result["ground.frame_b.f_y"], -9.80665, atol=1e-9)


def test_stiffness_is_found_from_rest():
    """A weight that starts at rest 0.2 m below the end of its spring needs c = m g / 0.2 m."""
    world, slider, body, spring = (
        p.World(),
        p.Prismatic(n=(0.0, -1.0)),
        p.Body(m=2.0),
        p.Spring(c=unknown(10.0), s_unstretched=0.3),
    )
    joints = [(world.frame_b, slider.frame_a, spring.frame_a), (slider.frame_b, body.frame_a, spring.frame_b)]
    model = joined(*joints, world=world, slider=slider, body=body, spring=spring)
    model.joints += [initial(slider.s == 0.5), initial(slider.v == 0), initial(slider.a == 0)]
    result = run(model, 1.0)
    np.testing.assert_allclose(result["spring.c"], 2.0 * 9.80665 / 0.2, rtol=1e-10)
    np.testing.assert_allclose(result["slider.s"], 0.5, atol=1e-9)


def test_a_slider_needs_a_direction():
    with pytest.raises(ValueError, match=r"must not be \(0, 0\)"):
        p.Prismatic(n=(0.0, 0.0))
