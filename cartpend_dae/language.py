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
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, dataclass_transform

import casadi as ca

from cartpend_dae.collector import DryFriction, collector_of
from cartpend_dae.errors import ModelError
from cartpend_dae.quantities import (
    STATE_SELECT,
    Declaration,
    Expression,
    Flow,
    P,
    Param,
    Port,
    PortField,
    Signal,
    StateSelect,
    Var,
    declared,
    is_number,
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
    state_select: StateSelect = "default",
    doc: str = "",
) -> Var:
    """Declare a variable.

    Parameters
    ----------
    unit
        SI unit such as ``"rad"``.
    start
        Guess of the initial value [unit]; `initial` fixes it.
    min, max, nominal
        Bounds and typical magnitude [unit].
    state_select
        Whether it shall be a state where constraints leave a choice, as in Modelica: ``"prefer"`` and ``"avoid"`` are
        wishes among variables whose derivative the model names; ``"always"`` and ``"never"`` are demands.
    doc
        A few words.

    Raises
    ------
    ValueError
        For another word as `state_select`.
    """
    if state_select not in STATE_SELECT:
        choices = ", ".join(f"`{choice}`" for choice in STATE_SELECT)
        raise ValueError(f"`state_select` of a variable is one of {choices}, not {state_select!r}.")
    return Var(Declaration(unit, doc, min, max, start, None, nominal, state_select))


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


def der(expression: Expression) -> ca.SX:
    """Return the derivative with respect to time [unit of the expression / s].

    Parameters
    ----------
    expression
        A scalar variable, a derivative (``der(der(x))``) or an expression of them, which is
        differentiated by the chain rule; the derivative of a number is 0.

    Raises
    ------
    ModelError
        Outside of `equations`, and for what is no scalar expression.
    """
    collector = collector_of("der")
    if is_number(expression):
        return ca.SX(0)
    if not isinstance(expression, ca.SX) or not expression.is_scalar():
        raise ModelError(f"`der` takes a variable or a scalar expression of variables, not {expression!r}.")
    if not expression.is_symbolic():
        return sum((ca.gradient(expression, symbol) * der(symbol) for symbol in ca.symvar(expression)), ca.SX(0))
    key = expression.element_hash()
    if key == collector.time.element_hash():
        return ca.SX(1)
    if key not in collector.derivatives:
        collector.derivatives[key] = (expression, ca.SX.sym(f"der({expression.name()})"))
    return collector.derivatives[key][1]


def time() -> ca.SX:
    """Return the time since the start of the simulation [s]."""
    return collector_of("time").time


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
    collector_of("dry_friction").frictions.append(DryFriction(force, ca.SX(speed), ca.SX(level), ca.SX(other)))
    return force


def connect(*ends: Port | ca.SX) -> Connection:
    """Join ports (potentials equal, flows sum to zero) or an output signal to inputs.

    Raises
    ------
    ModelError
        For fewer than two ends, for what is neither a port nor a signal, for a port joined to a signal, or for
        ports of different classes.
    """
    for end in ends:
        if not isinstance(end, Port | ca.SX):
            raise ModelError(
                f"`connect` names {_end_name(end)}, which is neither a port nor a signal: "
                f"write `connect(part.port, other.port)`."
            )
    if len(ends) < 2:
        raise ModelError("`connect` joins at least two ports or signals.")
    kinds = {type(end) for end in ends}
    if len(kinds) > 1:
        names = " and ".join(sorted(_end_name(end) for end in ends))
        raise ModelError(f"`connect` joins ports of one class: {names} do not fit together.")
    return Connection(ends)


def _end_name(end: object) -> str:
    if isinstance(end, Port):
        return f"`{type(end.owner).__name__}.{end.name}` ({type(end).__name__})"
    if isinstance(end, Component):
        return f"a component {type(end).__name__}"
    return f"`{end}` (signal)" if isinstance(end, ca.SX) else repr(end)


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
    tuples and dictionaries (``grid[0][1]``); their names are the names of the attributes.

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
        """True if the parameter was set to the number 0, so that the part need not exist.

        A model built without the part refuses other values of the parameter afterwards.
        """
        is_zero = ca.SX(bindings_of(self)[name]).is_zero()
        noted = state_of(self).built_as_zero
        noted.add(name) if is_zero else noted.discard(name)
        return is_zero

    def attach(self, name: str, part: C, *connections: Connection) -> C:
        """Add a part from outside under `name`, joined by `connections`, and return it.

        Raises
        ------
        ModelError
            If there is a part of that name, made by the model or attached before.
        """
        if name in parts_of(self):
            raise ModelError(f"This {type(self).__name__} has a part `{name}` already; attach it under another name.")
        state_of(self).attached[name] = (part, connections)
        return part


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
    made = {name: part for key, value in vars(component).items() for name, part in _parts_in(key, value)}
    return made | {name: part for name, (part, _) in attached_to(component).items()}


def _parts_in(name: str, value: object) -> Iterator[tuple[str, Component]]:
    """Yield the components of an attribute; lists, tuples and dictionaries may stand in each other."""
    if isinstance(value, Component):
        yield name, value
    elif isinstance(value, list | tuple | dict):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _parts_in(f"{name}[{key}]", item)


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
