"""Equations of a component class, evaluated once and instantiated for all its components together.

A call from Python to CasADi takes longer than the arithmetic behind it. The equations of a leaf component
(no parts, no dry friction) depend on its symbols, on its structural arguments and on which parameters are
literally zero; components that agree in these share a CasADi function, mapped over all their symbols.
"""

from dataclasses import dataclass, field

import casadi as ca

from cartpend_dae.collector import Collector
from cartpend_dae.language import (
    Component,
    attached_to,
    bindings_of,
    parameters_of,
    parts_of,
    used_ports_of,
    variables_of,
)
from cartpend_dae.quantities import state_of

Key = tuple[object, ...]


@dataclass(slots=True)
class Template:
    """The residuals of one kind of component as a function of its symbols, derivatives and time.

    `bases[k]` says what the k-th derivative is of: a symbol (n), or an earlier derivative (-1 - n).
    """

    function: ca.Function
    bases: tuple[int, ...]
    n_equations: int
    built_as_zero: frozenset[str]
    symbols: list[list[ca.SX]] = field(default_factory=list)
    derivatives: list[list[ca.SX]] = field(default_factory=list)
    positions: list[int] = field(default_factory=list)


def template_key(component: Component) -> Key | None:
    """Return what the equations of a component depend on besides its symbols; None if that is not simple."""
    if attached_to(component) or parts_of(component):
        return None
    plain = tuple((name, value) for name, value in vars(component).items() if name != "_state")
    if not all(isinstance(value, bool | int | float | str | type(None)) for _, value in plain):
        return None
    found = state_of(component).unknown
    zeros = tuple(
        name for name, value in bindings_of(component).items() if ca.SX(value).is_zero() and name not in found
    )
    return (type(component), plain, zeros)


def own_symbols(component: Component) -> list[ca.SX]:
    """Return the symbols of variables, ports and parameters, in the order of their declaration."""
    cls = type(component)
    symbols = [getattr(component, name) for name in (*variables_of(cls), *parameters_of(cls))]
    for port in used_ports_of(component).values():
        symbols += [getattr(port, name) for name in type(port).quantities]
    return symbols


def make_template(component: Component, residuals: list[ca.SX], collector: Collector) -> Template | None:
    """Make a template of a component whose equations were just collected; None if they use foreign symbols."""
    own = own_symbols(component)
    place = {symbol.element_hash(): k for k, symbol in enumerate(own)}
    derivatives: list[ca.SX] = []
    bases: list[int] = []
    for key, (_, derivative) in collector.derivatives.items():
        if key in place:
            bases.append(place[key])
            place[derivative.element_hash()] = -1 - len(derivatives)
            derivatives.append(derivative)
    block = ca.vertcat(*residuals) if residuals else ca.SX(0, 1)
    known = {*place, collector.time.element_hash()}
    if any(symbol.element_hash() not in known for symbol in ca.symvar(block)):
        return None
    arguments = [ca.vertcat(*own), ca.vertcat(*derivatives) if derivatives else ca.SX(0, 1), collector.time]
    function = ca.Function("equations", arguments, [block])
    return Template(function, tuple(bases), len(residuals), frozenset(state_of(component).built_as_zero))


def enrol(template: Template, component: Component, collector: Collector, position: int) -> None:
    """Note a component whose equations will stand at `position` among the residuals."""
    own = own_symbols(component)
    derivatives: list[ca.SX] = []
    for base in template.bases:
        symbol = own[base] if base >= 0 else derivatives[-1 - base]
        key = symbol.element_hash()
        if key not in collector.derivatives:
            collector.derivatives[key] = (symbol, ca.SX.sym(f"der({symbol.name()})"))
        derivatives.append(collector.derivatives[key][1])
    state_of(component).built_as_zero.update(template.built_as_zero)
    template.symbols.append(own)
    template.derivatives.append(derivatives)
    template.positions.append(position)


def instantiate(template: Template, time: ca.SX) -> list[ca.SX]:
    """Return the residuals of all enrolled components, a column each."""
    n = len(template.positions)
    if not n:
        return []
    symbols = ca.reshape(ca.vertcat(*[s for own in template.symbols for s in own]), -1, n)
    flat = [d for own in template.derivatives for d in own]
    derivatives = ca.reshape(ca.vertcat(*flat), -1, n) if flat else ca.SX(0, n)
    residuals = template.function.map(n)(symbols, derivatives, ca.repmat(time, 1, n))
    return ca.horzsplit(residuals)
