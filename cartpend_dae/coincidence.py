"""Events that coincide: CasADi differentiates the instant of one of them, and gives it to all that happens there.

That is right where one surface is crossed (two conditions on one speed, two clocks with one period) and wrong where two
are crossed that a parameter moves apart, such as two balls that land together: each has an instant of its own.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from cartpend_dae.integration import Integration

# events this part of the whole time apart coincide; at the instant that is located rounding leaves 1e-12 of it
TOGETHER = 1e-9
# gradients whose directions differ by less are those of one surface
PARALLEL = 1e-7


@dataclass(frozen=True, slots=True)
class Coincidence:
    """The first instant [s] at which two surfaces are crossed, and the numbers of their indicators."""

    time: float
    indicators: tuple[int, int]


def coincidence(whole: Integration, plugin: str, directions: np.ndarray) -> Coincidence | None:
    """Repeat a run and return the first coincidence of events whose instants move apart; None without any.

    Parameters
    ----------
    whole, plugin
        What was integrated, and by what: with events.
    directions
        The changes of the parameters by which it is differentiated (n_p, n_directions).
    """
    problem, transition = whole.problem, whole.options["transition"]
    n_x, book = problem["x"].numel(), ca.SX.sym("book", 3)  # the time and the indicators, from 1
    x = ca.vertcat(problem["x"], book)
    posed = problem | {"x": x, "ode": ca.vertcat(problem["ode"], ca.SX.zeros(3))}
    noted = _noted(problem, directions, float(whole.grid[-1] - whole.grid[0]))
    names = [transition.name_in(i) for i in range(transition.n_in())]
    inputs = [ca.MX.sym(name, transition.sparsity_in(i)) for i, name in enumerate(names)]
    inputs[2] = ca.MX.sym(names[2], n_x + 3)
    fired, time, state, *others = inputs
    after_x, after_z = transition(fired, time, state[:n_x], *others)
    after = [ca.vertcat(after_x, noted(fired, time, state[:n_x], *others, state[n_x:])), after_z]
    wrapped = ca.Function("transition", inputs, after, ca.event_in(), ca.event_out())
    again = replace(
        whole,
        key=(whole.key, "coincidence", directions.tobytes()),
        problem=posed,
        options=whole.options | {"transition": wrapped},
        x=np.append(whole.x, np.zeros(3)),
        is_compiled=False,
    )
    result, _ = again.run(plugin, whole.grid.size)
    if result is None:
        return None
    when, first, second = result["xf"][-3:, -1]
    return Coincidence(float(when), (round(first) - 1, round(second) - 1)) if second > 0.5 else None


def _noted(problem: dict[str, ca.SX], directions: np.ndarray, span: float) -> ca.Function:
    """Return (fired, t, x, z, p, u, book) -> book, with the first coincidence noted."""
    x, z, p, u, t, zero = (problem[name] for name in ("x", "z", "p", "u", "t", "zero"))
    n = zero.numel()
    fired, book = ca.SX.sym("fired"), ca.SX.sym("book", 3)
    in_x, in_t = ca.densify(ca.jacobian(zero, x)), ca.densify(ca.jacobian(zero, t))
    slopes, rates = [in_x, in_t, ca.densify(ca.jacobian(zero, p) @ ca.DM(directions))], in_x @ problem["ode"] + in_t
    if z.numel():
        slopes.append(ca.densify(ca.jacobian(zero, z)))
        in_z = ca.solve(ca.jacobian(problem["alg"], z), ca.densify(ca.jacobian(problem["alg"], x) @ problem["ode"]))
        rates = rates - ca.jacobian(zero, z) @ in_z
    every = ca.horzcat(*slopes)
    one = ca.vertcat(*[fired == k for k in range(n)])
    own = one.T @ every
    sizes = ca.sum2(every * every)
    cosines = (every @ own.T) ** 2 / (sizes * ca.sumsqr(own) + 1e-300)
    near = ca.logic_and(ca.fabs(zero) <= TOGETHER * span * ca.fabs(rates), ca.fabs(rates) > 0)
    apart = ca.logic_and(near, ca.logic_and(one == 0, cosines < 1 - PARALLEL))
    number = ca.mmax(apart * ca.SX(ca.DM(list(range(1, n + 1)))))
    new = ca.vertcat(t, fired + 1, number)
    noted = ca.if_else(ca.logic_and(book[2] == 0, number > 0), new, book)
    return ca.Function("noted", [fired, t, x, z, p, u, book], [noted])
