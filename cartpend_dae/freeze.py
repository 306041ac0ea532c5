"""Gathered -> FlatSystem: what was collected becomes vectors of symbols and equations, all at once."""

from collections.abc import Iterable

import casadi as ca
import numpy as np

from cartpend_dae.collector import Collector
from cartpend_dae.connections import end_name
from cartpend_dae.errors import ModelError
from cartpend_dae.explain import listed_findings
from cartpend_dae.gathered import Gathered
from cartpend_dae.happenings import hybrid_of
from cartpend_dae.quantities import is_number
from cartpend_dae.statements import foreign_sentence, residual_of, users_of, varying_findings
from cartpend_dae.system import FlatSystem, Frictions, Group, Initials
from cartpend_dae.templates import Template

Pair = tuple[ca.SX, ca.SX]  # a symbol and its derivative
Known = dict[tuple[int, int], int]  # (variable, order) -> position among the derivatives


def freeze(
    tables: Gathered, collector: Collector, templates: list[Template], inputs: tuple[int, ...], name: str
) -> FlatSystem:
    """Return the flat system of what was gathered.

    Raises
    ------
    ModelError
        For a symbol, or a derivative, of a component that is not part of the model.
    """
    symbols = _vector("v", len(tables.variables), tables.variable_of.values())
    parameters = _vector("p", len(tables.parameters), tables.parameter_of.values())
    known, used, zero, unknown = _derivatives(tables, collector)
    groups = [*(_instances(template, known) for template in templates), *tables.groups]
    derivatives = _vector("d", len(known), used)
    residual = _residuals(groups, (symbols, derivatives, parameters, collector.time), len(tables.origins))
    f = _frictions(tables, collector)
    loose = _stack(tables.loose)
    initials = _stack([residual_of(i.equation, o) for o, i in tables.initials])
    hybrid = hybrid_of(tables, collector)
    parts = [loose, initials, *f.laws, *hybrid.laws]
    if zero:
        parts = ca.substitute(parts, [_stack(zero)], [ca.SX.zeros(len(zero))])
    loose, initials = parts[:2]
    residual[tables.loose_rows] = loose
    bindings = _bindings(tables)
    flat = FlatSystem(
        name=name,
        components=tuple((place.path, type(place.component).__name__) for place in tables.places),
        variables=tuple(tables.variables),
        symbols=symbols,
        derivatives=tuple(known),
        derivative_symbols=derivatives,
        parameters=tuple(tables.parameters),
        parameter_symbols=parameters,
        parameter_bindings=bindings,
        time=collector.time,
        inputs=inputs,
        frictions=f.with_laws(parts[2:7]),
        residual=residual,
        origins=tuple(tables.origins),
        groups=tuple(groups),
        hybrid=hybrid.with_laws(parts[7:]),
        initials=_initials(tables, initials, ca.vertcat(symbols, derivatives), list(known)),
        connections=tuple(tuple(end_name(tables, end) for end in members) for members in tables.sets.sets()),  # type: ignore[arg-type]
    )
    _check_symbols(tables, flat, used, unknown)
    return flat


def _initials(tables: Gathered, residual: ca.SX, symbols: ca.SX, derivatives: list[tuple[int, int]]) -> Initials:
    """Return the initial equations, each with the names of what it starts."""
    names = [variable.name for variable in tables.variables]
    names += ["der(" * order + names[i] + ")" * order for i, order in derivatives]
    started: list[list[str]] = [[] for _ in tables.initials]
    for row, column in zip(*ca.jacobian_sparsity(residual, symbols).get_triplet(), strict=True):
        started[row].append(f"`{names[column]}`")
    whose = (f" for {', '.join(those[:8])}" if those else "" for those in started)
    origins = (origin + more for (origin, _), more in zip(tables.initials, whose, strict=True))
    return Initials(residual, tuple(i.fixed for _, i in tables.initials), tuple(origins))


def _stack(items: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*items) if items else ca.SX(0, 1)


def _vector(name: str, n: int, used: Iterable[tuple[int, ca.SX]]) -> ca.SX:
    """Return n symbols, those in use at their places and new ones elsewhere."""
    vector = ca.SX.sym(name, n)
    places, symbols = [place for place, _ in used], [symbol for _, symbol in used]
    if places:
        vector[places] = ca.vertcat(*symbols)
    return vector


def _derivatives(
    tables: Gathered, collector: Collector
) -> tuple[Known, list[tuple[int, ca.SX]], list[ca.SX], list[Pair]]:
    """Return the derivatives that were written: positions and symbols, those of parameters (zero), and foreign ones."""
    foreign: list[Pair] = []
    known: Known = {}
    of: dict[int, tuple[int, int] | None] = dict.fromkeys(tables.parameter_of)
    used: list[tuple[int, ca.SX]] = []
    zero: list[ca.SX] = []
    for key, (symbol, derivative) in collector.derivatives.items():
        if key in tables.variable_of:
            found: tuple[int, int] | None = (tables.variable_of[key][0], 1)
        elif key in of:
            lower = of[key]
            found = None if lower is None else (lower[0], lower[1] + 1)
        else:
            foreign.append((symbol, derivative))
            continue
        of[derivative.element_hash()] = found
        if found is None:
            zero.append(derivative)
        else:
            used.append((known.setdefault(found, len(known)), derivative))
    return known, used, zero, foreign


