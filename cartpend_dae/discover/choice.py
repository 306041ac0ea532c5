"""Which of several effects that were fitted to take, and what the data cannot tell from it."""

from dataclasses import replace

import numpy as np

from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.disturbed import ALIKE as ALIKE_WEIGHED
from cartpend_dae.discover.disturbed import fitted, is_composite
from cartpend_dae.discover.evidence import described, free_corrections, peaks_alone, price_of_corrections
from cartpend_dae.discover.gate import is_clean, most_of_noise, residuals
from cartpend_dae.discover.records import Candidate, Gate, Step
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import catalogue
from cartpend_dae.errors import SolverError

# models whose criterion differs by less than this, or this share of chi2, explain the data alike: the smaller is taken
ALIKE, ALIKE_SHARE, ALIKE_WHITE = 10.0, 0.01, 0.02
# responses with a larger cosine move the data alike
PARALLEL, SAME = 0.95, 0.999
# differences of BIC: what is one model in other words, what explains as much, and what explains clearly less
EQUAL = 0.1
NEAR, FAR_BEHIND = 3.0, 100.0
# what a law that is linear in the motion depends on
LINEAR = {"1", "x", "v", "a"}
# laws are right to some percent, and so much of what they explain may be left by their shape: where none leaves noise
# alone, those that differ by less than this share of the squares are alike; and what is left then shows no other
# effect, unless it leaves noise alone
SHAPE = 0.03
# what explains less than this share of what the additions before do is their shape, even if it leaves noise alone
TOUCH = 0.01
# ... and against random forces less than this share of the most that one of them does: -2 ln likelihood grows with the
# logarithm of what is left, so that the last of several effects, after which only small forces are, gains most. Of sets
# with one effect of another shape a second one gained 0.13 to 0.24 of it (reported seed 1121, linear cart)
FORCED = 0.3
SHAPELESS = "it explains no more than the laws found already may be wrong by"
# so many times what the best of them leaves beyond noise another law may leave and still be alike, and a simpler case
# of the best one itself
WORSE, SIMPLER = 4.0, 10.0
UNSURE = "its size differs from zero by less than its standard deviation"
ROUNDED = "`{}` that is rounded at rest explains it with fewer parameters"


def ordered_by_bic(bench: Workbench, judged: list[Candidate], base: Base, rules: Rules) -> list[Candidate]:
    """Put the one to take first: of those that explain the data alike, the one with the fewest parameters."""
    judged = sorted(judged, key=lambda c: (bool(c.why_not), -c.gain))
    good = [c for c in judged if not c.why_not]
    if not good:
        return judged
    at_once = [c for c in good if _does_several_at_once(c)]
    at_once = at_once if len(at_once) < len(good) else []
    judged = [
        replace(c, why_not="simpler ones come first: it does several things at once") if c in at_once else c
        for c in judged
    ]
    good = [c for c in good if c not in at_once]
    if all(c.fit is not None and residuals(c.fit).is_passed for c in good):
        unsure = [c for c in good if not is_determined(c)]
        unsure = unsure if len(unsure) < len(good) else []
        judged = [replace(c, why_not=UNSURE) if c in unsure else c for c in judged]
        good = [c for c in good if c not in unsure]
    best = good[0]
    assert best.fit is not None
    alike = [c for c in good if best.gain - c.gain < _margin(c, best) or _is_shapeless(c, judged, base)]
    alike = [c for c in alike if not is_composite(c.insertion)] or alike
    alike = [c for c in alike if not _is_bent(c)] or alike
    fewest = min(_numbers(c) for c in alike)
    first = _likeliest(bench, _plainest([c for c in alike if _numbers(c) == fewest]), base, rules)
    others = [replace(c, why_not=c.why_not or second(c, first)) for c in judged if c is not first]
    return [first, *others]


def _numbers(candidate: Candidate) -> int:
    """Return how many numbers a fit has; the height of a peak at rest alone is tried, and all in a range are alike."""
    return described(candidate.fit, candidate.insertion) - len(peaks_alone(candidate.insertion))


