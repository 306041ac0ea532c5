"""Connection sets: potentials are equal, flows sum to zero, one output drives each signal."""

import casadi as ca

from cartpend_dae.errors import ModelError
from cartpend_dae.gathered import Gathered
from cartpend_dae.language import Component, Connection, symbols_of
from cartpend_dae.quantities import Flow, Port


def join(tables: Gathered, path: str, component: Component | None, connection: Connection) -> None:
    """Note a connection; a port of the connecting component itself is seen from its inside.

    `component` is None for a part attached from outside, which sees all ports from outside.
    """
    where = path or "the model"
    tables.n_connections += 1
    keys: list[object] = []
    for end in connection.ends:
        if isinstance(end, Port):
            if id(end.owner) not in tables.path_of:
                raise ModelError(
                    f"`connect` in `{where}` names a port `{end.name}` of a {type(end.owner).__name__} "
                    f"that is no part of the model: store it in an attribute in `__post_init__`, under one name."
                )
            side = "outside" if end.owner is component else "inside"
            keys.append((tables.path_of[id(end.owner)], end.name, side))
        else:
            index = tables.index_of.get(end.element_hash()) if end.is_symbolic() else None
            if index is None or tables.variables[index].kind not in ("input", "output", "variable"):
                raise ModelError(
                    f"`connect` in `{where}` names `{end}`, which is neither a port nor a signal: write an equation, "
                    f"`yield self.x == {end}`, for a variable `x = var(unit=...)`, and connect that."
                )
            keys.append(index)
            if component is not None and end.element_hash() in {
                s.element_hash() for s in symbols_of(component).values()
            }:
                tables.driven_inside.add(index)
    sets = tables.sets if isinstance(connection.ends[0], Port) else tables.signal_sets
    for key in keys[1:]:
        sets.join(keys[0], key)


def connect_all(tables: Gathered) -> tuple[int, ...]:
    """Add the equations of all connection sets and return the variables that are inputs of the model."""
    for path, name in tables.ports:
        tables.sets.find((path, name, "inside"))
    for members in tables.sets.sets():
        _port_equations(tables, members)  # type: ignore[arg-type]
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
                tables.residuals.append(tables.symbols[index] - tables.symbols[source])
                tables.origins.append(_set_name([tables.variables[source].name, tables.variables[index].name]))
    return tuple(sorted(undriven | set(external)))


def _two_sources(tables: Gathered, sources: list[int], members: list[int]) -> str:
    driving, driven = (
        " and ".join(f"`{tables.variables[i].name}`" for i in chosen)
        for chosen in (sources, [i for i in members if i not in sources])
    )
    return f"The outputs {driving} {f'drive the same signal, {driven}' if driven else 'are joined'}: keep one of them."


def _port_equations(tables: Gathered, members: list[tuple[str, str, str]]) -> None:
    ports = [(tables.ports[path, name], side) for path, name, side in members]
    names = [f"{path}.{name}" if path else name for path, name, _ in members]
    label = _set_name(names)
    for quantity, kind in type(ports[0][0]).quantities.items():
        if isinstance(kind, Flow):
            total = ca.SX(0)
            for port, side in ports:
                total += getattr(port, quantity) if side == "inside" else -getattr(port, quantity)
            tables.residuals.append(total)
            tables.origins.append(f"{label}: sum of {quantity}")
        else:
            for name, (port, _) in zip(names[1:], ports[1:], strict=True):
                tables.residuals.append(getattr(ports[0][0], quantity) - getattr(port, quantity))
                tables.origins.append(f"{_set_name([names[0], name])}: equal {quantity}")


def _set_name(names: list[str]) -> str:
    if len(names) == 1:
        return f"unconnected {names[0]}"
    return "connection of " + ", ".join(sorted(set(names)))
