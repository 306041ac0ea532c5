"""The step in which a record stands, read from the record."""

import numpy as np
import pytest

from cartpend_dae.discover.grid import grid


def motion(n: int = 2000) -> np.ndarray:
    t = np.linspace(0.0, 10.0, n)
    return np.exp(-0.1 * t) * np.cos(5.3 * t) + 0.1 * t


@pytest.mark.parametrize("step", [0.1, 0.0137, 0.002])
@pytest.mark.parametrize("offset", [0.0, 0.31])
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.15])
def test_a_step_is_found_through_noise(step, offset, noise):
    g = np.random.default_rng(1)
    read = step * (np.round(motion() / step) + offset + noise * g.standard_normal(2000))
    assert grid(read) == pytest.approx(step, rel=2e-3)


@pytest.mark.parametrize("noise", [1e-6, 1e-3, 0.05])
def test_a_smooth_record_has_none(noise):
    read = motion() + noise * np.random.default_rng(2).standard_normal(2000)
    assert grid(read) == 0.0


def test_a_record_that_mostly_rests_has_none():
    read = np.where(np.arange(2000) < 500, motion(), motion()[500])
    assert grid(read + 1e-4 * np.random.default_rng(3).standard_normal(2000)) == 0.0


def test_a_step_is_found_in_a_record_that_mostly_rests_in_a_few_steps():
    rest = np.where(np.arange(2000) < 500, motion(), 0.03 * np.sin(np.arange(2000)))
    read = 0.06 * np.round(rest / 0.06) + 3e-4 * np.random.default_rng(4).standard_normal(2000)
    assert grid(read) == pytest.approx(0.06, rel=2e-3)


def test_a_record_of_few_values_has_none():
    assert grid(np.tile(np.random.default_rng(5).uniform(-1.0, 1.0, 24), 5)) == 0.0


@pytest.mark.parametrize("read", [np.zeros(0), np.ones(50)])
def test_what_does_not_move_has_none(read):
    assert grid(read) == 0.0