def _is_bent(candidate: Candidate) -> bool:
    """Return whether what corrects a law ends on a bound from which it never begins: it is hardly that law any more.

    Drag of the power 1.5, the least that there is, explained measured viscous friction better by 2 of BIC.
    """
    assert candidate.fit is not None
    begins = candidate.insertion.correction_starts
    ends = [e for e in candidate.fit.parameters if e.name in begins and e.status == "at-bound"]
    return any(not np.isclose(e.value, begins[e.name]).any() for e in ends)


def clearness(candidate: Candidate) -> float:
    """Return by how many standard deviations one of the sizes differs from zero, with residuals as they are."""
    assert candidate.fit is not None
    sizes = [e for e in candidate.fit.parameters if e.name in candidate.insertion.size_names]
    return float(max((abs(e.value) / e.sd for e in sizes if e.sd > 0), default=0.0))


def is_determined(candidate: Candidate) -> bool:
    """Return whether one of the sizes differs from zero by its standard deviation, with residuals as they are."""
    return clearness(candidate) > 1.0


def rounded_first(ranked: list[Candidate]) -> list[Candidate]:
    """Put the plainest law of dry friction first where the best one would be weaker at rest than in motion.

    No contact is; but one that creeps before it slides seems so, and other laws would take up what rounds its corner.
    It stays as it is where anything but a law of the same contact explains more than the plainest.
    """
    fitted_ones = [c for c in ranked if c.fit is not None]
    best = max(fitted_ones, key=lambda c: c.gain, default=None)
    if best is None or best.fit is None or not best.insertion.contradiction(best.fit.values):
        return ranked
    good = [c for c in ranked if not c.why_not]
    tied = [c for c in fitted_ones if c.gain > 0 and (c in good or c.why_not == second(c, ranked[0]))]
    plain = min((c for c in tied if contains(best, c, ranked)), key=lambda c: c.insertion.complexity, default=None)
    if plain is None or any(c.gain > plain.gain and not is_other_law(c, plain) for c in tied):
        return ranked
    others = [replace(c, why_not=c.why_not or ROUNDED.format(plain.insertion.prefix)) for c in ranked if c is not plain]
    return [replace(plain, why_not=""), *others]


def _does_several_at_once(candidate: Candidate) -> bool:
    """Return whether an effect between two parts contains another one of the catalogue, and yet leaves more than noise.

    It would soak up a part of what is missing elsewhere, as friction that lies where a chain gives way. What is left in
    the size of noise, of whatever colour, is no part of another effect.
    """
    fit = candidate.fit
    if fit is None or not is_composite(candidate.insertion):
        return False
    return residuals(fit).is_passed and fit.chi2 > most_of_noise(fit.n_residuals)


def _plainest(tied: list[Candidate]) -> list[Candidate]:
    """Leave out laws of more parameters, some of which end on their bounds, that explain no more than one of fewer."""
    least = min(c.insertion.complexity for c in tied)
    plain = max(c.gain for c in tied if c.insertion.complexity == least)
    return [c for c in tied if c.insertion.complexity == least or c.gain > plain + NEAR]


def _margin(candidate: Candidate, best: Candidate) -> float:
    """Return by how much the criterion of a candidate may be behind and still count as alike.

    One that leaves nothing but noise may be further behind: what is missing is then a matter of the law's exact shape.
    """
    assert candidate.fit is not None and best.fit is not None
    if _lacks_one_shape(candidate, best):
        return NEAR
    share = ALIKE_WHITE if is_clean(candidate.fit) else ALIKE_SHARE
    # so many percent of chi2 are so many percent of the number of residuals in BIC, which has the logarithm of chi2
    return max(ALIKE, share * best.fit.n_residuals)


