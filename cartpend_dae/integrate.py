"""From a consistent start through all events to the states at the output times, by CasADi's integrators."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np

from cartpend_dae.along import AllTimes
from cartpend_dae.breakdown import breakdown_sentence
from cartpend_dae.dae import all_variables
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.events import CHATTER, Machine, initial_memory, machine
from cartpend_dae.hybrid_problem import hybrid_problem, replaced
from cartpend_dae.initialize import Start, algebraics_along
from cartpend_dae.inputs import DrivenInputs, input_values, inputs_at, jumps_of
from cartpend_dae.integration import Integration
from cartpend_dae.prepared import content, once
from cartpend_dae.system import System

Method = Literal["adaptive", "cvodes", "idas", "erk", "rosenbrock", "rk4"]
MOST_EVENTS = 1_000_000
# trials by which an event is located, found by trial: with 30 the tests of events pass; with 50 and more one of
# two bearings that stick together is passed over, for a reason not yet known
MOST_TRIALS = 30
# erk is stable up to steps of about this over the fastest rate; beyond so many steps the implicit method is faster,
# which errs more often at events: the acceleration of a body at rest flickers by rounding
STABLE, MOST_STEPS = 3.3, 300_000
# compiled, an explicit step costs a quarter of an implicit one, of which a few thousand are enough
FEW_STEPS = 20_000
# so many times cvodes and idas start anew where inputs jump, some milliseconds each; more jumps are left to them
MOST_RESTARTS = 200
# largest steps as parts of the whole time, tried until no event is passed over
SHARES = (1 / 500, 1 / 2500, 1 / 12500, 1 / 62500)
# part of its largest magnitude by which an indicator may be below zero
UNSEEN = 1e-6


@dataclass(frozen=True, slots=True)
class Choice:
    """An integrator and its tolerances; `is_differentiated` asks for one whose derivatives are exact."""

    method: Method
    rtol: float
    atol: float
    is_compiled: bool = False
    is_differentiated: bool = False


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
    """States (n_x, n), algebraic variables (n_z, n) and, with events, memory (n_m, n) over a grid."""

    x: np.ndarray
    z: np.ndarray
    memory: np.ndarray | None


@dataclass(frozen=True, slots=True)
class Solved:
    """A run, the same `left` of the jumps of inputs, and what was integrated (None without states), by what plugin."""

    run: Run
    left: Run
    whole: Integration | None
    plugin: str


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
    names = [s.time, s.x, s.z, s.u, s.p, s.frictions.force]
    decide = ca.Function("decide", names, [h.differences < 0, s.frictions.speed, h.conditions])
    n_f, n_d, n_r = parts.modes.numel(), parts.discretes.numel(), parts.relations.numel()
    where = slice(n_f + n_d, n_f + n_d + n_r)
    for _ in range(20):
        given = np.concatenate([u, given_of(made, memory)])
        start = initialize(s, p, given)
        decided = decide(time, start.x, start.z, given, start.p, np.zeros(n_f))
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
    x, settled = made.settle(time, start.x, memory, start.z, u, start.p)
    x, settled = np.asarray(x).ravel(), np.asarray(settled).ravel()
    return Begin(system, made, x, start.z, start.p, start.found, settled, memory)


def integrate(begin: Begin, driven: DrivenInputs, grid: np.ndarray, choice: Choice) -> Run:
    """Integrate over a grid.

    Parameters
    ----------
    begin
        The start.
    driven
        Inputs over the intervals of the grid.
    grid
        Times (n,) [s].
    choice
        Integrator and tolerances.

    Raises
    ------
    ModelError
        For an integrator that cannot locate events.
    SolverError
        If the integration fails, or a condition of the model ends it.
    """
    return solved(begin, driven, grid, choice).run


def solved(begin: Begin, driven: DrivenInputs, grid: np.ndarray, choice: Choice) -> Solved:
    """Integrate over a grid as `integrate` does, and keep how."""
    system, made = begin.between, begin.machine
    if made is None and system.x.numel() == 0:
        z = algebraics_along(system, Start(begin.x, begin.z, begin.p, {}), begin.p, inputs_at(driven, grid), grid)
        run = Run(np.zeros((0, grid.size)), z, None)
        return Solved(run, run, None, "")
    posed = hybrid_problem(begin.system, made, driven, grid)
    problem = posed.problem
    options: dict[str, Any] = {"reltol": choice.rtol, "abstol": choice.atol, "show_eval_warnings": False}
    span = float(grid[-1] - grid[0])
    if ca.depends_on(ca.vertcat(problem["ode"], problem["alg"]), problem["t"]):
        options["max_step_size"] = span / 500  # what time does to a model at rest, a long step would pass over
    whole = Integration(
        begin.system, posed.key, problem, options, grid, begin.x, begin.z, begin.p, posed.stacked, choice.is_compiled
    )
    if made is None:
        return _run(begin, driven, choice, whole)
    # after an event an indicator counts only above `event_tol`: with its default of 1e-6 close events are lost
    options |= {
        "max_events": MOST_EVENTS,
        "transition": posed.transition,
        "event_tol": 0.0,
        "max_event_iter": MOST_TRIALS,
    }
    x_0 = np.concatenate([begin.x, begin.memory])
    x_0 = np.append(x_0, np.zeros(problem["x"].numel() - x_0.size))
    missed: list[str] = []
    for share in SHARES:
        options = options | {"max_step_size": span * share}
        found = _run(begin, driven, choice, replace(whole, options=options, x=x_0))
        _check_end(begin, found.run)
        run = _right_of_jumps(begin, made, driven, found.run, grid)
        missed = _missed(begin, made, driven, run, grid)
        if not missed:
            return replace(found, run=run)
    raise SolverError(
        f"{system.name}: events of {', '.join(missed)} are passed over even with steps of {options['max_step_size']:g} "
        f"s: a condition changes there and back faster than that. Simulate a shorter time, or let it change slower."
    )


def _run(begin: Begin, driven: DrivenInputs, choice: Choice, whole: Integration) -> Solved:
    """Integrate by the first of some integrators that can."""
    system, grid, n_x, n_m = begin.between, whole.grid, begin.x.size, begin.memory.size
    jumps = np.flatnonzero(jumps_of(driven, grid)).tolist()
    restarts = len(jumps) <= MOST_RESTARTS and not choice.is_differentiated  # a derivative is that of one piece
    whole = replace(whole, jumps=tuple(jumps if restarts else []))
    result, failures, plugin = None, [], ""
    for plugin in _plugins(begin, driven, grid, choice):
        result, reason = whole.run(plugin, grid.size)
        if result is not None:
            break
        failures.append((plugin, reason))
    if result is None:
        u = begin.inputs(inputs_at(driven, grid), np.tile(begin.memory[:, None], grid.size))
        raise SolverError(breakdown_sentence(system, whole, failures[0], u))
    x = np.column_stack([whole.x, np.asarray(result["xf"])])
    z = np.column_stack([begin.z, np.asarray(result["zf"])]) if begin.z.size else np.zeros((0, grid.size))
    run = Run(x[:n_x], z, None if begin.machine is None else x[n_x : n_x + n_m])
    return Solved(run, run, whole, plugin)


def _right_of_jumps(begin: Begin, made: Machine, driven: DrivenInputs, run: Run, grid: np.ndarray) -> Run:
    """Return a run that shows what is decided after the jump of an input, as the inputs themselves are shown."""
    if run.memory is None:
        return run
    x, memory, u = run.x.copy(), run.memory.copy(), inputs_at(driven, grid)
    for k in np.flatnonzero(jumps_of(driven, grid)):
        new_x, new_memory = made.settle(grid[k], x[:, k], memory[:, k], run.z[:, k], u[:, k], begin.p)
        x[:, k], memory[:, k] = np.asarray(new_x).ravel(), np.asarray(new_memory).ravel()
    return Run(x, run.z, memory)


def _missed(begin: Begin, made: Machine, driven: DrivenInputs, run: Run, grid: np.ndarray) -> list[str]:
    """Return the places whose memory disagrees with the states at an output time."""
    if run.memory is None:
        return []
    s, u = begin.system, inputs_at(driven, grid)
    arguments = [s.time, s.x, made.memory.vector, s.z, s.u, s.p]
    span = float(grid[-1] - grid[0])
    function = once(s, "indicators", span, lambda: AllTimes(ca.Function("indicators", arguments, [made.indicators])))
    values = function([grid[None, :], run.x, run.memory, run.z, u, begin.p], grid.size).T
    # an event lies where it is found; what a step leaves wrong is far larger
    least = -UNSEEN * np.abs(values).max(axis=1, initial=0.0)
    return sorted({f"`{made.places[k]}`" for k in np.flatnonzero((least > values.T).any(axis=0))})


def _plugins(begin: Begin, driven: DrivenInputs, grid: np.ndarray, choice: Choice) -> tuple[str, ...]:
    method = choice.method
    if begin.machine is not None:
        if method in ("cvodes", "idas"):
            what = "dry friction" if begin.system.hybrid.is_empty else "the model"
            raise ModelError(f"Method `{method}` cannot locate the events of {what}; use `adaptive`.")
        if method != "adaptive":
            return (method,)
        if begin.z.size:
            return ("rosenbrock",)
        n_steps = _fastest_rate(begin, driven, grid) * float(grid[-1] - grid[0]) / STABLE
        return ("erk", "rosenbrock") if n_steps < MOST_STEPS else ("rosenbrock", "erk")
    if method != "adaptive":
        return (method,)
    if choice.is_compiled or choice.is_differentiated:  # cvodes and idas cannot be
        n_steps = _fastest_rate(begin, driven, grid) * float(grid[-1] - grid[0]) / STABLE
        return ("erk",) if n_steps < FEW_STEPS and not begin.z.size else ("rosenbrock",)
    if begin.system.algebraics:
        return ("idas", "rosenbrock")
    # cvodes gives up now and then where an input jumps
    return ("cvodes", "rosenbrock") if jumps_of(driven, grid).any() else ("cvodes",)


def _fastest_rate(begin: Begin, driven: DrivenInputs, grid: np.ndarray) -> float:
    """Return the largest eigenvalue of the state equations at the start [1/s]; infinite for a large system."""
    if begin.x.size > 200:
        return np.inf
    u = begin.inputs(input_values(driven, grid[:1], driven.left[:, :1])[:, 0])
    key = (content(begin.x, begin.z, u, begin.p, begin.memory), float(grid[0]))
    return once(begin.between, "fastest rate", key, lambda: _rate(begin, u, float(grid[0])))


def _rate(begin: Begin, u: np.ndarray, time: float) -> float:
    made, s = begin.machine, begin.between
    ode, symbols, modes = s.ode, ca.SX(0, 1), np.zeros(0)
    if made is not None:
        (ode,) = replaced([s.ode], [(s.frictions.force, made.force)])
        symbols, modes = made.memory.modes, made.memory.split(begin.memory)["modes"]
    slopes = ca.Function("slopes", [s.time, s.x, s.z, s.u, s.p, symbols], [ca.jacobian(ode, s.x)])
    values = np.asarray(slopes(time, begin.x, begin.z, u, begin.p, modes))
    return float(np.abs(np.linalg.eigvals(values)).max(initial=0.0)) if np.all(np.isfinite(values)) else np.inf


def _check_end(begin: Begin, run: Run) -> None:
    """Refuse a run that events stopped, with the reason."""
    if begin.machine is None or run.memory is None:
        return
    reason, time = begin.machine.memory.split(run.memory[:, -1])["note"][:2]
    if not round(reason):
        return
    h, name = begin.system.hybrid, begin.system.name
    if reason > 0:
        action = h.actions[round(reason) - 1]
        raise SolverError(f"{name} ends at {time:.6g} s by `{action.place}`: {action.sentence}")
    places = ", ".join(sorted({f"`{place}`" for place in (*h.relation_places, *begin.system.frictions.places)}))
    if reason == CHATTER:
        raise SolverError(
            f"{name}: at {time:.6g} s the decisions of {places} go round in circles: each makes another one untrue. "
            f"Give a condition a width (two thresholds), or what they drive some inertia."
        )
    raise SolverError(
        f"{name}: events of {places} follow each other without end at {time:.6g} s. Let what bounces come to rest "
        f"below a small speed, or give what switches a width (two thresholds)."
    )


def trajectory(begin: Begin, run: Run, driven: DrivenInputs, fine: np.ndarray, grid: np.ndarray) -> Trajectory:
    """Return all variables at the output times `grid` of a run over `fine`."""
    system, p = begin.between, begin.p
    keep = np.searchsorted(fine, grid)
    u = inputs_at(driven, fine)[:, keep]
    x, z = run.x[:, keep], run.z[:, keep]
    memory = None if run.memory is None else run.memory[:, keep]
    if begin.machine is not None:
        u = begin.inputs(u, np.tile(begin.memory[:, None], grid.size) if memory is None else memory)
    force = _forces(begin, grid, x, z, u, memory)
    z = _after_jumps(begin, driven, fine, keep, (grid, x, z, u, force))
    values, columns = all_variables(system, grid, x, z, u, p, force)
    values.setflags(write=False)  # equal variables share a column
    names = tuple(variable.name for variable in system.variables)
    units = tuple(variable.declaration.unit for variable in system.variables)
    table = dict(zip(names, columns.tolist(), strict=True))
    return Trajectory(grid, names, values, units, table, _n_events(begin, run, driven, fine))


def _after_jumps(
    begin: Begin, driven: DrivenInputs, fine: np.ndarray, keep: np.ndarray, at: tuple[np.ndarray, ...]
) -> np.ndarray:
    """Solve anew for the algebraic variables where an input has jumped: what is returned holds after the jump."""
    grid, x, z, u, force = at
    jumped = np.flatnonzero(np.isin(keep, np.flatnonzero(jumps_of(driven, fine))))
    s = begin.between
    if not (z.shape[0] and jumped.size):
        return z
    known = ca.vertcat(s.time, s.x, s.u, s.frictions.force, s.p)
    settle = ca.rootfinder("settle", "newton", {"x": s.z, "p": known, "g": s.alg}, {"error_on_fail": False})
    p = np.tile(begin.p[:, None], jumped.size)
    given = np.vstack([grid[None, jumped], x[:, jumped], u[:, jumped], force[:, jumped], p])
    found = np.asarray(settle.map(jumped.size)(z[:, jumped], given))
    usable = np.isfinite(found).all(axis=0)
    new = np.array(z)
    new[:, jumped[usable]] = found[:, usable]
    return new


def _n_events(begin: Begin, run: Run, driven: DrivenInputs, fine: np.ndarray) -> int:
    """Return the number of instants at which something was decided, or without memory those at which inputs jump."""
    if begin.machine is None or run.memory is None:
        return int(jumps_of(driven, fine).sum())
    split = begin.machine.memory.split
    return round(float(split(run.memory[:, -1])["note"][4] - split(begin.memory)["note"][4]))


def _forces(
    begin: Begin, grid: np.ndarray, x: np.ndarray, z: np.ndarray, u: np.ndarray, memory: np.ndarray | None
) -> np.ndarray:
    """Return the friction forces at the output times, shape (n_f, n)."""
    system, made = begin.between, begin.machine
    n_f = len(system.frictions.places)
    if not n_f or made is None:
        return np.zeros((0, grid.size))
    arguments = [system.time, system.x, system.z, system.u, system.p]
    point = [grid[None, :], x, z, u, begin.p]
    if memory is not None:
        modes = np.round(made.memory.split(memory)["modes"])
    else:
        speed = AllTimes(ca.Function("speed", arguments, [system.frictions.speed]))
        speeds = speed(point, grid.size).T
        modes = np.where(np.abs(speeds) > 1e-9 * np.abs(speeds).max(initial=0.0), np.sign(speeds), 0.0)
    functions = [*arguments, made.memory.modes], [made.force]
    force = once(system, "force", None, lambda: AllTimes(ca.Function("force", *functions)))
    return force([*point, modes], grid.size).T
