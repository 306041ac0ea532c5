"""What the author of a model writes: components, their quantities, ports and equations.

One rule: *annotated = set in the constructor; not annotated = computed by the model.*

    class Spring(Compliant):
        c: Param = param(unit="N.m/rad", min=0, doc="stiffness")

        def equations(self) -> Statements:
            yield from super().equations()
            yield self.tau == self.c * self.phi_rel

Between symbols ``==`` makes an equation. Nothing here knows how equations are solved.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Never, TypeVar, dataclass_transform

import casadi as ca

from cartpend_dae.collector import DryFriction, collector_of
from cartpend_dae.declarations import discrete, flow, param, port, signal, var
from cartpend_dae.errors import CartpendError, ModelError
from cartpend_dae.explain import OF_PARTS, argument_sentence, failure_sentence, known_cause, nearest, position_sentence
from cartpend_dae.quantities import (
    Discrete,
    Expression,
    Param,
    Port,
    PortField,
    Quantity,
    Signal,
    Unknown,
    Var,
    declared,
    is_number,
    state_of,
)
from cartpend_dae.switching import Assign, When

__all__ = [
    "Component",
    "connect",
    "der",
    "discrete",
    "dry_friction",
    "flow",
    "initial",
    "param",
    "port",
    "signal",
    "time",
    "var",
]

C = TypeVar("C", bound="Component")


@dataclass(frozen=True, slots=True)
class Connection:
    """Ports, or signals, that are joined."""

    ends: tuple[Port | ca.SX, ...]


@dataclass(frozen=True, slots=True)
class Initial:
    """An equation that holds at the start only; `fixed=False` makes it a guess."""

    equation: ca.SX
    fixed: bool


Statement = ca.SX | Connection | Initial | When | Assign
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


def clock_rate(rate: Expression) -> None:
    """State how fast the time of the whole model passes in that of its simulation, dt/dt_s = rate, with t = 0 at 0.

    Inputs, records and sampling periods are in the time of the simulation: that of a recorder, whose clock may run
    wrong. `time` and `der` in the equations are in that of the model. Rates of several components multiply.

    Parameters
    ----------
    rate
        Positive number or expression of parameters [1].

    Raises
    ------
    ModelError
        Outside of `equations`, and, when the model is assembled, for a rate that changes in time.
    """
    collector_of("clock_rate").rates.append(ca.SX(rate))


def dry_friction(
    speed: ca.SX,
    level: Expression,
    level_neg: Expression | None = None,
    *,
    static: Expression | None = None,
    static_neg: Expression | None = None,
    mode: ca.SX | None = None,
) -> ca.SX:
    """Return a dry friction force or torque, with exact sticking.

    It is `level` while `speed` > 0, `-level_neg` while `speed` < 0, and at `speed` = 0 whatever between
    `-static_neg` and `static` keeps the speed at zero. Where the levels are zero or negative the parts are free of
    each other. Add it to the force that opposes `speed`: ``f == d * v_rel + dry_friction(v_rel, f_c)``. How sticking
    is computed is the choice of the simulation (events) or the estimation (time stepping), never of the component.

    Parameters
    ----------
    speed
        Relative speed [m/s or rad/s].
    level
        Force or torque while sliding forward [N or N.m], not negative; it may depend on the speed.
    level_neg
        Its magnitude while sliding backward; equal to `level` if left out.
    static, static_neg
        Largest force while stuck, forward and backward; the levels of sliding if left out.
    mode
        A discrete variable that shows -1 (backward), 0 (stuck), 1 (forward) or 2 (free).
    """
    force = ca.SX.sym("dry_friction")
    pos = ca.SX(level)
    neg = pos if level_neg is None else ca.SX(level_neg)
    static_pos = pos if static is None else ca.SX(static)
    static_back = static_pos if static is not None and level_neg is None else neg
    if static_neg is not None:
        static_back = ca.SX(static_neg)
    collector_of("dry_friction").frictions.append(
        DryFriction(force, ca.SX(speed), pos, neg, static_pos, static_back, mode)
    )
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
                f"write `connect(part.port, other.port)`, with parts that were made."
            )
    if len(ends) < 2:
        raise ModelError("`connect` joins at least two ports or signals: name the other end as well.")
    for i, end in enumerate(ends):
        if any(_is_same(end, other) for other in ends[:i]):
            raise ModelError(f"`connect` joins {_end_name(end)} to itself: name two ports or signals.")
    kinds = {type(end) for end in ends}
    if len(kinds) > 1:
        names = " and ".join(sorted(_end_name(end) for end in ends))
        cure = (
            "put a part between them that has a port of each class"
            if ca.SX not in kinds
            else "join ports to ports and signals to signals"
        )
        raise ModelError(f"`connect` joins ports of one class: {names} do not fit together; {cure}.")
    return Connection(ends)


def _is_same(end: Port | ca.SX, other: Port | ca.SX) -> bool:
    if isinstance(end, ca.SX) and isinstance(other, ca.SX):
        return end.is_scalar() and other.is_scalar() and end.element_hash() == other.element_hash()
    return end is other


def _end_name(end: object) -> str:
    if isinstance(end, PortField | Quantity):
        return f"the declaration of `{end.name}` in a class"
    if isinstance(end, Port):
        domain = type(end).__module__.rpartition(".")[2]
        return f"`{type(end.owner).__name__}.{end.name}` ({domain}.{type(end).__name__})"
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


def unknown(guess: float) -> Unknown:
    """Let the start of a simulation determine a parameter, as in ``Spring(c=unknown(10.0))``.

    The parameter takes the value with which one more condition of the start holds, an ``initial(...)``, a start value
    of the caller or a steady state, and keeps it along the run. Where nothing needs it, it keeps its guess.

    Parameters
    ----------
    guess
        Where the search begins [unit of the parameter].

    Raises
    ------
    ModelError
        If the guess is no finite number.
    """
    if not is_number(guess) or not math.isfinite(guess):
        raise ModelError(f"`unknown` takes a finite number, the guess of the parameter, not {guess!r}.")
    return Unknown(float(guess))


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

    def __init__(self, *values: object, **arguments: object) -> None:
        cls = type(self)
        fields = constructor_fields(cls)
        if values:
            raise TypeError(position_sentence(cls.__name__, values, list(fields)))
        unknown = sorted(set(arguments) - set(fields))
        missing = sorted(name for name, has_default in fields.items() if not has_default and name not in arguments)
        if unknown or missing:
            raise TypeError(argument_sentence(cls.__name__, unknown, missing, list(fields)))
        declared = parameters_of(cls)
        for name, value in arguments.items():
            setattr(self, name, value)
        for name, declaration in declared.items():
            if name not in arguments:
                setattr(self, name, declaration.declaration.default)
        try:
            self.__post_init__()
        except (RuntimeError, TypeError, NotImplementedError) as error:
            if isinstance(error, CartpendError) or known_cause(error) is None:
                raise
            raise ModelError(failure_sentence(f"`__post_init__` of {cls.__name__}", error, OF_PARTS)) from error

    def __post_init__(self) -> None:
        """Make the parts of the model; the parameters are set already."""

    def equations(self) -> Statements:
        """Yield equations, connections and initial equations."""
        yield from ()

    if not TYPE_CHECKING:  # else a checker would take every name for one that exists

        def __getattr__(self, name: str) -> Never:
            """Refuse a name that does not exist, with the nearest ones that do."""
            raise AttributeError(f"{type(self).__name__} has no `{name}`{nearest(name, _names_of(self))}")

    def is_zero(self, name: str) -> bool:
        """True if the parameter was set to the number 0, so that the part need not exist.

        A model built without the part refuses other values of the parameter afterwards.
        """
        is_zero = ca.SX(bindings_of(self)[name]).is_zero() and name not in state_of(self).unknown
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


def _names_of(component: Component) -> list[str]:
    cls = type(component)
    return [*parts_of(component), *ports_of(cls), *variables_of(cls), *parameters_of(cls)]


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


def variables_of(cls: type) -> dict[str, Var | Signal | Discrete]:
    """Return the declared variables, signals and discrete variables of a component class, those of its bases first."""
    return declared(cls, Var) | declared(cls, Signal) | declared(cls, Discrete)


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
