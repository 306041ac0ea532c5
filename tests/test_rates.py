"""Data made from the outcome of a search, the search repeated on them, and what would tell rival answers apart."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from test_discover_pendulum import COULOMB, NOISE, clean_run, noisy_setup

from cartpend_dae.discover import Workbench, discover, refit, splits
from cartpend_dae.discover.rates import made_anew
from cartpend_dae.discover.split import Split, _fit_known, _on_the_same_steps, still_alike
from cartpend_dae.discover.trial import too_little
from cartpend_dae.effects import catalogue, insertion_at
from cartpend_dae.experiment_design import Plan
from models.rota_damp import RotaDamp

pytestmark = pytest.mark.xdist_group("rates")

CARDS = tuple(card for card in catalogue() if card.id in ("coulomb_friction", "constant_load", "quadratic_drag"))


@pytest.fixture(scope="module")
def bench():
    return Workbench(noisy_setup(clean_run(COULOMB), 2))


@pytest.fixture(scope="module")
def right(bench):
    return refit(bench, (insertion_at(RotaDamp(), "coulomb_friction", "bearing"),))


def test_refit_is_the_model_with_the_effects_that_were_chosen(right):
    assert right.verdict == "explained"
    friction = right.final.values["bearing.coulomb_friction.tau_c"]
    assert friction == pytest.approx(COULOMB, rel=0.02)
    assert right.baseline.chi2 > 100 * right.final.chi2


def test_data_made_anew_are_the_model_and_its_noise(bench, right):
    taken = tuple(step.candidate.insertion for step in right.steps)
    (run,) = made_anew(bench.problem(taken), right.final, [0, 1])
    (old,) = bench.setup.train
    predicted = old.outputs["bearing.phi"].values - right.final.runs[0].residual[:, 0]
    noise = run.outputs["bearing.phi"].values - predicted
    # the sd of 600 values scatters by 3 %
    assert noise.std() == pytest.approx(NOISE, rel=0.15)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.15
    (same,) = made_anew(bench.problem(taken), right.final, [0, 1])
    np.testing.assert_array_equal(run.outputs["bearing.phi"].values, same.outputs["bearing.phi"].values)


def test_innovations_move_the_states_where_the_fit_is_of_predictions(bench, right):
    """Made with injection, the data carry disturbances: a free simulation is off by far more than the innovations."""
    taken = tuple(step.candidate.insertion for step in right.steps)
    fit = bench.fit(taken, right.final.point, (30.0,), bench.problem(taken).prior_sd)
    larger = replace(fit, weights_sd=10 * fit.weights_sd)
    (run,) = made_anew(bench.problem(taken), larger, [0, 1])
    (old,) = bench.setup.train
    free = old.outputs["bearing.phi"].values - right.final.runs[0].residual[:, 0]
    off = run.outputs["bearing.phi"].values - free
    assert off.std() > 1.5 * 10 * NOISE
    assert np.corrcoef(off[1:], off[:-1])[0, 1] > 0.5


def test_placebo_adds_nothing_and_power_finds_it_again():
    found = discover(noisy_setup(clean_run(COULOMB), 6), cards=CARDS, placebo=2, power=2)
    placebo, power = found.beyond.rates
    assert (placebo.removed, placebo.n, placebo.hits) == (None, 2, 0)
    assert (power.removed, power.n, power.hits) == ("bearing.coulomb_friction", 2, 2)
    assert power.sentence == (
        "Where `bearing.coulomb_friction` is missing, it was found again in 2 of 2 data sets made so."
    )


def test_experiments_that_tell_nothing_are_said_to():
    assert Split("bearing.a", "bearing.b", (("release", 0.43), ("step", 0.0))).sentence == (
        "None of 2 experiments tells `bearing.a` from `bearing.b` (evidence of 0.4 at most, where 20 would tell): "
        "another sensor is needed."
    )
    assert Split("bearing.a", "bearing.b", (("release", 2.3e-20), ("step", 0.0))).sentence == (
        "`bearing.b` is `bearing.a` in other words: none of 2 experiments differs."
    )


@pytest.mark.parametrize(("distance", "written"), [(43.21, "43"), (1114.0, "1,110"), (1.954e6, "1,950,000")])
def test_evidence_is_written_without_an_exponent(distance, written):
    said = Split("bearing.a", "bearing.b", (("release", distance),)).sentence
    assert said == f"To tell `bearing.a` from `bearing.b`, record: release (evidence about {written})."


def test_what_gains_nothing_rises_by_no_minus_zero():
    assert too_little(-1e-9) == "BIC stays as it is"
    assert too_little(-3.21) == "BIC rises by 3.2"
    assert too_little(7.0).startswith("BIC falls by 7.0, less than")


def drag_as_rival(bench):
    """Return the search that names Coulomb friction, with quadratic drag, fitted in its place, as a rival."""
    friction, drag = (
        refit(bench, (insertion_at(RotaDamp(), effect, "bearing"),))
        for effect in ("coulomb_friction", "quadratic_drag")
    )
    step = replace(friction.steps[0], aliases=("quadratic_drag at bearing",))
    return replace(friction, steps=(step,), candidates=(drag.steps[0].candidate,)), drag.final


def test_no_experiment_is_planned_for_a_rival_that_the_runs_refute(bench):
    search, drag = drag_as_rival(bench)
    assert drag.chi2 > 100 * search.final.chi2
    (told,) = splits(bench, search)
    assert told.ranking == () and told.times is not None and told.times > 4
    assert "these runs tell them apart" in told.sentence
    # ... and the answer no longer says that it may be the rival; other rivals stay
    both = replace(search.steps[0], aliases=("quadratic_drag at bearing", "dahl_friction at bearing"))
    after = still_alike(replace(search, steps=(both,)), (told,))
    assert after.steps[0].aliases == ("dahl_friction at bearing",)
    split = Split(told.chosen, told.rival, (("release", 30.0),))
    assert still_alike(search, (split,)).steps[0].aliases == ("quadratic_drag at bearing",)


def test_a_discovery_names_no_rival_that_its_runs_tell_apart(bench, monkeypatch):
    """The demonstration said of one rival both that the runs cannot tell it, and that they do."""
    search, _ = drag_as_rival(bench)
    assert search.steps[0].aliases
    monkeypatch.setattr(sys.modules["cartpend_dae.discover.prove"], "search", lambda *_, **__: search)
    found = discover(bench.setup, cards=CARDS)
    assert found.beyond.splits[0].times is not None
    assert found.search.steps[0].aliases == ()


def test_a_larger_release_splits_two_kinds_of_drag():
    """Dry friction against quadratic drag: the larger the swing, the further they lie apart."""
    bench = Workbench(noisy_setup(clean_run(COULOMB), 2, noise=20 * NOISE))
    search, drag = drag_as_rival(bench)
    assert drag.chi2 < 2 * search.final.chi2
    # an encoder as good as that of the other tests
    plan = Plan({"bearing.phi": 1.2}, {"bearing.phi": NOISE}, 6.0, 100.0, 0.5, 5.0)
    (split,) = splits(bench, search, plan=plan)
    assert (split.chosen, split.rival) == ("bearing.coulomb_friction", "bearing.quadratic_drag")
    names = [name for name, _ in split.ranking]
    distances = [distance for _, distance in split.ranking]
    assert distances == sorted(distances, reverse=True) and distances[0] > 1000
    assert names[0].startswith("release of bearing.phi from 1.2 rad") or "release" in names[0]
    assert split.sentence.startswith(
        "To tell `bearing.coulomb_friction` from `bearing.quadratic_drag`, record: release"
    )


def test_a_rival_that_was_judged_in_the_place_of_the_answer_is_not_fitted_again(bench, right):
    (step,) = right.steps
    drag = insertion_at(RotaDamp(), "quadratic_drag", "bearing")
    fit = bench.fit((drag,), right.final.point | drag.starts, (right.bandwidth,), right.final.weights_sd)
    rival = replace(step.candidate, insertion=drag, fit=fit)
    assert _fit_known(right, (drag,), rival) is fit
    assert _fit_known(right, (step.candidate.insertion, drag), rival) is None  # it was another model
    assert _fit_known(replace(right, bandwidth=3.0), (drag,), rival) is None
    assert _fit_known(right, (drag,), replace(rival, fit=None)) is None


def test_models_are_compared_on_the_same_steps(bench):
    """Errors of integration had counted as a difference of models that took 16 and 67 steps a sample."""
    slow = bench.build((), bench.setup.train)
    fast = bench.build((insertion_at(RotaDamp(), "coulomb_friction", "bearing"),), bench.setup.train)
    assert slow.layout.substeps < fast.layout.substeps
    both = _on_the_same_steps([slow, fast])
    assert [problem.layout.substeps for problem in both] == [fast.layout.substeps] * 2
