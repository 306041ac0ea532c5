"""What a later addition changes about earlier ones: they are taken back, or give their place to another effect."""

from dataclasses import replace

import numpy as np

from cartpend_dae.discover.bases import Library, base_of, followed
from cartpend_dae.discover.choice import NEAR, SHAPE, SIMPLER, clearness, step_beside, step_of
from cartpend_dae.discover.contradicted import contradicted
from cartpend_dae.discover.couple import as_fitted, plainer
from cartpend_dae.discover.disturbed import ALIKE, penalty
from cartpend_dae.discover.evidence import bic
from cartpend_dae.discover.gate import is_noise_alone, residuals
from cartpend_dae.discover.nested import shared
from cartpend_dae.discover.predicted import MIN_SHARE, explained
from cartpend_dae.discover.records import Candidate, Step
from cartpend_dae.discover.screen import candidates
from cartpend_dae.discover.shape import LAWS
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.trial import MIN_BIC_GAIN, try_all
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# a size is told from zero by so many standard deviations: 95 % of the normal distribution are within
CLEAR = 1.96


def prune(
    bench: Workbench, base: Base, steps: list[Step], rules: Rules, n_options: int, *, whole: bool = False
) -> tuple[Base, list[Step]]:
    """Take back each earlier addition that the model with the last one does without; of the `whole` that one, too.

    One is always left.
    """
    for step in list(steps if whole else steps[:-1]):
        if len(steps) == 1:
            break
        fewer = tuple(i for i in base.taken if i.prefix != step.candidate.insertion.prefix)
        trial = followed(bench, fewer, _early(base, rules), rules, base.bare)
        if trial is None:
            continue
        if rules.regime == "disturbances":
            share, _ = explained(bench, (fewer, trial.fit), (base.taken, base.fit), rules.sd)
            is_needed = share > MIN_SHARE
        else:
            cost = MIN_BIC_GAIN if rules.regime == "noise" else penalty(n_options) * len(step.candidate.parameters)
            is_needed = _criterion(trial, rules) - _criterion(base, rules) > cost
            # the search goes on until noise is left, and no further
            is_needed = is_needed and (rules.regime != "noise" or not is_noise_alone(trial.fit))
        if not is_needed:
            base = trial
            steps = [s for s in steps if s.candidate.insertion.prefix != step.candidate.insertion.prefix]
    return base, steps


def swap(
    bench: Workbench, base: Base, steps: list[Step], rules: Rules, library: Library, *, whole: bool = False
) -> tuple[Base, list[Step]]:
    """Put another effect in the place of each earlier one if, with the last one in, it explains more.

    The first effect chosen soaks up a part of those still missing, and may be the wrong one of two alike. If the last
    ones came together and leave more than noise, the `whole` is looked at, the least certain first, and any effect
    anywhere may take the place of one of them, until noise is left. Steps stay in the order in which they were found.
    Where more than noise is left, the other one must differ from zero as clearly as the one in whose place it is.
    """
    cards, places = library
    for old in list(reversed(steps) if whole else steps[:-1]):
        if whole and not residuals(base.fit).is_passed:
            break
        here = tuple(place for place in places if whole or place.at == old.candidate.insertion.place.at)
        others = [s for s in steps if s is not old]
        fewer = tuple(s.candidate.insertion for s in others)
        without = followed(bench, fewer, _early(base, rules), rules, base.bare)
        if without is None:
            continue
        ranked = try_all(bench, without, rules, candidates(cards, here, fewer))
        best = ranked[0] if ranked else None
        if best is None or best.why_not or best.fit is None or best.insertion.prefix == old.candidate.insertion.prefix:
            continue
        if rules.regime == "noise" and _is_vaguer(best, old, ranked):
            continue
        other = base_of(bench, base, fewer, best, rules)
        if _criterion(base, rules) - _criterion(other, rules) <= (ALIKE if rules.regime == "forces" else NEAR):
            continue
        base = other
        new = step_of(best, residuals(base.fit), ranked)
        steps = [new if step is old else step for step in steps]
    return base, steps


def _is_vaguer(best: Candidate, old: Step, ranked: list[Candidate]) -> bool:
    """Return whether an effect that leaves more than noise is not told from zero, and that of a step is.

    LuGre friction beside a gap left less of a measured pendulum than friction with a load, of which the data told
    nothing: 0.06 N.m, standard deviation 0.22, for 0.20 and 0.06.
    """
    assert best.fit is not None
    own = next((c for c in ranked if c.insertion.prefix == old.candidate.insertion.prefix and c.fit is not None), None)
    return own is not None and residuals(best.fit).is_passed and clearness(best) < CLEAR < clearness(own)


