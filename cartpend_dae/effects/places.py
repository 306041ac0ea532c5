"""Where effects may stand in a model, one place for each motion, force or signal that data can tell apart."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from cartpend_dae.effects.card import Card, E, Kind, Manner, R, T
from cartpend_dae.effects.catalogue import catalogue, checked
from cartpend_dae.effects.massless import without_mass
from cartpend_dae.effects.reading import Motion, Reading, motion_of, read
from cartpend_dae.effects.walk import walk
from cartpend_dae.errors import ModelError
from cartpend_dae.explain import nearest
from cartpend_dae.language import Component, parameters_of, parts_of, ports_of, used_ports_of, variables_of
from cartpend_dae.library import rotational, translational
from cartpend_dae.quantities import Discrete, Port, Signal, state_of
from cartpend_dae.units import same_dimension

# the coordinate of a flange; an effect between two flanges acts along it
COORDINATE: dict[type[Port], str] = {R: "phi", T: "s"}
# what passes through a port; an effect in series carries it
THROUGH: dict[type[Port], str] = {R: "tau", T: "f", E: "i"}
_DAMPING_UNITS = ("N.s/m", "N.m.s/rad")


@dataclass(frozen=True, slots=True)
class Place:
    """Where an effect may stand.

    Parameters
    ----------
    at
        Dotted name: of a component (parallel), a port (series), a parameter (law), or a signal or variable.
    kind
        The class of the ports that it joins; None for signals.
    port_a, port_b
        The ports of the component between which it stands, `port_a` None for ground; in series its port is `port_b`.
    same_motion
        Places that move alike, or pass on the same force or current, up to a factor: no data can tell them apart.
    insertion
        How an effect goes there.
    host
        The class of the component.
    unit
        Of a sensor or an input: the unit of the variable.
    is_behind
        Another place moves alike and stands for it, but for effects that take something from the component here.
    rival
        The kind of the place that stands for the same motion; an effect that fits there does not go here.
    load
        Of a bearing, a port of its shaft or what carries it: the variable with the force in it, where the model knows
        that.
    is_massless
        In series: it passes on what a current makes, and no mass enters that, as from a rotor without inertia.
    """

    at: str
    kind: Kind
    port_a: str | None
    port_b: str | None
    same_motion: tuple[str, ...]
    insertion: Manner = "parallel"
    host: type[Component] = Component
    unit: str = "1"
    rival: Kind = None
    is_behind: bool = False
    load: str = ""
    is_massless: bool = False


# the time of the whole model
CLOCK = Place("time", None, None, None, (), "clock")


def places(
    model: Component, measured: tuple[str, ...] = (), cards: tuple[Card, ...] | None = None
) -> tuple[Place, ...]:
    """Return the places of a model at which an effect may stand; `fits` tells which.

    An element between two flanges is a place across it, any other body one against ground. Of places that
    move alike the element with a damping law stands for all, as friction belongs there; then the first. A port that
    passes something on is a place in series; of those that pass on the same, that of a gear stands for all, then the
    first. Where the best place is on a shaft and an effect only goes on a line, or the other way round, the best place
    of its own kind stands behind it. Constants are places in a law, inputs of actuators places before them.

    Parameters
    ----------
    model
        The model.
    measured
        Names of measured variables, which are places for sensor effects.
    cards
        The effects; those of the catalogue if None.

    Raises
    ------
    TypeError
        If one of `cards` is no card.
    ModelError
        If cards are wrong; one line for each finding.
    """
    known = catalogue() if cards is None else checked(cards)
    reading = read(model)
    sensors = (_sensor(model, name) for name in measured)
    series = _weighed(model, reading, tuple(_series(model, reading)))
    found = (*_parallel(model, reading), *series, *_constants(model), *_inputs(model), CLOCK, *sensors)
    return tuple(place for place in found if any(fits(card, place) for card in known))


def fits(card: Card, place: Place) -> bool:
    """True if the effect of a card may stand at a place."""
    if card.insertion != place.insertion or place.kind not in card.components:
        return False
    if place.rival is not None and place.rival in card.components:
        return False
    if not issubclass(place.host, card.hosts or Component) or (_is_ground(place) and not card.hosts):
        return False
    if place.is_behind and not taken_from(card, place.host, place.kind):
        return False
    if card.insertion == "law":
        return place.at.rpartition(".")[2] == card.constant
    if card.is_massless is not None and card.is_massless is not place.is_massless:
        return False
    if (card.load and not place.load) or (card.is_elsewhere and place.load):
        return False
    return not card.units or any(same_dimension(place.unit, unit) for unit in card.units)


def taken_from(card: Card, host: type[Component], kind: Kind) -> Mapping[str, str]:
    """Return {parameter of the effect: that of the host} of what it takes from there; empty if the host lacks any."""
    wanted = card.takes.get(kind, {})
    return wanted if set(wanted.values()) <= set(parameters_of(host)) else {}


def place_at(model: Component, card: Card, at: str) -> Place:
    """Return the place of a name for the effect of a card, whether or not another one moves alike.

    Parameters
    ----------
    model
        The model.
    card
        The effect.
    at
        Dotted name: a component for an effect in parallel, a port for one in series, a parameter for one in a law,
        else a variable or signal.

    Raises
    ------
    ModelError
        If there is no such place; the nearest ones are offered.
    """
    found = places_at(model, card, at)
    if at not in found:
        raise ModelError(misplaced(model, card, at, list(found)))
    return found[at]


def places_at(model: Component, card: Card, at: str) -> dict[str, Place]:
    """Return the places for the effect of a card by name; of several called `at`, the one at which something moves."""
    named = list(_named(model, card))
    if card.is_massless is not None:
        named = list(_weighed(model, read(model), [place for place in named if place.at == at] or named))
    if card.load or sum(place.at == at for place in named) > 1:
        named = _moving(model, named)
    return {place.at: place for place in named if fits(card, place)}


def misplaced(model: Component, card: Card, at: str, known: list[str]) -> str:
    """Return the sentence for a place at which an effect does not go, with the nearest ones at which it does."""
    return (
        f"`{at}` is no place for `{card.id}` in {type(model).__name__}, which goes {_WHERE[card.insertion]}"
        f"{nearest(at, known)}"
    )


def _moving(model: Component, named: list[Place]) -> list[Place]:
    """Put places at which something moves behind those at which nothing does, and name the forces in bearings."""
    reading = read(model)
    loads = _loads(model, reading)
    motions = [_relative(reading, place) for place in named]
    found = [
        replace(place, load=loads.get((place.kind, motion), "")) for place, motion in zip(named, motions, strict=True)
    ]
    return [place for _, place in sorted(zip(motions, found, strict=True), key=lambda item: bool(item[0]))]


_WHERE: dict[Manner, str] = {
    "parallel": "across a component with two flanges or between one and ground",
    "series": "between a port and what is joined to it",
    "law": "into the constant of a component",
    "sensor": "behind a variable",
    "input": "before the input of an actuator",
    "clock": "at `time` alone",
}


def _named(model: Component, card: Card) -> Iterator[Place]:
    """Yield every place of the manner of a card, not merged; of two at one component the one across it."""
    for path, component in walk(model):
        if card.insertion == "parallel" and path:
            for kind, port_a, port_b in reversed(list(_pairs(component))):
                yield Place(path, kind, port_a, port_b, (), "parallel", type(component))
        if card.insertion == "series" and path:
            yield from _ports(path, component)
        if card.insertion == "sensor":
            names = (name for name, q in variables_of(type(component)).items() if not isinstance(q, Discrete))
            yield from (_variable(path, component, name, "sensor") for name in names)
    if card.insertion == "law":
        yield from (place for place in _constants(model) if place.at.rpartition(".")[2] == card.constant)
    if card.insertion == "input":
        yield from _inputs(model)
    if card.insertion == "clock":
        yield CLOCK


def _parallel(model: Component, reading: Reading) -> Iterator[Place]:
    groups: dict[Motion, list[tuple[tuple[int, int], Place]]] = {}
    loads = _loads(model, reading)
    for order, (path, component) in enumerate(walk(model)):
        for kind, port_a, port_b in _pairs(component) if path else ():
            place = Place(path, kind, port_a, port_b, (), "parallel", type(component))
            motion = _relative(reading, place)
            if motion:
                rank = (2 if port_a is None else 0 if _is_damped(component) else 1, order)
                load = loads.get((kind, motion), "")
                groups.setdefault(motion, []).append((rank, replace(place, load=load)))
    first = list(_merged(groups))
    yield from first
    # what is at rest elsewhere has a place of its own, for laws that begin at rest
    for group in groups.values():
        for _, place in group:
            if place.port_a is not None and not any(place.at == other.at for other in first):
                yield replace(place, is_behind=True)


def _relative(reading: Reading, place: Place) -> Motion:
    """Return the relative motion of what a place stands between; empty if there is none."""
    assert place.kind is not None
    ports = (f"{place.at}.{port}.{COORDINATE[place.kind]}" if port else "" for port in (place.port_a, place.port_b))
    a, b = (reading.relation(name) if name else None for name in ports)
    return motion_of(b, a, reading.number)


def _loads(model: Component, reading: Reading) -> dict[tuple[Kind, Motion], str]:
    """Return the forces in bearings that the model knows, by the motion of the shaft, and of what carries the bearing.

    The first are loads of friction; the second only tell that a body hangs there.
    """
    found: dict[tuple[Kind, Motion], str] = {}
    for path, component in walk(model):
        for name, declared in variables_of(type(component)).items():
            shaft = declared.declaration.load_of
            if path and shaft:
                for port, of in used_ports_of(component).items():
                    if port == shaft or type(of) is T:
                        position = reading.relation(f"{path}.{port}.{COORDINATE[type(of)]}")
                        motion = motion_of(position, None, reading.number)
                        found.setdefault((type(of), motion), f"{path}.{name}")
    return found


def _series(model: Component, reading: Reading) -> Iterator[Place]:
    groups: dict[tuple[object, ...], list[tuple[tuple[int, int], Place]]] = {}
    held: dict[tuple[object, ...], list[tuple[tuple[int, int], Place]]] = {}
    loads = _loads(model, reading)
    for order, (path, component) in enumerate(walk(model)):
        for place in _ports(path, component) if path else ():
            assert place.kind is not None
            relation = reading.relation(f"{place.at}.{THROUGH[place.kind]}")
            if relation.base < 0:  # it passes nothing on
                continue
            is_gear = len({type(port) for port in used_ports_of(component).values()} & set(COORDINATE)) == 2
            # a force that is a function of position differs from another one of it by more than a factor
            share = round(reading.number(relation.offset) / reading.number(relation.factor), 9)
            key = (relation.base, relation.order, share)
            rank = 0 if is_gear or _is_ground(place) else 1
            if place.kind is R:
                motion = motion_of(reading.relation(f"{place.at}.phi"), None, reading.number)
                place = replace(place, load=loads.get((R, motion), ""))
            (held if _is_held(place, reading) else groups).setdefault(key, []).append(((rank, order), place))
    # a base stands apart, with what it alone holds: an effect there moves what hangs on it against ground
    bases = {key: group for key, group in held.items() if any(_is_ground(place) for _, place in group)}
    for key, group in held.items():
        if key not in bases:
            groups.setdefault(key, []).extend(group)
    yield from _merged(groups)
    yield from _merged(bases)


def _weighed(model: Component, reading: Reading, series: Sequence[Place]) -> tuple[Place, ...]:
    """Return places in series that know whether they pass on what a current makes, and no mass enters that."""
    pins = (port.at for path, component in walk(model) for port in _ports(path, component) if path and port.kind is E)
    currents = {reading.relation(f"{pin}.i").base for pin in pins}
    forces = {place.at: f"{place.at}.{THROUGH[place.kind]}" for place in series if place.kind in COORDINATE}
    driven = [force for force in forces.values() if reading.relation(force).base in currents - {-1}]
    light = without_mass(model, driven) if driven else frozenset()
    return tuple(replace(place, is_massless=forces.get(place.at) in light) for place in series)


def _is_held(place: Place, reading: Reading) -> bool:
    return place.kind in COORDINATE and reading.relation(f"{place.at}.{COORDINATE[place.kind]}").base < 0


def _is_ground(place: Place) -> bool:
    return place.insertion == "series" and place.host in (rotational.Fixed, translational.Fixed)


def _merged(groups: Mapping[Any, list[tuple[tuple[int, int], Place]]]) -> Iterator[Place]:
    """Yield the best place of each group, and the best of each other kind behind it; the others are named."""
    for group in groups.values():
        ordered = [place for _, place in sorted(group, key=lambda item: item[0])]
        names = tuple(dict.fromkeys(place.at for place in ordered))
        first = ordered[0]
        for kind in dict.fromkeys(place.kind for place in ordered):
            best = next(place for place in ordered if place.kind is kind)
            others = tuple(name for name in names if name != best.at)
            yield replace(best, same_motion=others, rival=None if kind is first.kind else first.kind)


def _ports(path: str, component: Component) -> Iterator[Place]:
    for name, port in used_ports_of(component).items():
        if type(port) in THROUGH:
            yield Place(f"{path}.{name}", type(port), None, name, (), "series", type(component))


def _constants(model: Component) -> Iterator[Place]:
    """Yield the parameters of components without parts, which are those that a factor can multiply."""
    for path, component in walk(model):
        attached = state_of(component).attached
        if path and not any(part not in attached for part in parts_of(component)):
            for name, declared in parameters_of(type(component)).items():
                unit = declared.declaration.unit
                yield Place(f"{path}.{name}", None, None, None, (), "law", type(component), unit)


def _inputs(model: Component) -> Iterator[Place]:
    """Yield the input signals of components that have ports: those of actuators."""
    for path, component in walk(model):
        for name, declared in variables_of(type(component)).items():
            is_input = isinstance(declared, Signal) and declared.direction == "in"
            if path and is_input and ports_of(type(component)):
                yield _variable(path, component, name, "input")


def _sensor(model: Component, name: str) -> Place:
    path, _, variable = name.rpartition(".")
    for found, component in walk(model):
        if found == path and variable in variables_of(type(component)):
            return _variable(path, component, variable, "sensor")
    # a quantity of a port, or one that an effect has put there: nothing stands behind it
    return Place(name, None, None, None, (), "sensor")


def _variable(path: str, component: Component, name: str, manner: Manner) -> Place:
    unit = variables_of(type(component))[name].declaration.unit
    return Place(f"{path}.{name}" if path else name, None, None, None, (), manner, type(component), unit)


def _is_damped(component: Component) -> bool:
    return any(q.declaration.unit in _DAMPING_UNITS for q in parameters_of(type(component)).values())


def _pairs(component: Component) -> Iterator[tuple[type[Port], str | None, str]]:
    """Yield what an effect may be put between: two flanges of a kind, or ground (None) and a flange."""
    by_kind: dict[type[Port], list[str]] = {}
    for name, port in used_ports_of(component).items():
        if type(port) in COORDINATE:
            by_kind.setdefault(type(port), []).append(name)
    for kind, names in by_kind.items():
        if len(names) == 2:
            yield kind, names[0], names[1]
        yield kind, None, names[-1]
