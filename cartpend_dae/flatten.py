"""Component tree -> FlatSystem: dotted names, connection sets, balance.

Ports that nothing joins, those of the whole model too, pass no flow.
"""

from collections.abc import Iterator

import casadi as ca

from cartpend_dae.collector import Collector, collecting
from cartpend_dae.connections import connect_all, join
from cartpend_dae.errors import ModelError
from cartpend_dae.gathered import Gathered
from cartpend_dae.language import (
    Component,
    Connection,
    Initial,
    Statement,
    attached_to,
    bindings_of,
    parameters_of,
    parts_of,
    symbols_of,
    used_ports_of,
    variables_of,
)
from cartpend_dae.quantities import Flow, Signal, state_of
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
    _check_balance(tables, inputs, type(model).__name__)
    return _freeze(tables, collector, inputs, type(model).__name__)


def _walk(component: Component, path: str) -> Iterator[tuple[str, Component]]:
    yield path, component
    for name, part in parts_of(component).items():
        yield from _walk(part, f"{path}.{name}" if path else name)


def _declare(tables: Gathered, path: str, component: Component) -> None:
    if id(component) in tables.path_of:
        raise ModelError(
            f"The same {type(component).__name__} stands in the model twice, as `{tables.path_of[id(component)]}` "
            f"and as `{path}`; make two."
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
    built_as_zero, unknown = state_of(component).built_as_zero, state_of(component).unknown
    for name, declared in parameters_of(type(component)).items():
        dotted = f"{path}.{name}" if path else name
        bound = ca.SX(bindings_of(component)[name])
        if name in built_as_zero and not bound.is_zero():
            raise ModelError(
                f"`{dotted}` was 0 when `{path or type(component).__name__}` was made, so that the part it belongs "
                f"to does not exist; set it in the constructor."
            )
        value = float(ca.DM(bound)) if bound.is_constant() else None
        tables.parameters.append(Parameter(dotted, declared.declaration, value, name in built_as_zero, name in unknown))
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
    for count, statement in enumerate(_statements(component, where), start=1):
        origin = f"{where}: equation {count}"
        if isinstance(statement, Connection):
            join(tables, path, component, statement)
        elif isinstance(statement, Initial):
            tables.initials.append((f"{where}: initial equation {count}", statement))
        else:
            tables.residuals.append(_residual(statement, origin))
            tables.origins.append(origin)
            tables.own_equations[path] += 1
    for _, connections in attached_to(component).values():
        for connection in connections:
            join(tables, path, None, connection)
    tables.frictions += [(where, i) for i in range(n_frictions, len(collector.frictions))]


def _statements(component: Component, where: str) -> Iterator[Statement]:
    statements = component.equations()
    if statements is None:
        raise ModelError(
            f"`equations` of `{where}` ({type(component).__name__}) returns nothing: `yield` each equation."
        )
    yield from statements


def _residual(statement: object, origin: str) -> ca.SX:
    if isinstance(statement, bool) or (isinstance(statement, ca.SX) and statement.is_constant()):
        always = bool(statement) if isinstance(statement, bool) else bool(float(statement))
        what = "holds always and determines nothing" if always else "can never hold"
        raise ModelError(f"{origin} {what}: both its sides are the same kind of constant. Remove or correct it.")
    if not isinstance(statement, ca.SX) or not statement.is_scalar() or statement.op() != ca.OP_EQ:
        raise ModelError(f"{origin} is `{statement}`, which is not an equation: write `left == right`.")
    return statement.dep(0) - statement.dep(1)


def _check_balance(tables: Gathered, inputs: tuple[int, ...], name: str) -> None:
    n_unknowns = len(tables.variables) - len(inputs)
    findings = sorted(_local_findings(tables))
    if n_unknowns == len(tables.origins) and not findings:
        return
    counts = f"{name} has {len(tables.origins)} equations for {n_unknowns} unknowns"
    listing = "\n".join(f"  - {finding}" for finding in findings)
    if not findings:
        listing = "  - every component is balanced by itself: look at what is connected"
    raise ModelError(f"{counts}; look here:\n{listing}")


def _local_findings(tables: Gathered) -> Iterator[str]:
    """Compare each component's equations with own variables + output signals + flows of its ports."""
    inner = {key[:2] for members in tables.sets.sets() for key in members if key[2] == "outside"}  # type: ignore[index]
    for path, component in tables.components:
        expected = 0
        for name, declared in variables_of(type(component)).items():
            index = tables.index_of[symbols_of(component)[name].element_hash()]
            if isinstance(declared, Signal):
                expected += declared.direction == "out" and index not in tables.driven_inside
            else:
                expected += 1
        for port_name, port in used_ports_of(component).items():
            if (path, port_name) not in inner:
                expected += sum(isinstance(kind, Flow) for kind in type(port).quantities.values())
        given = tables.own_equations[path]
        if given != expected:
            difference = "too few" if given < expected else "too many"
            yield (
                f"`{path or type(component).__name__}` ({type(component).__name__}) gives {given} equations and needs "
                f"{expected} (own variables, output signals and port flows): {abs(given - expected)} {difference}"
                + ("; is `yield from super().equations()` missing?" if given < expected else "")
            )


def _freeze(tables: Gathered, collector: Collector, inputs: tuple[int, ...], name: str) -> FlatSystem:
    derivatives, symbols, zero = _derivatives(tables, collector)
    residual = ca.vertcat(*tables.residuals) if tables.residuals else ca.SX(0, 1)
    f = _frictions(tables, collector)
    initials = ca.vertcat(*[_residual(i.equation, o) for o, i in tables.initials]) if tables.initials else ca.SX(0, 1)
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
    _check_symbols(flat)
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
            raise ModelError(f"`der({symbol})` names a quantity of a component that is not part of the model.")
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


def _check_symbols(flat: FlatSystem) -> None:
    known = ca.vertcat(flat.symbols, flat.derivative_symbols, flat.parameter_symbols, flat.time, flat.frictions.force)
    f = flat.frictions
    used = (flat.residual, flat.parameter_bindings, flat.initials.residual, f.speed, f.level_pos, f.level_neg)
    foreign = _foreign(ca.vertcat(*used), known)
    if foreign:
        listing = ", ".join(f"`{symbol}`" for symbol in foreign)
        raise ModelError(
            f"{flat.name} uses {listing} of a component that is not part of the model: "
            f"store every part in an attribute in `__post_init__`."
        )


def _foreign(expression: ca.SX, known: ca.SX) -> list[ca.SX]:
    hashes = {symbol.element_hash() for symbol in ca.vertsplit(known)}
    return [symbol for symbol in ca.symvar(expression) if symbol.element_hash() not in hashes]