def _instances(template: Template, known: Known) -> Group:
    """Return the equations of all components of a kind; their derivatives become known."""
    n = len(template.places)
    layout = template.places[0].layout
    variable = np.array([place.variable for place in template.places])
    parameter = np.array([place.parameter for place in template.places])
    derivatives = [
        [known.setdefault((place.variable + position, order), len(known)) for place in template.places]
        for position, order in template.derivatives
    ]
    return Group(
        function=template.function,
        equations=np.arange(template.n_equations)[:, None] + np.array(template.rows),
        variables=np.arange(len(layout.variables))[:, None] + variable,
        derivatives=np.array(derivatives, dtype=int).reshape(-1, n),
        parameters=np.arange(len(layout.parameters))[:, None] + parameter,
    )


def _residuals(groups: list[Group], vectors: tuple[ca.SX, ca.SX, ca.SX, ca.SX], n: int) -> ca.SX:
    """Return the residuals of all groups at their places; the others are left as zeros."""
    residual = ca.SX.zeros(n)
    symbols, derivatives, parameters, time = vectors
    for group in groups:
        n_instances = group.equations.shape[1]
        if group.equations.size:
            columns = group.function.map(n_instances)(
                pick(symbols, group.variables),
                pick(derivatives, group.derivatives),
                pick(parameters, group.parameters),
                ca.repmat(time, 1, n_instances),
            )
            residual[group.equations.ravel(order="F").tolist()] = ca.vec(columns)
    return residual


def pick(vector: ca.SX, indices: np.ndarray) -> ca.SX:
    """Return the elements of a vector at a matrix of indices."""
    return ca.reshape(vector[indices.ravel(order="F").tolist(), 0], *indices.shape)


def _bindings(tables: Gathered) -> ca.SX:
    """Return what parameters are set to as a column, numbers all at once."""
    bindings = ca.SX(ca.DM([float(b) if is_number(b) else 0.0 for b in tables.bindings]))
    places = [i for i, b in enumerate(tables.bindings) if not is_number(b)]
    if places:
        bindings[places] = ca.vertcat(*[tables.bindings[i] for i in places])
    return bindings


def _frictions(tables: Gathered, collector: Collector) -> Frictions:
    items = [(place, collector.frictions[i]) for place, i in tables.frictions]
    return Frictions(
        places=tuple(place for place, _ in items),
        force=_stack([friction.force for _, friction in items]),
        speed=_stack([friction.speed for _, friction in items]),
        level_pos=_stack([friction.level_pos for _, friction in items]),
        level_neg=_stack([friction.level_neg for _, friction in items]),
        static_pos=_stack([friction.static_pos for _, friction in items]),
        static_neg=_stack([friction.static_neg for _, friction in items]),
    )


def _check_symbols(tables: Gathered, flat: FlatSystem, used: list[tuple[int, ca.SX]], unknown: list[Pair]) -> None:
    """Refuse symbols of components outside the model, and parameters that are set to what changes in time."""
    known = {symbol.element_hash() for _, symbol in used} | {flat.time.element_hash()}
    f, events = flat.frictions, flat.hybrid
    known |= {symbol.element_hash() for symbol in ca.vertsplit(ca.vertcat(f.force, events.symbols))}
    frictions = ca.vertcat(*f.laws)
    loose = flat.residual[tables.loose_rows, 0]  # the equations of a template hold no foreign symbols
    parts = ca.vertcat(loose, flat.initials.residual, flat.parameter_bindings, frictions)
    origins = [flat.origins[i] for i in tables.loose_rows] + list(flat.initials.origins)
    origins += [f"what `{parameter.name}` is set to" for parameter in flat.parameters]
    origins += [f"{place}: dry friction" for place in f.places] * len(f.laws)
    parts = ca.vertcat(parts, *events.laws)
    origins += [f"{place}: a condition" for place in events.relation_places]
    origins += ["a condition"] * (parts.numel() - len(origins) - len(events.actions))
    origins += [f"{action.place}: an action at an event" for action in events.actions]
    found = [
        (f"`{symbol}`", symbol)
        for symbol in ca.symvar(parts)
        if (key := symbol.element_hash()) not in tables.variable_of
        and key not in tables.parameter_of
        and key not in known
    ]
    found = [(f"`der({symbol})`", derivative) for symbol, derivative in unknown] + [
        item for item in found if all(item[1].element_hash() != d.element_hash() for _, d in unknown)
    ]
    if found:
        users = users_of(ca.vertcat(*[symbol for _, symbol in found]), parts, origins)
        tables.findings += [
            foreign_sentence(what, [*dict.fromkeys(of)]) for (what, _), of in zip(found, users, strict=True)
        ]
    tables.findings += varying_findings(flat)
    if tables.findings:
        raise ModelError(listed_findings(flat.name, tables.findings))
