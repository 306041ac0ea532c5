"""Which integrators are tried, in which order: by the kind of system and its fastest rate."""

from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from cartpend_dae.begin import Begin
from cartpend_dae.errors import ModelError
from cartpend_dae.hybrid_problem import replaced
from cartpend_dae.inputs import DrivenInputs, input_values, jumps_of
from cartpend_dae.prepared import content, once

Method = Literal["adaptive", "cvodes", "idas", "erk", "rosenbrock", "rk4"]
# erk is stable up to steps of about this over the fastest rate; beyond so many steps the implicit method is faster,
# which errs more often at events: the acceleration of a body at rest flickers by rounding
STABLE, MOST_STEPS = 3.3, 300_000
# compiled, an explicit step costs a quarter of an implicit one, of which a few thousand are enough
FEW_STEPS = 20_000


@dataclass(frozen=True, slots=True)
class Choice:
    """An integrator and its tolerances; `is_differentiated` asks for one whose derivatives are exact."""

    method: Method
    rtol: float
    atol: float
    is_compiled: bool = False
    is_differentiated: bool = False


def plugins(begin: Begin, driven: DrivenInputs, grid: np.ndarray, choice: Choice) -> tuple[str, ...]:
    """Return the integrators to try, in this order.

    Raises
    ------
    ModelError
        For an integrator that cannot locate events.
    """
    method = choice.method
    if begin.machine is not None:
        if method in ("cvodes", "idas"):
            what = "dry friction" if begin.system.hybrid.is_empty else "the model"
            raise ModelError(f"Method `{method}` cannot locate the events of {what}; use `adaptive`.")
        if method != "adaptive":
            return (method,)
        if begin.z.size:
            return ("rosenbrock",)
        n_steps = _fastest_rate(begin, driven, grid) * float(grid[-1] - grid[0]) / STABLE
        most = FEW_STEPS if choice.is_compiled else MOST_STEPS
        return ("erk", "rosenbrock") if n_steps < most else ("rosenbrock", "erk")
    if method != "adaptive":
        return (method,)
    if choice.is_compiled or choice.is_differentiated:  # cvodes and idas cannot be
        n_steps = _fastest_rate(begin, driven, grid) * float(grid[-1] - grid[0]) / STABLE
        return ("erk",) if n_steps < FEW_STEPS and not begin.z.size else ("rosenbrock",)
    if begin.system.algebraics:
        return ("idas", "rosenbrock")
    # cvodes gives up now and then where an input jumps
    return ("cvodes", "rosenbrock") if jumps_of(driven, grid).any() else ("cvodes",)


def _fastest_rate(begin: Begin, driven: DrivenInputs, grid: np.ndarray) -> float:
    """Return the largest eigenvalue of the state equations at the start [1/s]; infinite for a large system."""
    if begin.x.size > 200:
        return np.inf
    u = begin.inputs(input_values(driven, grid[:1], driven.left[:, :1])[:, 0])
    key = (content(begin.x, begin.z, u, begin.p, begin.memory), float(grid[0]))
    return once(begin.between, "fastest rate", key, lambda: _rate(begin, u, float(grid[0])))


def _rate(begin: Begin, u: np.ndarray, time: float) -> float:
    made, s = begin.machine, begin.between
    ode, symbols, modes = s.ode, ca.SX(0, 1), np.zeros(0)
    if made is not None:
        (ode,) = replaced([s.ode], [(s.frictions.force, made.force)])
        symbols, modes = made.memory.modes, made.memory.split(begin.memory)["modes"]
    slopes = ca.Function("slopes", [s.time, s.x, s.z, s.u, s.p, symbols], [ca.jacobian(ode, s.x)])
    values = np.asarray(slopes(time, begin.x, begin.z, u, begin.p, modes))
    return float(np.abs(np.linalg.eigvals(values)).max(initial=0.0)) if np.all(np.isfinite(values)) else np.inf
