"""A search against random forces has explained the runs only if the free simulation is explained, too."""

from dataclasses import replace

import pytest
from test_discovery_choice import bench, plain_fit  # noqa: F401

from cartpend_dae.discover.bases import noise_rules
from cartpend_dae.discover.state import Base
from cartpend_dae.discover.verdict import compared, is_told_freely, verdict
from cartpend_dae.effects import insertion_at, places
from models.rota_damp import RotaDamp


@pytest.fixture(scope="module")
def bases(bench):  # noqa: F811
    """The model without friction, and with effects, at some injection, as a search against forces leaves it."""
    rules = replace(noise_rules(bench, places(RotaDamp()), 0.0), regime="forces")

    def make(effect=None):
        taken = () if effect is None else (insertion_at(RotaDamp(), effect, "bearing"),)
        starts = taken[0].starts if taken else {}
        return Base(taken, {2.0: bench.fit(taken, starts, (2.0,), rules.sd)})

    return rules, make


def test_a_right_effect_takes_the_error_of_the_free_simulation(bench, plain_fit, bases):  # noqa: F811
    rules, make = bases
    start, base = compared(bench, Base((), {0.0: plain_fit}), make(), make("coulomb_friction"), rules)
    assert start.fit is plain_fit and 0.0 in base.fits
    assert is_told_freely(bench, start, base)


@pytest.mark.parametrize("effect", ["added_inertia", "quadratic_drag", None])
def test_what_leaves_most_of_the_error_of_the_free_simulation_explains_nothing(bench, plain_fit, bases, effect):  # noqa: F811
    """A clock that runs wrong had been claimed for a gap: forces took all that was left, the free error hardly fell."""
    rules, make = bases
    start, base = compared(bench, Base((), {0.0: plain_fit}), make(), make(effect), rules)
    assert not is_told_freely(bench, start, base)


def test_effects_beside_which_something_is_left_only_improve():
    assert [verdict(True, True), verdict(True, False)] == ["improved", "explained"]
    assert [verdict(False, True), verdict(False, False)] == ["unexplained", "unexplained"]
