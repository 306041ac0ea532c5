"""Where a richer law starts anew: from a plainer one of the same place that it contains, and yet explains less than.

A law explains no less than one that it contains. Where its fit does, it went astray, as one does that sticks for good.
"""

from collections.abc import Callable
from dataclasses import replace

from cartpend_dae.discover.records import Candidate
from cartpend_dae.effects import Insertion

# a peak at rest begins so many times as high as what it peaks above: at its height no start from rest tells it
PEAK = 1.3
# ends of names of a parameter each way
WAYS = ("_pos", "_neg")


def restarted(fitted: list[Candidate], worth: Callable[[Candidate], float]) -> list[Candidate]:
    """Return the richer ones of some candidates from the best plainer one that is worth more, with its whole fit.

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
        plain = [c for c in fitted if c.fit is not None and _holds(rich, c)]
        best = max(plain, key=worth, default=None)
        if best is None or best.fit is None or (rich.fit is not None and worth(rich) >= worth(best)):
            continue
        found.append(replace(rich, parameters={**best.fit.point, **as_plain(rich.insertion, best)}, fit=None))
    return found


def own(candidate: Candidate) -> Candidate:
    """Return a candidate that was restarted with no parameters but those of its effect."""
    names = candidate.insertion.parameter_names
    return replace(candidate, parameters={name: candidate.parameters[name] for name in names})


def _holds(rich: Candidate, plain: Candidate) -> bool:
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
