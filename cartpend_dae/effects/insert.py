"""Insertion of effects into any model: find the places, put the component there."""

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca

from cartpend_dae.alias import alias, symbolic
from cartpend_dae.effects.card import Card
from cartpend_dae.errors import ModelError
from cartpend_dae.flatten import flatten
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
    used_ports_of,
    variables_of,
)
from cartpend_dae.library import rotational, translational
from cartpend_dae.system import Relation, unknown_name

_FIXED: dict[type[Port], type[Component]] = {
    rotational.Flange: rotational.Fixed,
    translational.Flange: translational.Fixed,
}
_POSITION: dict[type[Port], str] = {rotational.Flange: "phi", translational.Flange: "s"}


@dataclass(frozen=True, slots=True)
class Place:
    """Where an effect may stand: between `port_a` (None: ground) and `port_b` of the component `at`.

    For a sensor `at` is the measured variable and there are no ports. `same_motion` lists the places that
    move alike, up to a factor, so that no data can tell them apart.
    """

    at: str
    kind: type[Port] | None
    port_a: str | None
    port_b: str | None
    same_motion: tuple[str, ...]


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


def walk(model: Component, path: str = "") -> Iterator[tuple[str, Component]]:
    """Yield all components with their dotted paths, the model itself first."""
    yield path, model
    for name, part in parts_of(model).items():
        yield from walk(part, f"{path}.{name}" if path else name)


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


def places(model: Component, measured: tuple[str, ...] = ()) -> tuple[Place, ...]:
    """Return the places of a model, one for each motion that data can tell apart.

    An element between two flanges is a place across it, any other body one against ground. Of places that
    move alike the element with a damping law stands for all, as friction belongs there; then the first.

    Parameters
    ----------
    model
        The model.
    measured
        Names of measured variables, which are places for sensor effects.
    """
    aliased = alias(flatten(model))
    position_of = {variable.name: i for i, variable in enumerate(aliased.flat.variables)}
    values = {q.name: q.value for q in aliased.flat.parameters if q.value is not None}
    numbers = _Numbers(aliased.flat.parameter_symbols, aliased.flat.parameter_bindings)
    groups: dict[tuple[object, ...], list[tuple[tuple[int, int], Place]]] = {}
    for order, (path, component) in enumerate(walk(model)):
        if not path:
            continue
        ports = {name: port for name, port in used_ports_of(component).items() if type(port) in _FIXED}
        for port_a, port_b in _pairs(ports):
            kind = type(ports[port_b])
            coordinate = _POSITION[kind]
            relative = _relative(
                aliased.relations[position_of[f"{path}.{port_b}.{coordinate}"]],
                None if port_a is None else aliased.relations[position_of[f"{path}.{port_a}.{coordinate}"]],
                numbers,
            )
            if not relative:
                continue
            damped = any(
                "N.s/m" in q.declaration.unit or "N.m.s/rad" in q.declaration.unit
                for q in parameters_of(type(component)).values()
            )
            rank = (0 if port_a is not None and damped else 1 if port_a is not None else 2, order)
            groups.setdefault(relative, []).append((rank, Place(path, kind, port_a, port_b, ())))
    found = []
    for group in groups.values():
        best = min(group, key=lambda item: item[0])[1]
        others = tuple(dict.fromkeys(place.at for _, place in group if place.at != best.at))
        found.append(Place(best.at, best.kind, best.port_a, best.port_b, others))
    del values
    return (*found, *(Place(name, None, None, None, ()) for name in measured))


def _pairs(ports: dict[str, Port]) -> Iterator[tuple[str | None, str]]:
    """Yield what an effect may be put between: two flanges of a kind, or ground and a flange."""
    by_kind: dict[type[Port], list[str]] = {}
    for name, port in ports.items():
        by_kind.setdefault(type(port), []).append(name)
    for names in by_kind.values():
        if len(names) == 2:
            yield names[0], names[1]
        yield None, names[-1]


class _Numbers:
    """Values of coefficients at the present parameters."""

    def __init__(self, symbols: ca.SX, bindings: ca.SX) -> None:
        values = bindings
        for _ in range(20):
            if not ca.symvar(values):
                break
            values = ca.substitute(values, symbols, bindings)
        self._function = lambda e: float(ca.substitute(symbolic(e), symbols, values))

    def __call__(self, coefficient: object) -> float:
        return self._function(coefficient)


def _relative(b: Relation, a: Relation | None, numbers: _Numbers) -> tuple[object, ...]:
    """Return the relative position b - a as a direction in the space of chains; empty if it is constant."""
    terms: dict[tuple[int, int], float] = {}
    for relation, sign in ((b, 1.0), (a, -1.0)):
        if relation is not None and relation.base >= 0:
            key = (relation.base, relation.order)
            terms[key] = terms.get(key, 0.0) + sign * numbers(relation.factor)
    left = sorted((key, value) for key, value in terms.items() if abs(value) > 1e-12)
    if not left:
        return ()
    lead = left[0][1]
    return tuple((key, round(value / lead, 9)) for key, value in left)
