"""Copies of models: made anew, with what was changed, attached and spliced in since."""

from collections.abc import Callable, Iterator

import casadi as ca

from cartpend_dae.effects.walk import component_at, walk
from cartpend_dae.language import (
    Component,
    Connection,
    Port,
    attached_to,
    bindings_of,
    constructor_fields,
    parameters_of,
    parts_of,
    variables_of,
)
from cartpend_dae.quantities import state_of

End = Port | ca.SX


def rebuild(model: Component) -> Component:
    """Make an equal model anew, attached parts and changed parameters included."""
    fresh = _construct(model)
    _copy_bindings(model, fresh)
    translated = _translation(model, fresh)
    for path, component in list(walk(model)):
        owner = component_at(fresh, path)
        for name, (part, connections) in attached_to(component).items():
            if name in attached_to(owner):  # the model attaches it itself when it is made
                continue
            owner.attach(name, rebuild(part))
            _take_again(component, owner, part, name)
            joined = tuple(Connection(tuple(translated(end) for end in joint.ends)) for joint in connections)
            attached_to(owner)[name] = (attached_to(owner)[name][0], joined)
    for path, component in walk(model):
        old, new = state_of(component), state_of(component_at(fresh, path))
        new.diverted = {name: translated(end) for name, end in old.diverted.items()}
        new.scaled = {name: tuple(_signal(translated(f)) for f in factors) for name, factors in old.scaled.items()}
    return fresh


def _take_again(old: Component, new: Component, part: Component, name: str) -> None:
    """Bind parameters of an attached part to those of its new owner, where they were bound to the old one's."""
    of_owner = list(parameters_of(type(old)))
    before, after = ([getattr(owner, each) for each in of_owner] for owner in (old, new))
    fresh = attached_to(new)[name][0]
    for each, value in bindings_of(part).items():
        if before and not ca.SX(value).is_constant():
            bindings_of(fresh)[each] = ca.substitute(ca.SX(value), ca.vertcat(*before), ca.vertcat(*after))


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


def _translation(model: Component, fresh: Component) -> Callable[[End], End]:
    """Return what finds the port or signal of the new model that corresponds to one of the old."""
    paths = {id(component): path for path, component in walk(model)}
    signals = {
        symbol.element_hash(): (path, variable)
        for path, component in walk(model)
        for variable, symbol in signals_of(component)
    }

    def translated(end: End) -> End:
        if isinstance(end, Port):
            return getattr(component_at(fresh, paths[id(end.owner)]), end.name)
        path, variable = signals[end.element_hash()]
        return getattr(component_at(fresh, path), variable)

    return translated


def signals_of(component: Component) -> Iterator[tuple[str, ca.SX]]:
    """Yield the variables and signals of a component by name."""
    for variable in variables_of(type(component)):
        yield variable, getattr(component, variable)


def _signal(end: End) -> ca.SX:
    assert not isinstance(end, Port)
    return end
