"""What CasADi's integrators solve: equations, memory, indicators and inputs, packed as they want them."""

from collections.abc import Hashable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.events import Machine
from cartpend_dae.inputs import DrivenInputs, jumps_of
from cartpend_dae.prepared import once
from cartpend_dae.system import System

# after an input has jumped, by this part of the time, all is decided again
AFTER = 1e-14


@dataclass(frozen=True, slots=True)
class Posed:
    """What `casadi.integrator` solves, what happens at events, and inputs over the intervals.

    `key` holds all that the problem and the transition depend on besides the system.
    """

    problem: dict[str, ca.SX]
    transition: ca.Function | None
    stacked: np.ndarray
    key: Hashable


@dataclass(frozen=True, slots=True)
class _Shape:
    """How inputs change over the intervals of a grid: numbers of those with other values and with slopes, in order.

    `constants` are the values of the inputs that keep them, 0 for the others, and `functions` of time as text.
    """

    rows: tuple[int, ...]
    sloping: tuple[int, ...]
    constants: tuple[float, ...]
    functions: tuple[tuple[int, str], ...]
    has_jumps: bool

    @property
    def needs_begin(self) -> bool:
        """Whether the begin of the interval counts."""
        return bool(self.sloping) or self.has_jumps


@dataclass(frozen=True, slots=True)
class _Packed:
    """Inputs as expressions, and the symbols that change between intervals.

    `begin` is the begin of the interval, or that of the last one at which an input jumped where none has a slope;
    `jumps` tells whether an input jumped there, None where none does at all.
    """

    values: ca.SX
    symbols: ca.SX
    begin: ca.SX
    jumps: ca.SX | None


def _shape(s: System, driven: DrivenInputs, jumping: np.ndarray, *, is_hybrid: bool) -> _Shape:
    left, slope = driven.left, driven.slope
    sloping = np.flatnonzero(np.any(slope != 0, axis=1)).tolist()
    changing = np.flatnonzero(np.any(left != left[:, :1], axis=1)).tolist()
    rows = sorted({*(row for row in changing if row not in driven.expressions), *sloping})
    moving = {*rows, *driven.expressions}
    constants = [0.0 if row in moving else float(left[row, 0]) for row in range(left.shape[0])]
    functions = {
        row: ca.Function("f", [s.time], [ca.SX(of(s.time))]).serialize() for row, of in driven.expressions.items()
    }
    has_jumps = is_hybrid and bool(jumping.any())
    return _Shape(tuple(rows), tuple(sloping), tuple(constants), tuple(functions.items()), has_jumps)


def _inputs(s: System, driven: DrivenInputs, shape: _Shape) -> _Packed:
    """Pack the inputs; what is constant stands as a number, for an integrator stops wherever a symbol may change."""
    values = ca.SX(ca.DM(shape.constants)) if shape.constants else ca.SX(0, 1)
    begin = ca.SX.sym("begin", 1, 1)
    jumps = ca.SX.sym("jumps") if shape.has_jumps else None
    starts, slopes = ca.SX.sym("left", len(shape.rows)), ca.SX.sym("slope", len(shape.sloping))
    for k, row in enumerate(shape.rows):
        values[row] = starts[k]
    for k, row in enumerate(shape.sloping):
        values[row] += slopes[k] * (s.time - begin)
    for row, expression in driven.expressions.items():
        values[row] = ca.SX(expression(s.time))
    more = [*([begin] if shape.needs_begin else []), *([] if jumps is None else [jumps])]
    return _Packed(values, ca.vertcat(starts, slopes, *more), begin, jumps)


def hybrid_problem(system: System, made: Machine | None, driven: DrivenInputs, grid: np.ndarray) -> Posed:
    """Return the problem for `casadi.integrator`, what happens at events, and inputs over the intervals.

    Parameters
    ----------
    system, made
        The system, and with events its machine for the length of the grid.
    driven, grid
        Inputs over the intervals of the grid (n,) [s].
    """
    jumping = jumps_of(driven, grid)
    shape = _shape(system, driven, jumping, is_hybrid=made is not None)
    key = (shape, None if made is None else float(grid[-1] - grid[0]))
    problem, transition = once(system, "problem", key, lambda: _posed(system, made, _inputs(system, driven, shape)))
    begins = grid[:-1]
    if not shape.sloping:  # an integrator stops wherever one of these changes, so they change at jumps only
        last = np.maximum.accumulate(np.where(jumping > 0, np.arange(jumping.size), 0))
        begins, jumping = begins[last], np.maximum.accumulate(jumping)
    more = [*([begins] if shape.needs_begin else []), *([jumping] if shape.has_jumps else [])]
    stacked = np.vstack([driven.left[list(shape.rows)], driven.slope[list(shape.sloping)], *more])
    return Posed(problem, transition, stacked, key)


