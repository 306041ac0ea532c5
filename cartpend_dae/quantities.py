"""Declared quantities and ports as Python descriptors: on a class a declaration, on an instance a symbol."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, Never, Self, TypeGuard, TypeVar, get_args, overload
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError
from cartpend_dae.explain import nearest

if TYPE_CHECKING:
    from cartpend_dae.language import Component, Connection


Expression = ca.SX | float | int
StateSelect = Literal["never", "avoid", "default", "prefer", "always"]
STATE_SELECT: tuple[StateSelect, ...] = get_args(StateSelect)
# how the name of an input ends that stands for an output of an FMU
HIDDEN = " (of the FMU)"


P = TypeVar("P", bound="Port")


Q = TypeVar("Q")


@dataclass(frozen=True, slots=True)
class Declaration:
    """What a model says of one quantity: unit, bounds, start and a few words.

    `is_shortest_time`: of a parameter, no state of its component changes in less time than this. `load_of`: of a
    variable, the port at whose bearing it is the force that is carried.
    """

    unit: str
    doc: str = ""
    min: float | None = None
    max: float | None = None
    start: float | None = None
    default: float | None = None
    nominal: float | None = None
    state_select: StateSelect = "default"
    is_shortest_time: bool = False
    load_of: str = ""

    @property
    def wish(self) -> int:
        """How gladly it becomes a state, from -2 (never) over 0 (default) to 2 (always)."""
        return STATE_SELECT.index(self.state_select) - 2


@dataclass(frozen=True, slots=True)
class Unknown:
    """A parameter that the start of the simulation determines; `guess` is where its search begins."""

    guess: float


@dataclass(slots=True)
class InstanceState:
    """The symbols, ports and parameter bindings of one component or port.

    `built_as_zero` names the parameters that were 0 when `Component.is_zero` was asked, `unknown` those that the
    start determines: they are bound to their guess. `diverted` and `scaled` are the work of `splice`.
    """

    symbols: dict[str, ca.SX] = field(default_factory=dict)
    bindings: dict[str, Expression] = field(default_factory=dict)
    ports: dict[str, "Port"] = field(default_factory=dict)
    attached: dict[str, tuple["Component", tuple["Connection", ...]]] = field(default_factory=dict)
    built_as_zero: set[str] = field(default_factory=set)
    unknown: set[str] = field(default_factory=set)
    diverted: dict[str, "Port | ca.SX"] = field(default_factory=dict)
    scaled: dict[str, tuple[ca.SX, ...]] = field(default_factory=dict)


def is_number(value: object) -> TypeGuard[float]:
    """True for a real number of Python or numpy; a truth value, a text or an array is none."""
    return isinstance(value, float | int | np.integer | np.floating) and not isinstance(value, bool)


def state_of(instance: object) -> InstanceState:
    """Return the symbols, ports and bindings of a component or port, made at the first call."""
    table = instance.__dict__
    if "_state" not in table:
        table["_state"] = InstanceState()
    return table["_state"]


def symbol_of(instance: object, name: str) -> ca.SX:
    """Return the symbol of a quantity of one component or port, the same at every call.

    Its name tells the class of the component, `Mass.flange_a.s`: a symbol may outlive its owner, as a mistake.
    """
    symbols = state_of(instance).symbols
    if name not in symbols:
        owner = f"{type(instance.owner).__name__}.{instance.name}" if isinstance(instance, Port) else None
        symbols[name] = ca.SX.sym(f"{owner or type(instance).__name__}.{name}")
    return symbols[name]


def declared(cls: type, kind: type[Q]) -> dict[str, Q]:
    """Return the declarations of one kind, those of the bases first; looked up once for each class.

    It is a `WeakKeyDictionary` by class, so that classes that a study has loaded can be forgotten.
    """
    known = _DECLARED.setdefault(cls, {})
    if kind not in known:
        known[kind] = _look_up(cls, kind)
    return known[kind]


_DECLARED: "WeakKeyDictionary[type, dict[type, Any]]" = WeakKeyDictionary()


def _look_up(cls: type, kind: type[Q]) -> dict[str, Q]:
    found: dict[str, Q] = {}
    for base in reversed(cls.__mro__):
        found.update({name: value for name, value in vars(base).items() if isinstance(value, kind)})
    return found


class Quantity:
    """A declared quantity: read on the class it is its declaration, on an instance its symbol."""

    def __init__(self, declaration: Declaration) -> None:
        self.declaration = declaration
        self.name: str = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> ca.SX: ...
    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        return symbol_of(instance, self.name)


class Param(Quantity):
    """A parameter: constant in time, set in the constructor by a number or an expression of the parent's parameters.

    Where `splice.scale` let a variable multiply it, the equations of its component read the product.
    """

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> ca.SX: ...
    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        value = symbol_of(instance, self.name)
        for factor in state_of(instance).scaled.get(self.name, ()):
            value = value * factor
        return value

    def __set__(self, instance: object, value: Expression | Unknown) -> None:
        state = state_of(instance)
        if isinstance(value, Unknown):
            state.unknown.add(self.name)
            state.bindings[self.name] = value.guess
            return
        if not is_number(value) and not (isinstance(value, ca.SX) and value.is_scalar()):
            raise TypeError(
                f"{type(instance).__name__}: `{self.name}` must be a number or an expression of parameters, "
                f"not {value!r}."
            )
        state.unknown.discard(self.name)
        state.bindings[self.name] = value


class Computed(Quantity):
    """A quantity that the model computes; it cannot be assigned."""

    def __set__(self, instance: object, value: Never) -> None:
        raise AttributeError(
            f"`{self.name}` of {type(instance).__name__} is computed by the model and cannot be assigned: "
            f"write an equation, `yield self.{self.name} == ...`, or give a start value by `initial(...)`."
        )


class Var(Computed):
    """A variable computed by the model; in a port the potential (equal at a connection)."""


class Flow(Computed):
    """A port variable that sums to zero at a connection, positive into the component."""


class Discrete(Computed):
    """A variable that changes at events only, by `assign`."""


class Signal(Computed):
    """A directed quantity: an input, driven by one output or by the experiment, or an output."""

    def __init__(self, direction: Literal["in", "out"], declaration: Declaration) -> None:
        super().__init__(declaration)
        self.direction = direction


class PortField(Generic[P]):
    """The declaration of a port of class `kind`; on an instance the port itself."""

    def __init__(self, kind: type[P], doc: str) -> None:
        self.kind, self.doc = kind, doc
        self.name: str = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> P: ...
    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        ports = state_of(instance).ports
        if self.name not in ports:
            ports[self.name] = self.kind._make(instance, self.name)
        return ports[self.name]

    def __set__(self, instance: object, value: Never) -> None:
        raise AttributeError(f"Port `{self.name}` of {type(instance).__name__} cannot be assigned: use `connect`.")


class Port:
    """Base of all ports: potentials (`var`) are equal at a connection, flows (`flow`) sum to zero."""

    quantities: ClassVar[dict[str, Computed]] = {}
    owner: "Component"
    name: str

    def __init_subclass__(cls) -> None:
        """Collect the declared quantities of the class; a flow belongs to each potential, or joints have no balance."""
        cls.quantities = declared(cls, Computed)
        flows = [name for name, quantity in cls.quantities.items() if isinstance(quantity, Flow)]
        potentials = [name for name in cls.quantities if name not in flows]
        if len(flows) != len(potentials):
            raise ModelError(
                f"Port {cls.__name__} has {len(potentials)} `var` ({', '.join(potentials) or 'none'}) and "
                f"{len(flows)} `flow` ({', '.join(flows) or 'none'}): declare as many of one as of the other."
            )

    if not TYPE_CHECKING:  # else a checker would take every name for one that exists

        def __getattr__(self, name: str) -> Never:
            """Refuse a name that does not exist, with the nearest ones that do."""
            raise AttributeError(f"Port {type(self).__name__} has no `{name}`{nearest(name, list(self.quantities))}")

    @classmethod
    def _make(cls, owner: "Component", name: str) -> Self:
        made = cls()
        made.owner, made.name = owner, name
        return made
