"""Two plain laws where one rich law leaves noise alone too."""

import importlib
from dataclasses import replace

import independent
import numpy as np
import pytest
from test_discover_pendulum import COULOMB, VISCOUS, noisy_setup

from cartpend_dae import simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover import revise
from cartpend_dae.discover.bases import fit_base, noise_rules
from cartpend_dae.discover.choice import step_of
from cartpend_dae.discover.couple import _made, _whole, couple, plainer, simpler
from cartpend_dae.discover.evidence import bic
from cartpend_dae.discover.gate import is_noise_alone, residuals
from cartpend_dae.discover.log import Log
from cartpend_dae.discover.promising import Couple
from cartpend_dae.discover.records import Candidate, FreeSpec, Setup
from cartpend_dae.discover.revise import plain, swap
from cartpend_dae.discover.screen import UNSEEN, candidates
from cartpend_dae.discover.shape import is_left_to_shape, leaves_little
from cartpend_dae.discover.shortlist import PLACES, at_few_places
from cartpend_dae.discover.state import Base
from cartpend_dae.discover.trial import try_in_noise
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import catalogue, insert, insertion_at, places
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp

QUADRATIC = 0.001


def test_coulomb_friction_and_drag_are_told_from_a_stribeck_curve():
    run = independent.pendulum(duration=6.0, angle=1.2, viscous=VISCOUS, coulomb=COULOMB, quadratic=QUADRATIC)
    bench = Workbench(noisy_setup(run, 0))
    where = places(bench.setup.model, ("bearing.phi",), catalogue())
    rules = noise_rules(bench, where, 0.0)
    base = fit_base(bench, (), {}, rules)
    base = replace(base, bare=base.fit.chi2)
    options = candidates(catalogue(), where, ())
    stage, ranked = try_in_noise(bench, base, rules, options)
    # its curve with four parameters takes up the drag, and nothing but noise is left
    assert ranked[0].insertion.prefix == "bearing.stribeck_friction"
    assert ranked[0].fit is not None and is_noise_alone(ranked[0].fit)
    made = couple(bench, base, rules, options, ranked, stage)
    assert made is not None
    after, steps = made
    named = {step.candidate.insertion.prefix for step in steps}
    assert named == {"bearing.coulomb_friction", "bearing.quadratic_drag"}
    found = {e.name.rpartition(".")[2]: e for e in after.fit.parameters}
    for name, truth in (("tau_c", COULOMB), ("d2", QUADRATIC), ("d", VISCOUS)):
        assert abs(found[name].value - truth) < 4 * found[name].sd


def test_a_law_each_way_gives_its_place_to_coulomb_friction_where_both_ways_are_alike_beside_the_others():
    run = independent.pendulum(duration=6.0, angle=1.2, viscous=VISCOUS, coulomb=COULOMB, quadratic=QUADRATIC)
    bench = Workbench(noisy_setup(run, 0))
    where = places(bench.setup.model, ("bearing.phi",), catalogue())
    rules = noise_rules(bench, where, 0.0)

    def made(effect):
        insertion = insertion_at(bench.setup.model, effect, "bearing")
        return Candidate(insertion, insertion.starts, 0.0, 50.0, 0.0, None, "")

    each_way, drag, coulomb = (made(name) for name in ("asymmetric_friction", "quadratic_drag", "coulomb_friction"))
    starts = {"bearing.asymmetric_friction.tau_c_pos": 1.1 * COULOMB, "bearing.asymmetric_friction.tau_c_neg": COULOMB}
    guess = {**each_way.parameters, **drag.parameters, "bearing.quadratic_drag.d2": QUADRATIC, **starts}
    fit = bench.fit((each_way.insertion, drag.insertion), guess, (0.0,), rules.sd)
    base = Base((each_way.insertion, drag.insertion), {0.0: fit})
    steps = [step_of(c, residuals(fit), [c]) for c in (each_way, drag)]
    after, found = plain(bench, base, steps, rules, [each_way, drag, coulomb], np.inf)
    assert [step.candidate.insertion.prefix for step in found] == ["bearing.quadratic_drag", "bearing.coulomb_friction"]
    assert {i.prefix for i in after.taken} == {"bearing.quadratic_drag", "bearing.coulomb_friction"}
    assert is_noise_alone(after.fit) and bic(after.fit) < bic(fit)
    assert plain(bench, after, found, rules, [each_way, drag, coulomb], np.inf) == (after, found)


