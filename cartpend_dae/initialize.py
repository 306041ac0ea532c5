"""Consistent start values: which state starts where, from fixed values, guesses and equations."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.continuous import before_events
from cartpend_dae.errors import SolverError
from cartpend_dae.prepared import content, once
from cartpend_dae.start_conditions import Conditions, Request, Steady, conditions_of
from cartpend_dae.start_failure import failure_sentence
from cartpend_dae.start_search import ranked, search, with_friction
from cartpend_dae.start_solver import Outcome, newton
from cartpend_dae.system import System


@dataclass(frozen=True, slots=True)
class Start:
    """Start of a simulation: states (n_x,), algebraic variables (n_z,), parameters (n_p,), those `found` by name."""

    x: np.ndarray
    z: np.ndarray
    p: np.ndarray
    found: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Found:
    """A start, with the conditions of it and the outcome of the search, for a report."""

    start: Start
    conditions: Conditions
    outcome: Outcome


def initialize(
    system: System,
    p: np.ndarray,
    u: np.ndarray,
    start: Mapping[str, float],
    time: float = 0.0,
    *,
    unknown: Mapping[str, float] | None = None,
    steady: Steady = False,
) -> Start:
    """Find start values that satisfy, in this order: equations, rest, `start`, fixed initial equations, guesses, zero.

    A lower condition is used only where the higher ones leave freedom. With algebraic variables, nonlinear
    conditions, unknown parameters or dry friction forces the equations are solved by damped Newton steps, and where
    these fail by a path to the solution.

    Parameters
    ----------
    system
        The assembled system.
    p, u
        Parameters (n_p,) and inputs at the start (n_u,), SI units.
    start
        Start values by variable name, SI units; they overrule the model's own. Where a rest is asked for they say
        which rest is meant, and where it leaves freedom.
    time
        Start time [s].
    unknown
        Guesses of the parameters that the start determines, by name, SI units; by default those which the model
        sets to `unknown(...)`, with their values in `p`.
    steady
        True: all derivatives are zero at the start. Names: the derivatives of these variables are.

    Raises
    ------
    ModelError
        If a name is unknown.
    SolverError
        If two fixed start values contradict each other, there is no rest, or no solution was found.
    """
    if unknown is None:
        unknown = {q.name: float(p[i]) for i, q in enumerate(system.parameters) if q.is_unknown}
    request = Request(p, u, start, time, unknown, steady)
    rest = steady if isinstance(steady, bool) else tuple(steady)
    key = (content(p, u), tuple(start.items()), time, tuple(unknown.items()), rest)
    before = once(system, "before events", None, lambda: before_events(system))
    return once(system, "start", key, lambda: find_start(before, request).start)


def unknown_parameters(system: System, known: Collection[str], more: Mapping[str, float]) -> dict[str, float]:
    """Return the guesses of what the start determines: those parameters of the model that are not `known`, and more.

    Parameters
    ----------
    system
        The assembled system.
    known
        Names of parameters to which the caller gives values.
    more
        Guesses of further ones by name, which overrule the model's, SI units.
    """
    own = {q.name: q.value for q in system.parameters if q.is_unknown and q.value is not None and q.name not in known}
    return own | dict(more)


def find_start(system: System, request: Request) -> Found:
    """Find start values, and keep how they were found.

    Parameters
    ----------
    system, request
        The assembled system, and what the caller wants.

    Raises
    ------
    ModelError, SolverError
        As `initialize`.
    """
    conditions = conditions_of(system, request)
    n_x, n_z, n_f, _ = conditions.sizes
    tried: list[str] = []
    if n_f:
        outcome = with_friction(system, request, conditions, tried)
    else:
        free = ranked(conditions, request, np.zeros(len(system.frictions.places)))
        outcome = search(conditions, free, conditions.base, tried)
    if not outcome.is_solved:
        raise SolverError(failure_sentence(system, request, conditions, outcome, tried))
    p = np.array(request.p, dtype=float)
    p[list(conditions.unknown)] = outcome.point[n_x + n_z + n_f :]
    found = {system.parameters[i].name: float(p[i]) for i in conditions.unknown}
    _check_found(system, conditions, found)
    return Found(Start(outcome.point[:n_x], outcome.point[n_x : n_x + n_z], p, found), conditions, outcome)


def algebraics_along(system: System, start: Start, p: np.ndarray, u: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the algebraic variables of a model without states at all times, each search from the last solution.

    Parameters
    ----------
    system, start
        The assembled system, and its start at the first of the times.
    p, u, times
        Parameters (n_p,), inputs (n_u, n_times) and times (n_times,), SI units.

    Raises
    ------
    SolverError
        If at some time there is no solution.
    """
    z, request = np.zeros((start.z.size, times.size)), Request(p, np.zeros(len(system.inputs)), {})
    conditions, point = conditions_of(system, request), start.z
    for k, time in enumerate(times.tolist() if start.z.size else []):
        request = replace(request, u=u[:, k], time=time)
        outcome = newton(ranked(conditions, request, np.zeros(len(system.frictions.places))), point)
        point = outcome.point if outcome.is_solved else find_start(system, request).start.z
        z[:, k] = point
    return z


def _check_found(system: System, conditions: Conditions, found: Mapping[str, float]) -> None:
    guesses = conditions.base[conditions.base.size - len(found) :]
    for (name, value), guess in zip(found.items(), guesses, strict=True):
        d = system.parameters[system.parameter_index(name)].declaration
        low, high = -np.inf if d.min is None else d.min, np.inf if d.max is None else d.max
        if not low <= value <= high:
            raise SolverError(
                f"{system.name}: the start asks for `{name}` = {value:g} {d.unit}, outside its bounds "
                f"[{low:g}, {high:g}]. Check the conditions of the start, or try another guess than {guess:g} {d.unit}."
            )
