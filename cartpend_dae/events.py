"""Events inside the integrator: modes of dry friction, relations, discrete variables and clocks as memory.

The memory is carried as states with derivative zero, so that CasADi's event-locating integrators change it exactly
where an indicator falls through zero. At an event everything is decided again and again until nothing changes.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from cartpend_dae.dae import friction_laws
from cartpend_dae.errors import ModelError
from cartpend_dae.hybrid import Hybrid
from cartpend_dae.merge import parallel_frictions
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
N_NOTE = 8


@dataclass(frozen=True, slots=True)
class Memory:
    """What is constant between events, each a column of symbols.

    `modes` of dry frictions in {-1, 0, 1, 2}, `discretes`, `relations` and `held` conditions in {0, 1}, the `next`
    time of each clock, and `note`: why the run stopped (0: it did not; the number of an action, from 1; `CHATTER` or
    `ZENO`), when, the time of the last event, how many were at that instant, how many in all; the time of the last
    jump of a state, the interval before it, and how many intervals in a row were short and ever shorter.
    """

    modes: ca.SX
    discretes: ca.SX
    relations: ca.SX
    held: ca.SX
    next: ca.SX
    note: ca.SX

    @property
    def vector(self) -> ca.SX:
        """All of it as one column."""
        return ca.vertcat(self.modes, self.discretes, self.relations, self.held, self.next, self.note)

    @property
    def whole(self) -> "Memory":
        """The memory with whole numbers as such: implicit integrators leave 1e-39 where there was zero."""
        whole = [ca.floor(part + 0.5) for part in (self.modes, self.relations, self.held)]
        note = ca.SX(self.note)
        note[0] = ca.floor(note[0] + 0.5)
        return Memory(whole[0], self.discretes, whole[1], whole[2], self.next, note)

    def split(self, values: np.ndarray) -> "dict[str, np.ndarray]":
        """Return the rows of (n_memory, n) values by the name of the part."""
        parts, at = {}, 0
        for name in ("modes", "discretes", "relations", "held", "next", "note"):
            n = getattr(self, name).numel()
            parts[name], at = values[at : at + n], at + n
        return parts


@dataclass(frozen=True, slots=True)
class Machine:
    """A system with its memory.

    `system` is that between events: discrete variables, relations and pulses are inputs after its own. `force` are the
    friction forces that the memory implies; `indicators` fire where they fall through zero;
    ``settle(t, x, memory, z, u, p) -> (x, memory)`` decides at an event.
    """

    system: System
    memory: Memory
    force: ca.SX
    indicators: ca.SX
    settle: ca.Function


def between_events(system: System) -> System:
    """Return the system between events, whose discrete variables, relations and pulses are inputs after its own."""
    h = system.hybrid
    if h.is_empty:
        return system
    names = [system.variables[i].name for i in h.discretes]
    names += [f"relation {k + 1} ({place})" for k, place in enumerate(h.relation_places)]
    names += [f"clock {k + 1}" for k in range(h.pulses.numel())]
    none = ca.SX(0, 1)
    empty = Hybrid(none, none, (), none, none, none, none, (), none, (), h.modes)
    u = ca.vertcat(system.u, system.d, h.relations, h.pulses)
    return replace(system, inputs=(*system.inputs, *names), u=u, d=none, hybrid=empty)


def machine(system: System, span: float = 1.0) -> Machine:
    """Describe a system by memory, indicators and decisions.

    Parameters
    ----------
    system
        A system with dry friction or events of its own.
    span
        Length of the whole run [s], against which events at one instant are told.
    """
    s, h = system, system.hybrid
    _check_jumps(s)
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
    rigid = parallel_frictions(plain)
    whole = memory.whole
    force = _forces(law.free, law.influence, law.level_pos, law.level_neg, whole.modes, rigid) if n_f else ca.SX(0, 1)
    step = _step(s, memory, force, law.speed, span)
    indicators = _indicators(s, whole, force, law.speed)
    if h.relations.numel():
        force, indicators = ca.substitute([force, indicators], [h.relations], [whole.relations])
    return Machine(plain, memory, force, indicators, _settle(s, memory, step))


def _check_jumps(system: System) -> None:
    """Refuse a jump of what is no state of this model."""
    jumps = {(a.place, system.variables[a.target].name) for a in system.hybrid.actions if a.kind == "reinit"}
    findings = [
        f"`reinit` in `{place}` names `{name}`, which is no state here, because what is connected to it gives its "
        f"value: connect it through a spring or a gap, or leave the `reinit` out"
        for place, name in sorted(jumps)
        if name not in system.state_relations
    ]
    if findings:
        raise ModelError(f"{system.name}: {'; '.join(findings)}.")


def _forces(free: ca.SX, influence: ca.SX, pos: ca.SX, neg: ca.SX, modes: ca.SX, is_shared: tuple[bool, ...]) -> ca.SX:
    """Solve: a sliding friction has its level, a stuck one keeps its relative acceleration at zero."""
    n = modes.numel()
    rows, right = [], []
    for i in range(n):
        stuck = modes[i] == 0
        # frictions on one motion have no unique shares; a small slope makes them so
        slope = MARGIN * influence[i, i] if n > 2 or is_shared[i] else 0
        unit = ca.SX.zeros(1, n)
        unit[i] = 1
        hold = ca.SX(influence[i, :])
        hold[i] = hold[i] + slope
        rows.append(ca.if_else(stuck, hold, unit))
        slides = ca.if_else(modes[i] > 1, 0, ca.if_else(modes[i] > 0, pos[i], -neg[i]))
        right.append(ca.if_else(stuck, -free[i], slides))
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


def _indicators(s: System, memory: Memory, force: ca.SX, speed: ca.SX) -> ca.SX:
    """Return what falls through zero at an event, from above; all stay above zero once the run has stopped."""
    f, h = s.frictions, s.hybrid
    found: list[ca.SX] = []
    for i in range(f.force.numel()):
        mode = memory.modes[i]
        # the small offset lets an event fire whose indicator is exactly zero at an output time
        up = (1 + MARGIN) * f.static_pos[i] - force[i]
        down = (1 + MARGIN) * f.static_neg[i] + force[i]
        found.append(ca.if_else(mode == 0, up, ca.if_else(mode == 2, 1, mode * speed[i])))
        found.append(ca.if_else(mode == 0, down, 1))
        if not f.static_pos[i].is_constant() and ca.depends_on(f.static_pos[i], ca.vertcat(_moving(s), h.symbols)):
            found.append(ca.if_else(mode == 2, FREE - f.static_pos[i], f.static_pos[i] - FREE / 2))
    for k in range(h.relations.numel()):
        difference = h.differences[k]
        found.append(ca.if_else(memory.relations[k] > 0.5, -difference, difference) + _band(s, k))
    # a clock ticks just before its time: an indicator that is zero exactly at an output time may be passed over
    found += [memory.next[k] - 1e-10 * h.periods[k] - s.time for k in range(h.pulses.numel())]
    indicators = ca.SX(ca.vertcat(*found))
    if f.places:
        indicators = ca.substitute(indicators, f.force, force)
    indicators = ca.substitute(indicators, h.pulses, ca.SX.zeros(h.pulses.numel()))
    return ca.if_else(memory.note[0] == 0, indicators, 1)


def _moving(s: System) -> ca.SX:
    return ca.vertcat(s.x, s.z, s.u, s.d, s.time)


def _step(s: System, memory: Memory, force: ca.SX, speed: ca.SX, span: float) -> ca.Function:
    """Return one round of decisions: (t, x, memory, z, u, p, is_first) -> (x, memory, whether anything changed)."""
    f, h, vector = s.frictions, s.hybrid, memory.vector
    memory = memory.whole
    is_first = ca.SX.sym("is_first")
    band = ca.SX(ca.vertcat(*[_band(s, k) for k in range(h.relations.numel())]))
    # an event lies on the edge of the band within rounding: half of it tells which relation that is
    relations = h.differences < ca.if_else(memory.relations > 0.5, band, -band) / 2
    ticks = is_first * (s.time >= memory.next - 1e-9 * h.periods)
    truths, values = ca.substitute([h.conditions, h.values], [h.symbols], [ca.vertcat(relations, ticks)])
    fires = truths * (1 - memory.held)
    x, discretes, stop, jumped = _acted(s, memory, fires, values)
    x, modes = _modes(s, memory, force, speed, is_first, x)
    next_time = memory.next + ticks * h.periods
    for i, target in enumerate(h.modes):
        if target >= 0:
            discretes[h.discretes.index(target)] = modes[i]
    new = ca.vertcat(modes, discretes, relations, truths, next_time)
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


def _modes(s: System, memory: Memory, force: ca.SX, speed: ca.SX, is_first: ca.SX, x: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Decide on the modes: what has come to rest sticks, and of what sticks the most overloaded slides."""
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
        is_free = ca.logic_and(f.static_pos[i] <= FREE, f.static_neg[i] <= FREE)
        at_rest = ca.fabs(v) <= REST
        rests = ca.if_else(is_first, ca.logic_or(mode * v <= REST, mode == 2), ca.logic_or(mode * v < 0, mode == 2))
        rests = ca.logic_or(rests, ca.logic_and(at_rest, ca.fabs(before[i]) > REST))
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
    released = ca.logic_and(loads >= ca.mmax(loads), loads > -MARGIN)
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
    stopped = ca.if_else(ca.logic_and(note[0] == 0, reason != 0), time, note[1])
    jump, before = ca.if_else(anew, time, note[5]), ca.if_else(anew, interval, note[6])
    return ca.vertcat(reason, stopped, time, crowd, note[4] + is_first, jump, before, shrinks)


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
    reason = ca.if_else(ca.logic_and(changed, new_m[first] == 0), CHATTER, new_m[first])
    new_m = ca.vertcat(new_m[:first], reason, new_m[first + 1 :])
    return ca.Function("settle", [time, x, m, z, u, p], [new_x, new_m])


