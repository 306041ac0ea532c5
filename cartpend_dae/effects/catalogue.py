"""The effects that `discover` tries."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from cartpend_dae.effects.card import Card
from cartpend_dae.effects.card_check import card_findings
from cartpend_dae.effects.elastic import elastic_cards
from cartpend_dae.effects.electrical import electrical_cards
from cartpend_dae.effects.friction import friction_cards
from cartpend_dae.effects.inertial import inertial_cards
from cartpend_dae.effects.input import input_cards
from cartpend_dae.effects.kinematic import kinematic_cards
from cartpend_dae.effects.loads import load_cards
from cartpend_dae.effects.sensor import sensor_cards
from cartpend_dae.errors import ModelError
from cartpend_dae.explain import nearest
from cartpend_dae.study import run_file


def catalogue(*files: Path | str) -> tuple[Card, ...]:
    """Return the cards of all effects, ordered by the number of their parameters and then by id.

    Parameters
    ----------
    files
        Python files with effects of a user's own: every `Card` that stands in one by a name of its own is taken, once
        if it has several. A card of the package's own id takes the place of all those.

    Raises
    ------
    StudyError
        If a file cannot be read or fails.
    ModelError
        If a file has no card, or cards are wrong; one line for each finding.
    """
    found, read = list(_own()), [(Path(file), cards_of(Path(file))) for file in files]
    everything = [*found, *(card for _, own in read for card in own)]
    known = {str(card.id) for card in everything}
    wrong = [f"{file}: {text}" for file, own in read for card in own for text in card_findings(card, known)]
    if wrong:
        raise ModelError("\n".join(wrong))
    for _, own in read:
        ours = [card if not (inside := _inside(card, everything)) else replace(card, contains=inside) for card in own]
        found = [card for card in found if all(card.id != other.id for other in own)] + ours
    return tuple(sorted(found, key=lambda card: (len(card.parameters), card.id)))


def _inside(card: Card, everything: Sequence[Card]) -> tuple[str, ...]:
    """Return the ids of the effects that a card contains."""
    return tuple(sorted({other.id for other in everything if card.id in other.nested_in}))


@cache
def _own() -> tuple[Card, ...]:
    """Return the cards of the package."""
    groups = (
        friction_cards(),
        elastic_cards(),
        load_cards(),
        inertial_cards(),
        electrical_cards(),
        kinematic_cards(),
        sensor_cards(),
        input_cards(),
    )
    return tuple(card for group in groups for card in group)


def cards_of(file: Path) -> tuple[Card, ...]:
    """Return the cards that stand in a Python file.

    Raises
    ------
    StudyError
        If the file cannot be read or fails.
    ModelError
        If it has none.
    """
    values = vars(run_file(file.absolute(), "file of effects")).values()
    found = {id(value): value for value in values if isinstance(value, Card)}
    if not found:
        raise ModelError(f"{file}: there is no card in it; write `CARD = Card(id=..., ...)` beside the component.")
    return tuple(found.values())


def checked(cards: Sequence[Card]) -> Sequence[Card]:
    """Return cards that were given, if those that are not the package's are right.

    Raises
    ------
    TypeError
        If one is no card.
    ModelError
        If cards are wrong; one line for each finding.
    """
    for given in (cards,) if isinstance(cards, str | Card) else cards:
        if isinstance(cards, str | Card) or not isinstance(given, Card):
            shown = repr(given.id) if isinstance(given, Card) else repr(given)
            raise TypeError(
                f"`cards` is a tuple of cards, and {shown} is none; write "
                f"`cards=tuple(card for card in catalogue() if card.id in ({shown},))`."
            )
    ours = {id(card) for card in _own()}
    known = {str(card.id) for card in (*_own(), *cards)}
    wrong = [text for card in cards if id(card) not in ours for text in card_findings(card, known)]
    if wrong:
        raise ModelError("\n".join(wrong))
    return cards


def variants_of(effect: str, cards: Sequence[Card] | None = None) -> tuple[Card, ...]:
    """Return the cards with an id, of the package if `cards` is None: one effect may be inserted in two manners.

    Raises
    ------
    ModelError
        If there is none; the nearest are offered.
    """
    cards = catalogue() if cards is None else cards
    if not (found := tuple(card for card in cards if card.id == effect)):
        raise ModelError(f"There is no effect `{effect}`{nearest(effect, [card.id for card in cards])}")
    return found


def card_of(effect: str) -> Card:
    """Return the card of the package with an id, of several the last; errors are those of `variants_of`."""
    return variants_of(effect)[-1]
