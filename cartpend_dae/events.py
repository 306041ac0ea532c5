"""Events inside the integrator: modes of dry friction, relations, discrete variables and clocks as memory.

The memory is carried as states with derivative zero, so that CasADi's event-locating integrators change it exactly
where an indicator falls through zero. At an event everything is decided again and again until nothing changes.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.continuous import between_events
from cartpend_dae.dae import Friction, friction_laws
from cartpend_dae.errors import ModelError
from cartpend_dae.memory import N_NOTE, Memory
from cartpend_dae.merge import Motions, held_by_others, shared_motions
from cartpend_dae.prepared import content, once
from cartpend_dae.system import System

# relative width of the band in which a holding force counts as at its limit
MARGIN = 1e-9
# width of the band, relative to its two sides, in which a relation keeps its value: far above rounding, and
# 1e-12 of a second where it is passed at the pace of time
BAND = 1e-12
# a few times the relative rounding of time, within which an event is located
TICK = 1e-15
# sliding speed below which a friction has come to rest at an event [m/s or rad/s]
REST = 1e-9
# static force below which two parts are free of each other [N or N.m]
FREE = 1e-10
# rounds of decisions at one event, after which they are taken to go round in circles
ROUNDS = 40
# events within this part of the whole time count as one instant; so many of them end the run
INSTANT, CROWD = 1e-9, 200
# jumps that follow each other faster than this part of the whole time, and ever faster so many times, have no end
HASTE, SHRINKS = 1e-6, 3

CHATTER, ZENO = -1, -2
# of each friction: whether another one on its motion sticks, and the force that it then lacks to stick
Shared = tuple[tuple[ca.SX, ca.SX], ...]


@dataclass(frozen=True, slots=True)
class Machine:
    """A system with its memory.

    `system` is that between events: discrete variables, relations and pulses are inputs after its own. `force` are the
    friction forces that the memory implies; `indicators` fire where they fall through zero, each at a place;
    ``settle(t, x, memory, z, u, p) -> (x, memory)`` decides at an event, by rounds of
    ``round(t, x, memory, z, u, p, is_first) -> (x, memory, whether anything changed)``.
    """

    system: System
    memory: Memory
    force: ca.SX
    indicators: ca.SX
    places: tuple[str, ...]
    settle: ca.Function
    round: ca.Function


def machine(system: System, span: float = 1.0, *, slips: bool = False) -> Machine:
    """Describe a system by memory, indicators and decisions.

    Parameters
    ----------
    system
        A system with dry friction or events of its own.
    span
        Length of the whole run [s], against which events at one instant are told.
    slips
        Whether what rests right at its limit of friction slides, as a steady state that slides may ask for.

    Raises
    ------
    ModelError
        If a `reinit` names what is no state.
    """
    s, h = system, system.hybrid
    _check_targets(s)
    _check_conditions(s)
    plain = between_events(s)
    n_f = s.frictions.force.numel()
    memory = Memory(
        modes=ca.SX.sym("modes", n_f),
        discretes=s.d,
        relations=h.relations,
        held=ca.SX.sym("held", h.conditions.numel()),
        next=ca.SX.sym("next", h.pulses.numel()),
        note=ca.SX.sym("note", N_NOTE),
    )
    law = friction_laws(plain)
    motions = shared_motions(plain)
    whole = memory.whole
    force = _forces(law, whole.modes, motions) if n_f else ca.SX(0, 1)
    shared = held_by_others(motions, whole.modes, force, (law.level_pos, law.level_neg))
    step = _step(s, memory, force, law.speed, shared, span, -MARGIN if slips else MARGIN / 2)
    indicators, places = _indicators(s, whole, force, law.speed, shared)
    if h.relations.numel():
        force, indicators = ca.substitute([force, indicators], [h.relations], [whole.relations])
    return Machine(plain, memory, force, indicators, places, _settle(s, memory, step), step)


def _check_targets(s: System) -> None:
    """Refuse a jump of a variable that nothing keeps."""
    wrong = sorted(
        {
            f"`reinit` in `{action.place}` names `{s.variables[action.target].name}`, which is no state"
            for action in s.hybrid.actions
            if action.kind == "reinit" and s.variables[action.target].name not in s.state_relations
        }
    )
    if wrong:
        states = ", ".join(f"`{name}`" for name in s.states) or "none"
        raise ModelError(f"{s.name}: {'; '.join(wrong)}, so that nothing keeps its value; the states are: {states}.")


def _check_conditions(s: System) -> None:
    """Refuse a condition that a signal makes depend on what changes between events."""
    h = s.hybrid
    moves = ca.which_depends(h.conditions, ca.vertcat(s.x, s.z, s.time), 1, True) if h.conditions.numel() else []
    places = sorted({a.place for a in h.actions if a.when >= 0 and moves[a.when]})
    if places:
        raise ModelError(
            f"{s.name}: a condition of `when` in {', '.join(f'`{place}`' for place in places)} is a signal that "
            f"changes between events, so that none tells when it becomes true: compare it by `<`, `<=`, `>` or `>=`."
        )


def _forces(law: Friction, modes: ca.SX, motions: Motions) -> ca.SX:
    """Solve for forces: sliding has its level, stuck no relative acceleration; on one motion each does as much work."""
    n = modes.numel()
    before = {i: members[:k] for members in motions for k, (i, _) in enumerate(members)}
    ratios = {i: ratio for members in motions for i, ratio in members}
    rows, right = [], []
    for i in range(n):
        own, stuck = law.influence[i, i], modes[i] == 0
        unit, share = ca.SX.zeros(1, n), ca.SX.zeros(1, n)
        unit[i], share[i] = 1, own
        hold = ca.SX(law.influence[i, :])
        # frictions that close a ring have no unique forces either; a small slope makes them so
        hold[i] = hold[i] + (MARGIN * own if n > 2 else 0)
        follows = ca.SX(0)
        for j, ratio in before.get(i, ()):
            share[j] = ca.if_else(ca.logic_and(modes[j] == 0, ca.logic_not(follows)), -own * ratio / ratios[i], 0)
            follows = ca.logic_or(follows, modes[j] == 0)
        rows.append(ca.if_else(stuck, ca.if_else(follows, share, hold), unit))
        slides = ca.if_else(modes[i] > 1, 0, ca.if_else(modes[i] > 0, law.level_pos[i], -law.level_neg[i]))
        right.append(ca.if_else(stuck, ca.if_else(follows, 0, -law.free[i]), slides))
    return ca.solve(ca.densify(ca.vertcat(*rows)), ca.vertcat(*right)) if n > 1 else right[0] / rows[0]


def _band(s: System, k: int) -> ca.SX:
    """Return the half width of the band in which relation k keeps its value.

    It is wider than rounding of the two sides, and than what the difference changes in the smallest step of time.
    """
    difference = s.hybrid.differences[k]
    rate = ca.jtimes(difference, s.x, s.ode) + ca.jacobian(difference, s.time)
    sides = ca.fabs(difference)
    if difference.op() in (ca.OP_SUB, ca.OP_ADD):
        sides = ca.fabs(difference.dep(0)) + ca.fabs(difference.dep(1))
    return BAND * (1e-2 + sides) + TICK * (1 + ca.fabs(s.time)) * ca.fabs(rate)


def _indicators(s: System, memory: Memory, force: ca.SX, speed: ca.SX, shared: Shared) -> tuple[ca.SX, tuple[str, ...]]:
    """Return what falls through zero at an event, from above, and its place; above zero once the run has stopped."""
    f, h = s.frictions, s.hybrid
    found: list[ca.SX] = []
    places: list[str] = []
    for i in range(f.force.numel()):
        mode = memory.modes[i]
        # the small offsets let an event fire whose indicator is exactly zero at an output time, and leave no doubt
        # at the event that the limit is passed, even where it is zero
        up = (1 + MARGIN) * f.static_pos[i] + FREE / 2 - force[i]
        down = (1 + MARGIN) * f.static_neg[i] + FREE / 2 + force[i]
        is_held, excess = shared[i]
        sliding = ca.if_else(is_held, excess + MARGIN * f.static_pos[i] + FREE / 2, mode * speed[i])
        found.append(ca.if_else(mode == 0, up, ca.if_else(mode == 2, 1, sliding)))
        found.append(ca.if_else(mode == 0, down, 1))
        level = ca.fmax(f.static_pos[i], f.static_neg[i])
        if not level.is_constant() and ca.depends_on(level, ca.vertcat(_moving(s), h.symbols)):
            # a level that is cut off at zero is flat there: a step down at the limit is found far sooner
            taken = ca.if_else(level < FREE, 1, FREE - level)
            found.append(ca.if_else(mode == 2, taken, ca.if_else(level > FREE / 2, level - FREE / 2, -1)))
        places += [f.places[i]] * (len(found) - len(places))
    for k in range(h.relations.numel()):
        difference = h.differences[k]
        # what has just turned back inside the band is well above zero, lest its next crossing go unseen
        rate, side = _pace(s, k), ca.if_else(memory.relations[k] > 0.5, -1, 1)
        found.append(side * difference + _band(s, k) * ca.if_else(side * rate > 0, 3, 1))
    places += [*h.relation_places, *h.clock_places(s.name)]
    # a clock ticks just before its time: an indicator that is zero exactly at an output time may be passed over
    found += [h.offsets[k] + (memory.next[k] - 1e-10) * h.periods[k] - s.time for k in range(h.pulses.numel())]
    indicators = ca.SX(ca.vertcat(*found))
    if f.places:
        indicators = ca.substitute(indicators, f.force, force)
    indicators = ca.substitute(indicators, h.pulses, ca.SX.zeros(h.pulses.numel()))
    return ca.if_else(memory.note[0] == 0, indicators, 1), tuple(places)


def _moving(s: System) -> ca.SX:
    return ca.vertcat(s.x, s.z, s.u, s.d, s.time)


def _step(
    s: System, memory: Memory, force: ca.SX, speed: ca.SX, shared: Shared, span: float, limit: float
) -> ca.Function:
    """Return one round of decisions: (t, x, memory, z, u, p, is_first) -> (x, memory, whether anything changed)."""
    f, h, vector = s.frictions, s.hybrid, memory.vector
    memory = memory.whole
    is_first = ca.SX.sym("is_first")
    band = ca.SX(ca.vertcat(*[_band(s, k) for k in range(h.relations.numel())]))
    # an event lies on the edge of the band within rounding: half of it tells which relation that is
    relations = h.differences < ca.if_else(memory.relations > 0.5, band, -band) / 2
    relations = _heading(s, relations, band)
    ticks = is_first * (s.time >= h.offsets + (memory.next - 1e-9) * h.periods)
    truths, values = ca.substitute([h.conditions, h.values], [h.symbols], [ca.vertcat(relations, ticks)])
    fires = truths * (1 - memory.held)
    x, discretes, stop, jumped = _acted(s, memory, fires, values)
    x, modes = _modes(s, memory, force, speed, shared, is_first, x, limit)
    next_tick = memory.next + ticks
    for i, target in enumerate(h.modes):
        if target >= 0:
            discretes[h.discretes.index(target)] = modes[i]
    new = ca.vertcat(modes, discretes, relations, truths, next_tick)
    old = vector[: new.numel()]
    changed = ca.sum1(ca.vertcat(new != old, x != s.x)) > 0
    note = _noted(memory.note, s.time, is_first, stop, jumped, span)
    arguments = [s.time, s.x, vector, s.z, s.u, s.p, is_first]
    results = [x, ca.vertcat(new, note), changed]
    if f.places:
        results = ca.substitute(results, [f.force], [force])
    if h.relations.numel():
        results = ca.substitute(results, [h.relations], [memory.relations])
    return ca.Function("step", arguments, results)


def _heading(s: System, relations: ca.SX, band: ca.SX) -> ca.SX:
    """Let the direction of motion decide a relation inside its band, such as that of what has just bounced.

    Else it would leave the band with the old value, and come back within one step of the integrator unseen. Only
    states tell the direction: an algebraic variable or an input does not say how fast it changes.
    """
    h = s.hybrid
    if not h.relations.numel():
        return relations
    decided = []
    for k in range(h.relations.numel()):
        rate = _pace(s, k)
        turned = ca.if_else(rate == 0, relations[k], rate < 0)
        decided.append(ca.if_else(ca.fabs(h.differences[k]) < 2 * band[k], turned, relations[k]))
    return ca.vertcat(*decided)


def _pace(s: System, k: int) -> ca.SX:
    """Return how fast the difference of relation k changes, or 0 where states alone do not tell."""
    difference, unknown = s.hybrid.differences[k], ca.vertcat(s.z, s.u, s.frictions.force)
    if unknown.numel() and ca.depends_on(difference, unknown):
        return ca.SX(0)
    return ca.jtimes(difference, s.x, s.ode) + ca.jacobian(difference, s.time)


def _acted(s: System, memory: Memory, fires: ca.SX, values: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Carry out the actions of the conditions that have become true; tell whether a state has jumped."""
    h = s.hybrid
    x, discretes, stop, jumped = ca.SX(s.x), ca.SX(memory.discretes), memory.note[0], ca.SX(0)
    for number, action in enumerate(h.actions):
        fired = fires[action.when] if action.when >= 0 else ca.SX(1)
        if action.kind == "terminate":
            stop = ca.if_else(ca.logic_and(fired, stop == 0), number + 1, stop)
        elif action.kind == "assign":
            k = h.discretes.index(action.target)
            discretes[k] = ca.if_else(fired, values[number], discretes[k])
        else:
            relation = s.state_relations[s.variables[action.target].name]
            state = (values[number] - relation.offset) / relation.factor
            x[relation.state] = ca.if_else(fired, state, x[relation.state])
            jumped = ca.fmax(jumped, fired)
    return x, discretes, stop, jumped


