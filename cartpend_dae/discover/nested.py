"""Where a law starts anew: from one of the same place that contains it or that it contains, and that went further.

A law explains no less than one that it contains. Where its fit does, it went astray, as one does that sticks for good;
so may one that explains much less than a richer law, of which it may be a case.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.evidence import SPEEDS, ended_at_zero, peaks_alone
from cartpend_dae.discover.gate import is_clean
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.shortlist import corrected, each_choice
from cartpend_dae.effects import Insertion

# a peak at rest begins so many times as high as what it peaks above: at its height no start from rest tells it
PEAK = 1.3
# ... or as many as a law says that has this parameter
RATIO = "r_s"
# ... and where its fit does not tell, as it acts only where a run stops for good, it is tried at each of these
PEAKS = (PEAK, 1.6, 2.0, 2.5)
# a gap that is not passed in the order of the data is tried at these multiples of its width, and of its shape
WIDTHS, PUSHES = (0.7, 1.0, 1.4, 2.0), (0.6, 1.5)
# ... and a law with a frequency of its own, whose parameter ends so, at these multiples of it
CUTOFF, FARTHER = ".w_c", (0.2, 5.0)
# a law that leaves so many times more than a richer one starts from that
MUCH = 2.0
# ... and one that sticks creeps, where a richer one that is weaker at rest is likelier by this [-2 ln likelihood]
CREEPS = 20.0
# ends of names of a parameter each way
WAYS = ("_pos", "_neg")


def restarted(fitted: list[Candidate], worth: Callable[[Candidate], float]) -> list[Candidate]:
    """Return the richer ones of some candidates from the best plainer one that is worth more, with its whole fit.

    One whose fit is not of the law that it is called is worth nothing.

    Parameters
    ----------
    fitted
        Candidates that were fitted, or failed.
    worth
        What a candidate is worth; larger is better.

    Returns
    -------
    list
        Candidates whose `parameters` are the point of the plainer fit and their own, to start from.
    """
    found: list[Candidate] = []
    for rich in fitted:
        plain = [c for c in fitted if c.fit is not None and holds(rich, c)]
        best = max(plain, key=worth, default=None)
        is_better = rich.fit is not None and not contradicts(rich) and best is not None and worth(rich) >= worth(best)
        if best is None or best.fit is None or is_better:
            continue
        found.append(replace(rich, parameters={**best.fit.point, **as_plain(rich.insertion, best)}, fit=None))
    return found


def simplified(
    fitted: list[Candidate],
    left: Callable[[Candidate], float],
    is_behind: Callable[[float, float], bool] = lambda plain, rich: plain >= MUCH * rich,
    new: frozenset[str] | None = None,
) -> list[Candidate]:
    """Return the plainer ones of some candidates from the best richer one: its whole fit, each choice and correction.

    Those that leave much more than it does, and those whose fit is not what they are called; and such as stick, where
    the data tell that a richer law is weaker at rest.

    Parameters
    ----------
    fitted
        Candidates that were fitted, or failed.
    left
        What a candidate leaves; infinite without a fit.
    is_behind
        Whether a plainer law that leaves the first leaves much more than a richer one that leaves the second.
    new
        Prefixes of richer laws that ended elsewhere since this was asked last; None for all.

    Returns
    -------
    list
        Candidates as of `restarted`.
    """
    found: list[Candidate] = []
    for plain in fitted:
        rich = min((c for c in fitted if c.fit is not None and holds(c, plain)), key=left, default=None)
        if rich is None or rich.fit is None or (new is not None and rich.insertion.prefix not in new):
            continue
        values = shared(plain.insertion, rich)
        if values and (is_behind(left(plain), left(rich)) or contradicts(plain)):
            options = each_choice(plain) + corrected(plain) + (_creeping(plain, rich) if contradicts(rich) else [])
            found += _from(rich, values, options)
        elif plain.insertion.card.creeping is not None:
            weak = [c for c in fitted if c.fit is not None and holds(c, plain) and contradicts(c)]
            weaker = min(weak, key=left, default=None)
            if weaker is not None and _is_told(left(plain), left(weaker), weaker):
                found += _from(weaker, shared(plain.insertion, weaker), _creeping(plain, weaker))
    return found


def _from(rich: Candidate, values: Mapping[str, float], options: list[Candidate]) -> list[Candidate]:
    """Return laws to be fitted from a richer one: its whole fit, and the values that they share."""
    assert rich.fit is not None
    return [replace(c, parameters={**rich.fit.point, **c.parameters, **values}, fit=None) for c in options]


def _is_told(plain: float, rich: float, of: Candidate) -> bool:
    """Return whether what two laws leave of the squared errors tells them apart, whatever the noise is."""
    assert of.fit is not None
    return 0 < rich < plain < np.inf and of.fit.n_residuals * np.log(plain / rich) > CREEPS


def chosen_otherwise(found: list[Candidate]) -> list[Candidate]:
    """Return laws with their other choices, where a law of the contact with more parameters alone leaves noise alone.

    Which exponent of a law is right, the first few steps may tell wrongly.
    """
    clean = [c for c in found if not c.why_not and c.fit is not None and is_clean(c.fit)]
    again: list[Candidate] = []
    for candidate in found:
        if candidate.fit is None or is_clean(candidate.fit):
            continue
        n, point = len(candidate.insertion.parameter_names), candidate.fit.point
        if any(is_other_law(one, candidate) and len(one.insertion.parameter_names) > n for one in clean):
            again += [replace(c, parameters=point, fit=None) for c in each_choice(candidate)[1:]]
    return again


def _creeping(plain: Candidate, rich: Candidate) -> list[Candidate]:
    """Return a law where it creeps, below the speed at which a richer one that is weaker at rest turns, if it can."""
    card, place = plain.insertion.card.creeping, plain.insertion.place
    if card is None or rich.fit is None:
        return []
    (start,) = card.starts(place.kind)
    speeds = [rich.fit.values[name] for name in rich.insertion.parameter_names if name.endswith(SPEEDS)]
    option = Insertion(card, place, {name: next(iter(speeds), first) for name, first in start.items()})
    return [replace(plain, insertion=option, parameters=option.starts, others=())]


def shared(insertion: Insertion, rich: Candidate) -> dict[str, float]:
    """Return the parameters of a law that a richer one has too, as fitted there; the mean of one for each way."""
    assert rich.fit is not None
    there = {name.rpartition(".")[2]: rich.fit.values[name] for name in rich.insertion.parameter_names}
    found: dict[str, float] = {}
    for name in insertion.parameter_names:
        short = name.rpartition(".")[2]
        values = [there[one] for one in (short, *(short + way for way in WAYS)) if one in there]
        if values:
            found[name] = sum(values) / len(values)
    for peak, level in insertion.card.peaks.items():
        if peak not in there and level in there:
            found[f"{insertion.prefix}.{peak}"] = there.get(RATIO, PEAK) * there[level]
    return found


def is_nothing_in(plain: Candidate, rich: Candidate) -> bool:
    """Return whether all sizes of a law ended at zero in the fit of a richer one, which does what that one cannot."""
    if rich.fit is None:
        return False
    known, own = set(rich.insertion.parameter_names), (name.rpartition(".")[2] for name in plain.insertion.size_names)
    sizes = {f"{rich.insertion.prefix}.{name}" for name in own}
    return bool(sizes) and sizes <= known and sizes <= ended_at_zero(rich.fit, rich.insertion)


def with_peaks(
    insertion: Insertion, point: Mapping[str, float], heights: tuple[float, ...] = PEAKS
) -> list[dict[str, float]]:
    """Return a point, and with each height of a peak that is at rest alone, over the level below it."""
    peaks = peaks_alone(insertion).items()
    return [dict(point), *(dict(point) | {high: ratio * point[low]} for high, low in peaks for ratio in heights)]


def with_gaps(insertion: Insertion, point: Mapping[str, float]) -> list[dict[str, float]]:
    """Return the point of a law with flanks, and others: wider and narrower gaps, stiffer and softer flanks.

    Whether the next impact comes before a reversal or after it changes at once, so that few starts lead to the law.
    """
    sizes = [name for name in insertion.size_names if insertion.card.knocks]
    kept = {*sizes, *insertion.corrections}
    shapes = [name for name in insertion.parameter_names if sizes and name not in kept]
    others = [
        {name: wide * point[name] for name in sizes} | {name: push * point[name] for name in shapes}
        for wide, push in product(WIDTHS, PUSHES)
        if sizes
    ]
    return [dict(point), *(dict(point) | other for other in others)]


def with_cutoffs(insertion: Insertion, point: Mapping[str, float]) -> list[dict[str, float]]:
    """Return other points of a law with a frequency of its own: that frequency far lower and far higher.

    Which of its swings are those of the record changes with it, so that a fit stays near where it began.
    """
    kind = insertion.place.kind
    found: list[dict[str, float]] = []
    for item in insertion.parameters:
        name = f"{insertion.prefix}.{item.names[kind]}"
        if item.role == "shape" and name.endswith(CUTOFF):
            low, high = item.bounds_at(kind)
            others = {min(max(ratio * point[name], low), high) for ratio in FARTHER}
            found += [dict(point) | {name: value} for value in sorted(others - {point[name]})]
    return found


def contradicts(candidate: Candidate) -> bool:
    """Return whether the fit of a candidate is not of the law that it is called."""
    return candidate.fit is not None and bool(candidate.insertion.contradiction(candidate.fit.values))


def own(candidate: Candidate) -> Candidate:
    """Return a candidate that was restarted with no parameters but those of its effect."""
    names = candidate.insertion.parameter_names
    return replace(candidate, parameters={name: candidate.parameters[name] for name in names})


def holds(rich: Candidate, plain: Candidate) -> bool:
    """Return whether a candidate is the next richer law than another one at the same place."""
    one, two = rich.insertion, plain.insertion
    return one.place.at == two.place.at and one.card.id in two.card.nested_in


def as_plain(insertion: Insertion, plain: Candidate) -> dict[str, float]:
    """Return the values with which a law nearly is another one that was fitted: the same where names agree."""
    assert plain.fit is not None
    before = {name.rpartition(".")[2]: plain.fit.values[name] for name in plain.insertion.parameter_names}
    values = insertion.starts
    for name in values:
        short = name.rpartition(".")[2]
        below = insertion.card.peaks.get(short)
        for stem in (short, *(short.removesuffix(way) for way in WAYS if short.endswith(way))):
            values[name] = before.get(stem, values[name])
        if below in before:
            values[name] = PEAK * before[below]
    return values
