"""What CasADi's integrators solve: equations, memory, indicators and inputs, packed as they want them."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.events import Machine
from cartpend_dae.inputs import DrivenInputs, jumps_of
from cartpend_dae.system import System

# after an input has jumped, by this part of the time, all is decided again
AFTER = 1e-14


@dataclass(frozen=True, slots=True)
class _Packed:
    """Inputs as expressions, the symbols that change between intervals, and their values over these.

    `begin` is the begin of the interval and `jumps` whether an input jumps there, None where none does.
    """

    values: ca.SX
    symbols: ca.SX
    stacked: np.ndarray
    begin: ca.SX
    jumps: ca.SX | None


def _inputs(s: System, driven: DrivenInputs, grid: np.ndarray, *, is_hybrid: bool) -> _Packed:
    """Pack the inputs; what is constant stands as a number, for an integrator stops wherever a symbol may change."""
    left, slope = driven.left, driven.slope
    values = ca.SX(ca.DM(left[:, 0])) if left.shape[0] else ca.SX(0, 1)
    sloping = np.flatnonzero(np.any(slope != 0, axis=1))
    changing = [r for r in range(left.shape[0]) if r not in driven.expressions and np.any(left[r] != left[r, 0])]
    rows = sorted({*changing, *sloping.tolist()})
    jumping = jumps_of(driven, grid)
    has_jumps = is_hybrid and bool(jumping.any())
    begin = ca.SX.sym("begin", 1, 1)
    needs_begin = bool(sloping.size) or has_jumps
    jumps = ca.SX.sym("jumps") if has_jumps else None
    starts, slopes = ca.SX.sym("left", len(rows)), ca.SX.sym("slope", sloping.size)
    for k, row in enumerate(rows):
        values[row] = starts[k]
    for k, row in enumerate(sloping.tolist()):
        values[row] += slopes[k] * (s.time - begin)
    for row, expression in driven.expressions.items():
        values[row] = ca.SX(expression(s.time))
    symbols = ca.vertcat(starts, slopes, *([begin] if needs_begin else []), *([] if jumps is None else [jumps]))
    more = [*([grid[:-1]] if needs_begin else []), *([] if jumps is None else [jumping])]
    return _Packed(values, symbols, np.vstack([left[rows], slope[sloping], *more]), begin, jumps)


def hybrid_problem(
    system: System, made: Machine | None, driven: DrivenInputs, grid: np.ndarray
) -> tuple[dict[str, ca.SX], ca.Function | None, np.ndarray]:
    """Return the problem for `casadi.integrator`, what happens at events, and inputs over the intervals.

    Parameters
    ----------
    system, made
        The system, and with events its machine.
    driven, grid
        Inputs over the intervals of the grid (n,) [s].
    """
    s = system
    packed = _inputs(s, driven, grid, is_hybrid=made is not None)
    if made is None:
        ode, alg = replaced([s.ode, s.alg], [(s.u, packed.values)])
        problem = {"x": s.x, "z": s.z, "p": s.p, "u": packed.symbols, "t": s.time, "ode": ode, "alg": alg}
        return problem, None, packed.stacked
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
    watched = _watched(differences, s, ode)
    shadow = ca.SX.sym("shadow", watched.numel())
    x = ca.vertcat(s.x, memory.vector, shadow)
    runs = whole.note[0] == 0
    ode = ca.vertcat(ca.if_else(runs, ode, 0), ca.SX.zeros(memory.vector.numel()), ca.if_else(runs, watched, 0))
    problem = {"x": x, "z": s.z, "p": s.p, "u": packed.symbols, "t": s.time, "ode": ode, "alg": alg, "zero": indicators}
    return problem, _transition(s, made, packed, shadow.numel()), packed.stacked


def _watched(differences: ca.SX, s: System, ode: ca.SX) -> ca.SX:
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
