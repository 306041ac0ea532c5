"""Stage 3: the most promising effects are fitted and judged, and one of them is put first."""

from dataclasses import replace

import numpy as np

from cartpend_dae.discover.attempts import each
from cartpend_dae.discover.choice import SHAPELESS, is_determined, ordered_by_bic, rounded_first, second
from cartpend_dae.discover.contact import is_other_law, is_other_link
from cartpend_dae.discover.contradicted import contradicted
from cartpend_dae.discover.disturbed import ALIKE, is_composite, judge, margin_of, ordered, penalty
from cartpend_dae.discover.evidence import bic, cancelled, coloured_bic, ended_at_zero
from cartpend_dae.discover.first import first_fit
from cartpend_dae.discover.gate import is_clean, is_noise_alone
from cartpend_dae.discover.held import held_elsewhere
from cartpend_dae.discover.nearest import NARROW, left_by, left_early, nearest
from cartpend_dae.discover.nested import (
    MUCH,
    chosen_otherwise,
    holds,
    own,
    restarted,
    simplified,
    with_cutoffs,
    with_gaps,
    with_peaks,
)
from cartpend_dae.discover.predicted import trials
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.rescan import rescanned
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.shape import MOST, is_shape_error
from cartpend_dae.discover.shortlist import (
    as_well,
    at_few_places,
    best_of_each,
    equivalents,
    is_simple,
    unlike,
    with_others,
    with_waves,
)
from cartpend_dae.discover.stages import HIDDEN, screened_freely, screened_where_it_shows
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.workbench import ROUGH, Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# so many of the best predictions are fitted at the first stage; the best of them with less injection, in so many steps
WIDE, MIDDLE, LATER = 10, 8, 10
# plainer laws start again from richer ones so often, as one that was reached so may lead to a plainer one still
DOWN = 2
# against random forces: so many are fitted, of those that promise this share of what they must gain
FEW, HALF = 5, 0.5
# so many where one is only to be confirmed
RIVALS = 3
# share of what a law of dry friction explains against random forces by which another of its contact is clearly better
LAW = 0.1
# a law that leaves less than so many times what the best one leaves at first may be the wrong one of its contact
NEAR = 1.5
# predictions below this share of the best one are not fitted
FAINT = 0.03
# noise alone: drop of BIC (largest on 90 data sets with nothing missing: 8.6)
MIN_BIC_GAIN = 20.0


def try_all(
    bench: Workbench, base: Base, rules: Rules, options: list[Insertion], least: float = 0.0
) -> list[Candidate]:
    """Screen all, fit the most promising, and judge; the accepted one, if any, comes first.

    Against random forces those are fitted alone that promise a good part of the `least` that they must gain.
    """
    if rules.regime == "disturbances":
        return trials(bench, base.taken, base.fit, options, rules.sd)
    if rules.regime == "forces":
        return weighed_trials(bench, base, rules, options, pointed=() if base.taken else rules.told, least=least)
    return try_in_noise(bench, base, rules, options)[1]


def try_in_noise(bench: Workbench, base: Base, rules: Rules, options: list[Insertion]) -> tuple[float, list[Candidate]]:
    """Do so where noise is all that is left; return also the bandwidth of the stage at which they were screened.

    Where none is accepted, and one promises nearly all of the free simulation, they are screened there as well: the
    injection is led astray by a sensor that is far too late, and hides it.
    """
    stage, screened = screened_where_it_shows(bench, base, rules, options)
    ranked = _tried(bench, base, rules, stage, screened)
    if base.taken or stage == bench.last or any(c.fit is not None and not c.why_not for c in ranked[:1]):
        return stage, ranked
    freely = screened_freely(bench, base, rules, options)
    again = _tried(bench, base, rules, bench.last, freely, is_led=False) if freely else []
    return (bench.last, again) if again and not again[0].why_not else (stage, ranked)


