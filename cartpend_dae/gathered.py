"""What is gathered on the walk through a component tree, and the layout of the quantities of a class."""

from dataclasses import dataclass, field
from typing import NamedTuple

import casadi as ca

from cartpend_dae.graph import DisjointSets
from cartpend_dae.language import Component, Connection, Initial, parameters_of, ports_of, variables_of
from cartpend_dae.quantities import Declaration, Discrete, Expression, Flow, Port, Signal
from cartpend_dae.switching import Assign, When
from cartpend_dae.system import Group, Kind, Parameter, Variable


@dataclass(frozen=True, slots=True)
class Layout:
    """The quantities of a component class in order: own variables and signals, then those of the ports.

    `position` finds an own variable, `ports` the class of a port and the position of its first quantity.
    """

    variables: tuple[tuple[str, Kind, Declaration], ...]
    position: dict[str, int]
    ports: dict[str, tuple[type[Port], int]]
    parameters: dict[str, tuple[int, Declaration]]
    outputs: frozenset[str]
    n_flows: int

    @property
    def n_equations(self) -> int:
        """Number of equations that make the class balanced: own variables, output signals and port flows."""
        n_known = sum(kind in ("input", "discrete") for _, kind, _ in self.variables)
        return len(self.position) - n_known + self.n_flows


def layout_of(cls: type) -> Layout:
    """Return the layout of a component class."""
    variables: list[tuple[str, Kind, Declaration]] = []
    position: dict[str, int] = {}
    for name, declared in variables_of(cls).items():
        position[name] = len(variables)
        kind: Kind = "variable"
        if isinstance(declared, Discrete):
            kind = "discrete"
        elif isinstance(declared, Signal):
            kind = "input" if declared.direction == "in" else "output"
        variables.append((name, kind, declared.declaration))
    ports: dict[str, tuple[type[Port], int]] = {}
    for port_name, port in ports_of(cls).items():
        ports[port_name] = (port.kind, len(variables))
        for name, quantity in port.kind.quantities.items():
            kind = "flow" if isinstance(quantity, Flow) else "potential"
            variables.append((f"{port_name}.{name}", kind, quantity.declaration))
    return Layout(
        variables=tuple(variables),
        position=position,
        ports=ports,
        parameters={name: (k, p.declaration) for k, (name, p) in enumerate(parameters_of(cls).items())},
        outputs=frozenset(name for name, kind, _ in variables if kind == "output"),
        n_flows=sum(kind == "flow" for _, kind, _ in variables),
    )


@dataclass(slots=True)
class Place:
    """A component at its place in the tree; `variable` and `parameter` are the first of its own among all."""

    path: str
    component: Component
    layout: Layout
    variable: int
    parameter: int
    n_equations: int = 0

    @property
    def name(self) -> str:
        """The dotted name, for the whole model its class."""
        return self.path or type(self.component).__name__

    @property
    def type_name(self) -> str:
        """The name of the class."""
        return type(self.component).__name__

    def port_quantity(self, port: str, quantity: str) -> int:
        """Return the index of a quantity of a port among all variables."""
        kind, first = self.layout.ports[port]
        return self.variable + first + list(kind.quantities).index(quantity)


class End(NamedTuple):
    """A port in a connection, seen from its inside or its outside."""

    place: int
    port: str
    side: str


@dataclass(slots=True)
class Gathered:
    """What is gathered on the walk through the tree; symbols are found by their element hash."""

    places: list[Place] = field(default_factory=list)
    place_of: dict[int, int] = field(default_factory=dict)
    variables: list[Variable] = field(default_factory=list)
    n_parameters: int = 0
    parameters: list[Parameter] = field(default_factory=list)
    bindings: list[Expression] = field(default_factory=list)
    variable_of: dict[int, tuple[int, ca.SX]] = field(default_factory=dict)
    parameter_of: dict[int, tuple[int, ca.SX]] = field(default_factory=dict)
    origins: list[str] = field(default_factory=list)
    loose: list[ca.SX] = field(default_factory=list)
    loose_rows: list[int] = field(default_factory=list)
    groups: list[Group] = field(default_factory=list)
    frictions: list[tuple[str, int]] = field(default_factory=list)
    initials: list[tuple[str, Initial]] = field(default_factory=list)
    whens: list[tuple[str, When | Assign]] = field(default_factory=list)
    relation_places: list[str] = field(default_factory=list)
    equality_places: list[str] = field(default_factory=list)
    connections: list[tuple[int, Component | None, Connection]] = field(default_factory=list)
    sets: DisjointSets = field(default_factory=DisjointSets)
    signal_sets: DisjointSets = field(default_factory=DisjointSets)
    driven_inside: set[int] = field(default_factory=set)
    inner_ports: set[End] = field(default_factory=set)
    diverted: dict[object, object] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    causes: list[BaseException] = field(default_factory=list)
