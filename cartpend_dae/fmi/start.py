"""The start of an FMU: the equations that the package solved at export, square, for the C to solve again."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.continuous import before_events
from cartpend_dae.dae import parameter_vector
from cartpend_dae.errors import SolverError
from cartpend_dae.events import initial_memory, settled_modes
from cartpend_dae.fmi.equations import Equations
from cartpend_dae.initialize import find_start, unknown_parameters
from cartpend_dae.memory import N_NOTE
from cartpend_dae.start_conditions import Conditions, Rank, Request


@dataclass(frozen=True, slots=True)
class StartProblem:
    """A start at the parameters of the model, and how to find that at others.

    `functions`: ``start(t, v, u, m, p, s, given) -> r, dr/dv`` in the point v (states, algebraic variables, friction
    forces where a condition holds one, unknown parameters); a state with `given` = 1 starts at s instead of what the
    model says. ``decide -> relations, speeds, conditions``; ``begin(t, p) -> m``, the memory before any decision.
    `settable[i]`: whether state i can be given; `is_free[i]`: whether nothing but its start value decides it.
    """

    functions: tuple[ca.Function, ...]
    point: np.ndarray
    scale: np.ndarray
    memory: np.ndarray
    u: np.ndarray
    unknown: tuple[int, ...]
    n_forces: int
    settable: tuple[bool, ...]
    is_free: tuple[bool, ...]


def start_problem(e: Equations) -> StartProblem:
    """Find the start of a system at its own parameters and input defaults, and pose it for other ones.

    Raises
    ------
    SolverError
        If there is no start.
    """
    s = e.system
    p = parameter_vector(s)
    inputs = [s.variables[s.index_of(name)].declaration for name in s.inputs]
    u = np.array([d.default if d.default is not None else d.start or 0.0 for d in inputs])
    memory = np.zeros(0) if e.made is None else initial_memory(e.made, s, 0.0, u, p)
    guesses = unknown_parameters(s, {}, {})
    decide = _decide(e)
    for _ in range(20):
        given = np.asarray(ca.Function("given", [e.memory, s.u], [e.given()])(memory, u)).ravel()
        request = Request(p, given, {}, 0.0, guesses, False)
        found = find_start(before_events(e.between), request)
        n_x, _, n_f, _ = found.conditions.sizes
        agreed = _with_relations(e, decide, memory, found.start.x, found.start.z, u, found.start.p)
        if n_f:
            modes = settled_modes(e.between, 0.0, found.start.x, agreed[:n_f], found.start.z, given, found.start.p)
            agreed[:n_f] = modes
        if np.array_equal(agreed, memory):
            break
        memory = agreed
    else:
        raise SolverError(f"{s.name}: no start fits its conditions: each start that is tried makes others true.")
    conditions, chosen = found.conditions, found.outcome.chosen
    soft = _soft_rows(conditions, chosen, found.outcome.jacobian[chosen].toarray(), n_x)
    start, is_free = _start_function(e, request, conditions, chosen, soft)
    begin = _begin(e, memory)
    return StartProblem(
        (start, decide, begin),
        found.outcome.point,
        conditions.scale,
        memory,
        u,
        conditions.unknown,
        n_f,
        tuple(i in soft for i in range(n_x)),
        tuple(is_free.get(i, False) for i in range(n_x)),
    )


def _with_relations(e: Equations, decide: ca.Function, memory: np.ndarray, *at: np.ndarray) -> np.ndarray:
    """Return the memory with the relations and modes of a start."""
    if e.made is None:
        return memory
    x, z, u, p = at
    relations, speeds, held = (np.asarray(v).ravel() for v in decide(0.0, x, memory, z, u, p))
    parts, new = e.made.memory, memory.copy()
    n_f, n_d, n_r = parts.modes.numel(), parts.discretes.numel(), parts.relations.numel()
    new[:n_f] = np.sign(np.where(np.abs(speeds) > 1e-9, speeds, 0.0))
    new[n_f + n_d : n_f + n_d + n_r] = relations
    new[n_f + n_d + n_r : n_f + n_d + n_r + held.size] = held
    return new


def _soft_rows(conditions: Conditions, chosen: np.ndarray, slopes: np.ndarray, n_x: int) -> dict[int, int]:
    """Return, by state, the row among the chosen that gives way where the importer sets its start.

    Rows of one unknown first; each state has at most one row, and each row one state.
    """
    rows = [k for k in range(chosen.size) if conditions.ranks[chosen[k]] >= Rank.CALLER]
    found: dict[int, int] = {}
    for k in sorted(rows, key=lambda k: int(np.count_nonzero(slopes[k]))):
        size = np.abs(slopes[k, :n_x])
        free = [j for j in np.flatnonzero(size).tolist() if j not in found]
        if free:
            found[max(free, key=lambda j: size[j])] = k
    return found


def _start_function(
    e: Equations, request: Request, conditions: Conditions, chosen: np.ndarray, soft: dict[int, int]
) -> tuple[ca.Function, dict[int, bool]]:
    s, n_x = e.system, e.system.x.numel()
    point = ca.SX.sym("v", conditions.base.size)
    starts, given = ca.SX.sym("s", n_x), ca.SX.sym("given", n_x)
    known = s.p[[i for i in range(s.p.numel()) if i not in set(conditions.unknown)], 0]
    mode = ca.SX.zeros(s.frictions.force.numel()) if e.made is None else e.made.memory.whole.modes
    # the conditions are a function; called on symbols they become expressions again
    every, _ = conditions.function.call([point, e.given(), known, s.time, mode], True, False)
    rows = every[chosen.tolist(), 0]
    is_free: dict[int, bool] = {}
    moving = ca.vertcat(s.p, s.u, s.time)
    for state, row in soft.items():
        plain = ca.SX(rows[row])
        alone = ca.jacobian_sparsity(plain, point).nnz() == 1
        is_free[state] = alone and not (moving.numel() and ca.depends_on(plain, moving))
        rows[row] = ca.if_else(given[state] > 0.5, point[state] - starts[state], plain)
    arguments = [s.time, point, s.u, e.memory, s.p, starts, given]
    names = ["t", "v", "u", "m", "p", "s", "given"]
    slopes = ca.densify(ca.jacobian(rows, point))
    return ca.Function("fmu_start", arguments, [ca.densify(rows), slopes], names, ["r", "J"], {"cse": True}), is_free


def _decide(e: Equations) -> ca.Function:
    """Return what relations, sliding speeds and conditions are at a start."""
    s, h = e.system, e.system.hybrid
    results = [h.differences < 0 if h.differences.numel() else ca.SX(0, 1), s.frictions.speed, h.conditions]
    if e.made is None:
        results = [ca.SX(0, 1)] * 3
    else:
        n_f, whole = s.frictions.force.numel(), e.made.memory.whole
        old = ca.vertcat(s.frictions.force, h.relations, h.pulses)
        new = ca.vertcat(ca.SX.zeros(n_f), whole.relations, ca.SX.zeros(h.pulses.numel()))
        if old.numel():
            results = ca.substitute(results, [old], [new])
    return ca.Function("fmu_decide", e.arguments, [ca.densify(value) for value in results])


def _begin(e: Equations, memory: np.ndarray) -> ca.Function:
    """Return the memory at a time, before anything is decided there: clocks at their first tick from then on."""
    s, h = e.system, e.system.hybrid
    if e.made is None:
        return ca.Function("fmu_begin", [s.time, s.p], [ca.SX(0, 1)])
    first = ca.fmax(0, ca.ceil((s.time - h.offsets) / h.periods - 1e-9)) if h.pulses.numel() else ca.SX(0, 1)
    n_d = e.made.memory.modes.numel() + e.made.memory.discretes.numel()
    n_rest = memory.size - n_d - first.numel() - N_NOTE
    discretes = [s.variables[i].declaration.start or 0.0 for i in h.discretes]
    long_ago = s.time - 1e3
    note = ca.vertcat(0, 0, long_ago, 0, 0, long_ago, 1e3, 0, s.time)
    begin = ca.vertcat(ca.SX.zeros(n_d - len(discretes)), ca.SX(ca.DM(discretes)), ca.SX.zeros(n_rest), first, note)
    return ca.Function("fmu_begin", [s.time, s.p], [ca.densify(begin)])