def _modes(
    s: System, memory: Memory, force: ca.SX, speed: ca.SX, shared: Shared, is_first: ca.SX, x: ca.SX, limit: float
) -> tuple[ca.SX, ca.SX]:
    """Decide on the modes: what has come to rest sticks, and of what sticks the most overloaded slides.

    It is overloaded where its force is beyond its level by more than the part `limit` of it.
    """
    f = s.frictions
    n = f.force.numel()
    if not n:
        return x, memory.modes
    slopes = ca.jacobian(speed, s.x)
    modes: list[ca.SX] = []
    over: list[ca.SX] = []
    before, speed = speed, ca.substitute(speed, s.x, x)  # a state may just have jumped
    for i in range(n):
        v, mode = speed[i], memory.modes[i]
        # events lie at FREE while free and at FREE/2 while not: between the two there is no doubt
        is_free = ca.logic_and(f.static_pos[i] <= 0.75 * FREE, f.static_neg[i] <= 0.75 * FREE)
        at_rest = ca.fabs(v) <= REST
        rests = ca.if_else(is_first, ca.logic_or(mode * v <= REST, mode == 2), ca.logic_or(mode * v < 0, mode == 2))
        rests = ca.logic_or(rests, ca.logic_and(at_rest, ca.fabs(before[i]) > REST))
        is_held, excess = shared[i]
        rests = ca.if_else(is_held, excess < -(MARGIN * f.static_pos[i] + FREE / 2) / 2, rests)
        slides = ca.logic_and(mode != 0, ca.logic_not(rests))
        new = ca.if_else(slides, mode, ca.if_else(at_rest, 0, ca.sign(v)))
        new = ca.if_else(mode == 0, ca.if_else(ca.fabs(v) > 1e3 * REST, ca.sign(v), 0), new)
        stops = ca.logic_and(mode != 0, ca.logic_and(new == 0, ca.logic_not(is_free)))
        gradient = slopes[i, :]
        x = ca.if_else(stops, x - gradient.T * (v / ca.sumsqr(gradient)), x)
        modes.append(ca.if_else(is_free, 2, new))
        load = ca.fmax(
            (force[i] - f.static_pos[i]) / (f.static_pos[i] + FREE),
            (-force[i] - f.static_neg[i]) / (f.static_neg[i] + FREE),
        )
        over.append(ca.if_else(ca.logic_and(mode == 0, modes[-1] == 0), load, -1))
    column, loads = ca.vertcat(*modes), ca.vertcat(*over)
    # what has just come to rest takes its share first: two on one motion slide only once both are at their limits
    comes_to_rest = ca.sum1(ca.logic_and(memory.modes != 0, column == 0)) > 0
    # a limit is passed by the margin where its event lies; what has come to rest right at its limit stays
    released = ca.logic_and(ca.logic_and(loads >= ca.mmax(loads), loads > limit), ca.logic_not(comes_to_rest))
    return x, ca.if_else(released, ca.if_else(force > 0, 1, -1), column)


