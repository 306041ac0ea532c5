"""A run by the engine in C, where it can."""

import logging
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.begin import Begin, Run
from cartpend_dae.inputs import DrivenInputs, jumps_of
from cartpend_dae.native.run import Engine, Settings, loaded
from cartpend_dae.plugins import Choice, plugins
from cartpend_dae.prepared import once

logger = logging.getLogger(__name__)

# with more states and algebraic variables the dense matrices of the engine cost more than sparse ones
MOST_STATES = 60


@dataclass(frozen=True, slots=True)
class Attempt:
    """A run, and the least value and the largest magnitude of each indicator (n_g,) at its times."""

    run: Run
    lowest: np.ndarray
    largest: np.ndarray


def native_run(begin: Begin, driven: DrivenInputs, grid: np.ndarray, choice: Choice, longest: float) -> Attempt | None:
    """Integrate over a grid; None for a method or a size that the engine lacks, without a compiler, or if it fails.

    Parameters
    ----------
    begin, driven, grid, choice
        As `integrate` takes them.
    longest
        Longest step where something may be passed over [s].
    """
    if begin.x.size + begin.z.size > MOST_STATES:
        return None
    engine = _engine(begin, driven)
    if engine is None:
        return None
    if begin.machine is None and not engine.depends_on_time:
        longest = float(grid[-1] - grid[0])
    inputs = np.hstack([driven.left.T, driven.slope.T, grid[:-1, None]]), jumps_of(driven, grid)
    for plugin in plugins(begin, driven, grid, choice):
        if plugin not in ("erk", "rosenbrock"):
            return None
        settings = Settings(plugin, choice.rtol, choice.atol, longest)
        try:
            run = engine.run(settings, (begin.x, begin.z, begin.memory, begin.p), grid, inputs)
        except RuntimeError as error:
            logger.info("%s: the engine in C stops with %s: %s", begin.system.name, plugin, error)
            continue
        memory = None if begin.machine is None else run.memory
        return Attempt(Run(run.x, run.z, memory, (run.variables, run.columns)), run.lowest, run.largest)
    return None


def _engine(begin: Begin, driven: DrivenInputs) -> Engine | None:
    """Return the engine of a system, which keeps it for the runs that follow."""
    system, symbol = begin.system, begin.system.time
    functions = [ca.Function("f", [symbol], [ca.SX(of(symbol))]).serialize() for of in driven.expressions.values()]
    key = (begin.machine is not None, *driven.expressions, *functions)
    return once(system, "engine", key, lambda: loaded(system, begin.machine, driven.expressions))
