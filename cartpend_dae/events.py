"""Dry friction by events: each friction slides forward, slides backward, or sticks.

The modes are carried as states with derivative zero, so that CasADi's event-locating integrators
change them exactly when a sliding speed reaches zero or a holding force its limit.
"""

from dataclasses import dataclass

import casadi as ca

from cartpend_dae.dae import friction_laws
from cartpend_dae.system import System

# relative width of the band in which a holding force counts as at its limit
MARGIN = 1e-9


@dataclass(frozen=True, slots=True)
class HybridFriction:
    """A system with friction modes.

    `modes` (n_f, 1) are symbols in {-1, 0, 1}; `force` the friction forces they imply; `indicators`
    fire when they fall through zero; `settle(t, x, modes, z, u, p) -> (x, modes)` finds the modes
    that are consistent and stops what has come to rest.
    """

    modes: ca.SX
    force: ca.SX
    indicators: ca.SX
    settle: ca.Function


def friction_events(system: System) -> HybridFriction:
    """Describe the dry frictions of a system by modes and indicators.

    Frictions that stick together are solved together, as a linear system for the holding forces.

    Parameters
    ----------
    system
        A system with at least one dry friction.
    """
    s = system
    n = s.frictions.force.numel()
    law = friction_laws(s)
    modes = ca.SX.sym("modes", n)
    force = _forces(law.free, law.influence, law.level_pos, law.level_neg, modes)
    indicators = []
    for i in range(n):
        stuck = modes[i] == 0
        # the small offset lets an event fire whose indicator is exactly zero at an output time
        indicators.append(ca.if_else(stuck, (1 + MARGIN) * law.level_pos[i] - force[i], modes[i] * law.speed[i]))
        indicators.append(ca.if_else(stuck, (1 + MARGIN) * law.level_neg[i] + force[i], 1))
    arguments = [s.time, s.x, modes, s.z, s.u, s.p]
    speed = ca.Function("speed", arguments, [law.speed, ca.jacobian(law.speed, s.x)])
    holding = ca.Function("holding", arguments, [force, law.level_pos, law.level_neg])
    x_new, modes_new = s.x, modes
    x_new, modes_new = _stop(speed, arguments, x_new, modes_new)
    for _ in range(2 * n):
        modes_new = _release(holding, arguments, x_new, modes_new)
    settle = ca.Function("settle", arguments, [x_new, modes_new])
    return HybridFriction(modes, force, ca.vertcat(*indicators), settle)


def _forces(free: ca.SX, influence: ca.SX, pos: ca.SX, neg: ca.SX, modes: ca.SX) -> ca.SX:
    """Solve: a sliding friction has its level, a stuck one keeps its relative acceleration at zero."""
    n = modes.numel()
    rows, right = [], []
    for i in range(n):
        stuck = modes[i] == 0
        # three frictions between two bodies have no unique shares; a small slope makes them so
        slope = MARGIN * influence[i, i] if n > 2 else 0
        unit = ca.SX.zeros(1, n)
        unit[i] = 1
        hold = ca.SX(influence[i, :])
        hold[i] = hold[i] + slope
        rows.append(ca.if_else(stuck, hold, unit))
        right.append(ca.if_else(stuck, -free[i], ca.if_else(modes[i] > 0, pos[i], -neg[i])))
    return ca.solve(ca.densify(ca.vertcat(*rows)), ca.vertcat(*right)) if n > 1 else right[0] / rows[0]


def _stop(speed: ca.Function, arguments: list[ca.SX], x: ca.SX, modes: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Stop the frictions whose speed has reached zero against their mode, and remove the speed that is left."""
    time, _, _, z, u, p = arguments
    for i in range(modes.numel()):
        speeds, jacobian = speed(time, x, modes, z, u, p)
        stops = ca.logic_and(modes[i] != 0, modes[i] * speeds[i] <= 1e-9)
        gradient = jacobian[i, :]
        correction = gradient.T * (speeds[i] / ca.sumsqr(gradient))
        x = ca.if_else(stops, x - correction, x)
        modes = ca.vertcat(*[ca.if_else(stops, 0, modes[i]) if k == i else modes[k] for k in range(modes.numel())])
    return x, modes


def _release(holding: ca.Function, arguments: list[ca.SX], x: ca.SX, modes: ca.SX) -> ca.SX:
    """Let the stuck friction slide whose holding force exceeds its limit most."""
    time, _, _, z, u, p = arguments
    force, pos, neg = holding(time, x, modes, z, u, p)
    stuck = modes == 0
    over = ca.if_else(stuck, ca.fmax((force - pos) / (pos + 1e-300), (-force - neg) / (neg + 1e-300)), -1)
    worst = ca.mmax(over)
    slides = ca.logic_and(over >= worst, over > -MARGIN)
    return ca.if_else(slides, ca.if_else(force > 0, 1, -1), modes)
