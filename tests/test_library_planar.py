"""The rod on a sliding pivot: conserved quantities, and what it becomes where the pivot is held or free."""

import numpy as np
import pytest
from library_bench import joined
from scipy.integrate import solve_ivp

from cartpend_dae import simulate
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.planar import HangingRod

ROD = {"m": 0.1719, "l": 0.86, "g": 9.81}
M = 0.5
S, J = ROD["m"] * ROD["l"] / 2, ROD["m"] * ROD["l"] ** 2 / 3
START = {"cart.s": 0.1, "cart.v": -0.3, "rod.phi": 2.5, "rod.w": 1.0}


def rod_on(**others):
    parts = {"cart": translational.Mass(m=M)} | others
    rod = HangingRod(**ROD)
    return joined((parts["cart"].flange_b, rod.pivot), rod=rod, **parts)


def swing(model, duration=10.0, start=START):
    return simulate(model, duration, points=1001, start=start, rtol=1e-11, atol=1e-13)


def test_energy_and_momentum_of_a_free_cart_and_rod_stay():
    run = swing(rod_on())
    v, phi, w = (run[name] for name in ("cart.v", "rod.phi", "rod.w"))
    momentum = (M + ROD["m"]) * v + S * np.cos(phi) * w
    kinetic = (M + ROD["m"]) / 2 * v**2 + S * np.cos(phi) * v * w + J / 2 * w**2
    energy = kinetic - S * ROD["g"] * np.cos(phi)
    assert np.ptp(phi) > 5  # it swings over the top or nearly so: all terms matter
    # Local errors of 1e-11 over some thousand steps, against energies of about 1 J.
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(momentum, momentum[0], rtol=0, atol=1e-7)


def test_the_motion_is_that_of_the_hand_derived_equations():
    def rate(_, x):
        _, v, phi, w = x
        mass = [[M + ROD["m"], S * np.cos(phi)], [S * np.cos(phi), J]]
        force = [S * np.sin(phi) * w**2, -S * ROD["g"] * np.sin(phi)]
        return [v, *np.linalg.solve(mass, force)[:1], w, np.linalg.solve(mass, force)[1]]

    run = swing(rod_on(), duration=5.0)
    exact = solve_ivp(rate, (0, 5), list(START.values()), method="DOP853", t_eval=run.time, rtol=1e-12, atol=1e-13)
    # Two integrators of a tolerance of 1e-11 and less; the motion over the top magnifies their errors.
    for name, expected in zip(START, exact.y, strict=True):
        np.testing.assert_allclose(run[name], expected, rtol=0, atol=1e-7)


def test_on_a_held_pivot_it_is_the_slender_rod():
    wall, rod, shaft = translational.Fixed(), HangingRod(**ROD), rotational.SlenderRod(**ROD)
    held = joined((wall.flange, rod.pivot), wall=wall, rod=rod)
    start = {"rod.phi": 2.5, "rod.w": 1.0}
    one, two = (swing(model, 5.0, start) for model in (held, joined(rod=shaft)))
    np.testing.assert_allclose(one["rod.phi"], two["rod.phi"], rtol=0, atol=1e-8)
    # What holds the pivot is the centrifugal and inertial force of the rod along the line.
    along = S * (np.cos(two["rod.phi"]) * two["rod.a"] - np.sin(two["rod.phi"]) * two["rod.w"] ** 2)
    np.testing.assert_allclose(one["rod.pivot.f"], along, rtol=0, atol=1e-7)


def test_small_swings_have_the_frequency_of_cart_and_rod_against_each_other():
    omega = np.sqrt(S * ROD["g"] * (M + ROD["m"]) / (J * (M + ROD["m"]) - S**2))
    run = swing(rod_on(), 3.0, {"cart.s": 0.0, "cart.v": 0.0, "rod.phi": 1e-4, "rod.w": 0.0})
    # The error of the linearisation is of the order of the angle cubed, 1e-12.
    np.testing.assert_allclose(run["rod.phi"], 1e-4 * np.cos(omega * run.time), rtol=0, atol=1e-10)


def test_the_tip_moves_towards_positive_s():
    run = swing(rod_on(), 0.1, {"cart.s": 0.0, "cart.v": 0.0, "rod.phi": 0.0, "rod.w": 1.0})
    assert run["rod.phi"][-1] > 0
    # The rod's mass moves towards +s, so the cart falls behind; the momentum is that of the start.
    assert run["cart.v"][-1] == pytest.approx(S * (1 - np.cos(run["rod.phi"][-1]) * run["rod.w"][-1]) / (M + ROD["m"]))
