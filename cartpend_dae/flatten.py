"""Component tree -> FlatSystem: dotted names, connection sets, balance.

Ports that nothing joins, those of the whole model too, pass no flow.
"""

from collections.abc import Iterator

import casadi as ca

from cartpend_dae.balance import check_balance
from cartpend_dae.collector import Collector, collecting
from cartpend_dae.connections import connect_all, join
from cartpend_dae.errors import ModelError
from cartpend_dae.explain import listed_findings
from cartpend_dae.gathered import Gathered
from cartpend_dae.language import (
    Component,
    attached_to,
    bindings_of,
    parameters_of,
    parts_of,
    used_ports_of,
    variables_of,
)
from cartpend_dae.quantities import Flow, Signal, state_of
from cartpend_dae.statements import foreign_sentence, residual_of, stated_by, users_of, varying_findings
from cartpend_dae.system import FlatSystem, Frictions, Initials, Kind, Parameter, Variable
from cartpend_dae.templates import Key, Template, enrol, instantiate, make_template, template_key


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
    for path, component in _walk(model, ""):
        _declare(tables, path, component)
    collector = Collector(ca.SX.sym("time"))
    _collect_all(tables, collector)
    for path, component in tables.components:
        _declare_parameters(tables, path, component)
    inputs = connect_all(tables)
    if tables.findings:
        raise ModelError(listed_findings(type(model).__name__, tables.findings)) from next(iter(tables.causes), None)
    flat = _freeze(tables, collector, inputs, type(model).__name__)
    check_balance(tables, flat)
    return flat


def _walk(component: Component, path: str) -> Iterator[tuple[str, Component]]:
    yield path, component
    for name, part in parts_of(component).items():
        yield from _walk(part, f"{path}.{name}" if path else name)


def _declare(tables: Gathered, path: str, component: Component) -> None:
    if id(component) in tables.path_of:
        first = tables.path_of[id(component)]
        if not first or path.startswith((f"{first}.", f"{first}[")):
            raise ModelError(
                f"`{first or type(component).__name__}` contains itself, as `{path}`; leave that part out."
            )
        raise ModelError(
            f"The same {type(component).__name__} stands in the model twice, as `{first}` and as `{path}`; make two."
        )
    tables.components.append((path, component))
    tables.path_of[id(component)] = path
    prefix = f"{path}." if path else ""
    for name, declared in variables_of(type(component)).items():
        kind: Kind = "variable"
        if isinstance(declared, Signal):
            kind = "input" if declared.direction == "in" else "output"
        _add_variable(tables, Variable(prefix + name, kind, declared.declaration), getattr(component, name))
    for port_name, port in used_ports_of(component).items():
        tables.ports[path, port_name] = port
        for name, quantity in type(port).quantities.items():
            kind = "flow" if isinstance(quantity, Flow) else "potential"
            variable = Variable(f"{prefix}{port_name}.{name}", kind, quantity.declaration)
            _add_variable(tables, variable, getattr(port, name))


def _declare_parameters(tables: Gathered, path: str, component: Component) -> None:
    """Note the parameters, after the equations, which may ask `is_zero`."""
    built_as_zero = state_of(component).built_as_zero
    for name, declared in parameters_of(type(component)).items():
        dotted = f"{path}.{name}" if path else name
        bound = ca.SX(bindings_of(component)[name])
        if name in built_as_zero and not bound.is_zero():
            tables.findings.append(
                f"`{dotted}` was 0 when `{path or type(component).__name__}` was made, so that the part it belongs "
                f"to does not exist; set it in the constructor."
            )
        value = float(ca.DM(bound)) if bound.is_constant() else None
        tables.parameters.append(Parameter(dotted, declared.declaration, value, name in built_as_zero))
        tables.parameter_symbols.append(getattr(component, name))
        tables.bindings.append(bound)


def _add_variable(tables: Gathered, variable: Variable, symbol: ca.SX) -> None:
    tables.index_of[symbol.element_hash()] = len(tables.variables)
    tables.variables.append(variable)
    tables.symbols.append(symbol)


def _collect_all(tables: Gathered, collector: Collector) -> None:
    """Collect the equations of all components, those of one kind together."""
    templates: dict[Key, Template | None] = {}
    with collecting(collector):
        for path, component in tables.components:
            key = template_key(component)
            template = templates.get(key) if key is not None else None
            if template is not None:
                enrol(template, component, collector, len(tables.residuals))
                tables.residuals.append(ca.SX(0, 1))
                where = path or type(component).__name__
                tables.origins += [f"{where}: equation {k}" for k in range(1, template.n_equations + 1)]
                tables.own_equations[path] = template.n_equations
                continue
            before = (len(tables.residuals), len(collector.frictions), len(tables.initials), tables.n_connections)
            _collect(tables, collector, path, component)
            after = (len(collector.frictions), len(tables.initials), tables.n_connections)
            if key is not None and key not in templates:
                is_pure = before[1:] == after
                templates[key] = make_template(component, tables.residuals[before[0] :], collector) if is_pure else None
    for template in templates.values():
        if template is not None:
            columns = instantiate(template, collector.time)
            for position, column in zip(template.positions, columns, strict=True):
                tables.residuals[position] = column


def _collect(tables: Gathered, collector: Collector, path: str, component: Component) -> None:
    where = path or type(component).__name__
    n_frictions = len(collector.frictions)
    stated = stated_by(component, where)
    tables.residuals += stated.residuals
    tables.origins += stated.origins
    tables.own_equations[path] += len(stated.residuals)
    tables.initials += stated.initials
    tables.findings += stated.findings
    tables.causes += stated.causes
    connections = [(component, connection) for connection in stated.connections]
    connections += [(None, connection) for _, attached in attached_to(component).values() for connection in attached]
    for seen_from, connection in connections:
        try:
            join(tables, path, seen_from, connection)
        except ModelError as error:
            tables.findings.append(str(error))
    tables.frictions += [(where, i) for i in range(n_frictions, len(collector.frictions))]