def initial_memory(machine: Machine, system: System, time: float, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the memory before the first decision: start values, no modes, clocks at their first time from now on."""
    h, memory = system.hybrid, machine.memory
    start = [system.variables[i].declaration.start or 0.0 for i in h.discretes]
    clock = ca.Function("clock", [system.p], [h.periods, h.offsets])
    periods, offsets = (np.asarray(value).ravel() for value in clock(p))
    first = offsets + np.maximum(0.0, np.ceil((time - offsets) / periods - 1e-9)) * periods
    # the last event was long ago; a time far out of scale would spoil the error norm of the integrator
    none = np.zeros(memory.relations.numel() + memory.held.numel())
    return np.concatenate(
        [np.zeros(memory.modes.numel()), start, none, first, [0.0, 0.0, time - 1e3, 0.0, 0.0, time - 1e3, 1e3, 0.0]]
    )


def settled_modes(
    system: System, time: float, x: np.ndarray, modes: np.ndarray, z: np.ndarray, u: np.ndarray, p: np.ndarray
) -> np.ndarray:
    """Return the modes of dry friction that are consistent at a point, from a first guess; shape (n_f,)."""
    made = machine(system)
    memory = initial_memory(made, system, time, u, p)
    memory[: modes.size] = modes
    return np.asarray(made.settle(time, x, memory, z, u, p)[1]).ravel()[: modes.size]
