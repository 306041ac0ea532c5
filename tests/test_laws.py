"""Which law of a contact is the likeliest where small disturbances move the rig: starts, rounds and the choice."""

# ruff: noqa: F811 - fixtures of another file are arguments here

import importlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_discovery_choice import bench, plain_fit  # noqa: F401

from cartpend_dae.discover import iterated, laws
from cartpend_dae.discover.bases import noise_rules
from cartpend_dae.discover.choice import step_of
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.log import Log, Uncovered
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.screen import candidates
from cartpend_dae.discover.search import _is_weighed
from cartpend_dae.discover.state import Base
from cartpend_dae.effects import catalogue, insertion_at, places
from cartpend_dae.errors import SolverError
from cartpend_dae.uncertainty import Estimate
from models.rota_damp import RotaDamp

search = importlib.import_module("cartpend_dae.discover.search")  # the package has a function of this name


@pytest.fixture(scope="module")
def library():
    return catalogue(), places(RotaDamp(), ("bearing.phi",))


@pytest.fixture
def rules(bench, library):
    return noise_rules(bench, library[1], 0.0)


@pytest.fixture
def law(plain_fit):
    def make(effect, **values):
        insertion = insertion_at(RotaDamp(), effect, "bearing")
        named = insertion.starts | {f"{insertion.prefix}.{name}": value for name, value in values.items()}
        estimates = tuple(Estimate(name, value, 1e-6, "1", "ok") for name, value in named.items())
        fit = replace(plain_fit, parameters=(*plain_fit.parameters, *estimates))
        return Candidate(insertion, named, 30.0, 0.0, 0.0, fit, "")

    return make


@pytest.fixture
def likelihoods(monkeypatch, law):
    """Weigh each law as told, -2 ln likelihood by effect; of those screened beside one these promise something."""

    def say(criteria, beside, error=None):
        def weighed(bench, taken, loads, *_, **__):
            card = taken[-1].card.id
            if error is not None:
                raise error
            forces = SimpleNamespace(names=(), sizes=np.array([]))
            return law(card).fit, SimpleNamespace(criterion=criteria[card], validated=criteria[card], forces=forces)

        def screened(bench, taken, point, options, *_, **__):
            known = beside.get(taken[-1].card.id, ())
            each = {option.prefix: option for option in options}.values()
            found = [replace(law(option.card.id), insertion=option, fit=None) for option in each]
            return [c if c.insertion.card.id in known else replace(c, predicted=0.0) for c in found]

        monkeypatch.setattr(laws, "fitted", weighed)
        monkeypatch.setattr(laws, "reweighed", weighed)
        monkeypatch.setattr(laws, "polished", lambda bench, taken, loads, found, sd: found)
        monkeypatch.setattr(laws, "screen", screened)

    return say


ALL = {
    "coulomb_friction": 100.0,
    "stribeck_friction": 60.0,
    "breakaway_friction": 101.0,
    "asymmetric_friction": 99.0,
    "position_dependent_friction": 98.0,
    "load_dependent_friction": 99.0,
    "lugre_friction": 90.0,
    "dahl_friction": 300.0,
    "maxwell_slip_friction": 300.0,
    "hysteresis": 300.0,
    "iron_loss": 300.0,
}


def chosen(bench, library, rules, told):
    first, pool = laws.likeliest_law(bench, (), told, candidates(*library, ()), rules)
    return first, {c.insertion.card.id: c for c in pool}


def test_a_law_that_promises_more_beside_the_one_found_takes_its_place(bench, library, rules, law, likelihoods):
    likelihoods(ALL, {"coulomb_friction": {"stribeck_friction"}})
    first, pool = chosen(bench, library, rules, law("coulomb_friction", tau_c=0.2))
    assert first.insertion.card.id == "stribeck_friction" and first.gain == 40.0
    assert pool["coulomb_friction"].gain == 0.0 and pool["breakaway_friction"].gain == -1.0


def test_a_law_that_explains_no_more_than_alike_leaves_the_one_with_fewer_parameters(
    bench, library, rules, law, likelihoods
):
    likelihoods(ALL | {"stribeck_friction": 85.0}, {"coulomb_friction": {"stribeck_friction"}})
    told = law("coulomb_friction", tau_c=0.2)
    assert chosen(bench, library, rules, told)[0] is told


def test_a_law_that_the_one_found_contains_takes_its_place_where_it_does_as_well(
    bench, library, rules, law, likelihoods
):
    likelihoods(ALL | {"stribeck_friction": 95.0}, {})
    first, _ = chosen(bench, library, rules, law("stribeck_friction", tau_c=0.2, tau_s=0.3))
    assert first.insertion.card.id == "coulomb_friction" and first.gain == -5.0


