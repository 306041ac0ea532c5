"""What the author of a model writes: components, their quantities, ports and equations.

One rule: *annotated = set in the constructor; not annotated = computed by the model.*

    class Spring(Compliant):
        c: Param = param(unit="N.m/rad", min=0, doc="stiffness")

        def equations(self) -> Statements:
            yield from super().equations()
            yield self.tau == self.c * self.phi_rel

Between symbols ``==`` makes an equation. Nothing here knows how equations are solved.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar, dataclass_transform

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError
from cartpend_dae.quantities import (
    Declaration,
    Expression,
    Flow,
    P,
    Param,
    Port,
    PortField,
    Signal,
    Var,
    declared,
    state_of,
)

C = TypeVar("C", bound="Component")


def param(
    *,
    unit: str,
    default: float | None = None,
    min: float | None = None,
    max: float | None = None,
    nominal: float | None = None,
    doc: str = "",
) -> Param:
    """Declare a parameter; without `default` the constructor demands it.

    Parameters
    ----------
    unit
        SI unit such as ``"N.m/rad"``.
    default
        Value if the constructor does not name it [unit].
    min, max
        Physical bounds [unit]; checked when the model is assembled and used by the estimation.
    nominal
        Typical magnitude [unit], for scaling.
    doc
        A few words.
    """
    return Param(Declaration(unit, doc, min, max, None, default, nominal))


def var(
    *,
    unit: str,
    start: float | None = None,
    min: float | None = None,
    max: float | None = None,
    nominal: float | None = None,
    doc: str = "",
) -> Var:
    """Declare a variable; `start` [unit] is a guess of its initial value (`initial` fixes it)."""
    return Var(Declaration(unit, doc, min, max, start, None, nominal))


def flow(*, unit: str, nominal: float | None = None, doc: str = "") -> Flow:
    """Declare a flow of a port, positive into the component that owns the port."""
    return Flow(Declaration(unit, doc, nominal=nominal))


def signal(direction: Literal["in", "out"], *, unit: str, default: float | None = None, doc: str = "") -> Signal:
    """Declare a directed signal; an input that nothing drives is an input of the whole model.

    Parameters
    ----------
    direction
        ``"in"`` or ``"out"``.
    unit
        SI unit.
    default
        Value of an input that neither a connection nor the experiment drives [unit].
    doc
        A few words.
    """
    return Signal(direction, Declaration(unit, doc, default=default))


def port(kind: type[P], *, doc: str = "") -> PortField[P]:
    """Declare a port of the class `kind`."""
    return PortField(kind, doc)


@dataclass(frozen=True, slots=True)
class Connection:
    """Ports, or signals, that are joined."""

    ends: tuple[Port | ca.SX, ...]


@dataclass(frozen=True, slots=True)
class Initial:
    """An equation that holds at the start only; `fixed=False` makes it a guess."""

    equation: ca.SX
    fixed: bool


Statement = ca.SX | Connection | Initial


Statements = Iterator[Statement]


@dataclass(frozen=True, slots=True)
class DryFriction:
    """A set-valued force: `level_pos` or `-level_neg` while sliding, anything between while stuck."""

    force: ca.SX
    speed: ca.SX
    level_pos: ca.SX
    level_neg: ca.SX


@dataclass(slots=True)
class Collector:
    """What `der`, `time` and `dry_friction` note while equations are collected.

    `derivatives` maps the element hash of a symbol to (symbol, its derivative).
    """

    time: ca.SX
    derivatives: dict[int, tuple[ca.SX, ca.SX]] = field(default_factory=dict)
    frictions: list[DryFriction] = field(default_factory=list)


_collector: ContextVar[Collector] = ContextVar("collector")


@contextmanager
def collecting(collector: Collector) -> Iterator[Collector]:
    """Make `collector` the one that `der`, `time` and `dry_friction` write to."""
    token = _collector.set(collector)
    try:
        yield collector
    finally:
        _collector.reset(token)


def _current(what: str) -> Collector:
    try:
        return _collector.get()
    except LookupError:
        raise ModelError(f"`{what}` has a meaning inside `equations` only, while a model is assembled.") from None


def der(expression: ca.SX) -> ca.SX:
    """Return the derivative with respect to time [unit of the expression / s].

    Parameters
    ----------
    expression
        A scalar variable, a derivative (``der(der(x))``) or an expression of them, which is
        differentiated by the chain rule.

    Raises
    ------
    ModelError
        Outside of `equations`.
    """
    collector = _current("der")
    if not expression.is_symbolic():
        total = ca.SX(0)
        for symbol in ca.symvar(expression):
            if symbol.element_hash() == collector.time.element_hash():
                total += ca.gradient(expression, symbol)
            else:
                total += ca.gradient(expression, symbol) * der(symbol)
        return total
    key = expression.element_hash()
    if key not in collector.derivatives:
        collector.derivatives[key] = (expression, ca.SX.sym(f"der({expression.name()})"))
    return collector.derivatives[key][1]


def time() -> ca.SX:
    """Return the time since the start of the simulation [s]."""
    return _current("time").time


def dry_friction(speed: ca.SX, level: Expression, level_neg: Expression | None = None) -> ca.SX:
    """Return a dry friction force or torque, with exact sticking.

    It is `level` while `speed` > 0, `-level_neg` while `speed` < 0, and at `speed` = 0 whatever
    between the two keeps the speed at zero. Add it to the force that opposes `speed`:
    ``f == d * v_rel + dry_friction(v_rel, f_c)``. How sticking is computed is the choice of the
    simulation (events) or the estimation (time stepping), never of the component.

    Parameters
    ----------
    speed
        Relative speed [m/s or rad/s].
    level
        Force or torque while sliding forward [N or N.m], not negative.
    level_neg
        Its magnitude while sliding backward; equal to `level` if left out.
    """
    force = ca.SX.sym("dry_friction")
    other = level if level_neg is None else level_neg
    _current("dry_friction").frictions.append(DryFriction(force, ca.SX(speed), ca.SX(level), ca.SX(other)))
    return force


def connect(*ends: Port | ca.SX) -> Connection:
    """Join ports (potentials equal, flows sum to zero) or an output signal to inputs.

    Raises
    ------
    ModelError
        For fewer than two ends, for a port joined to a signal, or for ports of different classes.
    """
    if len(ends) < 2:
        raise ModelError("`connect` joins at least two ports or signals.")
    kinds = {type(end) for end in ends}
    if len(kinds) > 1:
        names = " and ".join(sorted(_end_name(end) for end in ends))
        raise ModelError(f"`connect` joins ports of one class: {names} do not fit together.")
    return Connection(ends)


def _end_name(end: Port | ca.SX) -> str:
    if isinstance(end, Port):
        return f"`{type(end.owner).__name__}.{end.name}` ({type(end).__name__})"
    return f"`{end}` (signal)"


def initial(equation: ca.SX, *, fixed: bool = True) -> Initial:
    """State an equation that holds at the start, such as ``initial(self.s == 0.1)``.

    Parameters
    ----------
    equation
        An equation between variables, derivatives and parameters.
    fixed
        False makes it a guess, used where nothing else determines the start.
    """
    return Initial(equation, fixed)


@dataclass_transform(kw_only_default=True, field_specifiers=(param,))
class Component:
    """Base of all models and their parts.

    A subclass declares quantities and ports, makes its parts in `__post_init__` and yields its
    equations from `equations`. Parts are the components found in its attributes, also in lists,
    tuples and dictionaries; their names are the names of the attributes.

    Raises
    ------
    TypeError
        If a parameter is missing, unknown, or not a number or an expression.
    """

    def __init__(self, **arguments: object) -> None:
        cls = type(self)
        fields = constructor_fields(cls)
        unknown = sorted(set(arguments) - set(fields))
        missing = sorted(name for name, has_default in fields.items() if not has_default and name not in arguments)
        if unknown or missing:
            raise TypeError(_argument_sentence(cls, unknown, missing, list(fields)))
        declared = parameters_of(cls)
        for name, value in arguments.items():
            if name in declared:
                _check_number(cls, name, value)
            setattr(self, name, value)
        for name, declaration in declared.items():
            if name not in arguments:
                setattr(self, name, declaration.declaration.default)
        self.__post_init__()

    def __post_init__(self) -> None:
        """Make the parts of the model; the parameters are set already."""

    def equations(self) -> Statements:
        """Yield equations, connections and initial equations."""
        yield from ()

    def is_zero(self, name: str) -> bool:
        """True if the parameter was set to the number 0, so that the part need not exist."""
        return ca.SX(bindings_of(self)[name]).is_zero()

    def attach(self, name: str, part: C, *connections: Connection) -> C:
        """Add a part from outside under `name`, joined by `connections`, and return it.

        Raises
        ------
        ModelError
            If a part of that name is attached already.
        """
        attached = state_of(self).attached
        if name in attached:
            raise ModelError(f"A part named `{name}` is attached already to this {type(self).__name__}.")
        attached[name] = (part, connections)
        return part


def _check_number(cls: type, name: str, value: object) -> None:
    if isinstance(value, ca.SX):
        if value.is_scalar():
            return
    elif (isinstance(value, float | int) and not isinstance(value, bool)) or isinstance(value, np.number):
        return
    raise TypeError(f"{cls.__name__}: `{name}` must be a number or an expression of parameters, not {value!r}.")


def _argument_sentence(cls: type, unknown: list[str], missing: list[str], known: list[str]) -> str:
    parts = []
    if unknown:
        parts.append("has no parameter " + ", ".join(f"`{name}`" for name in unknown))
    if missing:
        parts.append("needs a value for " + ", ".join(f"`{name}`" for name in missing))
    listing = ", ".join(f"`{name}`" for name in known) or "none"
    return f"{cls.__name__} {' and '.join(parts)}; its parameters are: {listing}."


def constructor_fields(cls: type) -> dict[str, bool]:
    """Return the names of the arguments of the constructor and whether each has a default."""
    fields: dict[str, bool] = {}
    for base in reversed(cls.__mro__):
        for name, annotation in vars(base).get("__annotations__", {}).items():
            if "ClassVar" in str(annotation) or not issubclass(base, Component):
                continue
            value = vars(base).get(name)
            fields[name] = value.declaration.default is not None if isinstance(value, Param) else name in vars(base)
    return fields


def parameters_of(cls: type) -> dict[str, Param]:
    """Return the declared parameters of a component class, those of its bases first."""
    return declared(cls, Param)


def variables_of(cls: type) -> dict[str, Var | Signal]:
    """Return the declared variables and signals of a component class, those of its bases first."""
    return declared(cls, Var) | declared(cls, Signal)


def ports_of(cls: type) -> dict[str, PortField[Any]]:
    """Return the declared ports of a component class, those of its bases first."""
    return declared(cls, PortField)


def parts_of(component: Component) -> dict[str, Component]:
    """Return the parts of a component by name, in the order of their making."""
    parts: dict[str, Component] = {}
    for name, value in vars(component).items():
        if isinstance(value, Component):
            parts[name] = value
        elif isinstance(value, list | tuple):
            parts.update({f"{name}[{i}]": item for i, item in enumerate(value) if isinstance(item, Component)})
        elif isinstance(value, dict):
            parts.update({f"{name}[{key}]": item for key, item in value.items() if isinstance(item, Component)})
    return parts | {name: part for name, (part, _) in state_of(component).attached.items()}


def symbols_of(instance: Component | Port) -> dict[str, ca.SX]:
    """Return the symbols of a component or port that were used so far, by name."""
    return state_of(instance).symbols


def used_ports_of(component: Component) -> dict[str, Port]:
    """Return all ports of a component by name."""
    return {name: getattr(component, name) for name in ports_of(type(component))}


def attached_to(component: Component) -> dict[str, tuple[Component, tuple[Connection, ...]]]:
    """Return the parts attached from outside, with the connections that join them."""
    return state_of(component).attached


def bindings_of(component: Component) -> dict[str, Expression]:
    """Return what each parameter of a component was set to."""
    return state_of(component).bindings
