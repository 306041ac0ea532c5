"""Insertion of effects into any model, by code.

parallel   port_a --[effect]-- port_b           beside what is there; port_a may be ground
series     port --[effect]-- the rest           the connection set of the port is split in two
law        k becomes k y                         in the equations of one component
sensor     variable --[effect]-- its readers     and its name in the records
input      its source --[effect]-- the input     and its name in the records
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any

import casadi as ca

from cartpend_dae.effects.card import GIVEN, Card, E, EffectParameter
from cartpend_dae.effects.catalogue import variants_of
from cartpend_dae.effects.places import Place, fits, misplaced, places_at, taken_from
from cartpend_dae.effects.rebuild import rebuild
from cartpend_dae.effects.walk import component_at
from cartpend_dae.errors import ModelError
from cartpend_dae.language import Component, Port, connect, parameters_of
from cartpend_dae.library import rotational, translational
from cartpend_dae.quantities import is_number, state_of
from cartpend_dae.splice import divert, scale

_FIXED: dict[type[Port], type[Component]] = {
    rotational.Flange: rotational.Fixed,
    translational.Flange: translational.Fixed,
}


@dataclass(frozen=True, slots=True)
class Insertion:
    """An effect at a place; `prefix` is the dotted name of its component in the model.

    `values` are numbers of its parameters, where they are not those with which it is absent: starts of shapes, choices.
    """

    card: Card
    place: Place
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def prefix(self) -> str:
        """Dotted name of the inserted component."""
        return f"{self.place.at}.{self.card.id}"

    @property
    def content(self) -> str:
        """What is kept of a model with it depends on this: its name and the numbers of its parameters."""
        return str((self.prefix, dict(self.values)))

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        """Parameters of the effect that can be estimated: all but what is tried or read."""
        return tuple(item for item in self.card.parameters if item.role not in GIVEN)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Dotted names of the parameters that can be estimated."""
        return tuple(f"{self.prefix}.{item.names[self.place.kind]}" for item in self.parameters)

    @property
    def size_names(self) -> tuple[str, ...]:
        """Dotted names of the parameters that are 0 where the effect is absent."""
        pairs = zip(self.parameter_names, self.parameters, strict=True)
        return tuple(name for name, item in pairs if item.role == "size")

    @property
    def corrections(self) -> tuple[str, ...]:
        """Dotted names of the parameters without which the law is what it is called."""
        return tuple(self.correction_starts)

    @property
    def correction_starts(self) -> dict[str, tuple[float, ...]]:
        """What corrects the law, by dotted name, and where it begins; at the first of these nothing is corrected."""
        pairs = zip(self.parameter_names, self.parameters, strict=True)
        return {name: item.starts_at(self.place.kind) for name, item in pairs if item.corrects}

    @property
    def complexity(self) -> int:
        """Number of parameters by which one effect is plainer than another: without corrections of its law."""
        return len(self.parameter_names) - len(self.corrections)

    def contradiction(self, values: Mapping[str, float]) -> str:
        """Say why fitted values, by dotted name, are not those of the effect; empty where they are."""
        for peak, level in self.card.peaks.items():
            high, low = values.get(f"{self.prefix}.{peak}"), values.get(f"{self.prefix}.{level}")
            if high is not None and low is not None and high < low:
                return (
                    f"its `{peak}` of {high:.3g} ends below its `{level}` of {low:.3g}, so that nothing peaks at rest"
                )
        return ""

    @property
    def starts(self) -> dict[str, float]:
        """The values from which an estimation begins, by dotted name."""
        kind = self.place.kind
        names = (item.names[kind] for item in self.parameters)
        firsts = (item.starts_at(kind)[0] for item in self.parameters)
        return {
            f"{self.prefix}.{name}": self.values.get(name, first) for name, first in zip(names, firsts, strict=True)
        }

    @property
    def measured(self) -> dict[str, str]:
        """Measured variables that must be read from another one now: {old name: new name}."""
        return {self.place.at: f"{self.prefix}.y"} if self.card.insertion == "sensor" else {}

    @property
    def driven(self) -> dict[str, str]:
        """Inputs that must be given to another one now: {old name: new name}."""
        return {self.place.at: f"{self.prefix}.u"} if self.card.insertion == "input" else {}


def insert(
    model: Component,
    effect: Card | str | Insertion,
    at: Place | str | None = None,
    **values: float,
) -> Component:
    """Return a copy of a model with an effect in it; without values the effect is there, and not felt.

    The effect stands under its place: ``insert(model, "coulomb_friction", "bearing")`` has the parameter
    ``bearing.coulomb_friction.tau_c``. Behind a sensor `encoder.s` the signal is ``encoder.s.sensor_gain.y``, before an
    input `amplifier.u` the new input is ``amplifier.u.dead_zone.u``.

    Parameters
    ----------
    model
        The model; it is left as it is.
    effect
        The card of an effect, or its id in the catalogue.
    at
        The place, or its dotted name: a component for an effect in parallel, a port for one in series, a parameter for
        one in a law, else a variable or signal.
    values
        Parameters of the effect by name, in SI.

    Raises
    ------
    ModelError
        If there is no such effect or place, the effect does not go there, or a value is outside of its bounds.
    TypeError
        If the effect has no such parameter, or the model is a class that was not made.
    """
    return insert_all(model, (effect if isinstance(effect, Insertion) else insertion_at(model, effect, at, values),))