def test_an_effect_that_ends_on_its_bounds_is_none_of_a_couple(gentle):
    """A clock that ran wrong by all that one may had come beside a gap (reported seed 1126, linear cart)."""
    bench, rules, _ = gentle
    base, steps = made_of(bench, rules, ("coulomb_friction", "bearing"), ("cubic_stiffness", "bearing"), tau_c=0.004)
    one, other = (step.candidate for step in steps)
    without = fit_base(bench, (), {}, rules)
    without = replace(without, bare=without.fit.chi2)
    pair = Couple(one, other, 0.0, {}, fit=base.fit)
    made = _made(bench, without, rules, pair, [])
    assert made is not None and len(made[1]) == 2
    held = [
        replace(e, status="at-bound") if e.name in other.insertion.parameter_names else e for e in base.fit.parameters
    ]
    at_bound = replace(pair, fit=replace(base.fit, parameters=tuple(held)))
    assert _made(bench, without, rules, at_bound, []) is None


def made_of(bench, rules, *parts, **values):
    """The model with effects, fitted, and their steps in this order."""
    insertions = [insertion_at(bench.setup.model, effect, at) for effect, at in parts]
    guess = {name: value for i in insertions for name, value in i.starts.items()}
    guess |= {name: value for name in guess for end, value in values.items() if name.endswith(f".{end}")}
    fits = {w: bench.fit(tuple(insertions), guess, (w,), rules.sd) for w in rules.descent}
    base = Base(tuple(insertions), fits, fit_base(bench, (), {}, rules).fit.chi2)
    told = [Candidate(i, i.starts, 0.0, 0.0, 0.0, base.fit, "") for i in insertions]
    return base, [step_of(c, residuals(base.fit), [c]) for c in told]


def hardening(duration, angle, viscous, coulomb, cubic):
    """A pendulum with dry friction and a spring that stiffens, and what may be added to its model."""
    hidden = insert(RotaDamp(), "coulomb_friction", "bearing", tau_c=coulomb)
    hidden = insert(hidden, "cubic_stiffness", "bearing", c3=cubic)
    points, first = round(100 * duration) + 1, {"bearing.phi": angle}
    run = simulate(hidden, duration, points=points, start=first, parameters={"bearing.d": viscous})
    noisy = run["bearing.phi"] + 3e-4 * np.random.default_rng(0).standard_normal(run.time.size)
    channels = {"bearing.phi": Channel(noisy, "zoh", 3e-4, "rad", 0.0)}
    start = {"bearing.phi": Start(angle, None)}
    experiment = Experiment("run", "train", run.time, {}, channels, start, "free", None)
    bench = Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), (experiment,), (), ()))
    cards = tuple(c for c in catalogue() if c.id in ("coulomb_friction", "cubic_stiffness", "sensor_gain"))
    where = places(RotaDamp(), ("bearing.phi",), cards)
    return bench, noise_rules(bench, where, 0.0), (cards, where)


@pytest.fixture
def gentle():
    return hardening(6.0, 1.2, viscous=0.01, coulomb=0.004, cubic=0.1)


@pytest.fixture
def strong():
    return hardening(8.0, 2.0, viscous=0.05, coulomb=0.02, cubic=0.5)


