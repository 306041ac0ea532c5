"""Which unknowns of an FMU depend on which knowns, by structure, through algebraic variables."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.fmi.equations import Equations
from cartpend_dae.fmi.start import StartProblem


@dataclass(frozen=True, slots=True)
class Dependencies:
    """Boolean tables: a row for each rate, value or indicator, a column for time, states, inputs and parameters.

    `start`, with the same columns twice, says on which of them each depends at the start, where states and parameters
    may follow from others.
    """

    rates: np.ndarray
    values: np.ndarray
    indicators: np.ndarray
    start: np.ndarray


def dependencies_of(e: Equations, start: StartProblem) -> Dependencies:
    """Return the dependencies of an FMU in continuous time, and at the start.

    Parameters
    ----------
    e, start
        The equations, and their start.
    """
    s = e.system
    known = ca.vertcat(s.time, s.x, s.u, s.p)
    inner = np.zeros((s.z.numel(), known.numel()), dtype=bool)
    if s.z.numel():
        inner = _inverse_pattern(_pattern(e.alg, s.z)) @ _pattern(e.alg, known)

    def through(expression: ca.SX) -> np.ndarray:
        direct = _pattern(expression, known)
        return direct | (_pattern(expression, s.z) @ inner) if s.z.numel() else direct

    return Dependencies(through(e.ode), through(e.values), through(e.indicators), _at_start(e, start))


def _at_start(e: Equations, start: StartProblem) -> np.ndarray:
    """Return on which of (time, states, inputs, parameters) each of these depends at the start."""
    s, n_v = e.system, start.point.size
    n_x, n_u = s.x.numel(), s.u.numel()
    depends = np.eye(1 + n_x + n_u + s.p.numel(), dtype=bool)
    if not n_v:
        return depends
    solve = start.functions[0]

    def pattern(argument: str) -> np.ndarray:
        return np.asarray(ca.DM(solve.jac_sparsity(0, solve.index_in(argument)), 1)) != 0

    given = pattern("s") & np.array(start.is_free, dtype=bool)  # the others are no knowns: something decides them
    known = np.hstack([pattern("t"), given, pattern("u"), pattern("p")])
    solved = _inverse_pattern(pattern("v")) @ known
    depends[1 : 1 + n_x] = solved[:n_x]
    for k, index in enumerate(start.unknown):
        depends[1 + n_x + n_u + index] = solved[n_v - len(start.unknown) + k]
    return depends


def _pattern(expression: ca.SX, symbols: ca.SX) -> np.ndarray:
    found = np.zeros((expression.numel(), symbols.numel()), dtype=bool)
    if found.size:
        rows, columns = ca.jacobian_sparsity(expression, symbols).get_triplet()
        found[rows, columns] = True
    return found


def _inverse_pattern(pattern: np.ndarray) -> np.ndarray:
    """Return where the inverse of a matrix of this pattern is not zero, told from random entries."""
    entries = np.random.default_rng(0).uniform(0.5, 2.0, pattern.shape) * pattern
    inverse = np.abs(np.linalg.inv(entries))
    return inverse > 1e-9 * inverse.max(initial=0.0)
