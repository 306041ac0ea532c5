"""Which unknowns of an FMU depend on which knowns, by structure, through algebraic variables."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.fmi.equations import Equations


@dataclass(frozen=True, slots=True)
class Dependencies:
    """Boolean tables: a row for each rate, value or indicator, a column for time, states, inputs and parameters."""

    rates: np.ndarray
    values: np.ndarray
    indicators: np.ndarray


def dependencies_of(e: Equations) -> Dependencies:
    """Return the dependencies of an FMU in continuous time.

    Parameters
    ----------
    e
        The equations.
    """
    s = e.system
    known = ca.vertcat(s.time, s.x, s.u, s.p)
    inner = np.zeros((s.z.numel(), known.numel()), dtype=bool)
    if s.z.numel():
        inner = _inverse_pattern(_pattern(e.alg, s.z)) @ _pattern(e.alg, known)

    def through(expression: ca.SX) -> np.ndarray:
        direct = _pattern(expression, known)
        return direct | (_pattern(expression, s.z) @ inner) if s.z.numel() else direct

    return Dependencies(through(e.ode), through(e.values), through(e.indicators))


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
