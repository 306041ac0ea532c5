"""Stage 4: add what the data ask for, one effect after the other, and take back what they no longer need."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from cartpend_dae.discover.bases import Library, base_of, fit_base, noise_alone, noise_rules, place_with_a_future
from cartpend_dae.discover.carried import carries_over
from cartpend_dae.discover.choice import SHAPE, beyond_shape, least_beyond, step_of
from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.couple import couple, plainer, simpler
from cartpend_dae.discover.disturbed import fitted, polished
from cartpend_dae.discover.edges import off_edges
from cartpend_dae.discover.evidence import described, leaves_clearly_less, with_robust_sd
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.laws import lawful
from cartpend_dae.discover.log import Log, Uncovered
from cartpend_dae.discover.mirror import mirrored
from cartpend_dae.discover.nested import is_nothing_in
from cartpend_dae.discover.peak import with_peak_at_rest
from cartpend_dae.discover.promising import may_be_two
from cartpend_dae.discover.rattle import RattlingError, is_all_that_tells, least_that_tells
from cartpend_dae.discover.records import Candidate, Regime, Search
from cartpend_dae.discover.regime import best_bandwidth, sampling_rate
from cartpend_dae.discover.revise import each_matters, plain, prune, settled, swap
from cartpend_dae.discover.screen import candidates, screen
from cartpend_dae.discover.shape import (
    MOST,
    best_rival,
    is_left_to_shape,
    is_most,
    is_nearly_all,
    is_plainer_left_to_shape,
    supported,
)
from cartpend_dae.discover.shortlist import distinct
from cartpend_dae.discover.state import Base, Rules, push_left
from cartpend_dae.discover.trial import judge_in_noise, lead_needed, try_all, try_in_noise, weighed_trials
from cartpend_dae.discover.verdict import compared, is_told_freely, pushes_remain, verdict
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Place
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# regimes in which more than noise moves the rig
MOVED = ("disturbances", "forces")
# so many effects together stand for the whole catalogue where the bandwidth of predictions is sought
RICH = 4


def search(
    bench: Workbench,
    cards: tuple[Card, ...],
    places: tuple[Place, ...],
    *,
    max_steps: int,
    regime: Regime | None = None,
) -> Search:
    """Find the effects that the training runs ask for.

    Parameters
    ----------
    bench
        The workbench with the runs.
    cards, places
        What may be added, and where.
    max_steps
        Largest number of additions.
    regime
        Forced regime; None finds out.
    """
    predicts = regime is None and any(run.score != "free" for run in bench.setup.train)
    regime = "disturbances" if predicts else regime  # who scores predictions knows that a free simulation drifts
    noise = noise_rules(bench, places, bench.last if regime == "noise" else 0.0)
    base = fit_base(bench, (), {}, noise)
    base = replace(base, bare=base.fit.chi2)
    gate = residuals(base.fit)
    if not gate.is_passed and (predicts or regime not in MOVED):
        return Search("noise", "noise", 0.0, base.fit, gate, base.fit, gate, (), (), "no-discrepancy", False)
    log = Log()
    rules, start, bare = noise, base, base
    library = (cards, places)
    try:
        if regime not in MOVED:
            try:
                base = _grow(bench, start, rules, library, max_steps, log)
            except RattlingError as rattling:
                bench = bench.predicting(rattling.least)
                return search(bench, cards, places, max_steps=max_steps, regime="noise")
        if regime == "disturbances":
            rules, start = _disturbed(bench, noise, start, log, library)
            log.begin_with(None)
            base = _grow(bench, start, rules, library, max_steps, log)
        elif regime == "forces" or (regime is None and residuals(base.fit).is_passed):
            # no sum of effects leaves noise alone, so that something else moves the rig as well
            alone = base
            rules, start, base = _against_forces(bench, noise, (start, alone), library, max_steps, log)
            if base is alone:
                base, log.steps = settled(bench, base, log.steps, noise, log.past)
        if rules.regime == "noise":
            log.base = base
            base, log.steps = with_peak_at_rest(bench, base, log.steps, rules, library)
        if rules.regime in MOVED and not predicts:  # else predictions told the law
            log.base = base  # what is interrupted from here on ends with the model of these steps
            base, log.steps = lawful(bench, base, log.steps, rules, noise, library)
    except KeyboardInterrupt:
        log.is_interrupted, base = True, log.base or start
    last_gate = residuals(base.fit)
    is_left = last_gate.is_passed or pushes_remain(start, base)
    bench = bench.on(rules.weighing)
    if rules.regime == "forces":
        start, base = compared(bench, bare, start, base, rules)
        is_left = is_left or not is_told_freely(bench, start, base)
        kept = {insertion.prefix for insertion in base.taken}
        log.steps = [step for step in log.steps if step.candidate.insertion.prefix in kept]
    return Search(
        rules.regime,
        log.judged,
        float(base.fit.bandwidth[0]),
        _reported(bench, start, rules),
        residuals(start.fit),
        _reported(bench, base, rules),
        last_gate,
        tuple(log.steps),
        tuple(log.tried.values()),
        verdict(bool(log.steps), is_left),
        log.is_interrupted,
    )


def _against_forces(
    bench: Workbench, noise: Rules, without: tuple[Base, Base], library: Library, max_steps: int, log: Log
) -> tuple[Rules, Base, Base]:
    """Search against random forces; return the rules, and the models before and after.

    What noise alone had found stands if it leaves no more than the shape of each effect, and no plainer law does; if
    both agree on it; if it is most of all, and forces find nothing, as the injection that suits them hides what is
    wrong at a sensor, or what leaves clearly more of the runs and is no other law of a contact; and if the model cannot
    be weighed so, or the search is interrupted before. Where forces find what leaves noise alone, there are none.
    """
    found, before = log.steps, replace(log, tried=dict(log.tried))
    old = (replace(noise, regime="disturbances"), *without)
    rules, start = noise, without[0]
    is_shape = bool(found) and is_left_to_shape(without[1].bare, without[1].fit)
    is_told = len(found) > 1 or not (found and is_plainer_left_to_shape(found[0].candidate, log.tried, without[1].bare))
    if is_shape and is_told and each_matters(bench, without[1], found, noise):
        return old
    try:
        rules, start = _forced(bench, noise, without[0])
        # above the sampling rate each sample is corrected by all of its error, and forces explain everything
        is_blind = bool(start.fit.bandwidth[0] > sampling_rate(bench))
        if (
            found
            and is_nearly_all(without[1])
            and (is_blind or _is_confirmed(bench, log, (without[0], start), rules, library))
        ):
            return old
        seen = None
        if is_blind:
            # what is so fast is faster than the usual steps, too
            rules, start = _forced(bench.on("weighed"), noise, without[0])
            seen = _uncovered(bench.on(rules.weighing), start, rules, library, log)
        rules = replace(rules, told=tuple(step.candidate for step in found[:1]))
        against, is_clear = (rules, start), seen is not None and seen.is_clear
        if is_blind and not is_clear:
            rules, start = _disturbed(bench, noise, without[0], log, library)
        log.begin_with(seen if is_clear else None)
        base = _grow(bench.on(rules.weighing), start, rules, library, max_steps, log)
        if seen is not None and not log.steps:  # predictions tell nothing
            rules, start = against
            log.begin_with(seen)
            base = _grow(bench.on(rules.weighing), start, rules, library, max_steps, log)
        if base.taken and rules.regime == "forces" and base.weighed is None:
            return noise, without[0], base
    except SolverError:  # it diverges in the steps with which it is weighed
        log.back_to(before)
        return old
    except KeyboardInterrupt:
        log.is_interrupted = True
        if log.base is not None and log.base is not before.base:
            return rules, start, log.base
        log.back_to(before)
        return old
    may_stand = is_most(without[1]) and carries_over(bench, *without, noise)
    is_told = bool(log.steps and found) and (
        _is_weighed(log, found[0].candidate) or not _explains_less(bench, base, found[0].candidate, noise)
    )
    if may_stand and not is_told:
        log.back_to(before)
        return old
    return rules, start, base


def _is_weighed(log: Log, first: Candidate) -> bool:
    """Return whether forces found another law of a contact than noise did, and weighed that one too.

    Both are as large and as fast, so that none of them is left to the forces; in a free simulation the richer one may
    take up what chance pushed.
    """
    tried = log.tried.get(first.insertion.prefix)
    is_fitted = tried is not None and tried.fit is not None
    return is_fitted and any(is_other_law(step.candidate, first) for step in log.steps)


def _explains_less(bench: Workbench, base: Base, first: Candidate, noise: Rules) -> bool:
    """Return whether what was found against forces leaves clearly more of the runs than another effect does alone.

    Forces that may do everything prefer what is as fast as they are, and leave what is large and slow to themselves.
    """
    assert first.fit is not None
    try:
        alone = bench.fit((first.insertion,), first.fit.point, (bench.last,), noise.sd, patient=False)
    except SolverError:
        return False
    try:
        found = bench.fit(base.taken, base.fit.point, (bench.last,), noise.sd, patient=False)
    except SolverError:
        return True
    return leaves_clearly_less(alone, found)


def _disturbed(bench: Workbench, noise: Rules, base: Base, log: Log, library: Library) -> tuple[Rules, Base]:
    """Weigh by predictions, with the bandwidth with which the most promising effects together predict best.

    Weights are the innovations of the baseline, so that costs are of order one.
    """
    early = base.fits[noise.screening].point
    ranked = [c for c in log.tried.values() if not c.why_not or c.fit is not None]
    if not log.tried:
        screened = screen(bench, (), early, candidates(*library, ()), noise.screening, noise.sd)
        ranked = [c for c in screened if not c.why_not]
    rich = distinct([step.candidate for step in log.steps] + ranked)[:RICH]
    bandwidth = best_bandwidth(bench, rich, early, noise.sd)
    fit = bench.fit((), {}, (bandwidth,), noise.sd)
    rules = Rules("disturbances", (bandwidth,), bandwidth, fit.noise_sd, noise.loads)
    return rules, replace(fit_base(bench, (), fit.point, rules), bare=base.bare)


def _forced(bench: Workbench, noise: Rules, base: Base) -> tuple[Rules, Base]:
    """Weigh against random forces, with the output injection that suits them."""
    early = base.fits[noise.screening]
    first = fitted(bench, (), noise.loads, early.point, noise.screening, noise.sd)
    fit, weighed = polished(bench, (), noise.loads, first, noise.sd)
    bandwidth = float(fit.bandwidth[0])
    rules = Rules("forces", (bandwidth,), bandwidth, noise.sd, noise.loads, bench.weighing, noise)
    return rules, Base((), {bandwidth: fit}, base.bare, weighed)


def _is_confirmed(bench: Workbench, log: Log, starts: tuple[Base, Base], rules: Rules, library: Library) -> bool:
    """Return whether the first effect explains as much against random forces as the one that would be taken there.

    One with fewer parameters that explains as much speaks against it. Which law a contact has is told by noise, unless
    forces say so clearly, or noise says the same: where it took the plainer one, or where the fit of the other one went
    astray and goes further from where forces left it. `starts` are the models without additions in both.
    """
    told, (alone, start) = log.steps[0].candidate, starts
    ranked = weighed_trials(bench, start, rules, candidates(*library, ()), (told.insertion.prefix,))
    own = next((c for c in ranked if c.insertion.prefix == told.insertion.prefix), None)
    if own is None or not own.gain > 0:
        return False
    best = ranked[0]
    if best is own or best.why_not:
        return True
    in_noise = log.tried.get(best.insertion.prefix)
    is_behind = in_noise is None or not in_noise.gain > told.gain
    if is_behind and rules.alone is not None and is_other_law(best, told):
        with suppress(SolverError):  # without forces it diverges
            in_noise = judge_in_noise(bench, alone, rules.alone, best)
    margin = lead_needed(best, told, in_noise)
    n_best, n_own = (described(c.fit, c.insertion) for c in (best, own))
    return n_best >= n_own and best.gain - own.gain < margin


def _uncovered(bench: Workbench, start: Base, rules: Rules, library: Library, log: Log) -> Uncovered | None:
    """Return the model with an effect that noise alone pointed to, or with a better one; None if none is accepted.

    Where something large and fast is missing, forces take it up whole, and nothing shows against them before it is in.
    """
    early = {c.early: c for c in log.tried.values() if c.early is not None}
    pointed = [step.candidate for step in log.steps[:1]] + ([early[min(early)]] if early else [])
    if not pointed:
        return None
    rivals = tuple(c.insertion.prefix for c in pointed)
    ranked = weighed_trials(bench, start, rules, candidates(*library, ()), rivals, tuple(pointed))
    winner = ranked[0] if ranked else None
    if winner is None or winner.why_not or winner.fit is None:
        return None
    base = base_of(bench, start, (), winner, rules)
    assert start.weighed is not None and base.weighed is not None
    before, after = (float(np.linalg.norm(one.forces.sizes)) for one in (start.weighed, base.weighed))
    is_clear = winner.fit.bandwidth[0] <= sampling_rate(bench) and after <= MOST * before
    tried, step = {c.insertion.prefix: c for c in ranked}, step_of(winner, residuals(base.fit), ranked)
    return Uncovered(base, step, tried, bool(is_clear))


def _grow(
    bench: Workbench,
    base: Base,
    rules: Rules,
    library: Library,
    max_steps: int,
    log: Log,
) -> Base:
    """Add effects while there is structure; the free simulation has it, so there is always a first round.

    It goes on from what the log has, and ends with the model in noise where that is all that is left.
    """
    first, base, log.judged = base, log.base or base, rules.regime
    alone = noise_alone(bench, base, rules)
    while alone is None and len(log.steps) < max_steps:
        try:
            grown = _grown(bench, base, rules, library, log, max_steps - len(log.steps))
        except SolverError:
            if not log.steps:
                raise
            break  # what was found before stands
        if grown is None:
            break
        base, alone = grown, noise_alone(bench, grown, rules)
        log.past.append((grown, log.steps))
        if rules.regime != "forces" and not residuals(base.fit).is_passed:
            break
        if push_left(first, base) < SHAPE:  # what is left may be what the laws found are wrong by
            break
    log.base = alone or log.base
    return alone or base


def _grown(bench: Workbench, base: Base, rules: Rules, library: Library, log: Log, n_more: int) -> Base | None:
    """Return the model with one more effect, or two of at most `n_more`, and log it; None if there is none to add."""
    tried = list(log.tried.values())
    is_plain = all(is_nothing_in(c, step.candidate) for step in log.steps for c in plainer(step, tried))
    if rules.regime == "noise" and is_plain and is_left_to_shape(base.bare, base.fit):
        return None
    if base.taken and is_all_that_tells(bench, base.bare, base.fit):
        return None
    options = candidates(*library, base.taken)
    if rules.regime == "noise" and log.steps:
        base = off_edges(bench, base, rules)
        options = supported(bench, base, rules, options)
        if not options:
            return None
    if rules.regime == "noise":
        stage, ranked = try_in_noise(bench, base, rules, options)
        least = least_that_tells(bench, base, rules, ranked)
        if least is not None:
            raise RattlingError(least)
    else:
        stage, ranked = 0.0, try_all(bench, base, rules, options, least_beyond(log.steps))
    if rules.regime == "forces":
        ranked = beyond_shape(ranked, log.steps)
    log.tried |= {candidate.insertion.prefix: candidate for candidate in ranked}
    may_couple = rules.regime == "noise" and n_more > 1 and may_be_two(base, rules, stage, bench.last)
    both = couple(bench, base, rules, options, ranked, stage) if may_couple else None
    if both is not None:
        made, steps = swap(bench, both[0], [*log.steps, *both[1]], rules, library, whole=True)
        if log.steps:
            made, steps = prune(bench, made, steps, rules, len(options), whole=True)
        # the others were tried in the couple
        seen = {candidate.insertion.prefix for candidate in ranked}
        unseen = [c for c in log.tried.values() if c.insertion.prefix not in seen]
        log.base, log.steps = plain(bench, made, steps, rules, unseen, base.fit.chi2)
        return log.base
    if not ranked or ranked[0].why_not:
        is_able = rules.regime == "noise" and bool(log.steps)
        instead = simpler(bench, base, rules, log.steps, ranked, list(log.tried.values())) if is_able else None
        if instead is not None:
            log.base, log.steps = instead
        return log.base if instead else None
    ranked = place_with_a_future(bench, base, ranked, rules, library)
    winner, left = ranked[0], base.fit.chi2
    base = replace(base_of(bench, base, base.taken, winner, rules), rival=best_rival(winner, ranked))
    steps = [*log.steps, step_of(winner, residuals(base.fit), ranked)]
    base, steps = prune(bench, base, steps, rules, len(options))
    before = steps
    base, steps = swap(bench, base, steps, rules, library)
    if any(
        a is not b for a, b in zip(steps, before, strict=True)
    ):  # beside what has taken the place of another one, others may do nothing any more
        base, steps = prune(bench, base, steps, rules, len(options), whole=True)
    if rules.regime == "noise" and len(steps) > 1:
        base, steps = plain(bench, base, steps, rules, list(log.tried.values()), left)
    log.steps, log.base = steps, base
    return base


def _reported(bench: Workbench, base: Base, rules: Rules) -> Fit:
    """Return the fit of a base with the standard deviations that its regime calls for."""
    if rules.regime == "noise":
        return mirrored(base.fit)
    try:
        linear = bench.solved(base.taken, base.fit, rules.sd)
    except SolverError:  # joined end to end its pieces diverge
        return mirrored(base.fit)
    return mirrored(with_robust_sd(base.fit, linear))
