"""A pendulum that sticks and one that does not, from a simulator that shares no code: 20 noise seeds each."""

import independent
import numpy as np
import pytest

from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover import FreeSpec, Setup, discover
from models.rota_damp import RotaDamp

# one worker of pytest-xdist, because the 20 discoveries are shared by three tests
pytestmark = pytest.mark.xdist_group("pendulum")

SEEDS = range(20)
NOISE = 1e-3
RELEASE, VISCOUS, COULOMB, DURATION = 0.6, 0.015, 0.012, 6.0


def clean_run(coulomb):
    """Return times and angles without noise, the same for all seeds."""
    return independent.pendulum(duration=DURATION, angle=RELEASE, viscous=VISCOUS, coulomb=coulomb)


def noisy_setup(run, seed, noise=NOISE):
    times, angles = run
    measured = angles + noise * np.random.default_rng(seed).standard_normal(angles.size)
    channel = Channel(measured, "zoh", None, "rad", 0.0)
    start = {"bearing.phi": Start(None, True), "bearing.w": Start(0.0, False)}
    experiment = Experiment("release", "train", times, {}, {"bearing.phi": channel}, start, "free", None)
    return Setup(RotaDamp(), (FreeSpec("bearing.d", guess=0.03, lower=0.0, upper=1.0),), (experiment,), (), ())


@pytest.fixture(scope="module")
def sticking():
    return clean_run(COULOMB)


@pytest.fixture(scope="module")
def sliding():
    return clean_run(0.0)


@pytest.fixture(scope="module")
def found(sticking):
    return [discover(noisy_setup(sticking, seed)) for seed in SEEDS]


def test_coulomb_friction_at_the_bearing_is_named_for_every_seed(found):
    for discovery in found:
        named = [(s.candidate.insertion.card.id, s.candidate.insertion.place.at) for s in discovery.search.steps]
        assert named == [("coulomb_friction", "bearing")]
        assert discovery.search.verdict == "explained"


def test_its_level_is_within_three_standard_deviations_in_19_of_20(found):
    estimates = [discovery.search.final.parameters[-1] for discovery in found]
    assert all(estimate.name == "bearing.coulomb_friction.tau_c" for estimate in estimates)
    inside = sum(abs(estimate.value - COULOMB) <= 3 * estimate.sd for estimate in estimates)
    assert inside >= 19


def test_the_stated_sd_is_the_scatter_over_seeds(found):
    values = np.array([[e.value for e in discovery.search.final.parameters] for discovery in found])
    stated = np.array([[e.sd for e in discovery.search.final.parameters] for discovery in found])
    # the sd of 20 values scatters by 16 %; three of these sds either way
    ratio = values.std(axis=0, ddof=1) / stated.mean(axis=0)
    assert np.all((ratio > 0.5) & (ratio < 1.5))


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_is_added_where_nothing_is_missing(sliding, seed):
    outcome = discover(noisy_setup(sliding, seed)).search
    assert outcome.verdict == "no-discrepancy"
    assert not outcome.steps
    viscous = outcome.final.parameters[0]
    assert abs(viscous.value - VISCOUS) < 4 * viscous.sd


def test_the_result_does_not_depend_on_the_number_of_processes(sticking, found):
    shared = discover(noisy_setup(sticking, SEEDS[0]), jobs=2).search
    alone = found[0].search
    assert shared.final.values == alone.final.values
    names = [candidate.insertion.prefix for candidate in alone.candidates]
    assert [candidate.insertion.prefix for candidate in shared.candidates] == names
    assert [c.gain for c in shared.candidates] == [c.gain for c in alone.candidates]
    assert [c.why_not for c in shared.candidates] == [c.why_not for c in alone.candidates]
