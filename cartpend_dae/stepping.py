"""One step of the classical Runge-Kutta method, with dry friction that sticks, as a CasADi expression.

Within a step a friction force is constant: its mean over the part of the step until the motion stops
and the part after that, in which it sticks or slides back. No smoothing, exact sticking, second-order
accurate through a reversal, and differentiable almost everywhere, so that estimation can follow it.

References
----------
W. Kutta, Z. Math. Phys. 46 (1901), 435-453 (the method of order four).
J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics" (1988),
doi:10.1007/978-3-7091-2624-0_1 (the time-stepping view of dry friction).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from cartpend_dae.dae import Friction, friction_laws
from cartpend_dae.system import System

# longest step in units of the shortest time in which a component may change
LONGEST = 2.0
# Newton steps from the values at the stage before: each squares the error, so that three leave rounding only; what is
# measured, where a current passes zero in a sharp law, may take more
NEWTON, MEASURED = 3, 10
# a step is worse than the one before it if it leaves more than this share of the squares: where it jumps from one side
# of a sharp law to the other it may do so for ever
LESS = 0.999
ROUNDS = 3  # where friction changes a load it follows, each round leaves less than its coefficient of the error


@dataclass(frozen=True, slots=True)
class Step:
    """One step over h [s]; a state is the states of the system and then its algebraic variables, shape (n_x + n_z,).

    ``function(t, h, x, u_a, u_b, p) -> x_next``: inputs run linearly from `u_a` to `u_b`. It is made of equal parts,
    ``part(k, t, h, x, u_a, u_b, p) -> x`` after part k, for those who go through them in a loop.
    ``measure(t, h, x, u, p) -> y``: all variables of the system, with the friction forces at the start of a step h.
    ``algebraic(t, h, x, u, p) -> z``: the algebraic variables among them; those of a state are of some moment before.
    """

    function: ca.Function
    part: ca.Function
    measure: ca.Function
    algebraic: ca.Function
    substeps: int


def runge_kutta(system: System, *, substeps: int = 1) -> Step:
    """Make the step function of a system.

    Algebraic variables follow the states by Newton's method from their values at the stage before. A shortest time of
    the model counts as half a step where it is less: the method is stable up to 2.8 of them.

    Parameters
    ----------
    system
        A system without events.
    substeps
        Number of equal steps that `h` is divided into.
    """
    t, h = ca.SX.sym("t"), ca.SX.sym("h")
    n_u, state = system.u.numel(), ca.SX.sym("x", system.x.numel() + system.z.numel())
    u_a, u_b, p = ca.SX.sym("a", n_u), ca.SX.sym("b", n_u), ca.SX.sym("p", system.p.numel())
    part, after = _part_function(system, substeps), state
    for k in range(substeps):
        after = part(k, t, h, after, u_a, u_b, p)
    names = ["t", "h", "x", "u_a", "u_b", "p"]
    function = ca.Function("step", [t, h, state, u_a, u_b, p], [after], names, ["x_next"], {"cse": True})
    return Step(function, part, *_measure_functions(system, substeps), substeps)


def _part_function(system: System, substeps: int) -> ca.Function:
    """Return (k, t, h, x, u_a, u_b, p) -> the state after the equal part of h that is number k, from 0 on."""
    k, t, h = ca.SX.sym("k"), ca.SX.sym("t"), ca.SX.sym("h")
    n_x, n_u = system.x.numel(), system.u.numel()
    state = ca.SX.sym("x", n_x + system.z.numel())
    u_a, u_b, p = ca.SX.sym("a", n_u), ca.SX.sym("b", n_u), ca.SX.sym("p", system.p.numel())
    rate, solve, hold = _rate_function(system), _algebraic_function(system), _friction_function(system)
    x, z = state[:n_x, 0], state[n_x:, 0]
    dt = h / substeps
    p_step = _followed(system, p, dt)
    t_k = t + k * dt
    u_0, u_1, u_2 = (u_a + (k + share) / substeps * (u_b - u_a) for share in (0.0, 0.5, 1.0))
    if not ca.depends_on(system.alg, system.frictions.force):  # what holds a friction may follow the inputs at once
        z = solve(t_k + dt / 2, x, z, u_1, p_step, ca.SX.zeros(system.frictions.force.numel()))
    force = hold(t_k, dt, x, z, u_0, u_1, u_2, p_step)
    own, lags = ca.SX(x), shortest_lags(system)
    for _ in range(ROUNDS if lags else 0):
        rates = rate(t_k, x, z, u_1, p_step, force)
        for i, parameter in lags:
            own[i] = x[i] + ca.fmin(p_step[parameter], dt) * rates[i]
        force = hold(t_k, dt, own, z, u_0, u_1, u_2, p_step)
    x = own
    slopes = []
    for share, u in ((0.0, u_0), (0.5, u_1), (0.5, u_1), (1.0, u_2)):
        at = x + share * dt * slopes[-1] if slopes else x
        z = solve(t_k + share * dt, at, z, u, p_step, force)
        slopes.append(rate(t_k + share * dt, at, z, u, p_step, force))
    x = x + dt / 6 * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
    return ca.Function("part", [k, t, h, state, u_a, u_b, p], [ca.vertcat(x, z)], {"cse": True})


def shortest_times(system: System) -> tuple[int, ...]:
    """Return the parameters that are shortest times in which a component changes, by their indices."""
    return tuple(i for i, q in enumerate(system.parameters) if q.declaration.is_shortest_time)


def shortest_lags(system: System) -> tuple[tuple[int, int], ...]:
    """Return the states that follow something with a shortest time as their lag, each with this parameter.

    Their rate is (load - state)/lag. On steps that are longer they are at their load when friction is found from them:
    else friction that follows a load would come late by a step and a half.
    """
    slopes = ca.diag(ca.jacobian(system.ode, system.x))
    found = []
    for parameter in shortest_times(system):
        for state in range(system.x.numel()):
            own = ca.simplify(slopes[state] * system.p[parameter])
            if own.is_constant() and float(own) == -1.0:
                found.append((state, parameter))
    return tuple(found)


def lags_of_inputs(system: System, inputs: Sequence[int]) -> set[int]:
    """Return the shortest times with which a state follows one of the inputs, which have these indices, at once."""
    inputs_of = ca.DM(ca.jacobian_sparsity(system.ode, system.u), 1).full()[:, list(inputs)].any(axis=1)
    times_of = ca.DM(ca.jacobian_sparsity(system.ode, system.p), 1).full()[inputs_of].any(axis=0)
    return {i for i in shortest_times(system) if times_of[i]}


def _followed(system: System, p: ca.SX, dt: ca.SX) -> ca.SX:
    """Return the parameters with no shortest time below the share of a step that can follow it."""
    found = ca.SX(p)
    for i in shortest_times(system):
        found[i] = ca.fmax(p[i], dt / LONGEST)
    return found


def _measure_functions(system: System, substeps: int) -> tuple[ca.Function, ca.Function]:
    """Return (t, h, x, u, p) -> all variables, with the friction of the first of the equal parts of h, and -> z."""
    s = system
    h = ca.SX.sym("h")
    x, z = ca.SX.sym("x", s.x.numel()), ca.SX.sym("z", s.z.numel())
    force, hold, solve = s.frictions.force, _friction_function(s), _algebraic_function(s, MEASURED)
    held, z_now = ca.SX.zeros(force.numel()), z
    if not ca.depends_on(s.alg, force):
        z_now = solve(s.time, x, z, s.u, s.p, held)
        if ca.depends_on(s.outputs, force):
            held = hold(s.time, h / substeps, x, z_now, s.u, s.u, s.u, s.p)
    else:
        held = hold(s.time, h / substeps, x, z, s.u, s.u, s.u, s.p)
        z_now = solve(s.time, x, z, s.u, s.p, held)
    outputs = ca.Function("outputs", [s.time, s.x, s.z, s.u, s.p, force], [s.outputs])
    value = outputs(s.time, x, z_now, s.u, s.p, held)
    arguments = [s.time, h, ca.vertcat(x, z), s.u, s.p]
    measure = ca.Function("measure", arguments, [value], {"cse": True})
    return measure, ca.Function("algebraic", arguments, [z_now], {"cse": True})


def _rate_function(system: System) -> ca.Function:
    s = system
    return ca.Function("rate", [s.time, s.x, s.z, s.u, s.p, s.frictions.force], [s.ode])


def _algebraic_function(system: System, steps: int = NEWTON) -> ca.Function:
    """Return (t, x, z, u, p, force) -> algebraic variables, from a guess of them nearby.

    A step after which no less is left is taken back by half; the last one is whole, as it gives the slopes. Equations
    that are linear in them take one.
    """
    s = system
    arguments = [s.time, s.x, s.z, s.u, s.p, s.frictions.force]
    if not s.z.numel():
        return ca.Function("solve", arguments, [s.z])
    jacobian = ca.jacobian(s.alg, s.z)
    residual = ca.Function("residual", arguments, [s.alg, jacobian])
    z = before = s.z
    least = ca.SX(ca.inf)
    for _ in range(steps - 1 if ca.depends_on(jacobian, s.z) else 0):
        value, slope = residual(s.time, s.x, z, s.u, s.p, s.frictions.force)
        left = ca.sumsqr(value)
        is_worse = left > LESS * least
        after = ca.if_else(is_worse, (before + z) / 2, z - ca.solve(slope, value))
        before, least, z = ca.if_else(is_worse, before, z), ca.fmin(left, least), after
    value, slope = residual(s.time, s.x, z, s.u, s.p, s.frictions.force)
    return ca.Function("solve", arguments, [z - ca.solve(slope, value)])


def _friction_function(system: System) -> ca.Function:
    """Return (t, h, x, z, u_0, u, u_2, p) -> mean friction forces over a step h; inputs at its start, middle, end."""
    s = system
    n = s.frictions.force.numel()
    h, u_0, u_2 = ca.SX.sym("h"), ca.SX.sym("u_0", s.u.numel()), ca.SX.sym("u_2", s.u.numel())
    arguments = [s.time, h, s.x, s.z, u_0, s.u, u_2, s.p]
    if not n:
        return ca.Function("hold", arguments, [ca.SX(0, 1)])
    law = friction_laws(s)
    free = ca.Function("free", [s.time, s.x, s.z, s.u, s.p], [law.free])
    begin, end = free(s.time, s.x, s.z, u_0, s.p), free(s.time + h, s.x, s.z, u_2, s.p)
    peaks = [i for i in range(n) if not ca.is_equal(law.static_pos[i], law.level_pos[i], 100)]
    within, after = (_levels_later(system, law, peaks, share * h) for share in (0.5, 1.0))
    force = _joint_stop(law, h) if n > 1 else [ca.SX(0)]
    for _ in range(1 if n == 1 else 10):  # Gauss-Seidel sweeps over frictions that act on each other
        for i in range(n):
            coupling = sum((law.influence[i, j] * force[j] for j in range(n) if j != i), ca.SX(0))
            ends = (begin[i] + coupling, end[i] + coupling) if i in peaks else None
            force[i] = _mean_force(law, i, law.free[i] + coupling, h, within[i], after[i], ends)
    return ca.Function("hold", arguments, [ca.vertcat(*force)])


def _levels_later(system: System, law: Friction, peaks: list[int], h: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    """Return the levels of each friction forward and backward, where it peaks at rest those of some time later if less.

    What starts to move passes a peak that is narrow in no time. How far it is by then is found without friction.
    """
    s, n = system, law.speed.numel()
    found = [(law.level_pos[i], law.level_neg[i]) for i in range(n)]
    if peaks:
        arguments = [s.time, s.x, s.z, s.u, s.p]
        levels = ca.Function("levels", arguments, [law.level_pos, law.level_neg])
        rate = ca.substitute(s.ode, s.frictions.force, ca.SX.zeros(n))
        later = levels(s.time, s.x + h * rate, s.z, s.u, s.p)
        for i in peaks:
            forward, backward = found[i]
            found[i] = ca.fmin(forward, later[0][i]), ca.fmin(backward, later[1][i])
    return found


def _joint_stop(law: Friction, h: ca.SX) -> list[ca.SX]:
    """Return the forces that stop all frictions together by the end of h, limited to their levels.

    Where all of them stick this is the solution already, however different the masses between them are.
    """
    n = law.speed.numel()
    # frictions that close a ring have no unique holding forces; the small slope makes them so
    matrix = law.influence + 1e-9 * ca.diag(ca.diag(law.influence))
    joint = ca.solve(matrix, -(law.free + law.speed / ca.fmax(h, 1e-30)))
    return [ca.fmin(ca.fmax(joint[i], -law.level_neg[i]), law.level_pos[i]) for i in range(n)]


def _mean_force(
    law: Friction,
    i: int,
    free: ca.SX,
    h: ca.SX,
    within: tuple[ca.SX, ca.SX],
    after: tuple[ca.SX, ca.SX],
    ends: tuple[ca.SX, ca.SX] | None,
) -> ca.SX:
    """Return the mean force of one friction over h, with the acceleration free + influence * force constant in parts.

    It slides at its level for the share of h until it stops; for the rest it holds, up to its static levels, or slides
    the way it is pushed, at its levels `after` h. Where it speeds up it slides at those `within` h. With what `free` is
    at both `ends` of h it breaks away at some time within.
    """
    tiny = 1e-30  # only keeps the unused branch finite where the motion does not slow down
    speed, influence, pos, neg = law.speed[i], law.influence[i, i], law.level_pos[i], law.level_neg[i]
    needed = -free / influence
    is_held = ca.logic_and(needed <= law.static_pos[i], -needed <= law.static_neg[i])
    resting = ca.if_else(is_held, needed, ca.fmin(ca.fmax(needed, -after[1]), after[0]))
    if ends is not None:
        begin, end = -ends[0] / influence, -ends[1] / influence
        resting = _broken_away(resting, begin, end, law.static_pos[i], after[0])
        resting = -_broken_away(-resting, -begin, -end, law.static_neg[i], after[1])
    slowing_pos, slowing_neg = -(free + influence * pos), free - influence * neg
    share_pos = ca.fmin(1, speed / ca.fmax(slowing_pos * h, tiny))
    share_neg = ca.fmin(1, -speed / ca.fmax(slowing_neg * h, tiny))
    forward = share_pos * _either(slowing_pos < 0, within[0], pos) + (1 - share_pos) * resting
    backward = -share_neg * _either(slowing_neg < 0, within[1], neg) + (1 - share_neg) * resting
    return ca.if_else(speed >= 0, forward, backward)


def _broken_away(resting: ca.SX, begin: ca.SX, end: ca.SX, static: ca.SX, level: ca.SX) -> ca.SX:
    """Return the mean force where what must be held grows past the static level within a step, else `resting`."""
    share = (static - begin) / ca.fmax(end - begin, 1e-30)
    mean = share * (begin + static) / 2 + (1 - share) * ca.fmin(level, static)
    return ca.if_else(ca.logic_and(begin < static, end > static), mean, resting)


def _either(condition: ca.SX, one: ca.SX, other: ca.SX) -> ca.SX:
    return other if ca.is_equal(one, other) else ca.if_else(condition, one, other)
