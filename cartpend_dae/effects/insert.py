"""Insertion of effects into any model, and copies of models."""

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca

from cartpend_dae.effects.card import Card
from cartpend_dae.effects.places import Place, walk
from cartpend_dae.errors import ModelError
from cartpend_dae.language import (
    Component,
    Connection,
    Port,
    attached_to,
    bindings_of,
    connect,
    constructor_fields,
    parameters_of,
    parts_of,
    variables_of,
)
from cartpend_dae.library import rotational, translational
from cartpend_dae.quantities import state_of
from cartpend_dae.system import unknown_name

_FIXED: dict[type[Port], type[Component]] = {
    rotational.Flange: rotational.Fixed,
    translational.Flange: translational.Fixed,
}


@dataclass(frozen=True, slots=True)
class Insertion:
    """An effect at a place; `prefix` is the dotted name of its component in the model."""

    card: Card
    place: Place

    @property
    def prefix(self) -> str:
        """Dotted name of the inserted component."""
        return f"{self.place.at}.{self.card.id}"

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Dotted names of the effect's parameters."""
        return tuple(f"{self.prefix}.{item.names[self.place.kind]}" for item in self.card.parameters)

    @property
    def measured(self) -> dict[str, str]:
        """Measured variables that must be read from another one now: {old name: new name}."""
        return {self.place.at: f"{self.prefix}.y"} if self.card.insertion == "sensor" else {}


def insert(model: Component, insertion: Insertion) -> Component:
    """Return a copy of a model with an effect in it; the effect starts without effect.

    Parameters
    ----------
    model
        The model; it is left as it is.
    insertion
        The effect and its place.

    Raises
    ------
    ModelError
        If the place does not exist.
    """
    fresh = rebuild(model)
    place, card = insertion.place, insertion.card
    effect = card.components[place.kind]()
    if card.insertion == "sensor":
        path, _, variable = place.at.rpartition(".")
        owner = component_at(fresh, path)
        owner.attach(f"{variable}.{card.id}", effect, connect(getattr(owner, variable), effect.u))  # type: ignore[attr-defined]
        return fresh
    owner = component_at(fresh, place.at)
    flange_a, flange_b = effect.flange_a, effect.flange_b  # type: ignore[attr-defined]
    assert place.kind is not None and place.port_b is not None
    if place.port_a is None:
        ground = _FIXED[place.kind]()
        owner.attach(f"{card.id}_ground", ground)
        joined = [connect(ground.flange, flange_a)]  # type: ignore[attr-defined]
    else:
        joined = [connect(getattr(owner, place.port_a), flange_a)]
    owner.attach(card.id, effect, *joined, connect(getattr(owner, place.port_b), flange_b))
    return fresh


def component_at(model: Component, path: str) -> Component:
    """Return the component of a dotted path; an empty path is the model itself.

    Raises
    ------
    ModelError
        If there is none; the nearest names are offered.
    """
    for found, component in walk(model):
        if found == path:
            return component
    raise ModelError(unknown_name("component", path, [p for p, _ in walk(model)], type(model).__name__))


def rebuild(model: Component) -> Component:
    """Make an equal model anew, attached parts and changed parameters included."""
    fresh = _construct(model)
    _copy_bindings(model, fresh)
    for path, component in list(walk(model)):
        for name, (part, connections) in attached_to(component).items():
            owner = component_at(fresh, path)
            if name in attached_to(owner):  # the model attaches it itself when it is made
                continue
            owner.attach(name, rebuild(part))
            _rejoin(model, fresh, owner, name, connections)
    return fresh


def _construct(component: Component) -> Component:
    cls = type(component)
    declared = parameters_of(cls)
    arguments = {
        name: bindings_of(component)[name] if name in declared else getattr(component, name)
        for name in constructor_fields(cls)
    }
    return cls(**arguments)


def _copy_bindings(old: Component, new: Component) -> None:
    """Copy numbers that were assigned after construction; expressions of parents stand already."""
    for name, value in bindings_of(old).items():
        if ca.SX(value).is_constant():
            bindings_of(new)[name] = value
    state_of(new).unknown.update(state_of(old).unknown)
    new_parts = parts_of(new)
    for name, part in parts_of(old).items():
        if name in new_parts:
            _copy_bindings(part, new_parts[name])


def _rejoin(
    model: Component, fresh: Component, owner: Component, name: str, connections: tuple[Connection, ...]
) -> None:
    """Repeat connections of an attached part with the ports and signals of the new model."""
    paths = {id(component): path for path, component in walk(model)}
    signals = {
        symbol.element_hash(): (path, variable)
        for path, component in walk(model)
        for variable, symbol in _signals(component)
    }

    def translated(end: Port | ca.SX) -> Port | ca.SX:
        if isinstance(end, Port):
            return getattr(component_at(fresh, paths[id(end.owner)]), end.name)
        path, variable = signals[end.element_hash()]
        return getattr(component_at(fresh, path), variable)

    part, _ = attached_to(owner)[name]
    renewed = tuple(Connection(tuple(translated(end) for end in connection.ends)) for connection in connections)
    attached_to(owner)[name] = (part, renewed)


def _signals(component: Component) -> Iterator[tuple[str, ca.SX]]:
    for variable in variables_of(type(component)):
        yield variable, getattr(component, variable)