def _tried(
    bench: Workbench, base: Base, rules: Rules, stage: float, screened: list[Candidate], *, is_led: bool = True
) -> list[Candidate]:
    """Fit the most promising of those screened at a stage, and judge; what is not led has no injection later either."""
    possible = [c for c in screened if not c.why_not]
    rest = [c for c in screened if c.why_not]
    if not base.taken and not any(_shows(c, base.fits[stage]) for c in possible):
        return [replace(c, why_not=_promises_little(c, base.fits[stage])) for c in possible] + rest
    wide = [c for c in possible[:WIDE] if c.predicted > FAINT * possible[0].predicted]
    wide += as_well(wide, possible[WIDE:])
    wide += equivalents(wide, possible[WIDE:], FAINT)
    wide += [c for c in possible if c not in wide and any(holds(other, c) for other in wide)]
    wide += [c for c in possible if c not in wide and any(holds(c, other) for other in wide)]
    wide, elsewhere = at_few_places(wide)
    early, enough = _first_fits(bench, base, rules, stage, wide)
    best = sorted(early, key=left_early)[:NARROW]
    told = {c.insertion.card.id for c in best if is_composite(c.insertion)}
    more = [c for c in elsewhere if c.insertion.card.id in told]
    if more:
        new, enough = _first_fits(bench, base, rules, stage, more, enough)
        early += new
    laws = other_laws(best, [c for c in possible if c not in wide and c not in elsewhere])
    if laws:
        new, enough = _first_fits(bench, base, rules, stage, laws, enough)
        early, wide = early + new, wide + laws
    if enough is None and not any(c.fit and explains_most(c.fit, base.fits[stage]) for c in early):
        others = [c for c in possible if c not in wide and c not in elsewhere]
        later = [c for c in others if c.predicted > FAINT * possible[0].predicted][:WIDE]
        early += _first_fits(bench, base, rules, stage, later, enough)[0]
        wide += later
    rest += [replace(c, why_not="others promise more") for c in possible if c not in wide and c not in more]
    rest += [c for c in early if c.why_not]
    ranked = sorted((c for c in early if not c.why_not), key=lambda c: bic(c.fit) if c.fit else np.inf)
    few = ranked[:MIDDLE] + [c for c in ranked[MIDDLE:] if is_simple(c)][:NARROW]
    rest += [replace(c, fit=None, why_not="others explain more at the first stage") for c in ranked if c not in few]
    judged = _judged(bench, base, rules, few, is_led)
    complete = [c for c in judged if c.fit is not None]
    ranked = rounded_first(ordered_by_bic(bench, complete, base, rules))
    return with_waves(ranked + [c for c in judged if c.fit is None] + rest, screened)


def other_laws(best: list[Candidate], others: list[Candidate]) -> list[Candidate]:
    """Return other laws of a link or a contact of which one is nearly the best at the first stage.

    A law promises little where its first order is that of a start far from it: one with a memory where nothing rubs
    yet, which is not asked for where another leaves noise alone, and a spring that hardens at once.
    """
    if not best or best[0].fit is None:
        return []
    near = [c for c in best if left_early(c) < NEAR * left_early(best[0])]
    found = [c for c in others if any(is_other_link(c, one) for one in near)]
    if not is_noise_alone(best[0].fit):
        found += [c for c in others if any(is_other_law(c, one) for one in near)]
    return found


def explains_most(fit: Fit, before: Fit) -> bool:
    """Return whether a fit leaves little beyond noise of what was left before it, at the stage of that fit."""
    return fit.chi2 - fit.n_residuals < MOST * (before.chi2 - fit.n_residuals)


def _shows(candidate: Candidate, fit: Fit) -> bool:
    """Return whether an effect promises to explain a good part of what is more than noise."""
    return candidate.predicted > HIDDEN * (fit.chi2 - fit.n_residuals)


def _promises_little(candidate: Candidate, fit: Fit) -> str:
    return f"it promises {100 * candidate.predicted / fit.chi2:.1f} % of what is left, and none promises much more"