def _lacks_one_shape(simple: Candidate, rich: Candidate) -> bool:
    """Return whether a law of a contact that was tried in several shapes has one number of shape less than another one.

    Its own shapes are not the right one then, and BIC decides: hysteresis, whose loop may be narrower than that of Dahl
    friction, had been taken for it at 5 standard deviations of that number (reported seed 1129).
    """
    one, other = simple.insertion, rich.insertion
    is_by_shape = len(one.size_names) == len(other.size_names) and other.complexity == one.complexity + 1
    has_shapes = any(parameter.role == "choice" for parameter in one.card.parameters)
    return is_by_shape and has_shapes and is_other_law(simple, rich)


def _likeliest(bench: Workbench, tied: list[Candidate], base: Base, rules: Rules) -> Candidate:
    """Return the best of those as simple as each other; against random forces, where none leaves noise alone.

    There a law that is linear in the motion is simpler than one that is not.
    """
    leaves_noise = any(c.fit is not None and not residuals(c.fit).is_passed for c in tied)
    if len(tied) == 1 or leaves_noise:
        return _in_the_rig(tied)

    def criterion(candidate: Candidate) -> float:
        assert candidate.fit is not None
        together = (*base.taken, candidate.insertion)
        try:
            return fitted(bench, together, rules.loads, candidate.fit.point, rules.screening, rules.sd)[1].criterion
        except SolverError:  # it diverges with the injection of that stage
            return np.inf

    values = [criterion(candidate) for candidate in tied]
    near = [c for c, value in zip(tied, values, strict=True) if value < min(values) + ALIKE_WEIGHED]
    linear = [c for c in near or tied if _is_linear(c)]
    return linear[0] if linear else tied[int(np.argmin(values))]


def _is_linear(candidate: Candidate) -> bool:
    """Return whether a law is linear in the motion, and fitted without a correction that makes it another one."""
    assert candidate.fit is not None
    is_corrected = bool(free_corrections(candidate.fit, candidate.insertion))
    return set(candidate.insertion.card.regressors) <= LINEAR and not is_corrected


def _in_the_rig(tied: list[Candidate]) -> Candidate:
    """Return the best law; of those that are as good to the last digits one in the rig, not the recorder's clock."""
    best = max(tied, key=_plain_gain)
    if best.insertion.card.insertion != "clock":
        return best
    others = [c for c in tied if c is not best and _plain_gain(c) > _plain_gain(best) - EQUAL]
    return max(others, key=_plain_gain, default=best)


def _plain_gain(candidate: Candidate) -> float:
    """Return by how much BIC falls with the law alone, without corrections of it that the data do not call for."""
    assert candidate.fit is not None
    n_free = len(free_corrections(candidate.fit, candidate.insertion))
    charged = n_free * float(np.log(candidate.fit.n_residuals))
    return candidate.gain + charged - price_of_corrections(candidate.fit, candidate.insertion)


def _is_shapeless(candidate: Candidate, judged: list[Candidate], base: Base) -> bool:
    """Return whether a candidate explains nearly as much as any, none explains all, and its law may have its shape."""
    if candidate.insertion.card.is_exact:
        return False
    good = [c for c in judged if c.fit is not None and not c.why_not]
    best = min(good, key=lambda c: c.fit.chi2 if c.fit else np.inf)
    assert candidate.fit is not None and best.fit is not None
    if any(not residuals(c.fit).is_passed for c in good if c.fit is not None):
        return False
    least, noise = best.fit.chi2, best.fit.n_residuals
    most = SIMPLER if contains(best, candidate, judged) else WORSE
    if candidate.fit.chi2 - noise > most * (least - noise):
        return False
    return candidate.fit.chi2 - least < SHAPE * (base.fit.chi2 - least)


def is_tied(candidate: Candidate, first: Candidate) -> bool:
    """Return whether a candidate was good enough, and explains the data as one does that was put before it."""
    if candidate.fit is None or candidate.why_not != second(candidate, first):
        return False
    return abs(first.gain - candidate.gain) < _margin(candidate, first)


def second(candidate: Candidate, first: Candidate) -> str:
    """Say why another effect is taken."""
    explains = "explains as much with fewer parameters" if candidate.gain > first.gain else "explains more"
    return f"`{first.insertion.prefix}` {explains}"