def test_laws_are_looked_for_again_beside_the_one_that_takes_the_place(bench, library, rules, law, likelihoods):
    """From break-away friction nothing else promised anything; from Coulomb friction, which did as well, the rest."""
    criteria = ALL | {"breakaway_friction": 500.0, "asymmetric_friction": 50.0, "stribeck_friction": 480.0}
    likelihoods(criteria, {"coulomb_friction": {"asymmetric_friction"}})
    first, _ = chosen(bench, library, rules, law("breakaway_friction", tau_c=0.2, tau_s=0.3))
    assert first.insertion.card.id == "asymmetric_friction" and first.gain == 450.0


def test_a_law_that_predicts_worse_what_is_left_out_is_none(bench, library, rules, law, likelihoods, monkeypatch):
    likelihoods(ALL, {"coulomb_friction": {"stribeck_friction"}})
    weighed = laws.fitted

    def overfitted(*args, **options):
        fit, found = weighed(*args, **options)
        found.validated = 100.0 + (found.criterion < 100.0)
        return fit, found

    monkeypatch.setattr(laws, "fitted", overfitted)
    told = law("coulomb_friction", tau_c=0.2)
    first, pool = chosen(bench, library, rules, told)
    assert first is told and pool["stribeck_friction"].why_not == laws.WORSE


def test_a_law_that_goes_with_forces_faster_than_the_samples_is_none(
    bench, library, rules, law, likelihoods, monkeypatch
):
    """Coulomb friction took the place of break-away friction that left half as much of a measured motor."""
    likelihoods(ALL, {"coulomb_friction": {"stribeck_friction"}})
    weighed = laws.fitted

    def fast(*args, **options):
        fit, found = weighed(*args, **options)
        return replace(fit, bandwidth=np.array([200.0 if found.criterion < 100.0 else 2.0])), found

    monkeypatch.setattr(laws, "fitted", fast)
    told = law("coulomb_friction", tau_c=0.2)
    first, pool = chosen(bench, library, rules, told)
    assert first is told and pool["stribeck_friction"].why_not == laws.BLIND


def test_where_there_is_no_other_law_the_one_found_stands(bench, rules, law):
    told = law("coulomb_friction")
    assert laws.likeliest_law(bench, (), told, [told.insertion], rules) == (told, [])


def test_a_law_begins_as_the_sum_of_what_was_found_and_what_it_would_do_beside_it(law):
    told = law("coulomb_friction", tau_c=0.2)
    values = {"bearing.coulomb_friction.tau_c": 0.2}
    stribeck = law("stribeck_friction", tau_c=0.01, tau_s=0.1, w_s=0.3, d=0.02)
    begun = {name.rpartition(".")[2]: v for name, v in laws.joined(stribeck, told, values).items()}
    assert begun == pytest.approx({"tau_c": 0.21, "tau_s": 0.3, "w_s": 0.3, "d": 0.02})
    each_way = law("asymmetric_friction", tau_c_pos=-0.3, tau_c_neg=0.1, d_pos=0.0, d_neg=0.0)
    begun = {name.rpartition(".")[2]: v for name, v in laws.joined(each_way, told, values).items()}
    assert begun["tau_c_pos"] == 0.0 and begun["tau_c_neg"] == pytest.approx(0.3)  # no law drives


def test_the_law_of_each_contact_is_put_right_and_one_that_diverges_stays(
    bench, library, rules, law, likelihoods, plain_fit
):
    told = law("coulomb_friction", tau_c=0.2)
    steps = [step_of(told, residuals(told.fit), [told])]
    base = Base((told.insertion,), {0.0: told.fit}, 2 * plain_fit.chi2)
    for error in (SolverError("it diverges"), np.linalg.LinAlgError("SVD did not converge")):
        likelihoods(ALL, {"coulomb_friction": {"stribeck_friction"}}, error=error)
        assert laws.lawful(bench, base, steps, rules, rules, library) == (base, steps)
    other = law("constant_load")
    alone = [step_of(other, residuals(other.fit), [other])]
    assert laws.lawful(bench, replace(base, taken=(other.insertion,)), alone, rules, rules, library)[1] == alone
    likelihoods(ALL, {"coulomb_friction": {"stribeck_friction"}})
    after, (step,) = laws.lawful(bench, base, steps, rules, rules, library)
    assert [i.card.id for i in after.taken] == ["stribeck_friction"] == [step.candidate.insertion.card.id]
    assert step.candidate.fit is after.fit and after.bare == base.bare