@pytest.mark.parametrize("is_first", [True, False])
def test_an_effect_elsewhere_takes_the_place_of_one_of_a_couple_that_leaves_more_than_noise(gentle, is_first):
    bench, rules, library = gentle
    parts = ("coulomb_friction", "bearing"), ("sensor_gain", "bearing.phi")
    base, steps = made_of(bench, rules, *(parts[::-1] if is_first else parts), tau_c=0.004)
    assert residuals(base.fit).is_passed
    after, found = swap(bench, base, steps, rules, library, whole=True)
    names = [step.candidate.insertion.prefix for step in found]
    # each stands where what it replaced stood: friction in the place of the gain, after a spring took that of friction
    assert names == ["bearing.coulomb_friction", "bearing.cubic_stiffness"]
    assert is_noise_alone(after.fit)


def test_a_couple_that_leaves_noise_is_not_looked_at_again(gentle, monkeypatch):
    bench, rules, library = gentle
    parts = ("coulomb_friction", "bearing"), ("cubic_stiffness", "bearing")
    base, steps = made_of(bench, rules, *parts, tau_c=0.004, c3=0.1)
    monkeypatch.setattr(revise, "try_all", lambda *a: pytest.fail("it was"))
    assert swap(bench, base, steps, rules, library, whole=True) == (base, steps)


def test_a_plainer_law_that_is_in_the_model_besides_is_not_put_in_twice(gentle):
    """A spring beside a weight off the axis, which is plainer, was to be that weight: the search ended with a fault."""
    bench, rules, _ = gentle
    parts = ("asymmetric_friction", "bearing"), ("coulomb_friction", "bearing")
    base, steps = made_of(bench, rules, *parts, tau_c=0.002, tau_c_pos=0.002, tau_c_neg=0.002)
    law = steps[1].candidate
    assert plainer(steps[0], [law]) == [law]
    assert plain(bench, base, steps, rules, [law], np.inf) == (base, steps)
    assert simpler(bench, base, rules, steps, [replace(law, why_not="refused")], [law]) is None


def test_a_plainer_law_begins_far_off_where_the_richer_one_took_up_the_viscous_friction(strong):
    bench, rules, _ = strong
    parts = ("stribeck_friction", "bearing"), ("cubic_stiffness", "bearing")
    base, steps = made_of(bench, rules, *parts, tau_c=0.02, tau_s=0.025, c3=0.5, d=0.05)
    d = base.fit.values["bearing.d"] + base.fit.values["bearing.stribeck_friction.d"]
    moved = {"bearing.d": 1e-6 * d, "bearing.stribeck_friction.d": d}  # the sum alone shows
    estimates = tuple(replace(e, value=moved.get(e.name, e.value)) for e in base.fit.parameters)
    base = replace(base, fits={**base.fits, 0.0: replace(base.fit, parameters=estimates)})
    coulomb = insertion_at(bench.setup.model, "coulomb_friction", "bearing")
    law = Candidate(coulomb, coulomb.starts, 0.0, 0.0, 0.0, None, "")
    _, found = plain(bench, base, steps, rules, [law], np.inf)
    assert {step.candidate.insertion.prefix for step in found} == {
        "bearing.coulomb_friction",
        "bearing.cubic_stiffness",
    }


