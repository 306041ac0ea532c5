"""What is gathered on the walk through a component tree."""

from collections import Counter
from dataclasses import dataclass, field

import casadi as ca

from cartpend_dae.graph import DisjointSets
from cartpend_dae.language import Component, Initial
from cartpend_dae.quantities import Port
from cartpend_dae.system import Parameter, Variable


@dataclass(slots=True)
class Gathered:
    """What is gathered on the walk through the tree; symbols are found by their element hash."""

    components: list[tuple[str, Component]] = field(default_factory=list)
    path_of: dict[int, str] = field(default_factory=dict)
    variables: list[Variable] = field(default_factory=list)
    symbols: list[ca.SX] = field(default_factory=list)
    index_of: dict[int, int] = field(default_factory=dict)
    parameters: list[Parameter] = field(default_factory=list)
    parameter_symbols: list[ca.SX] = field(default_factory=list)
    bindings: list[ca.SX] = field(default_factory=list)
    residuals: list[ca.SX] = field(default_factory=list)
    origins: list[str] = field(default_factory=list)
    own_equations: Counter[str] = field(default_factory=Counter)
    frictions: list[tuple[str, int]] = field(default_factory=list)
    initials: list[tuple[str, Initial]] = field(default_factory=list)
    sets: DisjointSets = field(default_factory=DisjointSets)
    signal_sets: DisjointSets = field(default_factory=DisjointSets)
    ports: dict[tuple[str, str], Port] = field(default_factory=dict)
    driven_inside: set[int] = field(default_factory=set)
    n_connections: int = 0
    findings: list[str] = field(default_factory=list)
    causes: list[BaseException] = field(default_factory=list)
