"""A search against random forces has explained the runs only if the free simulation is explained, too."""

from dataclasses import replace

import numpy as np
import pytest
from test_discovery_choice import bench, plain_fit  # noqa: F401

from cartpend_dae.discover import verdict as module
from cartpend_dae.discover.bases import noise_rules
from cartpend_dae.discover.evidence import cancelled
from cartpend_dae.discover.state import Base
from cartpend_dae.discover.verdict import compared, is_told_freely, verdict
from cartpend_dae.effects import insertion_at, places
from cartpend_dae.uncertainty import Estimate
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


def test_an_effect_that_the_free_simulation_leaves_at_nothing_is_out_of_the_model(bench, plain_fit, bases, monkeypatch):  # noqa: F811
    rules, _ = bases
    taken = tuple(insertion_at(RotaDamp(), effect, "bearing") for effect in ("coulomb_friction", "quadratic_drag"))
    starts = {name: value for insertion in taken for name, value in insertion.starts.items()}
    both = Base(taken, {2.0: bench.fit(taken, starts, (2.0,), rules.sd)})
    monkeypatch.setattr(module, "is_absent", lambda fit, insertion: insertion is taken[1])
    start, base = compared(bench, Base((), {0.0: plain_fit}), Base((), {2.0: both.fit}), both, rules)
    assert start.fit is plain_fit and base.taken == taken[:1]
    assert not any("quadratic_drag" in name for name in base.fit.values)


@pytest.mark.parametrize(
    ("r", "sign", "is_refused"), [(0.999, 1, True), (-0.999, -1, True), (0.999, -1, False), (0.9, 1, False)]
)
def test_effects_that_take_each_other_back_are_refused(plain_fit, r, sign, is_refused):  # noqa: F811
    """A linear spring and teeth were named for a cubic spring, of which they left noise alone."""
    spring, teeth = (insertion_at(RotaDamp(), effect, "bearing") for effect in ("linear_stiffness", "added_inertia"))
    values = {spring.size_names[0]: 0.3, teeth.size_names[0]: sign * 0.02}
    estimates = tuple(Estimate(name, value, 1e-3, "1", "ok") for name, value in values.items())
    fit = replace(plain_fit, parameters=estimates, starts=(), covariance=1e-6 * np.array([[1.0, r], [r, 1.0]]))
    for one, other in ((spring, teeth), (teeth, spring)):
        assert bool(cancelled(fit, one, (other,))) == is_refused
    if is_refused:
        assert f"`{teeth.prefix}`" in cancelled(fit, spring, (teeth,))
    assert not cancelled(fit, spring, ())
