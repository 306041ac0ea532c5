"""Simultaneous collocation: the states at all samples, and between them, are variables of one large programme.

No simulation has to come to its end, which helps where the first values of the parameters are far off.

Dry friction has no smooth equations. It is regularised here, less from one programme to the next; what is found is
where the estimation goes on with friction that sticks.
"""

from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae.collocation_programme import Interval, collocation_programme, interval_of
from cartpend_dae.errors import SolverError
from cartpend_dae.gauss_newton import Solution, bounds
from cartpend_dae.prepared import once
from cartpend_dae.problem import Problem
from cartpend_dae.programme import Hessian

# widths of regularised friction, as parts of the fastest sliding
WIDTHS = (0.1, 0.03, 0.01)


def collocated(
    problem: Problem,
    values: np.ndarray,
    states: np.ndarray,
    w: np.ndarray,
    data: np.ndarray,
    *,
    hessian: Hessian = "gauss-newton",
) -> Solution:
    """Minimise the cost of a problem from a point.

    Parameters
    ----------
    problem
        The problem.
    values
        Scaled variables (n_all,).
    states
        Guesses at all samples (n_state, n), as `shooting.run_through` returns them.
    w
        Bandwidth of the output injection of each output [rad/s].
    data
        The samples, see `stack_data`.
    hessian
        That of Gauss and Newton, or the exact one.

    Raises
    ------
    SolverError
        If the solver ends without a usable point.
    """
    widths = _widths(problem, values, states, data)
    found = None
    for width in widths:
        found = _solved(problem, values, states, (w, data, width), hessian)
        values, states = found.values, found.nodes
        if not found.success:
            break
    assert found is not None
    return Solution(
        found.values,
        found.nodes[:, :: problem.layout.length],
        found.cost,
        found.success,
        found.message,
        found.iterations,
    )


def _widths(problem: Problem, values: np.ndarray, states: np.ndarray, data: np.ndarray) -> tuple[float, ...]:
    """Return with which widths friction is regularised, one after the other; a single 0 without friction."""
    s = problem.system
    if not s.frictions.places:
        return (0.0,)
    speed = ca.Function("speed", [s.time, s.x, s.z, s.u, s.p], [s.frictions.speed])
    n_x, n_u = s.x.numel(), s.u.numel()
    p = problem.functions.parameters(values[problem.layout.owners[0]])
    found = speed.map(data.shape[1])(
        data[:1], states[:n_x], states[n_x:], data[2 : 2 + n_u], ca.repmat(p, 1, data.shape[1])
    )
    fastest = float(np.abs(np.asarray(found)).max(initial=0.0)) or 1.0
    return tuple(share * fastest for share in WIDTHS)


def _solved(
    problem: Problem,
    values: np.ndarray,
    states: np.ndarray,
    given: tuple[np.ndarray, np.ndarray, float],
    hessian: Hessian,
) -> Solution:
    """Solve one programme; the nodes of the solution are the states at all samples."""
    w, data, width = given
    solver, samples, interval = _kept(problem, hessian)
    lower, upper = bounds(problem)
    theta = values[problem.layout.owners][problem.layout.runs].T
    theta = np.repeat(theta, problem.layout.length, axis=1)[:, samples]
    now = states[:, samples]
    stages = np.tile(now, ((interval.n - interval.n_p - len(now)) // max(1, len(now)), 1))
    guess = np.vstack([theta, now, stages])
    open_ends = np.full(guess.size, np.inf)
    columns = np.vstack([data[:, samples], np.tile(np.append(w, width)[:, None], samples.size)])
    result = solver(
        x0=np.concatenate([values, guess.ravel(order="F")]),
        p=columns.ravel(order="F"),
        lbx=np.concatenate([lower, -open_ends]),
        ubx=np.concatenate([upper, open_ends]),
        lbg=0.0,
        ubg=0.0,
    )
    stats = solver.stats()
    solution, message = np.asarray(result["x"]).ravel(), str(stats["return_status"])
    if not np.all(np.isfinite(solution)):
        raise SolverError(f"The fit of {problem.system.name} gave no finite parameters ({message}).")
    found, rest = np.split(solution, [values.size])
    every = np.zeros_like(states)
    every[:, samples] = rest.reshape(interval.n, -1, order="F")[interval.n_p :][: len(now)]
    success = message in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    return Solution(found, every, float(result["f"]), success, message, int(stats["iter_count"]))


def _kept(problem: Problem, hessian: Hessian) -> tuple[ca.Function, np.ndarray, Interval]:
    """Return the solver of a problem, which samples of the data it is about, and its interval; made once."""
    begins = problem.begins

    def make() -> tuple[Any, ...]:
        layout = problem.layout
        samples = np.concatenate(
            [first * layout.length + np.arange(n) for first, n in zip(layout.first, layout.run_lengths, strict=True)]
        )
        interval = interval_of(layout, hessian)
        # what the key is made of must live as long
        return collocation_programme(problem, interval, hessian), samples, interval, begins

    return once(problem.system, "collocation", (id(begins), hessian), make)[:3]
