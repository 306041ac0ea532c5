"""Connection sets: potentials are equal, flows sum to zero, one output drives each signal."""

from collections import defaultdict

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError
from cartpend_dae.gathered import End, Gathered
from cartpend_dae.language import Component, Connection, symbols_of
from cartpend_dae.quantities import Flow, Port
from cartpend_dae.system import Group

Form = tuple[object, ...]


def join(tables: Gathered, place: int, component: Component | None, connection: Connection) -> None:
    """Note a connection; a port of the connecting component itself is seen from its inside.

    `component` is None for a part attached from outside, which sees all ports from outside and as they are;
    what the model itself connects to a port or signal that was diverted reaches what it was diverted to.
    """
    where = tables.places[place].path or "the model"
    keys: list[object] = []
    for end in connection.ends:
        if isinstance(end, Port):
            if id(end.owner) not in tables.place_of:
                raise ModelError(
                    f"`connect` in `{where}` names a port `{end.name}` of a {type(end.owner).__name__} "
                    f"that is no part of the model: store it in an attribute in `__post_init__`, under one name."
                )
            key = End(tables.place_of[id(end.owner)], end.name, "outside" if end.owner is component else "inside")
            keys.append(key if component is None else tables.diverted.get(key, key))
            if key.side == "outside":
                tables.inner_ports.add(key)
        else:
            index, _ = tables.variable_of.get(end.element_hash(), (None, None)) if end.is_symbolic() else (None, None)
            if index is None or tables.variables[index].kind not in ("input", "output", "variable"):
                raise ModelError(
                    f"`connect` in `{where}` names `{end}`, which is neither a port nor a signal: write an equation, "
                    f"`yield self.x == {end}`, for a variable `x = var(unit=...)`, and connect that."
                )
            is_own = component is not None and end.element_hash() in {
                s.element_hash() for s in symbols_of(component).values()
            }
            keys.append(index if is_own or component is None else tables.diverted.get(index, index))
            if is_own:
                tables.driven_inside.add(index)
    sets = tables.sets if isinstance(connection.ends[0], Port) else tables.signal_sets
    for key in keys[1:]:
        sets.join(keys[0], key)


def connect_all(tables: Gathered) -> tuple[int, ...]:
    """Add the equations of all connection sets and return the variables that are inputs of the model."""
    for number, place in enumerate(tables.places):
        for name in place.layout.ports:
            tables.sets.find(End(number, name, "inside"))
    forms: dict[Form, list[tuple[int, list[int]]]] = defaultdict(list)
    for members in tables.sets.sets():
        _port_equations(tables, forms, members)  # type: ignore[arg-type]
    inputs = _signal_equations(tables, forms)
    tables.groups += [_group(form, instances) for form, instances in forms.items()]
    return inputs


def _signal_equations(tables: Gathered, forms: dict[Form, list[tuple[int, list[int]]]]) -> tuple[int, ...]:
    undriven = {i for i, variable in enumerate(tables.variables) if variable.kind == "input"}
    external: list[int] = []
    for members in tables.signal_sets.sets():
        indices = sorted((int(i) for i in members), key=lambda i: (tables.variables[i].name.count("."), i))  # type: ignore[call-overload]
        outputs = [i for i in indices if tables.variables[i].kind in ("output", "variable")]
        sources = [i for i in outputs if i not in tables.driven_inside] or outputs[-1:]
        if len(sources) > 1:
            tables.findings.append(_two_sources(tables, sources, indices))
        undriven -= set(indices)
        source = sources[0] if sources else indices[0]
        tables.driven_inside.discard(source)
        if not sources:
            external.append(source)
        for index in indices:
            if index != source:
                pair = [tables.variables[index], tables.variables[source]]
                form = ("signal", *(variable.declaration.unit for variable in pair), (1, -1))
                forms[form].append((len(tables.origins), [index, source]))
                tables.origins.append(_set_name([pair[1].name, pair[0].name]))
    return tuple(sorted(undriven | set(external)))


def _two_sources(tables: Gathered, sources: list[int], members: list[int]) -> str:
    driving, driven = (
        " and ".join(f"`{tables.variables[i].name}`" for i in chosen)
        for chosen in (sources, [i for i in members if i not in sources])
    )
    return f"The outputs {driving} {f'drive the same signal, {driven}' if driven else 'are joined'}: keep one of them."


def _port_equations(tables: Gathered, forms: dict[Form, list[tuple[int, list[int]]]], members: list[End]) -> None:
    """Note the equations of a set: its variables by the form of the equation, a tuple that ends with the signs."""
    first, *others = members
    kind, _ = tables.places[first.place].layout.ports[first.port]
    starts = [tables.places[end.place].variable + tables.places[end.place].layout.ports[end.port][1] for end in members]
    names = [end_name(tables, end) for end in members]
    label = _set_name(names)
    for offset, (quantity, declared) in enumerate(kind.quantities.items()):
        if isinstance(declared, Flow):
            signs = tuple(1 if end.side == "inside" else -1 for end in members)
            forms[kind, quantity, signs].append((len(tables.origins), [start + offset for start in starts]))
            tables.origins.append(f"{label}: sum of {quantity}")
        else:
            for name, start in zip(names[1:], starts[1:], strict=True):
                forms[kind, quantity, (1, -1)].append((len(tables.origins), [starts[0] + offset, start + offset]))
                tables.origins.append(f"{_set_name([names[0], name]) if len(others) > 1 else label}: equal {quantity}")


def end_name(tables: Gathered, end: End) -> str:
    """Return the dotted name of a port."""
    path = tables.places[end.place].path
    return f"{path}.{end.port}" if path else end.port


def _set_name(names: list[str]) -> str:
    if len(names) == 1:
        return f"unconnected {names[0]}"
    return "connection of " + ", ".join(sorted(set(names)))


def _group(form: Form, instances: list[tuple[int, list[int]]]) -> Group:
    signs: tuple[int, ...] = form[-1]  # type: ignore[assignment]
    variables, nothing = ca.SX.sym("v", len(signs)), ca.SX(0, 1)
    total = sum((variables[k] if sign > 0 else -variables[k] for k, sign in enumerate(signs)), ca.SX(0))
    function = ca.Function("connection", [variables, nothing, nothing, ca.SX.sym("t")], [total])
    none = np.zeros((0, len(instances)), dtype=int)
    return Group(
        function=function,
        equations=np.array([[row for row, _ in instances]]),
        variables=np.array([members for _, members in instances]).T,
        derivatives=none,
        parameters=none,
    )
