"""What determines the start of each state: the caller, a fixed initial equation, a guess, or zero by default."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from cartpend_dae.assemble import assemble
from cartpend_dae.continuous import before_events
from cartpend_dae.dae import parameter_vector
from cartpend_dae.initialize import Found, find_start, unknown_parameters
from cartpend_dae.language import Component
from cartpend_dae.start_conditions import Rank, Request, Steady
from cartpend_dae.start_failure import unit_of
from cartpend_dae.system import System

ASSUMED = (Rank.GUESS, Rank.ZERO, Rank.UNKNOWN)
"""Conditions that nobody has asked for; each stands where a fixed one is missing."""


@dataclass(frozen=True, slots=True)
class StartValue:
    """The start of a state, or a parameter found [SI]: what gives it, and whether anything of that is assumed."""

    name: str
    value: float
    unit: str
    by: tuple[str, ...]
    is_assumed: bool

    def __str__(self) -> str:
        """Return value, unit and reason in a line."""
        return (
            f"`{self.name}` = {self.value:.6g}{self.unit and f' {self.unit}'}: {', '.join(self.by) or 'the equations'}"
        )


@dataclass(frozen=True, slots=True)
class StartReport:
    """What determines the start of a model; `assumed` are the conditions in the place of missing fixed ones."""

    name: str
    values: tuple[StartValue, ...]
    assumed: tuple[str, ...]

    def lines(self) -> tuple[str, ...]:
        """Return a line for each state and each parameter found, and one on what is missing."""
        n = len(self.assumed)
        if not n:
            return (*map(str, self.values), "the start is fully determined")
        missing = "1 fixed initial equation is" if n == 1 else f"{n} fixed initial equations are"
        listing = ", ".join([*self.assumed[:8], *([f"and {n - 8} more"] if n > 8 else [])])
        return (*map(str, self.values), f"{missing} missing for full determination; assumed instead: {listing}")

    def __str__(self) -> str:
        """Return the whole report."""
        return "\n".join([f"start of {self.name}:", *(f"  {line}" for line in self.lines())])


def describe_start(
    model: Component | System,
    *,
    start: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | None = None,
    unknown: Mapping[str, float] | None = None,
    steady: Steady = False,
    inputs: Mapping[str, float] | None = None,
    time: float = 0.0,
) -> StartReport:
    """Find the start of a model, and say what determines it and what is assumed.

    Parameters
    ----------
    model
        A component, or the system that `assemble` made of it.
    start, parameters, unknown, steady
        As in `simulate`.
    inputs
        Inputs at the start by name, SI units; by default those of the model, or 0.
    time
        Start time [s].

    Raises
    ------
    ModelError, SolverError
        As `simulate`, if a name is unknown or there is no start.
    """
    system = before_events(assemble(model))
    p = parameter_vector(system, dict(parameters or {}))
    defaults = [system.variables[system.index_of(name)].declaration.default or 0.0 for name in system.inputs]
    given = dict(zip(system.inputs, defaults, strict=True)) | dict(inputs or {})
    u = np.array([given[name] for name in system.inputs], dtype=float)
    found = unknown_parameters(system, parameters or {}, unknown or {})
    return report_of(system, find_start(system, Request(p, u, dict(start or {}), time, found, steady)))


def report_of(system: System, found: Found) -> StartReport:
    """Say what determines a start that was found.

    Parameters
    ----------
    system, found
        The assembled system and its start.
    """
    conditions, outcome = found.conditions, found.outcome
    n_x = len(system.states)
    places = [*range(n_x), *range(outcome.point.size - len(conditions.unknown), outcome.point.size)]
    names = [*system.states, *(system.parameters[i].name for i in conditions.unknown)]
    values = []
    for name, place, rows in zip(names, places, _givers(found, places), strict=True):
        is_assumed = any(conditions.ranks[k] in ASSUMED for k in rows)
        value = float(outcome.point[place])
        by = tuple(dict.fromkeys(_reason(found, name, k) for k in rows))
        values.append(StartValue(name, value, unit_of(system, name).strip(), by, is_assumed))
    assumed = [k for k in outcome.chosen.tolist() if conditions.ranks[k] in ASSUMED]
    return StartReport(system.name, tuple(values), tuple(_reason(found, "", k) for k in assumed))


def _givers(found: Found, places: list[int]) -> list[list[int]]:
    """Return for each unknown the conditions, besides the equations, on which its value depends."""
    chosen, ranks = found.outcome.chosen, found.conditions.ranks
    if not places:
        return []
    jacobian = found.outcome.jacobian[chosen]
    factors = splu(csc_array(jacobian.T))
    single = np.diff(jacobian.indptr) == 1
    alone = {int(jacobian.indices[jacobian.indptr[k]]): int(chosen[k]) for k in np.flatnonzero(single)}
    givers = []
    for place in places:
        if place in alone:
            givers.append([row for row in [alone[place]] if ranks[row] >= Rank.STEADY])
            continue
        unit = np.zeros(jacobian.shape[1])
        unit[place] = 1.0
        weights = np.abs(factors.solve(unit))
        by = chosen[weights > 1e-9 * weights.max(initial=1e-300)].tolist()
        givers.append([row for row in by if Rank.STEADY <= ranks[row] <= Rank.UNKNOWN])
    return givers


def _reason(found: Found, name: str, row: int) -> str:
    """Say what a condition is, for the state `name` or in general."""
    rank, label, about = found.conditions.ranks[row], found.conditions.names[row], found.conditions.about[row]
    if rank == Rank.ZERO:
        return "zero by default" if about == name else f"`{about}` zero by default"
    if rank == Rank.UNKNOWN:
        return "its guess" if about == name else f"the guess of `{about}`"
    kinds = {Rank.CALLER: " (caller)", Rank.FIXED: " (fixed)", Rank.GUESS: " (guess)"}
    return label + kinds.get(rank, "")
