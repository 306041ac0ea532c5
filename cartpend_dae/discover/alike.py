"""What is known beforehand to act like an effect that was added, under a condition, from the cards of the catalogue."""

from cartpend_dae.discover.choice import FAR_BEHIND, named
from cartpend_dae.discover.records import Candidate, Search, Step


def known_alike(search: Search, step: Step) -> dict[str, str]:
    """Return conditions under which effects that were tried act like an accepted one, by name (effect at place).

    Left out are those that the runs cannot tell from it anyway, those that are in the model, and those that as fitted
    explain clearly less.
    """
    own = step.candidate.insertion.card
    said = {*step.aliases, *step.richer, *(named(other.candidate) for other in search.steps)}
    found: dict[str, str] = {}
    for other in search.candidates:
        card = other.insertion.card
        why = own.equivalent_to.get(card.id) or card.equivalent_to.get(own.id)
        if why and named(other) not in said and not _is_behind(other, step):
            found[named(other)] = why
    return found


def _is_behind(other: Candidate, step: Step) -> bool:
    """Return whether a candidate was seen to explain clearly less, or to change nothing that a sensor sees."""
    is_fitted = other.fit is not None and other.gain != 0.0
    if is_fitted:
        return step.candidate.gain - other.gain > FAR_BEHIND
    if other.early is not None and step.candidate.early is not None:
        return other.early - step.candidate.early > FAR_BEHIND
    return other.response is None
