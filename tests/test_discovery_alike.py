"""What the catalogue knows beforehand of effects that act alike, beside an answer."""

from dataclasses import replace

import numpy as np
from test_discover_pendulum import clean_run, noisy_setup

from cartpend_dae.discover import Workbench, refit
from cartpend_dae.discover.alike import known_alike
from cartpend_dae.effects import insertion_at
from cartpend_dae.report.text import alias_sentence
from models.rota_damp import RotaDamp


def test_an_effect_that_acts_alike_under_a_condition_is_named_unless_the_runs_refute_it():
    bench = Workbench(noisy_setup(clean_run(0.05), 0))
    found = refit(bench, (insertion_at(RotaDamp(), "linear_stiffness", "bearing"),))
    step = replace(found.steps[0], candidate=replace(found.steps[0].candidate, gain=500.0))
    other = replace(step.candidate, insertion=insertion_at(RotaDamp(), "imbalance", "bearing"), gain=0.0, fit=None)
    seen = replace(other, response=np.ones(3))
    search = replace(found, steps=(step,), candidates=(step.candidate, seen))
    (name,) = known_alike(search, step)
    assert name == "imbalance at bearing"
    assert alias_sentence(search)[-1].startswith(
        "Known to act like `bearing.linear_stiffness` under a condition: imbalance at bearing (small angles"
    )
    refuted = replace(step.candidate, insertion=other.insertion, gain=100.0)
    assert not known_alike(replace(search, candidates=(refuted,)), step)
    assert not known_alike(replace(search, candidates=(other,)), step)  # no sensor sees it
    alias = replace(step, aliases=("imbalance at bearing",))
    assert not known_alike(replace(search, steps=(alias,)), alias)
