"""A dry friction that leaves nothing but noise gets its peak at rest, where the data tell one."""

import numpy as np
import pytest
from test_couples import made_of

from cartpend_dae import simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover import peak
from cartpend_dae.discover.bases import noise_rules
from cartpend_dae.discover.gate import is_noise_alone
from cartpend_dae.discover.peak import with_peak_at_rest
from cartpend_dae.discover.records import FreeSpec, Setup
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import catalogue, insert, places
from models.rota_damp import RotaDamp

LAWS = ("coulomb_friction", "stribeck_friction", "breakaway_friction")


def rubbing(effect, laws=LAWS, noise=3e-4, angles=(1.2,), **values):
    """A rod with a friction, let go at some angles, and what the laws of its contact are."""
    hidden, random, runs = insert(RotaDamp(), effect, "bearing", **values), np.random.default_rng(0), []
    for angle in angles:
        run = simulate(hidden, 12.0, points=1201, start={"bearing.phi": angle}, parameters={"bearing.d": 0.01})
        noisy = run["bearing.phi"] + noise * random.standard_normal(run.time.size)
        channels = {"bearing.phi": Channel(noisy, "zoh", noise, "rad", 0.0)}
        start = {"bearing.phi": Start(angle, None)}
        runs.append(Experiment(f"run{len(runs)}", "train", run.time, {}, channels, start, "free", None))
    bench = Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), tuple(runs), (), ()))
    cards = tuple(card for card in catalogue() if card.id in laws)
    where = places(RotaDamp(), ("bearing.phi",), cards)
    return bench, noise_rules(bench, where, 0.0), (cards, where)


@pytest.mark.parametrize(("tau_s", "law"), [(0.03015, "stribeck_friction"), (0.03, "coulomb_friction")])
def test_friction_gets_the_peak_that_the_data_tell_and_no_other(tau_s, law):
    bench, rules, library = rubbing("stribeck_friction", tau_c=0.03, tau_s=tau_s, w_s=0.5, d=0.0)
    base, steps = made_of(bench, rules, ("coulomb_friction", "bearing"), tau_c=0.03)
    assert is_noise_alone(base.fit)
    after, found = with_peak_at_rest(bench, base, steps, rules, library)
    assert [step.candidate.insertion.card.id for step in found] == [law]
    if law == "coulomb_friction":
        assert after is base
    else:
        assert after.fit.chi2 < base.fit.chi2 - 20
        assert after.fit.values["bearing.stribeck_friction.tau_s"] == pytest.approx(tau_s, rel=0.02)


@pytest.mark.parametrize(("r_f", "law"), [(0.001, "load_dependent_friction"), (0.0, "coulomb_friction")])
def test_where_a_peak_is_told_all_richer_laws_of_the_contact_are_tried(monkeypatch, r_f, law):
    """A Stribeck curve had taken the place of friction by the load, which leaves less with fewer parameters."""
    laws = (*LAWS, "load_dependent_friction")
    hidden = {"tau_c": 0.002 - 2 * r_f, "r_f": r_f}
    bench, rules, library = rubbing("load_dependent_friction", laws, 1e-3, (1.2, -0.46), **hidden)
    base, steps = made_of(bench, rules, ("coulomb_friction", "bearing"), tau_c=0.002)
    monkeypatch.setattr(peak, "is_noise_alone", lambda fit: True)  # as it is of longer runs under more noise
    after, found = with_peak_at_rest(bench, base, steps, rules, library)
    assert [step.candidate.insertion.card.id for step in found] == [law]
    assert (after.fit.chi2 < 1.05 * after.fit.n_residuals) and (after is base) == (r_f == 0)


def test_a_peak_is_looked_for_beside_a_law_that_none_with_a_peak_contains(monkeypatch):
    """Friction by the position had left noise alone, 1,682 of 1,602, where a Stribeck curve leaves 1,631."""
    laws = (*LAWS, "position_dependent_friction")
    bench, rules, library = rubbing("stribeck_friction", laws, 1e-3, tau_c=0.02, tau_s=0.03, w_s=0.5, d=0.0)
    base, steps = made_of(bench, rules, ("position_dependent_friction", "bearing"), tau_c=0.02, tau_c_cos=0.005, n=2.0)
    monkeypatch.setattr(peak, "is_noise_alone", lambda fit: True)
    after, found = with_peak_at_rest(bench, base, steps, rules, library)
    assert [step.candidate.insertion.card.id for step in found] == ["stribeck_friction"]
    assert after.fit.chi2 < base.fit.chi2 - 20