def plain(
    bench: Workbench, base: Base, steps: list[Step], rules: Rules, tried: list[Candidate], left: float
) -> tuple[Base, list[Step]]:
    """Put a plainer law, of those tried, in the place of each that contains it, if beside the others it does as well.

    Where the richer one leaves more than noise too, it does so if it leaves no more than laws may be wrong by, and much
    less than the last effect explains, before which chi2 was `left`. It begins as the richer one was fitted, if its own
    fit beside the others did not go further.
    """
    for old in list(steps):
        rich = replace(old.candidate, fit=base.fit)
        others = tuple(i for i in base.taken if i.prefix != rich.insertion.prefix)
        there = {i.prefix for i in others}
        for law in sorted(plainer(old, tried), key=_size):
            if _size(law) >= _size(rich) or law.insertion.prefix in there:
                continue
            values = shared(law.insertion, rich)
            together = (*others, law.insertion)
            try:
                fit = bench.fit(together, {**base.fit.point, **values}, rules.descent, rules.sd, patient=False)
            except SolverError:
                continue
            if law.fit is not None and law.fit.values.keys() == fit.values.keys() and law.fit.chi2 < fit.chi2:
                fit = law.fit
            if contradicted(bench.setup.train, law.insertion, fit):
                continue
            if bic(fit) - bic(base.fit) >= NEAR and not _is_shapeless(bench, base, others, fit, rules, left):
                continue
            found = replace(as_fitted(law, fit, fit), gain=old.candidate.gain)
            base = base_of(bench, base, others, found, rules)
            rivals = [c for c in tried if c.insertion.prefix not in {i.prefix for i in base.taken}]
            steps = [s for s in steps if s is not old] + [step_beside(found, residuals(fit), rivals)]
            break
    return base, steps


def _is_shapeless(
    bench: Workbench, base: Base, others: tuple[Insertion, ...], fit: Fit, rules: Rules, left: float
) -> bool:
    """Return whether a plainer law leaves no more than laws may be wrong by, and the richer one more than noise too.

    It must matter much less than the last effect, before which chi2 was `left`, as well.
    """
    noise = fit.n_residuals
    if not residuals(base.fit).is_passed or fit.chi2 - noise > SIMPLER * (base.fit.chi2 - noise):
        return False
    more = fit.chi2 - base.fit.chi2
    if LAWS * more >= left - base.fit.chi2:
        return False
    try:
        without = bench.fit(others, base.fit.point, (bench.last,), rules.sd, patient=False)
    except SolverError:
        return False
    return more < SHAPE * (without.chi2 - base.fit.chi2)


def _size(candidate: Candidate) -> int:
    return candidate.insertion.complexity


def each_matters(bench: Workbench, base: Base, steps: list[Step], rules: Rules) -> bool:
    """Return whether all that is left may be what the law of any one effect is wrong by: alone it matters so much."""
    if len(steps) == 1:
        return True
    left = base.fit.chi2 - base.fit.n_residuals
    for step in steps:
        fewer = tuple(i for i in base.taken if i.prefix != step.candidate.insertion.prefix)
        try:
            without = bench.fit(fewer, base.fit.point, (bench.last,), rules.sd, patient=False)
        except SolverError:
            continue  # without it the model does not even follow
        if left > SHAPE * (without.chi2 - base.fit.chi2):
            return False
    return True


def settled(
    bench: Workbench, base: Base, steps: list[Step], rules: Rules, past: list[tuple[Base, list[Step]]]
) -> tuple[Base, list[Step]]:
    """Take back the last additions as long as they explain less than is left beyond noise with them.

    What is left then is disturbances, or errors of the laws found before, and so may be what such an addition explains;
    and a law that took the place of another one beside it goes back as well, to the model of the `past`.
    """
    while len(steps) > 1:
        last = steps[-1].candidate.insertion.prefix
        fewer = tuple(insertion for insertion in base.taken if insertion.prefix != last)
        known = next((model for model in reversed(past) if len(model[1]) == len(steps) - 1), None)
        before = known[0] if known else followed(bench, fewer, _early(base, rules), rules, base.bare)
        if before is None or before.fit.chi2 - base.fit.chi2 > base.fit.chi2 - base.fit.n_residuals:
            break
        base, steps = before, known[1] if known else steps[:-1]
    return base, steps


def _early(base: Base, rules: Rules) -> dict[str, float]:
    """Return the fit of the stage of screening."""
    if rules.regime == "forces":
        return base.fit.point
    return base.fits[max(w for w in base.fits if w <= rules.screening)].point


def _criterion(base: Base, rules: Rules) -> float:
    """Return what is compared: BIC, percent of the cost of prediction, or -2 ln likelihood against random forces."""
    if rules.regime == "disturbances":
        return 100 * float(np.log(base.fit.chi2))
    return bic(base.fit) if base.weighed is None else base.weighed.criterion
