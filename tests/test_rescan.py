"""A law with a wave starts from the plainer law's fit, with the wave that shows beside that."""

import numpy as np
import pytest

from cartpend_dae import simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover.bases import fit_base, noise_rules
from cartpend_dae.discover.records import FreeSpec, Setup
from cartpend_dae.discover.rescan import rescanned
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.trial import first_fit
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import insert, insertion_at, places
from models.rota_damp import RotaDamp

WAVE = 8.8


@pytest.fixture(scope="module")
def bench():
    friction = {"tau_c": 0.009, "tau_c_sin": -0.0035, "tau_c_cos": 0.006, "n": WAVE}
    model = insert(RotaDamp(), "position_dependent_friction", "bearing", **friction)
    rng, runs = np.random.default_rng(0), []
    for name, angle in (("one", 1.0), ("other", -0.7)):
        run = simulate(model, 15.0, points=1501, start={"bearing.phi": angle})
        noisy = run["bearing.phi"] + 3e-4 * rng.standard_normal(run.time.size)
        channels = {"bearing.phi": Channel(noisy, "zoh", 3e-4, "rad", 0.0)}
        start = {"bearing.phi": Start(angle, None)}
        runs.append(Experiment(name, "train", run.time, {}, channels, start, "free", None))
    return Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), tuple(runs), (), ()))


def test_stops_hide_a_wave_that_shows_beside_the_plainer_law(bench):
    rules = noise_rules(bench, places(RotaDamp(), ("bearing.phi",)), bench.last)
    base = fit_base(bench, (), {}, rules)
    stage = rules.screening
    names = ("coulomb_friction", "position_dependent_friction")
    options = [insertion_at(RotaDamp(), name, "bearing") for name in names]
    screened = screen(bench, (), base.fits[stage].point, options, stage, rules.sd)
    fitted = [first_fit(bench, base, rules, stage, candidate) for candidate in screened]
    rich = next(c for c in fitted if c.insertion.card.id == "position_dependent_friction")
    (again,) = rescanned(bench, base, rules, stage, fitted)
    better = first_fit(bench, base, rules, stage, again)
    assert abs(rich.fit.values["bearing.position_dependent_friction.n"] - WAVE) > 1.0
    assert better.fit.values["bearing.position_dependent_friction.n"] == pytest.approx(WAVE, abs=0.2)
    assert better.fit.chi2 < 0.5 * rich.fit.chi2


def test_only_a_law_with_a_wave_is_looked_at_again(bench):
    rules = noise_rules(bench, places(RotaDamp(), ("bearing.phi",)), bench.last)
    base = fit_base(bench, (), {}, rules)
    options = [insertion_at(RotaDamp(), name, "bearing") for name in ("coulomb_friction", "stribeck_friction")]
    screened = screen(bench, (), base.fits[rules.screening].point, options, rules.screening, rules.sd)
    fitted = [first_fit(bench, base, rules, rules.screening, candidate) for candidate in screened]
    assert rescanned(bench, base, rules, rules.screening, fitted) == []