def insert_all(model: Component, insertions: Iterable[Insertion]) -> Component:
    """Return a copy of a model with several effects in it, put there one after the other.

    Raises
    ------
    TypeError
        If the model is a class that was not made.
    """
    _check_made(model)
    fresh = rebuild(model)
    for insertion in insertions:
        _put(fresh, insertion)
    return fresh


def _put(fresh: Component, insertion: Insertion) -> None:
    card, place = insertion.card, insertion.place
    host = component_at(fresh, place.at) if card.insertion == "parallel" else None
    taken = {} if host is None else taken_from(card, type(host), place.kind)
    made = card.components[place.kind](**_given(insertion), **{own: getattr(host, its) for own, its in taken.items()})
    if card.insertion == "parallel":
        _beside(fresh, card, place, made)
        return
    if card.insertion == "clock":
        fresh.attach(insertion.prefix, made)
        return
    path, _, name = place.at.rpartition(".")
    owner, label = component_at(fresh, path), f"{name}.{card.id}"
    if card.insertion == "law":
        joints = [connect(getattr(owner, read), getattr(made, own)) for own, read in card.reads.items()]
        scale(owner, name, owner.attach(label, made, *joints).y)  # type: ignore[attr-defined]
    else:
        near, far = _ends(card, place)
        ends = (_nearest_end(owner, name), getattr(made, near))
        owner.attach(label, made, connect(*(reversed(ends) if card.insertion == "input" else ends)))
        divert(owner, name, getattr(made, far))


def insertion_at(
    model: Component,
    effect: Card | str,
    at: Place | str | None,
    values: Mapping[str, float] | None = None,
    *,
    cards: Sequence[Card] | None = None,
) -> Insertion:
    """Return an effect at a place of a model; arguments and errors are those of `insert`.

    An id is looked up among `cards`, those of the package if None.
    """
    _check_made(model)
    variants = variants_of(effect, cards) if isinstance(effect, str) else (effect,)
    found = _insertion(model, variants, at, values or {})
    _check_values(found)
    return found


def _insertion(
    model: Component, variants: tuple[Card, ...], at: Place | str | None, values: Mapping[str, float]
) -> Insertion:
    if isinstance(at, Place):
        # that another place moves alike is a matter of what data can tell, not of where an effect can be put
        alone = replace(at, rival=None, is_behind=False)
        for card in variants:
            if fits(card, alone):
                return Insertion(card, at, values)
        raise ModelError(misplaced(model, variants[-1], at.at, list(places_at(model, variants[-1], at.at))))
    known: list[str] = []
    for card in variants:
        found = places_at(model, card, at or "")
        if at in found:
            return Insertion(card, found[at], values)
        known += found
    raise ModelError(misplaced(model, variants[-1], at or "", list(dict.fromkeys(known))))


def _check_made(model: Component) -> None:
    if isinstance(model, type):
        raise TypeError(f"An effect goes into a model that was made: write `{model.__name__}()`, not the class.")


def _check_values(insertion: Insertion) -> None:
    """Check that values lie within the bounds that the component of the effect declares."""
    declared = parameters_of(insertion.card.components[insertion.place.kind])
    for name, value in insertion.values.items():
        if name not in declared or not is_number(value):
            continue
        one = declared[name].declaration
        low, high = (-inf if one.min is None else one.min), (inf if one.max is None else one.max)
        if not low <= value <= high:
            unit = "" if one.unit == "1" else f" {one.unit}"
            raise ModelError(
                f"`{insertion.prefix}.{name}` is {value:g}{unit}, outside of its bounds [{low:g}, {high:g}]{unit}; "
                f"give a value inside."
            )


def _given(insertion: Insertion) -> dict[str, Any]:
    """Return the arguments with which the component is made: those given, and else the first start of each shape."""
    return {**insertion.card.starts(insertion.place.kind)[0], **insertion.values}


def _beside(model: Component, card: Card, place: Place, effect: Component) -> None:
    owner = component_at(model, place.at)
    flange_a, flange_b = effect.flange_a, effect.flange_b  # type: ignore[attr-defined]
    assert place.kind is not None and place.port_b is not None
    if place.port_a is None:
        ground = _FIXED[place.kind]()
        owner.attach(f"{card.id}_ground", ground)
        joined = [connect(ground.flange, flange_a)]  # type: ignore[attr-defined]
    else:
        joined = [connect(getattr(owner, place.port_a), flange_a)]
    if card.load:
        path, _, load = place.load.rpartition(".")
        body = component_at(model, path)
        joined.append(connect(getattr(body, load), getattr(effect, card.load)))
        if card.load_at_rest:
            at_rest = getattr(body, card.load_at_rest, getattr(body, load))
            joined.append(connect(at_rest, getattr(effect, card.load_at_rest)))
    owner.attach(card.id, effect, *joined, connect(getattr(owner, place.port_b), flange_b))


def _ends(card: Card, place: Place) -> tuple[str, str]:
    """Return which end of an effect is joined to the place itself, and which to the rest of the model."""
    if card.insertion == "sensor":
        return "u", "y"
    if card.insertion == "input":
        return "y", "u"
    return ("pin_p", "pin_n") if place.kind is E else ("flange_a", "flange_b")


def _nearest_end(owner: Component, name: str) -> Port | ca.SX:
    """Return what the model reaches at a port or signal: the far end of the last effect there, or the thing itself."""
    diverted = state_of(owner).diverted
    return diverted[name] if name in diverted else getattr(owner, name)
