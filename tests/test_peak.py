"""A dry friction that leaves nothing but noise gets its peak at rest, where the data tell one."""

import numpy as np
import pytest
from test_couples import made_of

from cartpend_dae import simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover.bases import noise_rules
from cartpend_dae.discover.gate import is_noise_alone
from cartpend_dae.discover.peak import with_peak_at_rest
from cartpend_dae.discover.records import FreeSpec, Setup
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import catalogue, insert, places
from models.rota_damp import RotaDamp

LAWS = ("coulomb_friction", "stribeck_friction", "breakaway_friction")


def rubbing(effect, **values):
    """A rod with a friction, and what the laws of its contact are."""
    hidden = insert(RotaDamp(), effect, "bearing", **values)
    run = simulate(hidden, 12.0, points=1201, start={"bearing.phi": 1.2}, parameters={"bearing.d": 0.01})
    noisy = run["bearing.phi"] + 3e-4 * np.random.default_rng(0).standard_normal(run.time.size)
    channels = {"bearing.phi": Channel(noisy, "zoh", 3e-4, "rad", 0.0)}
    experiment = Experiment("run", "train", run.time, {}, channels, {"bearing.phi": Start(1.2, None)}, "free", None)
    bench = Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), (experiment,), (), ()))
    cards = tuple(card for card in catalogue() if card.id in LAWS)
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
