"""Whether residuals are more than noise, and more than the rounding of a sensor that counts in steps."""

import numpy as np
import pytest

from cartpend_dae.data import von_neumann_z
from cartpend_dae.discover.gate import LIMIT, z_beyond_rounding

Q = 1e-3


def swing(error=0.0):
    """Return a slow swing that comes to rest, and what a sensor of steps Q shows of it, less a model's swing."""
    t = np.linspace(0.0, 15.0, 1501)
    true = np.exp(-t) * np.cos(4 * t) + 0.3 * Q
    return Q * np.round(true / Q) - true * (1 + error)


def test_rounding_is_no_structure_though_it_is_not_white():
    residual = swing()
    assert von_neumann_z(residual) > 3 * LIMIT  # at rest neighbouring errors are alike
    assert z_beyond_rounding(residual, Q) == pytest.approx(0.0, abs=1e-9)


def test_a_parameter_right_to_a_fifth_of_a_step_is_right_enough():
    assert z_beyond_rounding(swing(2e-4), Q) < LIMIT


@pytest.mark.parametrize("error", [2e-3, 1e-2])
def test_an_error_of_a_few_steps_is_structure(error):
    assert z_beyond_rounding(swing(error), Q) > LIMIT


def test_without_steps_it_is_the_ratio_of_von_neumann():
    residual = np.random.default_rng(0).standard_normal(500).cumsum()
    assert z_beyond_rounding(residual, 0.0) == von_neumann_z(residual)


def test_white_noise_of_the_size_of_a_step_stays_white():
    noise = Q * np.random.default_rng(1).standard_normal(2000)
    assert abs(z_beyond_rounding(noise, Q)) < LIMIT
