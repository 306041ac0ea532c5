"""Where effects may stand in a model, one place for each motion that data can tell apart."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca

from cartpend_dae.alias import alias
from cartpend_dae.flatten import flatten
from cartpend_dae.language import Component, parameters_of, parts_of, used_ports_of
from cartpend_dae.library import rotational, translational
from cartpend_dae.quantities import Port
from cartpend_dae.system import AliasedSystem, Coefficient, Relation, symbolic

# the coordinate of a flange; an effect between two flanges acts along it
COORDINATE: dict[type[Port], str] = {rotational.Flange: "phi", translational.Flange: "s"}
_DAMPING_UNITS = ("N.s/m", "N.m.s/rad")


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


def walk(model: Component, path: str = "") -> Iterator[tuple[str, Component]]:
    """Yield all components with their dotted paths, the model itself first."""
    yield path, model
    for name, part in parts_of(model).items():
        yield from walk(part, f"{path}.{name}" if path else name)


def places(model: Component, measured: tuple[str, ...] = ()) -> tuple[Place, ...]:
    """Return the places of a model.

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
    number = _evaluation(aliased)
    groups: dict[tuple[object, ...], list[tuple[tuple[int, int], Place]]] = {}
    for order, (path, component) in enumerate(walk(model)):
        for kind, port_a, port_b in _pairs(component) if path else ():
            ends = [
                None if p is None else aliased.relations[position_of[f"{path}.{p}.{COORDINATE[kind]}"]]
                for p in (port_a, port_b)
            ]
            motion = _motion(ends[1], ends[0], number)
            if motion:
                rank = (2 if port_a is None else 0 if _is_damped(component) else 1, order)
                groups.setdefault(motion, []).append((rank, Place(path, kind, port_a, port_b, ())))
    found = []
    for group in groups.values():
        best = min(group, key=lambda item: item[0])[1]
        others = tuple(dict.fromkeys(place.at for _, place in group if place.at != best.at))
        found.append(Place(best.at, best.kind, best.port_a, best.port_b, others))
    return (*found, *(Place(name, None, None, None, ()) for name in measured))


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


def _evaluation(aliased: AliasedSystem) -> Callable[[Coefficient], float]:
    """Return a function that gives the value of a coefficient at the present parameters."""
    symbols, values = aliased.flat.parameter_symbols, aliased.flat.parameter_bindings
    while ca.symvar(values):  # bindings are expressions of parents' parameters, a tree of finite depth
        values = ca.substitute(values, symbols, aliased.flat.parameter_bindings)
    return lambda coefficient: float(ca.substitute(symbolic(coefficient), symbols, values))


def _motion(b: Relation | None, a: Relation | None, number: Callable[[Coefficient], float]) -> tuple[object, ...]:
    """Return the relative position b - a as a direction in the space of chains; empty if it is constant."""
    terms: dict[tuple[int, int], float] = {}
    for relation, sign in ((b, 1.0), (a, -1.0)):
        if relation is not None and relation.base >= 0:
            key = (relation.base, relation.order)
            terms[key] = terms.get(key, 0.0) + sign * number(relation.factor)
    left = sorted((key, value) for key, value in terms.items() if abs(value) > 1e-12)
    return tuple((key, round(value / left[0][1], 9)) for key, value in left)
