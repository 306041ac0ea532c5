"""All effects in one model, none of them felt, and what each would change to first order: one simulation for all.

At size 0 the states inside an effect follow the model and do not act on it. So they are simulated once along the
trajectory of the model, and the sensitivities of the model's own states x to the size s of each effect obey

    d(dx)/dt = (df/dx) dx + df/ds,    de = (dh/dx) dx + dh/ds,

in which df/ds, for hundreds of effects, comes from as few adjoint directions as the model has states.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from scipy.ndimage import uniform_filter1d

from cartpend_dae.continuous import without_events
from cartpend_dae.cuts import owners_of
from cartpend_dae.discover.records import Setup
from cartpend_dae.discover.recursion import carried_along
from cartpend_dae.discover.scan import Scan, best_shapes, out_of_range
from cartpend_dae.discover.slopes import (
    LOST,
    Along,
    Growth,
    Local,
    basis_of,
    growth_of,
    held,
    local_slopes,
    roughness,
    sliding_force,
)
from cartpend_dae.discover.trail import Trail, nominal, run_along
from cartpend_dae.discover.unknown_input import Chain
from cartpend_dae.discover.workbench import COARSE, ROUGH, Workbench, assembled, weighing_step
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError
from cartpend_dae.problem import Problem
from cartpend_dae.shooting import run_through, scaled_values, sensitivities, start_slopes, weighted_residuals
from cartpend_dae.system import System
from cartpend_dae.transcribe import shown_state, stack_data

# a rig rests where over so long [s] the variance of a measured value is less than so many times that of its noise
REST, QUIET = 0.2, 2.5
# products of step and fastest eigenvalue: as far as the fastest motion allows, for what need not be exact; and shorter
# ones where that diverges, as a spring is stiffer than it began
STRIDES = (COARSE, 0.25, 0.05)
# share of itself by which df/ds may change between two samples for the mean of both ends to be good
JUMPS = 0.5
# what is fitted already is followed as the sizes are where that is so exact: an effect that does the same would else
# differ from it by the error of the trapezoidal rule, 2 % where motions die out within some samples, which passes for
# something new (damping of 3,457 N s/m was promised beside 47 that were free)
SAME = 0.1


@dataclass(frozen=True, slots=True)
class Sweep:
    """Weighted residuals (n,), their derivatives in what is fitted already (n, n_base), and in each size (n,).

    Sizes of effects that change too much between samples to be followed so are in `rough` instead. The `chain` has all
    sizes as forces; None where effects were judged alone. `again` are effects from better shapes, `refused` says
    by prefix why the runs go too short a way for one, or too far, and `moving` are prefixes of those with a motion of
    their own.
    """

    residual: np.ndarray
    base: np.ndarray
    sizes: dict[str, np.ndarray]
    chain: Chain | None = None
    again: tuple[Insertion, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    rough: Mapping[str, np.ndarray] = field(default_factory=dict)
    moving: frozenset[str] = frozenset()


def batches(options: list[Insertion]) -> list[tuple[Insertion, ...]]:
    """Group the candidates so that no effect stands twice at a place.

    A link behind a rotor without inertia stands apart: dry friction, a loss or another link there may need that it is
    rigid.
    """
    found: list[dict[str, Insertion]] = []
    for option in sorted(options, key=lambda o: o.card.is_massless is True):
        is_apart = option.card.is_massless is True
        alike = (b for b in found if all((o.card.is_massless is True) is is_apart for o in b.values()))
        batch = next((b for b in alike if option.prefix not in b), None)
        if batch is None:
            found.append(batch := {})
        batch[option.prefix] = option
    return [tuple(batch.values()) for batch in found]


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def sweep(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    options: tuple[Insertion, ...],
    point: Mapping[str, float],
    bandwidth: float,
    sd: np.ndarray,
    *,
    with_shapes: bool = False,
    is_fine: bool = False,
    trail: Trail | None = None,
) -> Sweep:
    """Linearise the model at a fit in the sizes of many effects at once.

    Parameters
    ----------
    bench
        The workbench.
    taken
        Effects in the model already.
    options
        Other effects, each at most once at a place.
    point
        The fit: parameters and free starts by name, SI.
    bandwidth
        Bandwidth of the output injection of that fit [rad/s].
    sd
        Noise used as weight, shape (n_y,).
    with_shapes
        Look for the most promising shapes as well; see `best_shapes`.
    is_fine
        Take the steps of `weighing_step`, if the simulation does not diverge on them.
    trail
        The likeliest course under random forces, along which to linearise; else the output injection leads it.

    Raises
    ------
    SolverError
        If the simulation with the effects diverges.
    """
    loads = () if trail is None else trail.loads
    whole = (*taken, *(load for load in loads if load not in options), *options)
    system = without_events(assembled(bench.setup.model, whole, bench.setup.train), "An estimation")
    system = _sliding(system, [i for i, place in enumerate(system.frictions.places) if _is_at(place, options)])
    places = None if trail is None else trail.in_states_of(system)
    if trail is not None and places is None:  # an effect makes other states of them
        return sweep(bench, taken, options, point, bandwidth, sd, with_shapes=with_shapes, is_fine=is_fine)
    inside = _inside(system, options, bench.problem(taken).system.states)
    alone = weighted_residuals(bench.problem(taken), point, bandwidth, sd) if trail is None else None
    for step, stride in strides(bench.setup, is_fine):
        problem = replace(bench.problem_of(system, (*taken, *loads), whole), step=step, stride=stride)
        run = run_along(problem, point, bandwidth, sd, trail, places)
        # where none of them is felt, all leave what the model leaves, but for the coarser steps
        if np.all(np.isfinite(run.states[run.own(inside)])) and run.leaves_no_more_than(alone):
            break
    else:
        raise SolverError("The model with all effects of the catalogue in it diverges.")
    values, data, carried, states, residual = run.values, run.data, run.carried, run.states, run.residual
    local = local_slopes(problem, system, inside, carried, data, states)
    if trail is not None and run.followed is not None:
        residual = nominal(problem, local, run.followed, values, run.own(inside), run.pushed(local, trail))
    names = tuple(name for insertion in options for name in insertion.size_names)
    fitted = tuple(item.name for item in problem.layout.free if ":" not in item.name and item.name not in names)
    along = Along(problem, system, inside, carried[: len(problem.layout.slots)], data, states)
    growth = growth_of(along, (*names, *fitted))
    # no rig sticks when its model does: what random forces move goes on as if it slid, at a level that stays as it is,
    # as one that falls with the speed would let what rests run away; only where the rig rests is it as the model says
    free = local
    if system.frictions.places:
        loose = _sliding(system, list(range(len(system.frictions.places))), is_felt=False)
        free = local_slopes(problem, loose, inside, carried, data, states)
        if trail is None:
            free = _stuck_where(_rests(problem, data), local, free)
        else:  # along it the model does as the rig did
            growth, free = held(along, growth, local, free), local
    found = _gathered(problem, values, (local, free), growth, residual, inside, (*names, *fitted), data)
    sizes, rough = dict[str, np.ndarray](), dict[str, np.ndarray]()
    for name, ratio in zip(names, roughness(growth), strict=False):
        (rough if ratio > JUMPS else sizes)[name] = found.sizes[name]
    base = found.base.copy()
    for i, item in enumerate(problem.layout.free):
        column = found.sizes.get(item.name, np.zeros(0)) * item.slope(values[i])
        if column.size and np.linalg.norm(column - base[:, i]) < SAME * np.linalg.norm(base[:, i]):
            base[:, i] = column
    if trail is not None:
        base = base[:, [i for i, item in enumerate(problem.variables) if item.name not in trail.sizes]]
    again: tuple[Insertion, ...] = ()
    told = {option.prefix: out_of_range(option, along) for option in options}
    refused = {prefix: why for prefix, why in told.items() if why}
    if with_shapes:
        scan = Scan(along, local, found.residual, basis_of(base))
        again = tuple(replace(o, values={**o.values, **shape}) for o in options for shape in best_shapes(o, scan))
    states = [name.removeprefix("der(") for name in system.states]
    moving = frozenset(o.prefix for o in options if any(name.startswith(f"{o.prefix}.") for name in states))
    return replace(found, base=base, sizes=sizes, again=again, refused=refused, rough=rough, moving=moving)


def strides(setup: Setup, is_fine: bool) -> list[tuple[float | None, float]]:
    """Return the longest steps [s] and strides to try, one after the other, where a simulation diverges."""
    finest: list[tuple[float | None, float]] = [(weighing_step(setup), ROUGH)] if is_fine else []
    return [*finest, *((None, stride) for stride in STRIDES)]


def _sliding(system: System, mine: list[int], *, is_felt: bool = True) -> System:
    """Return a system in which some dry frictions slide: at level 0 it does not matter how one sticks.

    Without being felt they push by nothing, which leaves all slopes but those of their levels as they are.
    """
    f = system.frictions
    others = [i for i in range(len(f.places)) if i not in mine]
    if not mine:
        return system
    slide, force = sliding_force(f)[mine, 0], f.force[mine, 0]
    # the level of one may depend on the force of another, which is nothing at first order
    slide = ca.substitute(slide, force, ca.SX.zeros(len(mine))) if is_felt else ca.SX.zeros(len(mine))
    parts = [system.ode, system.alg, system.outputs, system.initials.residual, system.invariants]
    ode, alg, outputs, initials, invariants = ca.substitute(parts, [force], [slide])
    laws = [law[others, 0] for law in f.laws]
    kept = replace(
        f,
        places=tuple(f.places[i] for i in others),
        force=f.force[others, 0],
        speed=laws[0],
        level_pos=laws[1],
        level_neg=laws[2],
        static_pos=laws[3],
        static_neg=laws[4],
    )
    return replace(
        system,
        ode=ode,
        alg=alg,
        outputs=outputs,
        initials=replace(system.initials, residual=initials),
        invariants=invariants,
        frictions=kept,
    )


def alone_with(bench: Workbench, taken: tuple[Insertion, ...], option: Insertion) -> Problem:
    """Return the problem of the model with a single effect more, in coarse steps."""
    return bench.coarse((*taken, option))


def one_by_one(
    problem: Problem, option: Insertion, point: Mapping[str, float], bandwidth: float, sd: np.ndarray
) -> Sweep:
    """Linearise a problem with a single effect more; the other arguments and the result are those of `sweep`.

    Raises
    ------
    SolverError
        If the simulation diverges.
    """
    values = scaled_values(problem, point)
    w = np.full(len(problem.outputs), float(bandwidth))
    data = stack_data(problem.layout, problem.experiments, 1.0 / sd)
    nodes = run_through(problem, values, w, data)[1][:, :: problem.layout.length]
    found = sensitivities(problem, values, nodes, w, data)
    measured = data[-len(problem.outputs) :].T.ravel() > 0
    flat = found.slopes.reshape(-1, values.size)[measured]
    if not np.all(np.abs(flat) < LOST):
        raise SolverError(f"the model with `{option.prefix}` diverges")
    names = [item.name for item in problem.variables]
    own = {name: names.index(name) for name in option.parameter_names}
    kept = [i for i in range(len(names)) if i not in own.values()]
    sizes = {name: flat[:, own[name]] / problem.variables[own[name]].scale for name in option.size_names}
    return Sweep(found.residuals.ravel()[measured], flat[:, kept], sizes)


def _is_at(name: str, options: tuple[Insertion, ...]) -> bool:
    """Return whether a dotted name is inside one of the options; joined frictions name all their places."""
    return all(
        any(part == option.prefix or part.startswith(option.prefix + ".") for option in options)
        for part in name.split(" + ")
    )


def _inside(system: System, options: tuple[Insertion, ...], own: tuple[str, ...]) -> list[int]:
    """Return the states that belong to the options; those that move as the model's `own` may be named after one."""
    shown = {found[0] for name in own if (found := shown_state(system, name)) is not None}
    named = (i for i, name in enumerate(system.states) if _is_at(name.removeprefix("der("), options))
    return [i for i in named if i not in shown]


