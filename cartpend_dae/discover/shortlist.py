"""Of candidates that were screened, those that are fitted."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

from cartpend_dae.discover.choice import SAME, are_parallel
from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.disturbed import is_composite
from cartpend_dae.discover.records import Candidate

# others are fitted as well where their prediction is behind by less than this share, be it that of the same
# effect elsewhere: it is made with their shapes as they are at first; so many of them
CLOSE, AS_WELL = 0.5, 10
# roles of what is tried at several values and not estimated
TRIED = ("choice", "teeth")
# an effect that does several things at once is fitted at so many places at first
PLACES = 2


def is_simple(candidate: Candidate) -> bool:
    """Return whether an effect has one parameter besides those that correct its law."""
    return candidate.insertion.complexity == 1


def as_well(first: list[Candidate], others: list[Candidate]) -> list[Candidate]:
    """Return those whose prediction is near that of the best, or near that of the same effect at its best place."""
    if not first:
        return []
    best: dict[str, float] = {}
    for candidate in first:
        best.setdefault(candidate.insertion.card.id, candidate.predicted)
    most = first[0].predicted
    near = [c for c in others if c.predicted > (1 - CLOSE) * min(best.get(c.insertion.card.id, most), most)]
    return near[:AS_WELL]


def equivalents(first: list[Candidate], others: list[Candidate], share: float) -> list[Candidate]:
    """Return those that may be equivalent to one of the first, and promise a share of the best: fits tell of them."""
    if not first:
        return []
    known = {name for candidate in first for name in candidate.insertion.card.equivalent_to}
    able = [c for c in others if c.insertion.card.id in known and c.predicted > share * first[0].predicted]
    return [c for c in able if c not in first]


def at_few_places(wide: list[Candidate]) -> tuple[list[Candidate], list[Candidate]]:
    """Return some candidates without effects that do several things at once beyond their best places, and those.

    They take longest to fit, and what they do at another place is of interest only where they explain much.
    """
    several: dict[str, list[Candidate]] = {}
    for candidate in wide:
        if is_composite(candidate.insertion):
            several.setdefault(candidate.insertion.card.id, []).append(candidate)
    later = [c for these in several.values() for c in these[PLACES:]]
    return [c for c in wide if c not in later], later


def unlike(ranked: list[Candidate]) -> list[Candidate]:
    """Leave out those that move the data as a simpler one before them does."""
    found: list[Candidate] = []
    for candidate in ranked:
        n = candidate.insertion.complexity
        if not any(c.insertion.complexity <= n and are_parallel(c, candidate, SAME) for c in found):
            found.append(candidate)
    return found


def distinct(ranked: list[Candidate]) -> list[Candidate]:
    """Leave out those that move the data as one before them does, or rub where one of them does."""
    found: list[Candidate] = []
    for candidate in ranked:
        if any(are_parallel(candidate, other) or is_other_law(candidate, other) for other in found):
            continue
        found.append(candidate)
    return found


def with_others(candidates: list[Candidate]) -> list[Candidate]:
    """Return candidates from all their starts, one after the other."""
    return [start for candidate in candidates for start in (candidate, *candidate.others)]


def corrected(candidate: Candidate) -> list[Candidate]:
    """Return a candidate from the other starts of its corrections."""
    kind, prefix = candidate.insertion.place.kind, candidate.insertion.prefix
    items = [item for item in candidate.insertion.card.parameters if item.corrects]
    starts = [(f"{prefix}.{item.names[kind]}", start) for item in items for start in item.starts_at(kind)[1:]]
    return [replace(candidate, parameters={**candidate.parameters, name: start}, others=()) for name, start in starts]


def best_of_each(judged: list[Candidate], criterion: Callable[[Candidate], float]) -> list[Candidate]:
    """Return one candidate of each effect at a place, from the start with which the criterion is smallest.

    Those with another of its choices are its `others`: beside a second effect they may do better.
    """
    starts: dict[str, list[Candidate]] = {}
    for candidate in judged:
        starts.setdefault(candidate.insertion.prefix, []).append(candidate)
    found: list[Candidate] = []
    for these in starts.values():
        fitted = [c for c in these if c.fit is not None]
        # one that was refused stands only where all were
        best = min(fitted, key=lambda c: (bool(c.why_not), criterion(c)), default=these[0])
        others = [c for c in (*these, *best.others) if chosen(c) != chosen(best)]
        found.append(replace(best, others=tuple(replace(c, others=()) for c in others)))
    return found


def with_waves(ranked: list[Candidate], screened: list[Candidate]) -> list[Candidate]:
    """Return candidates with the other waves that were promising before any was fitted among their `others`.

    What a wave explains alone may be mostly another effect, beside which another wave is the right one.
    """
    starts = {c.insertion.prefix: (c, *c.others) for c in screened}

    def of(candidate: Candidate) -> Candidate:
        told = [c for c in starts.get(candidate.insertion.prefix, ()) if _waves(c) != _waves(candidate)]
        return replace(candidate, others=(*candidate.others, *told)) if _waves(candidate) else candidate

    return [of(candidate) for candidate in ranked]


def each_wave(candidates: list[Candidate]) -> list[Candidate]:
    """Return candidates, and those of the same effects that start from other waves."""
    return [c for one in candidates for c in (one, *(c for c in one.others if _waves(c) != _waves(one)))]


def _waves(candidate: Candidate) -> list[float | None]:
    """Return the wave numbers from which a candidate starts."""
    insertion = candidate.insertion
    kind = insertion.place.kind
    return [insertion.values.get(i.names[kind]) for i in insertion.card.parameters if i.role == "wave"]


def each_choice(candidate: Candidate) -> list[Candidate]:
    """Return a candidate with each of its choices, its own first."""
    insertion = candidate.insertion
    kind = insertion.place.kind
    items = [item for item in insertion.card.parameters if item.role == "choice"]
    names = [item.names[kind] for item in items]
    starts = [item.starts_at(kind) for item in items]
    own = tuple(insertion.values.get(name, first) for name, (first, *_) in zip(names, starts, strict=True))
    others = [dict(zip(names, values, strict=True)) for values in product(*starts) if values != own]
    return [
        candidate,
        *(
            replace(candidate, insertion=replace(insertion, values={**insertion.values, **v}), others=())
            for v in others
        ),
    ]


def chosen(candidate: Candidate) -> dict[str, float]:
    """Return the values of what is tried and not estimated, as the approximation of a delay."""
    insertion = candidate.insertion
    names = {item.names[insertion.place.kind] for item in insertion.card.parameters if item.role in TRIED}
    return {name: value for name, value in insertion.values.items() if name in names}