def test_a_couple_gets_the_plainer_law_that_was_not_looked_at_beside_it(strong, monkeypatch):
    bench, rules, library = strong
    parts = ("stribeck_friction", "bearing"), ("cubic_stiffness", "bearing")
    both = made_of(bench, rules, *parts, tau_c=0.02, tau_s=0.025, c3=0.5, d=0.05)
    base = fit_base(bench, (), {}, rules)
    coulomb, viscous = (insertion_at(RotaDamp(), f"{law}_friction", "bearing") for law in ("coulomb", "viscous"))
    log = Log(tried={i.prefix: Candidate(i, i.starts, 0.0, 0.0, 0.0, None, "") for i in (coulomb, viscous)})
    log.tried[viscous.prefix] = replace(log.tried[viscous.prefix], why_not=UNSEEN)
    search = importlib.import_module("cartpend_dae.discover.search")
    monkeypatch.setattr(search, "try_in_noise", lambda *a: (rules.screening, [both[1][0].candidate]))
    monkeypatch.setattr(search, "least_that_tells", lambda *a: None)
    monkeypatch.setattr(search, "may_be_two", lambda *a: True)
    monkeypatch.setattr(search, "couple", lambda *a: both)
    after = search._grown(bench, replace(base, bare=base.fit.chi2), rules, library, log, 2)
    named = {"bearing.coulomb_friction", "bearing.cubic_stiffness"}
    assert {step.candidate.insertion.prefix for step in log.steps} == named
    assert {insertion.prefix for insertion in after.taken} == named
    assert is_noise_alone(after.fit)


@pytest.fixture
def wide():
    def make(effect, at, predicted):
        insertion = insertion_at(LinearDampMod(), effect, at)
        return Candidate(insertion, insertion.starts, predicted, 0.0, 0.0, None, "", np.ones(1))

    chains = ("cart.flange_a", "cart.flange_b", "inertial.flange_b", "rail.flange_b")
    several = [make("chain_tension_friction", at, 9.0 - k) for k, at in enumerate(chains)]
    return [several[0], make("coulomb_friction", "rail", 8.5), *several[1:], make("compliance", "cart.flange_a", 1.0)]


def test_what_does_several_things_at_once_is_fitted_at_its_best_places_first(wide):
    few, later = at_few_places(wide)
    assert few == [*wide[: PLACES + 1], wide[-1]]
    assert [c.insertion.place.at for c in later] == ["inertial.flange_b", "rail.flange_b"]


def test_a_couple_that_leaves_hardly_anything_gets_the_next_richer_law_of_its_contact():
    """Coulomb friction and a spring left 60 times the noise of Stribeck friction and a spring, 0.2 % of all."""
    hidden = insert(RotaDamp(), "stribeck_friction", "bearing", tau_c=0.02, tau_s=0.04, w_s=1.0)
    hidden = insert(hidden, "linear_stiffness", "bearing", c=0.3)
    first = {"bearing.phi": 1.2}
    run = simulate(hidden, 6.0, points=601, start=first, parameters={"bearing.d": 0.01})
    noisy = run["bearing.phi"] + 3e-4 * np.random.default_rng(0).standard_normal(run.time.size)
    channels = {"bearing.phi": Channel(noisy, "zoh", 3e-4, "rad", 0.0)}
    experiment = Experiment("run", "train", run.time, {}, channels, {"bearing.phi": Start(1.2, None)}, "free", None)
    bench = Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d"),), (experiment,), (), ()))
    rules = noise_rules(bench, places(RotaDamp(), ("bearing.phi",), catalogue()), 0.0)
    base = fit_base(bench, (), {}, rules)
    base = replace(base, bare=base.fit.chi2)

    def tried(effect):
        insertion = insertion_at(RotaDamp(), effect, "bearing")
        return Candidate(insertion, insertion.starts, 1.0, 0.0, 0.0, None, "", None, 1e9, insertion.starts)

    coulomb, spring, stribeck = (tried(name) for name in ("coulomb_friction", "linear_stiffness", "stribeck_friction"))
    begin = coulomb.parameters | spring.parameters
    fit = bench.fit((coulomb.insertion, spring.insertion), base.fit.point | begin, rules.stages, rules.sd)
    assert leaves_little(base.bare, fit) and not is_left_to_shape(base.bare, fit)
    few = [Couple(coulomb, spring, 1.0, begin)]
    made = _whole(bench, base, rules, few, [coulomb, spring, stribeck], rules.screening)
    assert made is not None
    assert {s.candidate.insertion.card.id for s in made[1]} == {"stribeck_friction", "linear_stiffness"}
    assert is_noise_alone(made[0].fit)