def weighed_trials(
    bench: Workbench,
    base: Base,
    rules: Rules,
    options: list[Insertion],
    rivals: tuple[str, ...] = (),
    pointed: tuple[Candidate, ...] = (),
    least: float = 0.0,
) -> list[Candidate]:
    """Screen all against random forces, fit the most promising of what must gain the `least`, and judge.

    Where only `rivals` (prefixes of effects) are to be confirmed, they are fitted with the first few others, each from
    one start; those `pointed` at are fitted from the point of their first fit too, whatever they promise, and where
    there are no rivals if they promise too little to be fitted else.
    """
    fit, weighed = base.fit, base.weighed
    assert weighed is not None
    screened = screen(bench, base.taken, fit.point, options, float(fit.bandwidth[0]), rules.sd, weighed=weighed)
    cost = penalty(len(options))
    possible = [c for c in screened if not c.why_not]
    possible.sort(key=lambda c: len(c.insertion.size_names) * cost - c.predicted)
    few = unlike([c for c in possible if c.predicted > HALF * max(cost * len(c.insertion.size_names), least)])
    few = few[: RIVALS if rivals else FEW]
    few += [c for c in possible if c not in few and c.insertion.prefix in rivals]
    richer_than = [c for c in few if not rivals or c.insertion.prefix in rivals]
    few += [c for c in possible if c not in few and any(holds(c, other) for other in richer_than)]
    few += [c for c in possible if c not in few and is_simple(c) and any(holds(other, c) for other in few)]
    rest = [c for c in screened if c.why_not]
    rest += [replace(c, why_not="others promise more") for c in possible if c not in few]
    for candidate in few:
        bench.expect(candidate.parameters)

    def judged_at(at: Workbench, candidate: Candidate) -> Candidate:
        return judge(at, base.taken, rules.loads, (fit, weighed), candidate, rules.sd, len(options))

    starts = few if rivals else with_others(few)
    known = {c.insertion.prefix: c for c in screened}
    begun = set[str]() if rivals else {c.insertion.prefix for c in few}
    pointed = tuple(c for c in pointed if c.begun and c.insertion.prefix not in begun)
    told = [replace(known.get(c.insertion.prefix, c), parameters=dict(c.begun), why_not="") for c in pointed]
    fitted = {c.insertion.prefix for c in told}
    rest = [c for c in rest if c.insertion.prefix not in fitted]
    judged = each(bench, [*starts, *told], judged_at, "last fit")
    judged = best_of_each(judged, lambda c: -c.gain)
    again = restarted(judged, lambda c: c.gain if c.fit else -np.inf)
    judged += map(own, each(bench, again, judged_at, "last fit"))
    judged = best_of_each(judged, lambda c: -c.gain)
    again = simplified(judged, lambda c: -c.gain, lambda plain, rich: plain - rich > ALIKE)
    judged += map(own, each(bench, again, judged_at, "last fit"))
    judged = best_of_each(judged, lambda c: -c.gain)
    found = [c for c in judged if c.fit is not None]
    return rounded_first(ordered(found, second)) + [c for c in judged if c.fit is None] + rest


def lead_needed(best: Candidate, told: Candidate, in_noise: Candidate | None) -> float:
    """Return how much more another effect must explain against random forces than one that noise alone told.

    Parameters
    ----------
    best
        The other effect, fitted against random forces.
    told
        The effect as it was taken in noise alone.
    in_noise
        The other one as it was judged there, if it was: where it explained more, but not by as much as the shape of a
        law, noise told nothing of the law.
    """
    is_told = in_noise is None or not in_noise.gain > told.gain
    return LAW * best.gain if is_told and is_other_law(best, told) else margin_of(best, told)