def _noted(note: ca.SX, time: ca.SX, is_first: ca.SX, stop: ca.SX, jumped: ca.SX, span: float) -> ca.SX:
    """Keep the book of events; too many at one instant stop the run."""
    at_once = time - note[2] <= INSTANT * span
    crowd = ca.if_else(is_first, ca.if_else(at_once, note[3] + 1, 0), note[3])
    interval = time - note[5]
    anew = ca.logic_and(jumped, interval > 0)
    is_shorter = ca.logic_and(interval < HASTE * span, interval < note[6])
    shrinks = ca.if_else(anew, ca.if_else(is_shorter, note[7] + 1, 0), note[7])
    endless = ca.logic_or(crowd > CROWD, shrinks >= SHRINKS)
    reason = ca.if_else(ca.logic_and(stop == 0, endless), ZENO, stop)
    # intervals that shrink by the same share end after a geometric series of them
    rest = ca.if_else(ca.logic_and(stop == 0, shrinks >= SHRINKS), interval**2 / (note[6] - interval), 0)
    stopped = ca.if_else(ca.logic_and(note[0] == 0, reason != 0), time + rest, note[1])
    jump, before = ca.if_else(anew, time, note[5]), ca.if_else(anew, interval, note[6])
    return ca.vertcat(reason, stopped, time, crowd, note[4] + is_first, jump, before, shrinks, note[8])