def _posed(s: System, made: Machine | None, packed: _Packed) -> tuple[dict[str, ca.SX], ca.Function | None]:
    if made is None:
        ode, alg = replaced([s.ode, s.alg], [(s.u, packed.values)])
        return {"x": s.x, "z": s.z, "p": s.p, "u": packed.symbols, "t": s.time, "ode": ode, "alg": alg}, None
    memory, pulses = made.memory, s.hybrid.pulses
    whole = memory.whole
    old = [(s.frictions.force, made.force), (pulses, ca.SX.zeros(pulses.numel()))]
    old += [(s.hybrid.relations, whole.relations), (s.u, packed.values)]
    ode, alg, differences = s.ode, s.alg, s.hybrid.differences
    for pair in old:
        ode, alg, differences = replaced([ode, alg, differences], [pair])
    (indicators,) = replaced([made.indicators], [(s.u, packed.values)])
    if packed.jumps is not None:
        # what an input that jumps makes untrue falls through nothing: just after the jump all is decided again
        is_unseen = ca.logic_and(packed.jumps > 0.5, whole.seen < packed.begin - AFTER / 2)
        soon = packed.begin + AFTER * (1 + ca.fabs(packed.begin)) - s.time
        indicators = ca.vertcat(indicators, ca.if_else(ca.logic_and(is_unseen, whole.note[0] == 0), soon, 1))
    followed = watched(differences, s, ode)
    shadow = ca.SX.sym("shadow", followed.numel())
    x = ca.vertcat(s.x, memory.vector, shadow)
    runs = whole.note[0] == 0
    ode = ca.vertcat(ca.if_else(runs, ode, 0), ca.SX.zeros(memory.vector.numel()), ca.if_else(runs, followed, 0))
    problem = {"x": x, "z": s.z, "p": s.p, "u": packed.symbols, "t": s.time, "ode": ode, "alg": alg, "zero": indicators}
    return problem, _transition(s, made, packed, shadow.numel())


def watched(differences: ca.SX, s: System, ode: ca.SX) -> ca.SX:
    """Return the rates of the differences that bend while the states do not: their error control keeps steps short.

    A step that is right for the states may pass over both crossings of a fast ``sin(w t) > 0``.
    """
    if not differences.numel():
        return ca.SX(0, 1)
    bent = ca.which_depends(differences, ca.vertcat(s.x, s.time), 2, True)
    moved = ca.which_depends(differences, s.z, 1, True) if s.z.numel() else [False] * len(bent)
    chosen = differences[[k for k in range(len(bent)) if bent[k] and not moved[k]], 0]
    return ca.jtimes(chosen, s.x, ode) + ca.jacobian(chosen, s.time) if chosen.numel() else ca.SX(0, 1)


def _transition(s: System, made: Machine, given: _Packed, n_shadow: int) -> ca.Function:
    """Return what happens at an event in the form that CasADi's integrators ask for."""
    inputs = ca.Function("inputs", [s.time, given.symbols], [given.values])
    n_x, n_m = s.x.numel(), made.memory.vector.numel()
    fired, time, x = ca.MX.sym("fired"), ca.MX.sym("t"), ca.MX.sym("x", n_x + n_m + n_shadow)
    z, p, packed = ca.MX.sym("z", s.z.numel()), ca.MX.sym("p", s.p.numel()), ca.MX.sym("u", given.symbols.numel())
    new_x, new_m = made.settle(time, x[:n_x], x[n_x : n_x + n_m], z, inputs(time, packed), p)
    if given.jumps is not None:
        new_m = ca.vertcat(new_m[:-1], packed[-2])  # decided with the inputs since the begin of the interval
    after = [ca.vertcat(new_x, new_m, x[n_x + n_m :]), z]
    return ca.Function("transition", [fired, time, x, z, p, packed], after, ca.event_in(), ca.event_out())


def replaced(expressions: list[ca.SX], pairs: list[tuple[ca.SX, ca.SX]]) -> list[ca.SX]:
    """Return expressions with symbols replaced by values; pairs without elements are passed over."""
    pairs = [pair for pair in pairs if pair[0].numel()]
    if not pairs:
        return expressions
    return list(ca.substitute(expressions, [old for old, _ in pairs], [new for _, new in pairs]))
