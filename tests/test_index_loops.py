"""Closed loops whose best states change along the motion, through full turns, against minimal coordinates.

The constraints of a slider-crank and of a four-bar linkage give none of the joint angles with a constant coefficient.
So more angles are states than there are degrees of freedom, and the constraints are kept as invariants.
"""

import numpy as np
import pytest
from library_bench import joined
from scipy.integrate import solve_ivp

from cartpend_dae import assemble, simulate
from cartpend_dae.library import planar as p
from cartpend_dae.library.rotational_sources import ConstantSpeed, ConstantTorque

G = 9.81
R, L = 0.1, 0.3
CRANK, ROD, PISTON = (1.0, 0.01), (0.5, 0.004), 0.8
"""Mass and moment of inertia about the centre."""


def slope(function, x):
    """Derivative of an analytic function of one variable, by a complex step: to rounding."""
    return np.imag(function(x + 1e-20j)) / 1e-20


def shape(length, mass, inertia):
    return p.BodyShape(m=mass, I=inertia, r_x=length, r_CM_x=length / 2, g=G)


def slider_crank(**more):
    world, crank, rod = p.World(g=G), shape(R, *CRANK), shape(L, *ROD)
    turn, pin, wrist, slider, piston = p.Revolute(), p.Revolute(), p.Revolute(), p.Prismatic(), p.Body(m=PISTON, g=G)
    joints = [(world.frame_b, turn.frame_a, slider.frame_a), (turn.frame_b, crank.frame_a)]
    joints += [(crank.frame_b, pin.frame_a), (pin.frame_b, rod.frame_a), (rod.frame_b, wrist.frame_b)]
    joints += [(wrist.frame_a, slider.frame_b, piston.frame_a)]
    if "source" in more:
        joints += [(more["source"].flange, turn.axis)]
    named = {"turn": turn, "pin": pin, "wrist": wrist, "slider": slider}
    return joined(*joints, world=world, crank=crank, rod=rod, piston=piston, **named, **more)


def rod_angle(phi):
    return np.arcsin(-R * np.sin(phi) / L)


def stroke(phi):
    return R * np.cos(phi) + np.sqrt(L**2 - R**2 * np.sin(phi) ** 2)


def inertia_of_crank(phi):
    """Reduced inertia about the crank shaft, from the motion of each centre of mass per angle of the crank."""
    turn = slope(rod_angle, phi)
    x = slope(lambda a: R * np.cos(a) + L / 2 * np.cos(rod_angle(a)), phi)
    y = slope(lambda a: R * np.sin(a) + L / 2 * np.sin(rod_angle(a)), phi)
    own = CRANK[1] + CRANK[0] * R**2 / 4
    return own + ROD[0] * (x**2 + y**2) + ROD[1] * turn**2 + PISTON * slope(stroke, phi) ** 2


def height_energy(phi):
    return G * (CRANK[0] * R / 2 * np.sin(phi) + ROD[0] * (R * np.sin(phi) + L / 2 * np.sin(rod_angle(phi))))


def crank_rates(_, state):
    phi, w = state
    step = 1e-5
    bend = (inertia_of_crank(phi + step) - inertia_of_crank(phi - step)) / (2 * step)  # to 1e-10
    return [w, -(bend * w**2 / 2 + slope(height_energy, phi)) / inertia_of_crank(phi)]


START = {"turn.phi": 0.3, "turn.w": 20.0, "pin.phi": rod_angle(0.3) - 0.3}


def test_a_free_slider_crank_has_one_degree_of_freedom_and_two_angles_as_states():
    system = assemble(slider_crank())
    assert len(system.states) == 4
    assert {"turn.phi", "turn.w"} < set(system.states)
    assert system.algebraics == ()
    assert system.invariants.numel() == 2


def test_a_free_slider_crank_follows_its_minimal_coordinate():
    result = simulate(slider_crank(), 5.0, points=501, start=START, rtol=1e-10, atol=1e-12)
    assert result["turn.phi"][-1] > 10 * 2 * np.pi
    exact = solve_ivp(crank_rates, (0, 5), [0.3, 20.0], "DOP853", result.time, rtol=1e-11, atol=1e-12).y
    # Local errors of 1e-10 over ten thousand steps, in speeds of 20 rad/s.
    np.testing.assert_allclose(result["turn.phi"], exact[0], atol=1e-4)
    np.testing.assert_allclose(result["turn.w"], exact[1], atol=1e-4)
    np.testing.assert_allclose(result["slider.s"], stroke(exact[0]), atol=1e-5)


@pytest.mark.slow
def test_a_slider_crank_keeps_its_constraint_and_energy_through_thousands_of_dead_centres():
    result = simulate(slider_crank(), 1000.0, points=20001, start=START, rtol=1e-8)
    phi, w = result["turn.phi"], result["turn.w"]
    assert phi[-1] > 1000 * 2 * np.pi
    np.testing.assert_allclose(result["slider.s"], stroke(phi), rtol=0, atol=1e-6)
    energy = inertia_of_crank(phi) * w**2 / 2 + height_energy(phi)
    # LSODA at the same tolerance loses 2e-4 of it in the minimal coordinate: it is the method that loses it.
    assert np.ptp(energy) < 1e-3 * energy[0]


def test_a_slider_crank_that_swings_about_its_lower_rest_keeps_its_energy():
    """Too slow for a turn: the crank comes back, and the best states with it."""
    start = START | {"turn.phi": -np.pi / 2 + 1.0, "turn.w": 0.0, "pin.phi": rod_angle(1 - np.pi / 2) - 1 + np.pi / 2}
    result = simulate(slider_crank(), 20.0, points=2001, start=start, rtol=1e-10, atol=1e-12)
    phi, w = result["turn.phi"], result["turn.w"]
    assert np.ptp(phi) < 2 * np.pi
    energy = inertia_of_crank(phi) * w**2 / 2 + height_energy(phi)
    np.testing.assert_allclose(energy, energy[0], atol=1e-6)