def _first_fits(
    bench: Workbench, base: Base, rules: Rules, stage: float, wide: list[Candidate], enough: Candidate | None = None
) -> tuple[list[Candidate], Candidate | None]:
    """Fit those with the fewest parameters first; where one leaves noise alone, much richer ones need no fit.

    Return also the one that is `enough`, which may be one of earlier fits.
    """
    for candidate in wide:
        bench.expect(candidate.parameters)
    found: list[Candidate] = []
    for count in sorted({c.insertion.complexity for c in wide}):
        these = [c for c in wide if c.insertion.complexity == count]
        if enough is not None and count > enough.insertion.complexity + 1:
            found += [replace(c, fit=None, why_not=_far_simpler(enough)) for c in these]
            continue
        starts = with_others(these)
        new = each(bench, starts, lambda at, candidate: first_fit(at, base, rules, stage, candidate), "first fit")
        again = restarted([*found, *new], lambda c: -left_by(c))
        again = [c for c in again if c.insertion.complexity == count]
        new += map(own, each(bench, again, lambda at, c: first_fit(at, base, rules, stage, c), "first fit"))
        new = best_of_each(new, left_by)
        found += new
        enough = enough or _enough(bench, base, rules, new)
    again, changed = rescanned(bench, base, rules, stage, found), None
    for _ in range(DOWN):
        again += simplified(found, left_by, new=changed)
        if not again:
            break
        new = map(own, each(bench, again, lambda at, c: first_fit(at, base, rules, stage, c), "first fit"))
        before = {c.insertion.prefix: left_by(c) for c in found}
        found, again = best_of_each([*found, *new], left_by), []
        changed = frozenset(c.insertion.prefix for c in found if left_by(c) < before[c.insertion.prefix])
    return found, enough


def _enough(bench: Workbench, base: Base, rules: Rules, new: list[Candidate]) -> Candidate | None:
    """Return the best of some candidates that do one thing if it leaves noise alone, with injection and without."""
    fitted_ones = [c for c in new if c.fit is not None and not c.why_not and not is_composite(c.insertion)]
    best = min(fitted_ones, key=left_by, default=None)
    if best is None or best.fit is None or not _is_clean(best):
        return None
    together = (*base.taken, best.insertion)
    try:
        last = bench.fit(together, best.fit.point, (rules.screening, bench.last), rules.sd, patient=False)
    except SolverError:  # without injection it diverges
        return None
    return best if is_noise_alone(last) else None


def _far_simpler(enough: Candidate) -> str:
    return f"`{enough.insertion.prefix}` leaves nothing but noise with far fewer parameters"


def _judged(bench: Workbench, base: Base, rules: Rules, few: list[Candidate], is_led: bool = True) -> list[Candidate]:
    """Fit to the end those with the fewest parameters first; where one leaves noise alone, richer ones need no fit.

    Before that all that may be led are fitted with the least injection, where some fall behind for good; where one that
    does not is refused, the next one takes its place.
    """
    ahead = min((left_by(c) for c in few), default=np.inf)
    if is_led:
        few = each(bench, few, lambda at, candidate: _nearer(at, base, rules, candidate, ahead), "nearer fit")
    found = [c for c in few if c.why_not]
    few = [c for c in few if not c.why_not]
    places, last = NARROW, list[Candidate]()
    while new := [c for c in nearest(few, base.fit.n_residuals, places) if c not in last]:
        last += new
        found += _last_fits(bench, base, rules, new, found)
        names = {c.insertion.prefix for c in last}
        judged = [c for c in found if c.insertion.prefix in names]
        if any(not c.why_not and _is_clean(c) for c in judged):
            break
        places = NARROW + sum(bool(c.why_not) or not is_determined(c) for c in judged)
    behind = [c for c in few if c not in last]
    others = chosen_otherwise([*found, *behind])
    found += [replace(c, fit=None, why_not="others explain more at the next stage") for c in behind]
    again = simplified(found, left_by) + others
    found += map(own, each(bench, again, lambda at, candidate: judge_in_noise(at, base, rules, candidate), "last fit"))
    return best_of_each(found, left_by)


def _last_fits(
    bench: Workbench, base: Base, rules: Rules, new: list[Candidate], before: list[Candidate]
) -> list[Candidate]:
    """Fit some candidates to the end, those with the fewest parameters first, as long as none before leaves noise."""
    found: list[Candidate] = []
    for count in sorted({c.insertion.complexity for c in new}):
        these = [c for c in new if c.insertion.complexity == count]
        enough = next((c for c in [*before, *found] if not c.why_not and _is_clean(c)), None)
        if enough is not None and count > enough.insertion.complexity + 1:
            found += [replace(c, fit=None, why_not=_far_simpler(enough)) for c in these]
            continue
        found += each(bench, these, lambda at, candidate: judge_in_noise(at, base, rules, candidate), "last fit")
    return found


