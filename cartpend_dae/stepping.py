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

from dataclasses import dataclass

import casadi as ca

from cartpend_dae.dae import Friction, friction_laws
from cartpend_dae.errors import SolverError
from cartpend_dae.system import System


@dataclass(frozen=True, slots=True)
class Step:
    """`function(t, h, x, u_a, u_b, p) -> x_next`: inputs run linearly from `u_a` to `u_b` over the step h [s]."""

    function: ca.Function
    substeps: int


def runge_kutta(system: System, *, substeps: int = 1) -> Step:
    """Make the step function of a system.

    Parameters
    ----------
    system
        An explicit system (no algebraic variables).
    substeps
        Number of equal steps that `h` is divided into.

    Raises
    ------
    SolverError
        If algebraic variables remain.
    """
    if system.algebraics:
        names = ", ".join(f"`{name}`" for name in system.algebraics)
        raise SolverError(
            f"{system.name} cannot be stepped by an explicit method: {names} follow from nonlinear equations. "
            f"Use the adaptive method."
        )
    t, h = ca.SX.sym("t"), ca.SX.sym("h")
    x, u_a, u_b = (
        ca.SX.sym("x", system.x.numel()),
        ca.SX.sym("a", system.u.numel()),
        ca.SX.sym("b", system.u.numel()),
    )
    p = ca.SX.sym("p", system.p.numel())
    rate = _rate_function(system)
    hold = _friction_function(system)
    now = x
    dt = h / substeps
    for k in range(substeps):
        t_k = t + k * dt
        share = [(k + part) / substeps for part in (0.0, 0.5, 1.0)]
        u_0, u_1, u_2 = (u_a + s * (u_b - u_a) for s in share)
        force = hold(t_k, dt, now, u_1, p)
        k1 = rate(t_k, now, u_0, p, force)
        k2 = rate(t_k + dt / 2, now + dt / 2 * k1, u_1, p, force)
        k3 = rate(t_k + dt / 2, now + dt / 2 * k2, u_1, p, force)
        k4 = rate(t_k + dt, now + dt * k3, u_2, p, force)
        now = now + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    function = ca.Function(
        "step", [t, h, x, u_a, u_b, p], [now], ["t", "h", "x", "u_a", "u_b", "p"], ["x_next"], {"cse": True}
    )
    return Step(function, substeps)


def _rate_function(system: System) -> ca.Function:
    s = system
    return ca.Function("rate", [s.time, s.x, s.u, s.p, s.frictions.force], [s.ode])


def _friction_function(system: System) -> ca.Function:
    """Return (t, h, x, u, p) -> mean friction forces over a step h."""
    s = system
    n = s.frictions.force.numel()
    h = ca.SX.sym("h")
    if not n:
        return ca.Function("hold", [s.time, h, s.x, s.u, s.p], [ca.SX(0, 1)])
    law = friction_laws(s)
    force = _joint_stop(law, h) if n > 1 else [ca.SX(0)]
    for _ in range(1 if n == 1 else 10):  # Gauss-Seidel sweeps over frictions that act on each other
        for i in range(n):
            coupling = sum((law.influence[i, j] * force[j] for j in range(n) if j != i), ca.SX(0))
            free = law.free[i] + coupling
            force[i] = _mean_force(law.speed[i], free, law.influence[i, i], law.level_pos[i], law.level_neg[i], h)
    return ca.Function("hold", [s.time, h, s.x, s.u, s.p], [ca.vertcat(*force)])


def _joint_stop(law: Friction, h: ca.SX) -> list[ca.SX]:
    """Return the forces that stop all frictions together by the end of h, limited to their levels.

    Where all of them stick this is the solution already, however different the masses between them are.
    """
    n = law.speed.numel()
    # frictions that close a ring have no unique holding forces; the small slope makes them so
    matrix = law.influence + 1e-9 * ca.diag(ca.diag(law.influence))
    joint = ca.solve(matrix, -(law.free + law.speed / ca.fmax(h, 1e-30)))
    return [ca.fmin(ca.fmax(joint[i], -law.level_neg[i]), law.level_pos[i]) for i in range(n)]


def _mean_force(speed: ca.SX, free: ca.SX, influence: ca.SX, pos: ca.SX, neg: ca.SX, h: ca.SX) -> ca.SX:
    """Return the mean force of one friction over h, with the acceleration free + influence * force constant in parts.

    It slides at its level for the share of h until it stops; for the rest it holds, or slides the other way.
    """
    tiny = 1e-30  # only keeps the unused branch finite where the motion does not slow down
    resting = ca.fmin(ca.fmax(-free / influence, -neg), pos)
    share_pos = ca.fmin(1, speed / ca.fmax(-(free + influence * pos) * h, tiny))
    share_neg = ca.fmin(1, -speed / ca.fmax((free - influence * neg) * h, tiny))
    forward = share_pos * pos + (1 - share_pos) * resting
    backward = -share_neg * neg + (1 - share_neg) * resting
    return ca.if_else(speed >= 0, forward, backward)
