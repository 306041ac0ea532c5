"""A system -> where a run of it begins: a consistent start, with relations and modes of friction that fit it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.errors import SolverError
from cartpend_dae.events import Machine, initial_memory, machine
from cartpend_dae.initialize import Start
from cartpend_dae.prepared import content, once
from cartpend_dae.system import Hybrid, System


@dataclass(frozen=True, slots=True)
class Begin:
    """A system where it starts: states (n_x,), algebraic variables (n_z,), parameters and, with events, memory.

    `undecided` is the memory before anything was decided.
    """

    system: System
    machine: Machine | None
    x: np.ndarray
    z: np.ndarray
    p: np.ndarray
    found: Mapping[str, float]
    memory: np.ndarray
    undecided: np.ndarray

    @property
    def between(self) -> System:
        """The system between events."""
        return self.machine.system if self.machine is not None else self.system

    def inputs(self, u: np.ndarray, memory: np.ndarray | None = None) -> np.ndarray:
        """Return the inputs of the system between events, from its own inputs (n_u, n) or (n_u,) and the memory."""
        if self.machine is None:
            return u
        return np.concatenate([u, given_of(self.machine, self.memory if memory is None else memory)])


@dataclass(frozen=True, slots=True)
class Run:
    """States (n_x, n), algebraic variables (n_z, n) and, with events, memory (n_m, n) over a grid.

    `variables` are all variables where they are known already: distinct ones (n_v, n), and the row of each.
    """

    x: np.ndarray
    z: np.ndarray
    memory: np.ndarray | None
    variables: tuple[np.ndarray, np.ndarray] | None = None


def given_of(made: Machine, memory: np.ndarray) -> np.ndarray:
    """Return what the memory gives to the system between events: discrete variables, relations, and no pulses."""
    parts = made.memory.split(memory)
    pulses = np.zeros((made.memory.next.numel(), *memory.shape[1:]))
    return np.concatenate([parts["discretes"], np.round(parts["relations"]), pulses])


def started(system: System, p: np.ndarray, u: np.ndarray, initialize: Callable[..., Start], grid: np.ndarray) -> Begin:
    """Find a consistent start, with relations and modes that fit it.

    Parameters
    ----------
    system, p, u
        The system, its parameters (n_p,) and inputs at the start (n_u,).
    initialize
        The search for a start of a system without events, given system, p and u.
    grid
        All times of the run [s].

    Raises
    ------
    SolverError
        If there is none, or if relations at the start go round in circles.
    """
    if system.hybrid.is_empty and not system.frictions.places:
        start = initialize(system, p, u)
        return Begin(system, None, start.x, start.z, start.p, start.found, np.zeros(0), np.zeros(0))
    time, span = float(grid[0]), float(grid[-1] - grid[0])
    made, h = once(system, "machine", span, lambda: machine(system, span)), system.hybrid
    memory = initial_memory(made, system, time, u, p)
    s, parts = made.system, made.memory
    decide = once(system, "decide", span, lambda: _deciding(s, h))
    n_f, n_d, n_r = parts.modes.numel(), parts.discretes.numel(), parts.relations.numel()
    where = slice(n_f + n_d, n_f + n_d + n_r)
    for _ in range(20):
        given = np.concatenate([u, given_of(made, memory)])
        start = initialize(s, p, given)
        point = (start.x, start.z, given, start.p)
        decided = once(s, "decided", (time, content(*point)), lambda: decide(time, *point, np.zeros(n_f)))  # noqa: B023
        relations, speeds, held = (np.asarray(value, dtype=float).ravel() for value in decided)
        if np.array_equal(relations, memory[where]):
            break
        memory[where] = relations
    else:
        listing = ", ".join(sorted({f"`{place}`" for place in h.relation_places}))
        raise SolverError(
            f"{system.name}: no start fits the conditions of {listing}: each start that is tried makes others true."
        )
    memory[:n_f] = np.sign(np.where(np.abs(speeds) > 1e-9, speeds, 0.0))
    memory[where.stop : where.stop + held.size] = held
    point = (start.x, memory, start.z, u, start.p)
    found = once(system, "settled", (time, span, content(*point)), lambda: made.settle(time, *point))
    x, settled = (np.asarray(value).ravel() for value in found)
    return Begin(system, made, x, start.z, start.p, start.found, settled, memory)


def _deciding(s: System, h: Hybrid) -> ca.Function:
    """Return relations, friction speeds and conditions at a point, as a function."""
    names = [s.time, s.x, s.z, s.u, s.p, s.frictions.force]
    return ca.Function("decide", names, [h.differences < 0, s.frictions.speed, h.conditions])
