"""Component tree -> FlatSystem: dotted names, connection sets, balance.

Ports that nothing joins, those of the whole model too, pass no flow.
"""

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca

from cartpend_dae.balance import check_balance
from cartpend_dae.collector import Collector, collecting
from cartpend_dae.connections import connect_all, join
from cartpend_dae.errors import ModelError
from cartpend_dae.explain import listed_findings
from cartpend_dae.freeze import freeze
from cartpend_dae.gathered import End, Gathered, Layout, Place, layout_of
from cartpend_dae.language import (
    Component,
    attached_to,
    parts_of,
)
from cartpend_dae.quantities import Port, is_number, state_of
from cartpend_dae.statements import stated_by
from cartpend_dae.system import FlatSystem, Parameter, Variable
from cartpend_dae.templates import Key, Template, make_template, template_key
from cartpend_dae.timekeeping import rate_of


def flatten(model: Component) -> FlatSystem:
    """Collect the equations of a component tree under dotted names.

    Parameters
    ----------
    model
        The whole model; its inputs that nothing drives are the inputs of the system.

    Raises
    ------
    ModelError
        For an equation that is none, a symbol of a foreign component, a signal with two sources, or unequal
        numbers of equations and unknowns; components are named.
    """
    if not isinstance(model, Component):
        found = f"the class `{model.__name__}`" if isinstance(model, type) else f"{model!r}"
        raise ModelError(f"A model is a component that was made, such as `Mass(m=1.0)`, not {found}.")
    tables = Gathered()
    layouts: dict[type, Layout] = {}
    for path, component in _walk(model, ""):
        _declare(tables, layouts, path, component)
    collector = Collector(ca.SX.sym("time"))
    templates = _collect_all(tables, collector)
    for place in tables.places:
        _declare_parameters(tables, place)
    _find_symbols(tables)
    _note_diverted(tables)
    _join_all(tables)
    inputs = connect_all(tables)
    name = type(model).__name__
    if tables.findings:
        raise ModelError(listed_findings(name, tables.findings)) from next(iter(tables.causes), None)
    flat = freeze(tables, collector, templates, inputs, name)
    check_balance(tables, flat)
    return replace(flat, rate=rate_of(flat, collector.rates)) if collector.rates else flat


def _walk(component: Component, path: str) -> Iterator[tuple[str, Component]]:
    yield path, component
    for name, part in parts_of(component).items():
        yield from _walk(part, f"{path}.{name}" if path else name)


def _declare(tables: Gathered, layouts: dict[type, Layout], path: str, component: Component) -> None:
    cls = type(component)
    if id(component) in tables.place_of:
        first = tables.places[tables.place_of[id(component)]].path
        if not first or path.startswith((f"{first}.", f"{first}[")):
            raise ModelError(f"`{first or cls.__name__}` contains itself, as `{path}`; leave that part out.")
        raise ModelError(f"The same {cls.__name__} stands in the model twice, as `{first}` and as `{path}`; make two.")
    layout = layouts.get(cls)
    if layout is None:
        layout = layouts[cls] = layout_of(cls)
    tables.place_of[id(component)] = len(tables.places)
    tables.places.append(Place(path, component, layout, len(tables.variables), tables.n_parameters))
    prefix = f"{path}." if path else ""
    tables.variables += [Variable(prefix + name, kind, declared) for name, kind, declared in layout.variables]
    tables.n_parameters += len(layout.parameters)


def _declare_parameters(tables: Gathered, place: Place) -> None:
    """Note the parameters, after the equations, which may ask `is_zero`."""
    state = state_of(place.component)
    prefix = f"{place.path}." if place.path else ""
    for name, (_, declared) in place.layout.parameters.items():
        bound = state.bindings[name]
        value = float(bound) if is_number(bound) else float(ca.DM(bound)) if ca.SX(bound).is_constant() else None
        if name in state.built_as_zero and value != 0:
            tables.findings.append(
                f"`{prefix}{name}` was 0 when `{place.name}` was made, so that the part it belongs "
                f"to does not exist; set it in the constructor."
            )
        flags = (name in state.built_as_zero, name in state.unknown)
        tables.parameters.append(Parameter(prefix + name, declared, value, *flags))
        tables.bindings.append(bound)