def _rests(problem: Problem, data: np.ndarray) -> np.ndarray:
    """Return at which samples (n,) a measured value changes by no more than its noise, before and after."""
    n_y, n_u = len(problem.outputs), problem.layout.system.u.numel()
    values, weight = data[2 + 2 * n_u : 2 + 2 * n_u + n_y], data[-n_y:]
    width = float(np.median(data[1][data[1] > 0]))
    size = 2 * max(2, round(0.5 * REST / width)) + 1
    scaled = np.where(weight > 0, values * weight, 0.0)
    share = uniform_filter1d(np.where(weight > 0, 1.0, 0.0), size, axis=1, mode="nearest")
    mean, square = (uniform_filter1d(scaled**power, size, axis=1, mode="nearest") for power in (1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = square / share - (mean / share) ** 2
    return np.any((spread < QUIET) & (share > 0.5), axis=0)


def _stuck_where(rests: np.ndarray, local: Local, free: Local) -> Local:
    names = ("transition", "theta", "measured", "error", "error_theta")
    return Local(*(np.where(rests[:, None, None], getattr(local, x), getattr(free, x)) for x in names))


def _gathered(
    problem: Problem,
    values: np.ndarray,
    locals_: tuple[Local, Local],
    growth: Growth,
    residual: np.ndarray,
    inside: list[int],
    names: tuple[str, ...],
    data: np.ndarray,
) -> Sweep:
    """Carry all sensitivities along the samples, and collect those of what was measured."""
    local, free = locals_
    layout, n_y = problem.layout, len(problem.outputs)
    n, n_own, n_sizes = growth.left.shape
    n_state, n_all = local.transition.shape[1], values.size
    weight = data[-n_y:].T
    start = dict(zip(layout.first, start_slopes(problem, values), strict=True))
    own = [i for i in range(problem.layout.n_state) if i not in inside]
    growth = growth.where_finite()
    h = data[1][:, None, None] / 2
    pushes = growth.moved(local, data[1])
    moved = pushes - local.measured @ growth.outputs
    loose = pushes + h * ((free.transition - local.transition)[:, :, :n_own] @ growth.left)
    begin = {k * layout.length: np.hstack([slopes[own], np.zeros((n_state, n_sizes))]) for k, slopes in start.items()}
    sample, theta = np.arange(n)[:, None, None], np.repeat(layout.owners[layout.runs], layout.length, axis=0)[:, None]
    driven = np.zeros((n, n_state, n_all + n_sizes))
    driven[:, :, n_all:] = moved
    driven[sample, np.arange(n_state)[:, None], theta] += local.theta
    columns = local.error @ carried_along(local.transition, driven, begin)
    columns[sample, np.arange(n_y)[:, None], theta] += local.error_theta
    columns[:, :, n_all:] -= growth.outputs * weight[:, :, None]
    measured = weight > 0
    flat = columns[measured]
    sizes = {name: flat[:, n_all + i] for i, name in enumerate(names)}
    noise = free.measured / np.where(measured, weight, np.inf)[:, None, :]
    first = tuple(segment * layout.length for segment in layout.first)
    owner = owners_of(problem.experiments)
    chain = Chain(names, free.transition, noise, loose, free.error, measured, first, data[1], owner)
    return Sweep(residual.T[measured], flat[:, :n_all], sizes, chain)