def _is_clean(candidate: Candidate) -> bool:
    return candidate.fit is not None and is_clean(candidate.fit)


def _nearer(bench: Workbench, base: Base, rules: Rules, candidate: Candidate, ahead: float) -> Candidate:
    """Fit a candidate with the least injection, roughly; one near the best, which leaves `ahead`, from more starts."""
    together = (*base.taken, candidate.insertion)
    assert candidate.fit is not None
    points = with_peaks(candidate.insertion, candidate.fit.point)
    if left_by(candidate) < MUCH * ahead and not _is_clean(candidate):
        points += with_gaps(candidate.insertion, candidate.fit.point)[1:]
        points += with_cutoffs(candidate.insertion, candidate.fit.point)
    # a free simulation may drift off at first; predictions do not
    least = bench.last or min(w for w in rules.stages if w > 0)
    fits, failure = [], SolverError("its simulation diverges")
    for point in points:
        try:
            fits.append(bench.fit(together, point, (least,), rules.sd, patient=False, iterations=LATER, stride=ROUGH))
        except SolverError as error:  # it diverges from this start
            failure = error
    fits = [fit for fit in fits if np.isfinite(fit.chi2)]
    if not fits:
        raise failure
    return replace(candidate, fit=min(fits, key=lambda fit: fit.chi2))


def too_little(gain: float) -> str:
    """Say how far BIC falls where that is not enough."""
    if abs(gain) < 0.05:  # what is written with one digit
        return "BIC stays as it is"
    return f"BIC falls by {gain:.1f}, less than {MIN_BIC_GAIN:g}" if gain > 0 else f"BIC rises by {-gain:.1f}"


def judge_in_noise(bench: Workbench, base: Base, rules: Rules, candidate: Candidate) -> Candidate:
    """Fit a candidate to the end, from its fit or a whole point, and say whether it is worth its parameters."""
    together = (*base.taken, candidate.insertion)
    begin = candidate.fit.point if candidate.fit else candidate.parameters
    fit = bench.fit(together, begin, (bench.last,), rules.sd, patient=False)
    fit = held_elsewhere(bench, together, candidate.insertion, fit, rules.sd)
    parameters = {name: fit.values[name] for name in candidate.insertion.parameter_names}
    gain, t = bic(base.fit) - bic(fit), _white_t(fit, candidate.insertion)
    coloured = coloured_bic(base.fit) - coloured_bic(fit)
    why = "" if gain > MIN_BIC_GAIN else too_little(gain)
    if not why and coloured < MIN_BIC_GAIN and not explains_most(fit, base.fit):
        why = f"with residuals as alike as they are BIC falls by {coloured:.1f} only, less than {MIN_BIC_GAIN:g}"
    if not why and is_shape_error(base, fit):
        why = f"{SHAPELESS}, and leaves more than noise"
    why = why or contradicted(bench.setup.train, candidate.insertion, fit)
    why = why or cancelled(fit, candidate.insertion, base.taken)
    if not why and is_absent(fit, candidate.insertion):
        why = "its parameter ends on its bound, where it has no effect"
    return replace(candidate, parameters=parameters, gain=gain, t=t, fit=fit, why_not=why)


def is_absent(fit: Fit, insertion: Insertion) -> bool:
    """Return whether all sizes of an effect end on bounds that are not the other end of how much of it there can be."""
    sizes = {e.name for e in fit.parameters if e.name in insertion.size_names}
    return bool(sizes) and sizes <= ended_at_zero(fit, insertion)


def _white_t(fit: Fit, insertion: Insertion) -> float:
    ratios = [abs(e.value) / e.sd for e in fit.parameters if e.name in insertion.parameter_names and e.sd > 0]
    return float(min(ratios, default=0.0))
