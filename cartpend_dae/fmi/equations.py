"""System -> the CasADi functions of a model with memory, which become the C of an FMU."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.events import Machine, machine
from cartpend_dae.hybrid_problem import replaced
from cartpend_dae.memory import N_NOTE
from cartpend_dae.system import System
from cartpend_dae.time_events import time_relations

# an event of time alone is set this part of the time late: then what it waits for has come, whatever the rounding
LATE = 1e-14


@dataclass(frozen=True, slots=True)
class Equations:
    """A system with its memory, all SX between events, and what follows for C.

    `ode`, `alg`, `values`, `indicators` depend on `time`, `x`, `memory`, `z`, `u`, `p`. `values` are all variables of
    the system and then its dependent parameters. `indicators` fall through zero at an event, those of time alone are
    left out: `next_time` (1, 1) says when these are due, and `kept` which of the machine's indicators are left.
    """

    system: System
    made: Machine | None
    memory: ca.SX
    ode: ca.SX
    alg: ca.SX
    values: ca.SX
    indicators: ca.SX
    places: tuple[str, ...]
    kept: tuple[int, ...]
    next_time: ca.SX

    @property
    def between(self) -> System:
        """The system between events."""
        return self.system if self.made is None else self.made.system

    @property
    def arguments(self) -> list[ca.SX]:
        """What a function of the model takes: (t, x, m, z, u, p)."""
        s = self.system
        return [s.time, s.x, self.memory, s.z, s.u, s.p]

    def given(self) -> ca.SX:
        """Return the inputs of the system between events, from its own inputs and the memory."""
        if self.made is None:
            return self.system.u
        memory, pulses = self.made.memory, self.system.hybrid.pulses
        return ca.vertcat(self.system.u, memory.discretes, memory.whole.relations, ca.SX.zeros(pulses.numel()))


def equations_of(system: System, span: float) -> Equations:
    """Return the equations of a system as the C of an FMU needs them.

    Parameters
    ----------
    system
        The assembled system.
    span
        Length of a usual run [s], against which events at one instant are told.
    """
    s = system
    values = ca.vertcat(s.outputs, _dependent_parameters(s))
    if s.hybrid.is_empty and not s.frictions.places:
        none = ca.SX(0, 1)
        return Equations(s, None, none, s.ode, s.alg, values, none, (), (), ca.SX(np.inf))
    made = machine(s, span)
    whole, pulses = made.memory.whole, s.hybrid.pulses
    parts = [s.ode, s.alg, values]
    for pair in (
        (s.frictions.force, made.force),
        (pulses, ca.SX.zeros(pulses.numel())),
        (s.hybrid.relations, whole.relations),
    ):
        parts = replaced(parts, [pair])
    runs = whole.note[0] == 0
    timed = time_relations(s)
    n_r, n_all = len(s.hybrid.relation_places), made.indicators.numel()
    first = n_all - pulses.numel() - n_r
    kept = [k for k in range(first + n_r) if k - first not in timed]
    return Equations(
        s,
        made,
        made.memory.vector,
        ca.if_else(runs, parts[0], 0) if s.x.numel() else parts[0],
        parts[1],
        parts[2],
        made.indicators[kept, 0],
        tuple(made.places[k] for k in kept),
        tuple(kept),
        _next_time(s, made, timed),
    )


def _dependent_parameters(s: System) -> ca.SX:
    """Return the parameters that follow from others, as expressions of the independent ones; parents come first."""
    flat = s.flat
    dependent = [i for i, q in enumerate(flat.parameters) if q.value is None]
    symbols, bindings = flat.parameter_symbols[dependent, 0], flat.parameter_bindings[dependent, 0]
    if not dependent:
        return ca.SX(0, 1)
    found, _ = ca.substitute_inplace([symbols], [bindings], [])
    return found[0]


def _next_time(s: System, made: Machine, timed: dict[int, tuple[ca.SX, ...]]) -> ca.SX:
    """Return when time alone changes something next: the ticks of clocks, and relations of time by straight pieces."""
    h, t = s.hybrid, s.time
    times = [h.offsets[k] + made.memory.whole.next[k] * h.periods[k] for k in range(h.pulses.numel())]
    soon = t + 4 * LATE * (1 + ca.fabs(t))
    for k, floors in timed.items():
        difference = h.differences[k]
        slope = ca.jacobian(difference, t)
        crossing = t - difference / ca.if_else(slope == 0, 1, slope)
        times.append(ca.if_else(ca.logic_and(slope != 0, crossing > soon), crossing, np.inf))
        for argument in floors:
            pace = ca.jacobian(argument, t)
            whole = ca.if_else(pace > 0, ca.floor(argument) + 1, ca.ceil(argument) - 1)
            jump = t + (whole - argument) / ca.if_else(pace == 0, 1, pace)
            times.append(ca.if_else(pace == 0, np.inf, jump + LATE * (1 + ca.fabs(jump))))
    soonest = ca.SX(np.inf)
    for time in times:
        soonest = ca.fmin(soonest, time)
    return ca.if_else(made.memory.note[0] == 0, soonest, np.inf)


def functions_of(e: Equations) -> list[ca.Function]:
    """Return the functions that the C of an FMU calls, but for those of its start.

    ``rates -> ode``; ``algebraic -> alg, d(alg)/dz``; ``outputs -> y``, all variables; ``indicators``; ``next_time``;
    ``rest -> x`` sets a sliding speed that has passed zero to zero; ``round -> x, m, changed`` decides once at an
    event; ``forward`` and ``adjoint`` are the derivatives of (ode, alg, y, indicators) in (t, x, u, p) and z. Each
    takes (t, x, m, z, u, p), the derivatives their directions as well.
    """
    s, names = e.system, ["t", "x", "m", "z", "u", "p"]

    def function(name: str, results: list[ca.SX]) -> ca.Function:
        dense = [ca.densify(value) for value in results]
        return ca.Function(
            f"fmu_{name}", e.arguments, dense, names, [f"o{k}" for k in range(len(dense))], {"cse": True}
        )

    return [
        function("rates", [e.ode]),
        function("algebraic", [e.alg, ca.jacobian(e.alg, s.z)]),
        function("outputs", [e.values]),
        function("indicators", [e.indicators]),
        function("next_time", [e.next_time]),
        function("rest", [_rest(e)]),
        _round(e),
        *_derivatives(e),
    ]


def _round(e: Equations) -> ca.Function:
    names = ["t", "x", "m", "z", "u", "p", "is_first"]
    if e.made is None:
        arguments = [*e.arguments, ca.SX.sym("is_first")]
        return ca.Function("fmu_round", arguments, [e.system.x, e.memory, ca.SX(0)], names, ["x_", "m_", "changed"])
    arguments = [ca.SX.sym(name, a.numel()) for name, a in zip(names, e.arguments, strict=False)]
    arguments.append(ca.SX.sym("is_first"))
    results = [ca.densify(value) for value in e.made.round.call(arguments, True, False)]
    return ca.Function("fmu_round", arguments, results, names, ["x_", "m_", "changed"], {"cse": True})


def _rest(e: Equations) -> ca.SX:
    """Return states in which no sliding speed has the sign against its mode.

    An importer stops a little after the instant at which a friction comes to rest; what it has slid back is set to
    zero, whatever that is, so that exact sticking does not depend on how well the importer locates events.
    """
    s, x = e.system, e.system.x
    if e.made is None or not s.frictions.places:
        return x
    modes = e.made.memory.whole.modes
    speed, gradients = s.frictions.speed, ca.jacobian(s.frictions.speed, s.x)
    (speed,) = replaced([speed], [(s.hybrid.relations, e.made.memory.whole.relations)])
    done = ca.SX(x)
    for i in range(modes.numel()):
        v, gradient = ca.substitute(ca.SX(speed[i]), x, done), gradients[i, :].T
        slides_back = ca.logic_and(modes[i] != 2, modes[i] * v < 0)
        done = ca.if_else(slides_back, done - gradient * (v / ca.sumsqr(gradient)), done)
    return done


def _derivatives(e: Equations) -> list[ca.Function]:
    s, names = e.system, ["t", "x", "m", "z", "u", "p"]
    known = ca.vertcat(s.time, s.x, s.u, s.p)
    parts = [e.ode, e.alg, e.values, e.indicators]
    results = ca.vertcat(*parts)
    d_known, d_z = ca.SX.sym("d_known", known.numel()), ca.SX.sym("d_z", s.z.numel())
    sizes = np.cumsum([0, *(part.numel() for part in parts)]).tolist()
    forward = ca.jtimes(results, ca.vertcat(known, s.z), ca.vertcat(d_known, d_z))
    weights = [ca.SX.sym("w", part.numel()) for part in parts]
    adjoint = ca.jtimes(results, ca.vertcat(known, s.z), ca.vertcat(*weights), True)
    n = known.numel()
    return [
        ca.Function(
            "fmu_forward",
            [*e.arguments, d_known, d_z],
            [ca.densify(part) for part in ca.vertsplit(forward, sizes)],
            [*names, "d_known", "d_z"],
            ["ode", "alg", "y", "i"],
            {"cse": True},
        ),
        ca.Function(
            "fmu_adjoint",
            [*e.arguments, *weights],
            [ca.densify(adjoint[:n]), ca.densify(adjoint[n:])],
            [*names, "ode", "alg", "y", "i"],
            ["known", "z_"],
            {"cse": True},
        ),
    ]


def note_places(e: Equations) -> slice:
    """Return where the notes on events stand in the memory."""
    n = e.memory.numel()
    return slice(n - N_NOTE, n) if n else slice(0, 0)