def least_beyond(steps: list[Step]) -> float:
    """Return what a further effect must explain of the likelihood, as the laws of some steps may be wrong by less."""
    return FORCED * max((step.candidate.gain for step in steps), default=0.0)


def beyond_shape(ranked: list[Candidate], steps: list[Step]) -> list[Candidate]:
    """Refuse what explains less of the likelihood than the laws of some steps may be wrong by."""
    least = least_beyond(steps)
    judged = [c if c.why_not or c.gain >= least else replace(c, why_not=SHAPELESS) for c in ranked]
    return sorted(judged, key=lambda c: bool(c.why_not))


def step_of(winner: Candidate, gate: Gate, ranked: list[Candidate]) -> Step:
    """Return an accepted addition with what the data cannot tell from it.

    Those are places that move alike, effects as good, and effects that act alike; apart from them, laws that contain
    the winner, which explain no more by their further parameters.
    """
    alike = [other for other in ranked if _is_alike(winner, other)]
    richer = [other for other in alike if contains(other, winner, ranked)]
    rivals = [named(other) for other in alike if other not in richer]
    return Step(winner, gate, (*_elsewhere(winner), *rivals), tuple(named(other) for other in richer))


def step_beside(part: Candidate, gate: Gate, ranked: list[Candidate]) -> Step:
    """Return an addition that was fitted together with others, with what was predicted to move the data alike.

    What others explained alone says nothing beside them, so that these are proposals: `splits` fits them in its place.
    """
    able = [c for c in ranked if not (contains(c, part, ranked) or contains(part, c, ranked))]
    alike = [c for c in able if are_parallel(part, c)]
    return Step(part, gate, (*_elsewhere(part), *map(named, alike)))


def _elsewhere(candidate: Candidate) -> list[str]:
    """Return the names of an effect at the places that move as its own does."""
    return [f"{candidate.insertion.card.id} at {place}" for place in candidate.insertion.place.same_motion]


def named(candidate: Candidate) -> str:
    """Return the name of an effect at a place, as reports give it."""
    return f"{candidate.insertion.card.id} at {candidate.insertion.place.at}"


def _is_alike(winner: Candidate, other: Candidate) -> bool:
    """Return whether an effect explains as much, or was predicted to move the data alike and not seen to do worse.

    It explains as much where its criterion is within NEAR; it does worse where its last fit or, without one, its first
    is clearly behind.
    """
    if other.insertion.prefix == winner.insertion.prefix:
        return False
    is_fitted = other.fit is not None and other.gain != 0.0
    if is_fitted and abs(winner.gain - other.gain) < NEAR:
        return True
    is_worse = is_fitted and winner.gain - other.gain > FAR_BEHIND
    if other.early is not None and winner.early is not None:
        is_worse |= other.early - winner.early > FAR_BEHIND
    return are_parallel(winner, other) and not is_worse


def contains(rich: Candidate, simple: Candidate, ranked: list[Candidate]) -> bool:
    """Return whether a law at a place contains another one at the same place, be it by a law in between.

    That one need not be among those that were fitted.
    """
    above = {card.id: card.nested_in for card in catalogue()}
    above |= {c.insertion.card.id: c.insertion.card.nested_in for c in (*ranked, simple)}
    known, new = set[str](), {simple.insertion.card.id}
    while new:
        known |= new
        new = {richer for card in new for richer in above.get(card, ())} - known
    return rich.insertion.place.at == simple.insertion.place.at and rich.insertion.card.id in known


def are_parallel(one: Candidate, other: Candidate, cosine: float = PARALLEL) -> bool:
    """Return whether two candidates are one, or were predicted to move the residuals in one direction."""
    if one.insertion.prefix == other.insertion.prefix:
        return True
    if one.response is None or other.response is None or one.response.size != other.response.size:
        return False
    return abs(float(one.response @ other.response)) > cosine