def _find_symbols(tables: Gathered) -> None:
    """Note the symbols that were made so far, for equations and connections: most components need none of their own."""
    for place in tables.places:
        layout = place.layout
        state = state_of(place.component)
        for name, symbol in state.symbols.items():
            if name in layout.position:
                tables.variable_of[symbol.element_hash()] = (place.variable + layout.position[name], symbol)
            else:
                number, _ = layout.parameters[name]
                tables.parameter_of[symbol.element_hash()] = (place.parameter + number, symbol)
        for name, port in state.ports.items():
            for quantity, symbol in state_of(port).symbols.items():
                tables.variable_of[symbol.element_hash()] = (place.port_quantity(name, quantity), symbol)


def _collect_all(tables: Gathered, collector: Collector) -> list[Template]:
    """Collect the equations of all components, those of one kind together."""
    templates: dict[Key, Template | None] = {}
    with collecting(collector):
        for number, place in enumerate(tables.places):
            key = template_key(place.component)
            template = templates.get(key) if key is not None else None
            if template is not None:
                _enrol(tables, template, place)
                continue
            n_notes = _n_notes(tables, collector)
            residuals = _collect(tables, collector, number)
            is_pure = n_notes == _n_notes(tables, collector)
            if key is not None and key not in templates:
                template = templates[key] = make_template(place, residuals, collector) if is_pure else None
            if template is not None:
                _enrol(tables, template, place)
                continue
            place.n_equations = len(residuals)
            tables.loose += residuals
            tables.loose_rows += range(len(tables.origins), len(tables.origins) + len(residuals))
            tables.origins += _origins(place)
    return [template for template in templates.values() if template is not None]


def _n_notes(tables: Gathered, collector: Collector) -> tuple[int, ...]:
    """Return the numbers of what a component states besides equations."""
    noted = (
        collector.frictions,
        collector.relations,
        collector.clocks,
        collector.rates,
        tables.initials,
        tables.connections,
        tables.whens,
    )
    return tuple(len(notes) for notes in noted)


def _enrol(tables: Gathered, template: Template, place: Place) -> None:
    template.enrol(place, len(tables.origins))
    place.n_equations = template.n_equations
    tables.origins += _origins(place)


def _origins(place: Place) -> list[str]:
    name = place.name
    return [f"{name}: equation {k}" for k in range(1, place.n_equations + 1)]


def _collect(tables: Gathered, collector: Collector, number: int) -> list[ca.SX]:
    """Return the residuals of a component's equations; note its connections, starts, frictions and mistakes."""
    place = tables.places[number]
    n_frictions, n_relations = len(collector.frictions), len(collector.relations)
    n_equalities = len(collector.equalities)
    stated = stated_by(place.component, place.name)
    tables.initials += stated.initials
    tables.whens += [(place.name, statement) for statement in stated.whens]
    tables.relation_places += [place.name] * (len(collector.relations) - n_relations)
    tables.equality_places += [place.name] * (len(collector.equalities) - n_equalities)
    tables.findings += stated.findings
    tables.causes += stated.causes
    tables.connections += [(number, place.component, connection) for connection in stated.connections]
    for _, connections in attached_to(place.component).values():
        tables.connections += [(number, None, connection) for connection in connections]
    tables.frictions += [(place.name, i) for i in range(n_frictions, len(collector.frictions))]
    return stated.residuals


def _note_diverted(tables: Gathered) -> None:
    """Note which ports and signals of parts the model reaches by way of a part attached from outside."""

    def key(end: Port | ca.SX) -> object:
        if isinstance(end, Port):
            return End(tables.place_of[id(end.owner)], end.name, "inside")
        return tables.variable_of[end.element_hash()][0]

    for place in tables.places:
        for name, to in state_of(place.component).diverted.items():
            tables.diverted[key(getattr(place.component, name))] = key(to)


def _join_all(tables: Gathered) -> None:
    for number, component, connection in tables.connections:
        try:
            join(tables, number, component, connection)
        except ModelError as error:
            tables.findings.append(str(error))
