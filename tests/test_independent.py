"""The independent simulator against closed forms: it must be right before it judges the package."""

import ast
import sys
from pathlib import Path

import independent
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

STIFFNESS, MASS = 1200.0 + 1300.0, 10.0
SYMMETRIC = {"mass": MASS, "stiffness_1": 1200.0, "stiffness_2": 1300.0, "stretch": 0.0}
CLOSE = 1e-9
"""Runge-Kutta at 1e-4 s errs by (omega h)^4/120 of a radian, some 1e-13; the rest is margin."""


def coulomb_oscillation(t, x0, f_c):
    """Half cycles about +-f_c/k that shrink by 2 f_c/k each, until friction holds the spring."""
    w, rest = np.sqrt(STIFFNESS / MASS), f_c / STIFFNESS
    x, turned = np.full_like(t, np.nan), x0
    for k in range(100):
        inside = t >= k * np.pi / w - 1e-12
        if abs(turned) <= rest:
            x[inside] = turned
            break
        centre = np.copysign(rest, turned)
        x[inside] = centre + (turned - centre) * np.cos(w * t[inside] - k * np.pi)
        turned = 2 * centre - turned
    return x


@pytest.mark.parametrize("f_c", [20.0, 35.0, 0.0])
@pytest.mark.parametrize("x0", [0.11, -0.05, 0.001])
def test_coulomb_damped_cart_loses_its_amplitude_linearly_and_sticks(f_c, x0):
    t, x = independent.cart_between_springs(duration=2.0, position=x0, viscous=0.0, coulomb=f_c, **SYMMETRIC)
    np.testing.assert_allclose(x, coulomb_oscillation(t, x0, f_c), rtol=0, atol=CLOSE)


def test_viscous_cart_follows_the_damped_oscillation():
    d, x0 = 48.0, 0.1
    t, x = independent.cart_between_springs(duration=2.0, position=x0, viscous=d, coulomb=0.0, **SYMMETRIC)
    delta = d / (2 * MASS)
    w = np.sqrt(STIFFNESS / MASS - delta**2)
    expected = x0 * np.exp(-delta * t) * (np.cos(w * t) + delta / w * np.sin(w * t))
    np.testing.assert_allclose(x, expected, rtol=0, atol=CLOSE)


def test_the_springs_hold_the_cart_where_their_forces_balance():
    _, x = independent.cart_between_springs(duration=20.0, position=0.1146, viscous=60.0, coulomb=0.0)
    assert x[-1] == pytest.approx(0.095 * (1320.1 - 1197.3) / (1320.1 + 1197.3), abs=CLOSE)


@pytest.mark.parametrize("amplitude", [0.351, 1.5, 3.0])
def test_undamped_pendulum_follows_the_elliptic_functions(amplitude):
    """phi = 2 asin(k sn(K - omega t, k^2)) with k = sin(amplitude/2) and, for a rod, omega^2 = 3 g/(2 l)."""
    t, phi = independent.pendulum(duration=6.0, angle=amplitude, viscous=0.0, coulomb=0.0)
    k, omega = np.sin(amplitude / 2), np.sqrt(1.5 * 9.81 / 0.86)
    expected = 2 * np.arcsin(k * ellipj(ellipk(k**2) - omega * t, k**2)[0])
    np.testing.assert_allclose(phi, expected, rtol=0, atol=CLOSE)


def test_dry_friction_takes_the_energy_that_the_way_costs():
    """m g (l/2) (cos phi_1 - cos phi_0) = tau_c |phi_1 - phi_0| from one turning point to the next."""
    weight, coulomb = 0.1719 * 9.81 * 0.86 / 2, 0.02
    turns = [0.9]
    while weight * np.sin(abs(turns[-1])) > coulomb:
        top, side = abs(turns[-1]), np.sign(turns[-1])

        def left_over(x, top=top):
            return weight * (np.cos(x) - np.cos(top)) / (top - x) - coulomb

        turns.append(side * brentq(left_over, -top, top * (1 - 1e-9), xtol=1e-14))
    _, phi = independent.pendulum(duration=20.0, angle=0.9, viscous=0.0, coulomb=coulomb)
    inner = phi[1:-1]
    peaks = [phi[0], *inner[(inner - phi[:-2]) * (phi[2:] - inner) < 0]]
    assert len(turns) > 15
    assert phi[-1] == pytest.approx(turns[-1], abs=CLOSE)
    # A sample misses a turning point by 5 ms at most, in which the angle moves by a t^2/2 < 2e-4 rad.
    np.testing.assert_allclose(peaks[: len(turns) - 1], turns[:-1], rtol=0, atol=2e-4)


def test_the_result_does_not_depend_on_the_step():
    runs = [
        independent.pendulum(duration=5.0, angle=-1.0, viscous=0.01, coulomb=0.015, step=h)[1] for h in (2e-4, 5e-4)
    ]
    np.testing.assert_allclose(runs[0], runs[1], rtol=0, atol=CLOSE)


def test_samples_are_at_100_hz_and_noise_comes_from_the_generator():
    arguments = {"duration": 5.0, "angle": -0.351, "viscous": 0.04, "coulomb": 0.0, "step": 1e-3}
    t, clean = independent.pendulum(**arguments)
    np.testing.assert_allclose(t, np.arange(501) / 100, rtol=0, atol=1e-12)
    noisy, same = (
        independent.pendulum(**arguments, noise=1e-3, generator=np.random.default_rng(3))[1] for _ in range(2)
    )
    np.testing.assert_array_equal(noisy, same)
    np.testing.assert_allclose(noisy - clean, 1e-3 * np.random.default_rng(3).standard_normal(501), atol=1e-15)


def test_it_imports_nothing_but_numpy_and_the_standard_library():
    tree = ast.parse(Path(independent.__file__).read_text())
    imported = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    imported |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert {name.split(".")[0] for name in imported} - set(sys.stdlib_module_names) == {"numpy"}


MOTOR = {"resistance": 0.739, "inductance": 245e-6, "constant": 0.170, "inertia": 1.2e-4}


def test_motor_without_dry_friction_is_the_matrix_exponential():
    voltage = np.repeat([6.0, -9.0, 0.0, 12.0], 25)
    _, current, speed = independent.dc_motor(voltage=voltage, viscous=1e-4, coulomb=0.0, **MOTOR)
    R, L, k, J = MOTOR.values()
    A = np.array([[-R / L, -k / L, 1 / L], [k / J, -1e-4 / J, 0.0], [0.0, 0.0, 0.0]])
    step, state = expm(A * 5e-4), np.zeros(2)
    for n, u in enumerate(voltage):
        # RK4 with a step of 3 % of the time constant of the winding: 1e-8 in each
        assert (current[n], speed[n]) == pytest.approx(tuple(state), rel=1e-6, abs=1e-6)
        state = (step @ [*state, u])[:2]


def test_motor_sticks_until_its_current_moves_it_and_runs_at_the_speed_that_friction_leaves():
    coulomb, viscous = 0.05, 1e-4
    R, L, k, _ = MOTOR.values()
    small, large = 0.9 * coulomb * R / k, 6.0
    voltage = np.repeat([small, large, 0.0], 100)
    times, current, speed = independent.dc_motor(voltage=voltage, viscous=viscous, coulomb=coulomb, **MOTOR)
    assert np.all(speed[:101] == 0)
    np.testing.assert_allclose(current[:100], small / R * (1 - np.exp(-R / L * times[:100])), rtol=1e-6, atol=1e-9)
    assert speed[200] == pytest.approx((k * large - R * coulomb) / (k**2 + R * viscous), rel=1e-5)
    assert speed[299] == 0