def _freeze(tables: Gathered, collector: Collector, inputs: tuple[int, ...], name: str) -> FlatSystem:
    derivatives, symbols, zero = _derivatives(tables, collector)
    residual = ca.vertcat(*tables.residuals) if tables.residuals else ca.SX(0, 1)
    f = _frictions(tables, collector)
    initials = ca.vertcat(*[residual_of(i.equation, o) for o, i in tables.initials]) if tables.initials else ca.SX(0, 1)
    residual, initials, speed, level_pos, level_neg = ca.substitute(
        [residual, initials, f.speed, f.level_pos, f.level_neg], zero, [ca.SX(0)] * len(zero)
    )
    flat = FlatSystem(
        name=name,
        components=tuple((path, type(component).__name__) for path, component in tables.components),
        variables=tuple(tables.variables),
        symbols=ca.vertcat(*tables.symbols),
        derivatives=derivatives,
        derivative_symbols=symbols,
        parameters=tuple(tables.parameters),
        parameter_symbols=ca.vertcat(*tables.parameter_symbols) if tables.parameters else ca.SX(0, 1),
        parameter_bindings=ca.vertcat(*tables.bindings) if tables.bindings else ca.SX(0, 1),
        time=collector.time,
        inputs=inputs,
        frictions=Frictions(f.places, f.force, speed, level_pos, level_neg),
        residual=residual,
        origins=tuple(tables.origins),
        initials=Initials(initials, tuple(i.fixed for _, i in tables.initials), tuple(o for o, _ in tables.initials)),
        connections=tuple(
            tuple(f"{k[0]}.{k[1]}" if k[0] else k[1] for k in members)  # type: ignore[index]
            for members in tables.sets.sets()
        ),
    )
    _check_symbols(tables, flat)
    return flat


def _derivatives(tables: Gathered, collector: Collector) -> tuple[tuple[tuple[int, int], ...], ca.SX, list[ca.SX]]:
    """Return (variable, order) and symbol of each derivative, and the derivatives of parameters, which are zero."""
    parameters = {symbol.element_hash() for symbol in tables.parameter_symbols}
    known: dict[int, tuple[int, int] | None] = {}
    keys, symbols, zero = [], [], []
    for key, (symbol, derivative) in collector.derivatives.items():
        if key in tables.index_of:
            found: tuple[int, int] | None = (tables.index_of[key], 1)
        elif key in parameters:
            found = None
        elif key in known:
            lower = known[key]
            found = None if lower is None else (lower[0], lower[1] + 1)
        else:
            residual = ca.vertcat(*tables.residuals)
            (users,) = users_of(derivative, residual, tables.origins)
            tables.findings.append(foreign_sentence(f"`der({symbol})`", users))
            found = None
        known[derivative.element_hash()] = found
        if found is None:
            zero.append(derivative)
        else:
            keys.append(found)
            symbols.append(derivative)
    return tuple(keys), ca.vertcat(*symbols) if symbols else ca.SX(0, 1), zero


def _frictions(tables: Gathered, collector: Collector) -> Frictions:
    items = [(place, collector.frictions[i]) for place, i in tables.frictions]
    if not items:
        none = ca.SX(0, 1)
        return Frictions((), none, none, none, none)
    return Frictions(
        places=tuple(place for place, _ in items),
        force=ca.vertcat(*[friction.force for _, friction in items]),
        speed=ca.vertcat(*[friction.speed for _, friction in items]),
        level_pos=ca.vertcat(*[friction.level_pos for _, friction in items]),
        level_neg=ca.vertcat(*[friction.level_neg for _, friction in items]),
    )


def _check_symbols(tables: Gathered, flat: FlatSystem) -> None:
    known = ca.vertcat(flat.symbols, flat.derivative_symbols, flat.parameter_symbols, flat.time, flat.frictions.force)
    f = flat.frictions
    used = (flat.residual, flat.parameter_bindings, flat.initials.residual, f.speed, f.level_pos, f.level_neg)
    foreign = _foreign(ca.vertcat(*used), known)
    if foreign:
        users = _users(flat, ca.vertcat(*foreign))
        tables.findings += [foreign_sentence(f"`{s}`", of) for s, of in zip(foreign, users, strict=True)]
    tables.findings += varying_findings(flat)
    if tables.findings:
        raise ModelError(listed_findings(flat.name, tables.findings))


def _users(flat: FlatSystem, foreign: ca.SX) -> list[list[str]]:
    """Return where each foreign symbol is used: in equations, in what parameters are set to, in dry frictions."""
    f = flat.frictions
    frictions = ca.vertcat(f.speed, f.level_pos, f.level_neg)
    parts = ca.vertcat(flat.residual, flat.initials.residual, flat.parameter_bindings, frictions)
    settings = [f"what `{parameter.name}` is set to" for parameter in flat.parameters]
    places = [f"{place}: dry friction" for place in f.places] * 3
    return users_of(foreign, parts, [*flat.origins, *flat.initials.origins, *settings, *places])


def _foreign(expression: ca.SX, known: ca.SX) -> list[ca.SX]:
    hashes = {symbol.element_hash() for symbol in ca.vertsplit(known)}
    return [symbol for symbol in ca.symvar(expression) if symbol.element_hash() not in hashes]
