"""How the start of a run changes with parameters and start values, by the conditions that determine it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from cartpend_dae.begin import Begin
from cartpend_dae.continuous import before_events
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.events import Machine
from cartpend_dae.initialize import Found, Start, find_start
from cartpend_dae.prepared import once
from cartpend_dae.start_conditions import Rank, Request, Steady
from cartpend_dae.system import System


@dataclass(frozen=True, slots=True)
class StartSlopes:
    """Derivatives of states and memory (n_x + n_m, n_names) and of the parameters (n_p, n_names) at the start."""

    state: np.ndarray
    parameters: np.ndarray


@dataclass(frozen=True, slots=True)
class KeepingSearch:
    """A search for a start, as `initialize`, that keeps what was asked and found: the last one counts."""

    kept: list[tuple[Request, Found]] = field(default_factory=list)

    def __call__(
        self,
        system: System,
        p: np.ndarray,
        u: np.ndarray,
        start: Mapping[str, float],
        time: float,
        *,
        unknown: Mapping[str, float],
        steady: Steady,
    ) -> Start:
        """Find a start and keep it."""
        before = once(system, "before events", None, lambda: before_events(system))
        request = Request(p, u, start, time, unknown, steady)
        self.kept.append((request, find_start(before, request)))
        return self.kept[-1][1].start


def start_slopes(begin: Begin, search: KeepingSearch, names: Sequence[str], u: np.ndarray) -> StartSlopes:
    """Differentiate a start by the implicit function theorem: the conditions that were solved stay solved.

    Parameters
    ----------
    begin, search
        The start, and the search that found it.
    names
        Parameters, and variables to which the caller gave a start value.
    u
        Inputs of the system at the start (n_u,).

    Raises
    ------
    ModelError
        For a parameter that the start determines.
    SolverError
        If the conditions of the start leave it open.
    """
    request, found = search.kept[-1]
    n_x, n_z, n_f, _ = found.conditions.sizes
    parameters = np.zeros((request.p.size, len(names)))
    for k, name in enumerate(names):
        if name not in request.start:
            parameters[begin.system.parameter_index(name), k] = 1.0
    point = _point_slopes(begin, request, found, names, parameters)
    parameters[list(found.conditions.unknown)] = point[n_x + n_z + n_f :]
    x, z = point[:n_x], point[n_x : n_x + n_z]
    if begin.machine is None:
        return StartSlopes(x, parameters)
    start = found.start
    undecided = start.x, begin.undecided, start.z, u, start.p
    by_state, by_z, by_p = settle_slopes(begin.system, begin.machine, request.time, *undecided)
    state = np.vstack([x, np.zeros((begin.undecided.size, len(names)))])
    return StartSlopes(by_state @ state + by_z @ z + by_p @ parameters, parameters)


def _point_slopes(
    begin: Begin, request: Request, found: Found, names: Sequence[str], parameters: np.ndarray
) -> np.ndarray:
    """Return the derivatives of all that the start determines, shape (n, n_names)."""
    conditions, outcome = found.conditions, found.outcome
    for name in names:
        if name in found.start.found:
            raise ModelError(
                f"`{name}` is found by the start of {begin.system.name}, so that nothing is differentiated by it: give "
                f"it a value, or name what it follows from."
            )
    by_p = np.asarray(_in_parameters(begin, request, found)).reshape(conditions.ranks.size, -1)
    right = by_p @ np.delete(parameters, list(conditions.unknown), axis=0)
    for k, name in enumerate(names):
        if name in request.start:
            own = [
                about == name and rank == Rank.CALLER
                for about, rank in zip(conditions.about, conditions.ranks, strict=True)
            ]
            right[own, k] = -1.0
    if not outcome.point.size:
        return np.zeros((0, len(names)))
    try:
        return -np.linalg.solve(outcome.jacobian[outcome.chosen].toarray(), right[outcome.chosen])
    except np.linalg.LinAlgError:
        raise SolverError(
            f"{begin.system.name}: the conditions of the start are singular where it was found, so that it has no "
            f"derivatives: give start values of other variables."
        ) from None


def _in_parameters(begin: Begin, request: Request, found: Found) -> ca.DM:
    """Return the derivatives of the conditions in the parameters that are known."""
    function = found.conditions.function
    symbols = [ca.SX.sym(function.name_in(i), function.sparsity_in(i)) for i in range(function.n_in())]
    slopes = ca.Function("slopes", symbols, [ca.densify(ca.jacobian(function(*symbols)[0], symbols[2]))])
    known = np.delete(request.p, list(found.conditions.unknown))
    modes = np.zeros(0) if begin.machine is None else begin.machine.memory.split(begin.memory)["modes"]
    mode = np.resize(modes, symbols[4].numel()) if modes.size else np.zeros(symbols[4].numel())
    return ca.DM(slopes(found.outcome.point, request.u, known, request.time, mode))


def settle_slopes(
    system: System,
    made: Machine,
    time: float,
    x: np.ndarray,
    memory: np.ndarray,
    z: np.ndarray,
    u: np.ndarray,
    p: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the derivatives of what is decided at a point: of states and memory in these, in z and in p."""

    def make() -> ca.Function:
        symbols = [ca.MX.sym(made.settle.name_in(i), made.settle.sparsity_in(i)) for i in range(made.settle.n_in())]
        after = ca.vertcat(*made.settle(*symbols))
        blocks = [ca.jacobian(after, symbols[i]) for i in (1, 2, 3, 5)]
        return ca.Function("settle_slopes", symbols, blocks)

    function = once(system, "settle slopes", id(made), make)
    by_x, by_memory, by_z, by_p = (np.asarray(ca.DM(block)) for block in function(time, x, memory, z, u, p))
    return np.hstack([by_x, by_memory]), by_z, by_p
