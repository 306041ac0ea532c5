"""Models with one fault: a statement deleted, repeated or joined to the wrong end, or a fixed point taken away."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca

from cartpend_dae.collector import Collector, collecting
from cartpend_dae.language import Component, Connection, Initial, Port, parts_of, symbols_of, used_ports_of

How = Literal["delete", "repeat", "swap", "remove"]
REFERENCES = ("Ground", "Fixed", "FixedTemperature", "World")


@dataclass(frozen=True)
class Fault:
    """What is done to a model, and the dotted names of the parts that it touches ("" is the model itself).

    `path` and `position` say which statement of which part; `remove` takes away the part `path`, of the class `kind`,
    and all its joints.
    """

    how: How
    path: str
    position: int
    touched: frozenset[str]
    is_connection: bool
    kind: str = ""

    def __str__(self) -> str:
        what = "connection" if self.is_connection else "equation"
        place = f"{what} {self.position} of {self.path or 'the model'}"
        return f"{self.how} {self.path if self.how == 'remove' else place} ({', '.join(sorted(self.touched))})"


def walk(component: Component, path: str = "") -> Iterator[tuple[str, Component]]:
    yield path, component
    for name, part in parts_of(component).items():
        yield from walk(part, f"{path}.{name}" if path else name)


def faults_of(model: Component) -> list[Fault]:
    """Return all faults that can be made in a model, in the order of its parts and statements."""
    components = list(walk(model))
    path_of_port = {id(component): path for path, component in components}
    path_of_symbol = {s.element_hash(): path for path, c in components for s in symbols_of(c).values()}
    found: list[Fault] = []
    joined: list[frozenset[str]] = []
    for path, component in components:
        with collecting(Collector(time=ca.SX.sym("time"))):
            statements = list(component.equations())
        path_of_symbol |= {s.element_hash(): path for s in symbols_of(component).values()}
        for k, statement in enumerate(statements):
            if isinstance(statement, Initial):
                continue
            touched = {path}
            if isinstance(statement, Connection):
                touched = {
                    path_of_port[id(e.owner)] if isinstance(e, Port) else path_of_symbol.get(e.element_hash(), path)
                    for e in statement.ends
                }
                joined.append(frozenset(touched))
            fault = Fault("delete", path, k, frozenset(touched), isinstance(statement, Connection))
            found += [fault, replace(fault, how="repeat")]
            if isinstance(statement, Connection) and any(twin_of(end) is not None for end in statement.ends):
                found.append(replace(fault, how="swap"))
    for path, component in components:
        if path and type(component).__name__ in REFERENCES:
            neighbours = frozenset().union(*(ends for ends in joined if path in ends)) - {path}
            found.append(Fault("remove", path, 0, neighbours, False, type(component).__name__))
    return found


def twin_of(end: object) -> Port | None:
    """Return another port of the same class at the same part, None if there is none."""
    if not isinstance(end, Port):
        return None
    others = [p for p in used_ports_of(end.owner).values() if type(p) is type(end) and p is not end]
    return others[0] if others else None


def break_model(model: Component, fault: Fault) -> Component:
    """Make the fault in the model, in place, and return it.

    The equations of the one part are replaced; as the part then holds more than plain values, it shares no template
    with others of its class.
    """
    components = dict(walk(model))
    if fault.how == "remove":
        _remove(components, fault.path)
        return model

    def edit(statements: list) -> list:
        chosen = statements[fault.position]
        new = {"delete": [], "repeat": [chosen, chosen]}.get(fault.how)
        if new is None:
            place = next(i for i, end in enumerate(chosen.ends) if twin_of(end) is not None)
            ends = list(chosen.ends)
            ends[place] = twin_of(ends[place])
            new = [Connection(tuple(ends))]
        return [*statements[: fault.position], *new, *statements[fault.position + 1 :]]

    _replace_equations(components[fault.path], edit)
    return model


def _replace_equations(component: Component, edit: Callable[[list], list]) -> None:
    original = component.equations
    component.equations = lambda: iter(edit(list(original())))  # type: ignore[method-assign]


def _remove(components: dict[str, Component], path: str) -> None:
    """Take a part out of its parent, which may name it still, and out of all connections."""
    part = components[path]
    parent, _, name = path.rpartition(".")

    def without(statement):
        if not isinstance(statement, Connection):
            return [statement]
        ends = tuple(end for end in statement.ends if not (isinstance(end, Port) and end.owner is part))
        return [Connection(ends)] if len(ends) > 1 else []

    for component in components.values():
        if any(other is part for other in parts_of(component).values()):
            _hide(component, name)
        if parts_of(component) or component is components[parent]:
            _replace_equations(component, lambda all_: [kept for statement in all_ for kept in without(statement)])


def _hide(component: Component, name: str) -> None:
    """Keep the part reachable by its name for the equations, but not among the parts."""
    part = vars(component).pop(name)
    component.__class__ = type(type(component).__name__, (type(component),), {name: property(lambda _: part)})