def test_a_law_that_leaves_far_more_of_the_runs_takes_no_place(bench, library, rules, law, likelihoods, plain_fit):
    """Against forces that do all that friction would, each of its laws is as likely (measured pendulum of the DFKI)."""
    told = law("coulomb_friction", tau_c=0.2)
    steps = [step_of(told, residuals(told.fit), [told])]
    likelihoods(ALL, {"coulomb_friction": {"stribeck_friction"}})
    after, _ = laws.lawful(bench, Base((told.insertion,), {0.0: told.fit}, 1.0), steps, rules, rules, library)
    for share, stands in ((0.6, False), (0.4, True)):
        base = Base((told.insertion,), {0.0: replace(told.fit, chi2=share * after.fit.chi2)}, 2 * plain_fit.chi2)
        found = laws.lawful(bench, base, steps, rules, rules, library)
        assert (found == (base, steps)) is stands


def test_a_law_is_fitted_from_where_the_one_before_ended_too(
    bench, library, rules, law, likelihoods, plain_fit, monkeypatch
):
    """From what forces had made of Coulomb friction the fit of a measured motor left 1.8 times as much."""
    told = law("breakaway_friction", tau_c=0.2, tau_s=0.3)
    steps = [step_of(told, residuals(told.fit), [told])]
    base = Base((told.insertion,), {0.0: told.fit}, 2 * plain_fit.chi2)
    likelihoods(ALL | dict.fromkeys(("stribeck_friction", "lugre_friction"), 500.0), {})
    guesses, name = [], "bearing.coulomb_friction.tau_c"
    fit = type(bench).fit

    def seen(bench, together, guess, bandwidths, sd, **options):
        if bandwidths == rules.descent and name in guess:
            guesses.append(guess[name])
            if guess[name] != 0.2:
                raise SolverError("it diverges")
        return fit(bench, together, guess, bandwidths, sd, **options)

    monkeypatch.setattr(type(bench), "fit", seen)
    after, (step,) = laws.lawful(bench, base, steps, rules, rules, library)
    assert step.candidate.insertion.card.id == "coulomb_friction"
    assert 0.2 in guesses and after.fit is step.candidate.fit


def test_no_law_is_asked_for_again_where_the_runs_are_too_long_to_be_followed(
    bench, library, rules, law, likelihoods, plain_fit, monkeypatch
):
    told = law("coulomb_friction", tau_c=0.2)
    steps = [step_of(told, residuals(told.fit), [told])]
    base = Base((told.insertion,), {0.0: told.fit}, 2 * plain_fit.chi2)
    likelihoods(ALL, {"coulomb_friction": {"stribeck_friction"}})
    monkeypatch.setattr(iterated, "MOST", sum(len(run.time) for run in bench.setup.train) - 1)
    assert laws.lawful(bench, base, steps, rules, rules, library) == (base, steps)


def test_where_predictions_tell_nothing_what_forces_told_before_stands(bench, rules, law, plain_fit, monkeypatch):
    """A gap explained 1,445 of -2 ln likelihood, and then predictions, which explain everything so, were asked."""
    told = law("cubic_stiffness")
    step = step_of(told, residuals(told.fit), [told])
    start, model = Base((), {0.0: plain_fit}, plain_fit.chi2), Base((told.insertion,), {0.0: told.fit}, plain_fit.chi2)
    fast = Base((), {0.0: replace(plain_fit, bandwidth=np.array([1e4]))}, plain_fit.chi2)
    against, predicted = (replace(rules, regime=regime) for regime in ("forces", "disturbances"))
    grown: list[str] = []

    def grow(bench, base, how, library, max_steps, log):
        grown.append(how.regime)
        return log.base or base

    monkeypatch.setattr(search, "_forced", lambda *_: (against, fast))
    monkeypatch.setattr(search, "_disturbed", lambda *_: (predicted, start))
    monkeypatch.setattr(search, "_grow", grow)
    for seen, regimes, taken in (
        (Uncovered(model, step, {}, True), ["forces"], model.taken),
        (Uncovered(model, step, {}, False), ["disturbances", "forces"], model.taken),
        (None, ["disturbances"], ()),
    ):
        grown.clear()
        monkeypatch.setattr(search, "_uncovered", lambda *_, seen=seen: seen)
        log = Log()
        _, _, base = search._against_forces(bench, rules, (start, start), ((), ()), 3, log)
        assert (grown, base.taken, log.steps) == (regimes, taken, [step] if seen else [])


def test_forces_decide_between_laws_of_one_contact_that_both_were_weighed(law):
    """A wave of friction left a sixth of what Coulomb friction did in free simulations, and explained no more."""
    wave, plain, load = law("position_dependent_friction"), law("coulomb_friction"), law("constant_load")
    log = Log(steps=[step_of(plain, residuals(plain.fit), [plain])])
    assert not _is_weighed(log, wave)  # never tried
    log.tried[wave.insertion.prefix] = replace(wave, fit=None)
    assert not _is_weighed(log, wave)  # only screened
    log.tried[wave.insertion.prefix] = wave
    assert _is_weighed(log, wave)
    log.steps = [step_of(load, residuals(load.fit), [load])]
    assert not _is_weighed(log, wave)  # no law of the contact
