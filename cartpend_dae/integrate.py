"""From a consistent start through all events to the states at the output times."""

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae.along import AllTimes
from cartpend_dae.begin import Begin, Run
from cartpend_dae.breakdown import breakdown_sentence
from cartpend_dae.dae import all_variables
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import SolverError
from cartpend_dae.events import CHATTER, Machine
from cartpend_dae.hybrid_problem import hybrid_problem
from cartpend_dae.initialize import Start, algebraics_along
from cartpend_dae.inputs import DrivenInputs, inputs_at, jumps_of
from cartpend_dae.integration import Integration
from cartpend_dae.native.attempt import native_run
from cartpend_dae.plugins import Choice, plugins
from cartpend_dae.prepared import once

MOST_EVENTS = 1_000_000
# trials by which an event is located, found by trial: with 30 the tests of events pass; with 50 and more one of
# two bearings that stick together is passed over, for a reason not yet known
MOST_TRIALS = 30
# so many times cvodes and idas start anew where inputs jump, some milliseconds each; more jumps are left to them
MOST_RESTARTS = 200
# largest steps as parts of the whole time, tried until no event is passed over
SHARES = (1 / 500, 1 / 2500, 1 / 12500, 1 / 62500)
# part of its largest magnitude by which an indicator may be below zero
UNSEEN = 1e-6


@dataclass(frozen=True, slots=True)
class Solved:
    """A run, the same `left` of the jumps of inputs, what CasADi integrated (None: it did not), and by what plugin."""

    run: Run
    left: Run
    whole: Integration | None
    plugin: str


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
    span = float(grid[-1] - grid[0])
    if choice.is_compiled and (run := _natively(begin, driven, grid, choice)) is not None:
        return Solved(run, run, None, "native")
    posed = hybrid_problem(begin.system, made, driven, grid)
    problem = posed.problem
    options: dict[str, Any] = {"reltol": choice.rtol, "abstol": choice.atol, "show_eval_warnings": False}
    if once(begin.system, "is driven by time", posed.key, lambda: _is_driven_by_time(problem)):
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


def _is_driven_by_time(problem: dict[str, ca.SX]) -> bool:
    return ca.depends_on(ca.vertcat(problem["ode"], problem["alg"]), problem["t"])


def _natively(begin: Begin, driven: DrivenInputs, grid: np.ndarray, choice: Choice) -> Run | None:
    """Integrate by the engine in C; None where it cannot, and CasADi's integrators have to, or to say why not."""
    span = float(grid[-1] - grid[0])
    for share in SHARES:
        found = native_run(begin, driven, grid, choice, span * share)
        if found is None or begin.machine is None:
            return None if found is None else found.run
        _check_end(begin, found.run)
        if not np.any(found.lowest < -UNSEEN * found.largest):
            return found.run
    return None


def _run(begin: Begin, driven: DrivenInputs, choice: Choice, whole: Integration) -> Solved:
    """Integrate by the first of some integrators that can."""
    system, grid, n_x, n_m = begin.between, whole.grid, begin.x.size, begin.memory.size
    jumps = np.flatnonzero(jumps_of(driven, grid)).tolist()
    restarts = len(jumps) <= MOST_RESTARTS and not choice.is_differentiated  # a derivative is that of one piece
    whole = replace(whole, jumps=tuple(jumps if restarts else []))
    result, failures, plugin = None, [], ""
    for plugin in plugins(begin, driven, grid, choice):
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
    system = begin.system
    if run.variables is None:
        values, columns = _variables(begin, run, driven, fine, grid)
    else:
        distinct, columns = run.variables
        values = (distinct if fine.size == grid.size else distinct[:, np.searchsorted(fine, grid)]).T
    values.setflags(write=False)  # equal variables share a column
    names = tuple(variable.name for variable in system.variables)
    units = tuple(variable.declaration.unit for variable in system.variables)
    table = dict(zip(names, columns.tolist(), strict=True))
    return Trajectory(grid, names, values, units, table, _n_events(begin, run, driven, fine))


def _variables(
    begin: Begin, run: Run, driven: DrivenInputs, fine: np.ndarray, grid: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct ones of all variables at the output times (n, n_v), and which of them each variable is."""
    keep = slice(None) if fine.size == grid.size else np.searchsorted(fine, grid)
    u = inputs_at(driven, fine)[:, keep]
    x, z = run.x[:, keep], run.z[:, keep]
    memory = None if run.memory is None else run.memory[:, keep]
    if begin.machine is not None:
        u = begin.inputs(u, np.tile(begin.memory[:, None], grid.size) if memory is None else memory)
    force = _forces(begin, grid, x, z, u, memory)
    z = _after_jumps(begin, driven, fine, keep, (grid, x, z, u, force))
    return all_variables(begin.between, grid, x, z, u, begin.p, force)


def _after_jumps(
    begin: Begin, driven: DrivenInputs, fine: np.ndarray, keep: slice | np.ndarray, at: tuple[np.ndarray, ...]
) -> np.ndarray:
    """Solve anew for the algebraic variables where an input has jumped: what is returned holds after the jump."""
    grid, x, z, u, force = at
    if not z.shape[0]:
        return z
    jumped, s = np.flatnonzero(np.append(jumps_of(driven, fine), 0.0)[keep]), begin.between
    if not jumped.size:
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