@pytest.mark.parametrize("w", [20.0, -3.0])
def test_a_slider_crank_turned_at_a_given_speed_has_no_freedom_left(w):
    """The angle is prescribed, and the torque is what the reduced inertia and the weights need."""
    source = ConstantSpeed(w_fixed=w)
    result = simulate(slider_crank(source=source), 3.0, points=301, start=START | {"turn.w": w}, rtol=1e-9)
    phi = START["turn.phi"] + w * result.time
    np.testing.assert_allclose(result["turn.phi"], phi, atol=1e-7)
    np.testing.assert_allclose(result["slider.s"], stroke(phi), atol=1e-7)
    bend = (inertia_of_crank(phi + 1e-5) - inertia_of_crank(phi - 1e-5)) / 2e-5
    torque = bend * w**2 / 2 + slope(height_energy, phi)
    # Differences of inertias of 1e-2 over 2e-5, times 400: 1e-7; and the angle's error.
    np.testing.assert_allclose(-result["source.flange.tau"], torque, atol=1e-5)


# --- four bars

BASE, BARS = 0.4, {"crank": (0.1, 0.5, 0.002), "coupler": (0.35, 0.7, 0.008), "rocker": (0.3, 0.6, 0.005)}
"""Distance of the two bearings; length, mass and moment of inertia of each bar. The crank can turn (Grashof)."""


def four_bars(**more):
    world, far = p.World(g=G), p.Fixed(r_x=BASE)
    crank, coupler, rocker = (shape(*bar) for bar in BARS.values())
    turn, pin, other, rock = p.Revolute(), p.Revolute(), p.Revolute(), p.Revolute()
    joints = [(world.frame_b, turn.frame_a), (turn.frame_b, crank.frame_a), (crank.frame_b, pin.frame_a)]
    joints += [(pin.frame_b, coupler.frame_a), (coupler.frame_b, other.frame_b), (other.frame_a, rocker.frame_b)]
    joints += [(rocker.frame_a, rock.frame_b), (rock.frame_a, far.frame_b)]
    if "source" in more:
        joints += [(more["source"].flange, turn.axis)]
    parts = {"crank": crank, "coupler": coupler, "rocker": rocker, "turn": turn, "pin": pin, "other": other}
    return joined(*joints, world=world, far=far, rock=rock, **parts, **more)


def angles(phi):
    """Absolute angles of coupler and rocker: the upper point of intersection of two circles."""
    a, c, b = (BARS[name][0] for name in ("crank", "coupler", "rocker"))
    x, y = BASE - a * np.cos(phi), -a * np.sin(phi)
    square = x**2 + y**2
    along = (square + c**2 - b**2) / (2 * square)
    across = np.sqrt(c**2 / square - along**2)
    tip_x, tip_y = along * x - across * y, along * y + across * x  # from the crank's tip
    # arctan2 is not analytic: from the half angle instead
    coupler = 2 * np.arctan(tip_y / (c + tip_x))
    rocker = 2 * np.arctan((tip_y - y) / (b + tip_x - x))
    return coupler, rocker


def centres(phi):
    a, c, b = (BARS[name][0] for name in ("crank", "coupler", "rocker"))
    coupler, rocker = angles(phi)
    return (
        (a / 2 * np.cos(phi), a / 2 * np.sin(phi), phi),
        (a * np.cos(phi) + c / 2 * np.cos(coupler), a * np.sin(phi) + c / 2 * np.sin(coupler), coupler),
        (BASE + b / 2 * np.cos(rocker), b / 2 * np.sin(rocker), rocker),
    )


def energy_of_bars(phi, w):
    total = 0.0
    for k, (_, mass, inertia) in enumerate(BARS.values()):
        x, y, turn = (slope(lambda a, k=k, i=i: centres(a)[k][i], phi) for i in range(3))
        total = total + (mass * (x**2 + y**2) + inertia * turn**2) * w**2 / 2 + mass * G * centres(phi)[k][1]
    return total


def start_of_bars(phi, w):
    coupler, rocker = angles(phi)
    return {"turn.phi": phi, "turn.w": w, "pin.phi": coupler - phi, "rock.phi": rocker, "other.phi": coupler - rocker}


@pytest.mark.slow
def test_four_bars_close_and_keep_their_energy_through_hundreds_of_turns():
    result = simulate(four_bars(), 1000.0, points=10001, start=start_of_bars(0.5, 12.0), rtol=1e-8)
    phi, w = result["turn.phi"], result["turn.w"]
    assert phi[-1] > 500 * 2 * np.pi
    coupler, rocker = angles(phi)
    np.testing.assert_allclose(result["rock.phi"], rocker, atol=1e-6)
    np.testing.assert_allclose(result["coupler.phi"], coupler, atol=1e-6)
    energy = energy_of_bars(phi, w)
    assert np.ptp(energy) < 1e-3 * energy[0]


def test_a_torque_on_four_bars_does_its_work():
    source = ConstantTorque(tau_constant=3.0)
    result = simulate(four_bars(source=source), 1.0, points=301, start=start_of_bars(0.5, 0.0), rtol=1e-10, atol=1e-12)
    phi = result["turn.phi"]
    work = energy_of_bars(phi, result["turn.w"]) - 3.0 * (phi - phi[0])
    # Local errors of 1e-10 over ten thousand steps, of the work that was done.
    assert np.ptp(work) < 1e-6 * 3.0 * np.ptp(phi)
    assert np.ptp(phi) > 2 * np.pi
