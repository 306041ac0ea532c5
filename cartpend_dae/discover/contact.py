"""Which candidates are laws of one contact, which has one law of dry friction, or of one link."""

from cartpend_dae.discover.records import Candidate
from cartpend_dae.effects import Card, Place


def is_other_law(one: Candidate, other: Candidate) -> bool:
    """Return whether two candidates are laws of dry friction of the same contact."""
    both = is_dry(one.insertion.card) and is_dry(other.insertion.card)
    return both and moves_alike(one.insertion.place, other.insertion.place)


def is_other_link(one: Candidate, other: Candidate) -> bool:
    """Return whether two candidates are laws of what gives way between the same two points, such as a chain."""
    a, b = one.insertion, other.insertion
    return a.card is not b.card and gives_way(a.card) and gives_way(b.card) and a.place.at == b.place.at


def gives_way(card: Card) -> bool:
    """Return whether an effect is a law of how a link gives way to what it carries; a loss of gears is none."""
    return card.insertion == "series" and any(term.endswith("tau") for term in card.regressors)


def is_dry(card: Card) -> bool:
    """Return whether an effect is a law of dry friction."""
    return card.insertion == "parallel" and "sign v" in card.regressors


def moves_alike(one: Place, other: Place) -> bool:
    """Return whether two places have one motion; a part such as a rod may have two, of which each is another's too."""
    return one.at == other.at or one.at in other.same_motion or other.at in one.same_motion
