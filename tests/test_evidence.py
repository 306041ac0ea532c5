"""What makes one model better than another: in which units, and how surely."""

from types import SimpleNamespace

import numpy as np
import pytest

from cartpend_dae.discover import choice, disturbed, gate
from cartpend_dae.discover.evidence import lead, leaves_clearly_less
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.workbench import last_bandwidth
from cartpend_dae.effects import catalogue, insertion_at
from models.rota_damp import RotaDamp


def fit_of(*residuals, sd=1.0):
    runs = tuple(SimpleNamespace(residual=np.asarray(one, dtype=float).reshape(-1, 1)) for one in residuals)
    return SimpleNamespace(
        runs=runs, weights_sd=np.array([sd]), chi2=sum(float(np.sum((np.asarray(one) / sd) ** 2)) for one in residuals)
    )


def test_a_fit_that_is_better_in_all_blocks_leads_and_one_that_is_better_in_a_single_one_does_not():
    noise = np.random.default_rng(0).standard_normal(1000)
    bump = np.zeros(1000)
    bump[100:150] = 30.0
    assert lead(fit_of(noise), fit_of(3 * noise)) > 10
    assert leaves_clearly_less(fit_of(noise), fit_of(1.3 * noise))
    assert leaves_clearly_less(fit_of(noise), fit_of(noise + bump))
    assert not leaves_clearly_less(fit_of(noise), fit_of(noise + bump / 10))
    assert lead(fit_of(noise), fit_of(noise + bump)) < 2
    assert lead(fit_of(3 * noise), fit_of(noise)) < -10


def test_the_lead_does_not_depend_on_units_nor_on_values_that_are_missing():
    noise = np.random.default_rng(1).standard_normal(1000)
    some = np.where(np.arange(1000) % 7, noise, np.nan)
    before = lead(fit_of(some, noise), fit_of(2 * some, 3 * noise))
    after = lead(fit_of(1e-3 * some, 1e-3 * noise, sd=1e-3), fit_of(2e-3 * some, 3e-3 * noise, sd=1e-3))
    assert after == pytest.approx(before, rel=1e-9) and np.isfinite(before)


@pytest.mark.parametrize(("z", "share"), [(3.0, choice.ALIKE_SHARE), (2.0, choice.ALIKE_WHITE)])
def test_percent_of_chi2_are_percent_of_the_residuals_in_bic_however_large_chi2_is(monkeypatch, z, share):
    """BIC has n ln chi2: a model that leaves some percent less gains as many of n, also where chi2 is 1000 times n."""
    monkeypatch.setattr(gate, "residuals", lambda fit: SimpleNamespace(largest=z))
    insertion = SimpleNamespace(size_names=(), complexity=1, card=SimpleNamespace(parameters=()))
    found = [
        choice._margin(candidate, candidate)
        for chi2 in (1e3, 1e6)
        for candidate in [SimpleNamespace(insertion=insertion, fit=SimpleNamespace(chi2=chi2, n_residuals=2000))]
    ]
    assert found == [share * 2000] * 2


def test_predictions_are_compared_where_an_observer_forgets_within_their_horizon():
    free, ahead = SimpleNamespace(horizon=None), SimpleNamespace(horizon=0.5)
    assert last_bandwidth((free,)) == 0.0
    # damped by 0.7, an error falls as exp(-0.7 w t): to 5 % within the horizon
    assert np.exp(-0.7 * last_bandwidth((free, ahead)) * 0.5) == pytest.approx(0.05, rel=0.02)


def test_an_effect_in_series_that_contains_another_one_is_known():
    def is_composite(name):
        cards = [card for card in catalogue() if card.id == name]
        return any(disturbed.is_composite(SimpleNamespace(card=card)) for card in cards)

    assert is_composite("chain_tension_friction")
    assert not any(map(is_composite, ("compliance", "backlash", "gear_loss", "asymmetric_friction")))


def test_what_grows_beyond_all_numbers_against_forces_is_told_and_not_judged():
    insertion = insertion_at(RotaDamp(), "quadratic_drag", "bearing")
    candidate = Candidate(insertion, insertion.starts, 0.0, 0.0, 0.0, None, "")
    base = SimpleNamespace(linear=100.0)
    # products of residual and column, and their lengths: -r.c is 3 of |r|^2 = 10, so that 9 are explained
    good = np.array([[10.0, -3.0], [-3.0, 1.0], [1.0, 1.0]])
    known = disturbed._predicted(candidate, [1], [good], np.zeros(1), 50, base)
    assert known.parameters["bearing.quadratic_drag.d2"] == pytest.approx(3.0)
    lost = disturbed._predicted(candidate, [1], [good, np.full((3, 2), np.nan)], np.zeros(2), 50, base)
    assert (lost.predicted, lost.why_not) == (0.0, disturbed.LOST)
