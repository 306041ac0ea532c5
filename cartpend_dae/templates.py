"""Equations of a component class, evaluated once and instantiated for all its components together.

A call from Python to CasADi takes longer than the arithmetic behind it. The equations of a leaf component
(no parts, no dry friction) depend on its symbols, on its structural arguments and on which parameters are
literally zero; components that agree in these share a CasADi function, mapped over all their symbols.
"""

from dataclasses import dataclass, field

import casadi as ca

from cartpend_dae.collector import Collector
from cartpend_dae.gathered import Place
from cartpend_dae.language import Component, attached_to, bindings_of, parts_of
from cartpend_dae.quantities import is_number, state_of

Key = tuple[object, ...]


@dataclass(slots=True)
class Template:
    """The residuals of one kind of component as a function of its variables, derivatives, parameters and time.

    `derivatives[k]` is the k-th derivative as (position of the variable, order). `places` are the components,
    `rows` the first equation of each.
    """

    function: ca.Function
    derivatives: tuple[tuple[int, int], ...]
    n_equations: int
    built_as_zero: frozenset[str]
    places: list[Place] = field(default_factory=list)
    rows: list[int] = field(default_factory=list)

    def enrol(self, place: Place, row: int) -> None:
        """Note a component whose equations stand from `row` on."""
        if self.built_as_zero:
            state_of(place.component).built_as_zero.update(self.built_as_zero)
        self.places.append(place)
        self.rows.append(row)


def template_key(component: Component) -> Key | None:
    """Return what the equations of a component depend on besides its symbols; None if that is not simple."""
    if attached_to(component) or parts_of(component):
        return None
    plain = tuple((name, value) for name, value in vars(component).items() if name != "_state")
    if not all(isinstance(value, bool | int | float | str | type(None)) for _, value in plain):
        return None
    found = state_of(component).unknown
    zeros = tuple(
        name
        for name, value in bindings_of(component).items()
        if (value == 0 if is_number(value) else ca.SX(value).is_zero()) and name not in found
    )
    return (type(component), plain, zeros)


def make_template(place: Place, residuals: list[ca.SX], collector: Collector) -> Template | None:
    """Make a template of a component whose equations were just collected; None if they use foreign symbols."""
    component, layout = place.component, place.layout
    variables = [getattr(component, name) for name in layout.position]
    for name, (kind, _) in layout.ports.items():
        port = getattr(component, name)
        variables += [getattr(port, quantity) for quantity in kind.quantities]
    parameters = [getattr(component, name) for name in layout.parameters]
    derivatives, keys, zero = _derivatives(variables, parameters, collector)
    block = ca.vertcat(*residuals) if residuals else ca.SX(0, 1)
    if zero:
        block = ca.substitute(block, ca.vertcat(*zero), ca.SX.zeros(len(zero)))
    own = [*variables, *parameters, *derivatives, collector.time]
    known = {symbol.element_hash() for symbol in own}
    if any(symbol.element_hash() not in known for symbol in ca.symvar(block)):
        return None
    arguments = [ca.vertcat(*part) if part else ca.SX(0, 1) for part in (variables, derivatives, parameters)]
    function = ca.Function("equations", [*arguments, collector.time], [block])
    return Template(function, tuple(keys), len(residuals), frozenset(state_of(component).built_as_zero))


def _derivatives(
    variables: list[ca.SX], parameters: list[ca.SX], collector: Collector
) -> tuple[list[ca.SX], list[tuple[int, int]], list[ca.SX]]:
    """Return the derivatives of variables with (position, order), and those of parameters, which are zero."""
    known: dict[int, tuple[int, int] | None] = {symbol.element_hash(): (k, 0) for k, symbol in enumerate(variables)}
    known |= {symbol.element_hash(): None for symbol in parameters}
    symbols: list[ca.SX] = []
    keys: list[tuple[int, int]] = []
    zero: list[ca.SX] = []
    for key, (_, derivative) in collector.derivatives.items():
        if key not in known:
            continue
        lower = known[key]
        known[derivative.element_hash()] = None if lower is None else (lower[0], lower[1] + 1)
        if lower is None:
            zero.append(derivative)
        else:
            symbols.append(derivative)
            keys.append((lower[0], lower[1] + 1))
    return symbols, keys, zero