def _settle(s: System, memory: Memory, step: ca.Function) -> ca.Function:
    """Repeat the rounds of decisions until nothing changes; a memory that still changes is marked as chattering."""
    n_m = memory.vector.numel()
    skip_arguments = [ca.MX.sym(step.name_in(i), step.sparsity_in(i)) for i in range(step.n_in())]
    skip = ca.Function("skip", skip_arguments, [skip_arguments[1], skip_arguments[2], ca.MX(0)])
    chosen = ca.Function.if_else("round", step, skip)
    sizes = [step.sparsity_in(i) for i in range(6)]
    time, x, m, z, u, p = (ca.MX.sym(name, size) for name, size in zip("txmzup", sizes, strict=True))
    new_x, new_m, changed = step(time, x, m, z, u, p, 1)
    for _ in range(ROUNDS):
        new_x, new_m, changed = chosen(changed, time, new_x, new_m, z, u, p, 0)
    first = n_m - N_NOTE
    chatters = ca.logic_and(changed, new_m[first] == 0)
    reason, stopped = ca.if_else(chatters, CHATTER, new_m[first]), ca.if_else(chatters, time, new_m[first + 1])
    new_m = ca.vertcat(new_m[:first], reason, stopped, new_m[first + 2 :])
    return ca.Function("settle", [time, x, m, z, u, p], [new_x, new_m])


