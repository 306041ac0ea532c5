"""A network as a matrix P(s), written from its laws, and as the state equations that `assemble` made of it."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
from library_bench import Bench

from cartpend_dae import connect
from cartpend_dae.system import System
from random_models.laws import KINDS, LINE, SHAFT, Form, Kind

POINTS = (0.31 + 0.77j, 1.1 - 0.43j, 0.6 + 1.9j)
"""Complex frequencies in general position, near the time scales of networks of parts of size one."""
DIFFERENTIATING = {
    f"{prefix}{name}" for prefix in ("", "rot_") for name in ("damper", "spring_damper", "speed_sensor")
} | {"mass", "long_mass", "inertia", "machine", "motor"}
"""Kinds with a speed among their variables."""


@dataclass(frozen=True)
class Element:
    """A part of a kind, between nodes (one a port), with the values of its parameters."""

    kind: str
    nodes: tuple[str, ...]
    values: tuple[float, ...]

    @property
    def facts(self) -> Kind:
        return KINDS[self.kind]


@dataclass(frozen=True)
class Network:
    """Elements by name ``e0, e1, ...``, joined where they name the same node."""

    elements: tuple[Element, ...]

    @cached_property
    def ends(self) -> list[tuple[str, str, str, str]]:
        """Return (node, port, its potential, its flow), the last three by dotted name, for all ports."""
        return [
            (node, f"e{k}.{port}", f"e{k}.{port}.{domain.potential}", f"e{k}.{port}.{domain.flow}")
            for k, element in enumerate(self.elements)
            for node, (port, domain) in zip(element.nodes, element.facts.ports, strict=True)
        ]

    @cached_property
    def nodes(self) -> list[str]:
        return sorted({node for node, *_ in self.ends})

    @cached_property
    def inputs(self) -> list[str]:
        return [f"e{k}.{e.facts.input}" for k, e in enumerate(self.elements) if e.facts.input]

    def model(self, *, in_chains: bool = False) -> Bench:
        """Return the model of the library; a node is one connection, or a chain of connections of two."""
        bench = Bench()
        for k, element in enumerate(self.elements):
            setattr(bench, f"e{k}", element.facts.make(element.values))
        for node in self.nodes:
            names = [port.split(".") for at, port, *_ in self.ends if at == node]
            ports = [getattr(getattr(bench, part), port) for part, port in names]
            groups = list(pairwise(ports)) if in_chains else [ports] * (len(ports) > 1)
            bench.joints += [connect(*group) for group in groups]
        return bench

    def matrix(self, s: complex) -> tuple[np.ndarray, np.ndarray]:
        """Return P(s), and the matrix of inputs and constants: P(s) (node potentials, flows) = Q (inputs, 1)."""
        n_nodes, n_ends = len(self.nodes), len(self.ends)
        n = n_nodes + n_ends
        unit = np.eye(n + len(self.inputs) + 1, dtype=type(s))
        potential = dict(zip(self.nodes, unit, strict=False))
        given = dict(zip(self.inputs, unit[n:], strict=False))
        rows: list[Form] = []
        first = n_nodes
        for k, element in enumerate(self.elements):
            facts = element.facts
            x = [potential[node] for node in element.nodes]
            f = [unit[first + i] for i in range(len(x))]
            u = given.get(f"e{k}.{facts.input}", unit[-1])
            rows += facts.laws(s, x, f, element.values, u, unit[-1])
            first += len(x)
        for node in self.nodes:
            rows.append(sum((unit[n_nodes + i] for i, end in enumerate(self.ends) if end[0] == node), 0 * unit[0]))
        table = np.array(rows)
        return table[:, :n], -table[:, n:]

    @cached_property
    def pencil(self) -> "Pencil":
        """Return P0, P1, P2 of P(s) = P0 + s P1 + s^2 P2, from three values of s, and Q."""
        (zero, right), (plus, _), (minus, _) = (self.matrix(s) for s in (0.0, 1.0, -1.0))
        moving = {
            node
            for e in self.elements
            if e.kind in DIFFERENTIATING
            for node, (_, domain) in zip(e.nodes, e.facts.ports, strict=True)
            if domain in (LINE, SHAFT)
        }
        rows = tuple(i for i, node in enumerate(self.nodes) if node in moving)
        return Pencil((zero, (plus - minus) / 2, (plus + minus) / 2 - zero), right, rows)


@dataclass(frozen=True)
class Pencil:
    """P(s) q = Q (u, 1) with P(s) = P0 + s P1 + s^2 P2; at `moving`, potentials that laws differentiate."""

    P: tuple[np.ndarray, np.ndarray, np.ndarray]
    Q: np.ndarray
    moving: tuple[int, ...]

    def at(self, s: complex) -> np.ndarray:
        return self.P[0] + s * self.P[1] + s**2 * self.P[2]

    @cached_property
    def is_singular(self) -> bool:
        """Whether P(s) is singular at two points in general position, and so everywhere."""
        singular = [np.linalg.svd(self.at(s), compute_uv=False) for s in POINTS[:2]]
        return all(values[-1] < 1e-11 * values[0] for values in singular)

    @cached_property
    def degree(self) -> int:
        """Return the degree of det P(s), the number of degrees of freedom of the motion; -1 if it is zero."""
        if self.is_singular:
            return -1
        low, high = (np.linalg.slogdet(self.at(s))[1] for s in (1e3, 1e4))
        return round((high - low) / np.log(10))

    @cached_property
    def needs_the_derivative_of_an_input(self) -> bool:
        """Whether something in the model grows with s: flows, potentials, or speeds where a law has them."""
        if self.is_singular:
            return False
        motions = [np.linalg.solve(self.at(s), self.Q[:, :-1]) for s in (1e3, 1e6)]
        low, high = (np.abs(np.vstack([q, s * q[list(self.moving)]])) for q, s in zip(motions, (1e3, 1e6), strict=True))
        # What is bounded differs by parts of a thousand, what grows by a thousand; below 1e-3 stands rounding.
        return bool(np.any((high > 30 * low) & (high > 1e-3)))

    @cached_property
    def hides_its_structure(self) -> bool:
        """Whether coefficients cancel, so that their places alone promise another kind of system.

        The twin has the same places and other coefficients. Nothing cancels in it: it is what a structural
        analysis sees.
        """
        generator = np.random.default_rng(1)
        scattered = [part * generator.uniform(0.5, 2.0, part.shape) for part in (*self.P, self.Q)]
        twin = Pencil((scattered[0], scattered[1], scattered[2]), scattered[3], self.moving)
        return (self.degree, self.needs_the_derivative_of_an_input) != (
            twin.degree,
            twin.needs_the_derivative_of_an_input,
        )


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B (u, 1), and all variables y = C x + D (u, 1), at the parameters' own values."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    names: tuple[str, ...]


def state_space(system: System) -> StateSpace:
    """Return the matrices of a linear system without algebraic variables."""
    assert system.algebraics == ()
    assert system.invariants.numel() == 0
    both = ca.vertcat(system.ode, system.outputs)
    given = ca.vertcat(system.x, system.u)
    function = ca.Function("both", [given, system.p, system.time], [ca.densify(ca.jacobian(both, given)), both])
    zero = np.zeros(given.numel())
    slopes, offset = (np.asarray(m) for m in function(zero, system.parameter_values, 0.0))
    n = system.x.numel()
    right = np.hstack([slopes[:, n:], offset.reshape(-1, 1)])
    return StateSpace(slopes[:n, :n], right[:n], slopes[n:, :n], right[n:], tuple(v.name for v in system.variables))
