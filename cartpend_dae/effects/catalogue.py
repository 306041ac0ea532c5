"""The effects that `discover` tries."""

from functools import cache
from pathlib import Path

from cartpend_dae.effects.card import Card
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
        Python files with effects of a user's own: every `Card` that stands in one by a name of its own is taken.
        A card of the package's own id takes the place of all those.

    Raises
    ------
    StudyError
        If a file cannot be read or fails.
    ModelError
        If a file has no card.
    """
    found = list(_own())
    for file in files:
        own = cards_of(Path(file))
        found = [card for card in found if all(card.id != other.id for other in own)] + list(own)
    return tuple(sorted(found, key=lambda card: (len(card.parameters), card.id)))


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
    found = tuple(
        value for value in vars(run_file(file.absolute(), "file of effects")).values() if isinstance(value, Card)
    )
    if not found:
        raise ModelError(f"{file}: there is no card in it; write `CARD = Card(id=..., ...)` beside the component.")
    return found


def variants_of(effect: str) -> tuple[Card, ...]:
    """Return the cards of the package with an id: one effect may be inserted in two manners.

    Raises
    ------
    ModelError
        If there is none; the nearest are offered.
    """
    cards = catalogue()
    if not (found := tuple(card for card in cards if card.id == effect)):
        raise ModelError(f"There is no effect `{effect}`{nearest(effect, [card.id for card in cards])}")
    return found


def card_of(effect: str) -> Card:
    """Return the card of the package with an id, of several the last; errors are those of `variants_of`."""
    return variants_of(effect)[-1]