def initial_memory(machine: Machine, system: System, time: float, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the memory before the first decision: start values, no modes, clocks at their first tick from now on."""
    h, memory = system.hybrid, machine.memory
    start = [system.variables[i].declaration.start or 0.0 for i in h.discretes]
    periods, offsets = once(system, "clocks", content(p), lambda: _clocks(system, p))
    if np.any(wrong := ~(periods > 0)):
        k = int(np.flatnonzero(wrong)[0])
        place = h.clock_places(system.name)[k]
        raise ModelError(f"The period of a clock in `{place}` is {periods[k]:g} s: `sample` takes a positive one.")
    first = np.maximum(0.0, np.ceil((time - offsets) / periods - 1e-9))
    # the last event was long ago; a time far out of scale would spoil the error norm of the integrator
    none = np.zeros(memory.relations.numel() + memory.held.numel())
    return np.concatenate(
        [
            np.zeros(memory.modes.numel()),
            start,
            none,
            first,
            [0.0, 0.0, time - 1e3, 0.0, 0.0, time - 1e3, 1e3, 0.0, time],
        ]
    )


def _clocks(system: System, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return periods and offsets of the clocks [s]."""
    periods, offsets = ca.Function("clock", [system.p], [system.hybrid.periods, system.hybrid.offsets])(p)
    return np.asarray(periods).ravel(), np.asarray(offsets).ravel()


def settled_modes(
    system: System, time: float, x: np.ndarray, modes: np.ndarray, z: np.ndarray, u: np.ndarray, p: np.ndarray
) -> np.ndarray:
    """Return the modes of dry friction that are consistent at a point, from a first guess; shape (n_f,)."""
    made = machine(system, slips=True)
    memory = initial_memory(made, system, time, u, p)
    memory[: modes.size] = modes
    return np.asarray(made.settle(time, x, memory, z, u, p)[1]).ravel()[: modes.size]
