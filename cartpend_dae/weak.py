"""What the data of a problem cannot identify: directions of the parameters that no output shows.

With the sensitivities S of the outputs to the logarithms of the parameters, weighed by the noise, and free start
values eliminated, F = S' S is the information. An eigenvector v of it with the eigenvalue f says that along
p_i exp(v_i t) the outputs show t with the standard deviation 1/sqrt(f); white noise is assumed. Where that is more
than 1, parameters may be wrong by a factor of e, and the data do not identify the direction.
"""

import re
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca
import numpy as np

from cartpend_dae.dae import parameter_vector
from cartpend_dae.problem import Problem, dominant_frequency
from cartpend_dae.shooting import linearised
from cartpend_dae.transcribe import Free

UNSEEN = 1.0
"""Standard deviation of a logarithm from which on a direction counts as not identified."""
BLIND = 1e-9
"""Sensitivity, relative to the largest, below which a direction is lost in rounding."""


@dataclass(frozen=True, slots=True)
class WeakDirections:
    """Parameters that share directions no output shows: `combinations` of them are all that can be known.

    `sd` is the standard deviation of the logarithm along the best of these directions, infinite if nothing shows.
    """

    parameters: tuple[str, ...]
    combinations: tuple[str, ...]
    sd: float

    def __str__(self) -> str:
        names = _listing(self.parameters)
        if not self.combinations:
            return f"{names} {'is' if len(self.parameters) == 1 else 'are'} not identified: no output shows a change."
        near = (
            " near the guesses"
            if any("." in part for part in re.findall(r"\^([\d.]+)", str(self.combinations)))
            else ""
        )
        return f"{names} are not identified one by one: only {_listing(self.combinations)}{near}."


def weak_directions(problem: Problem) -> tuple[WeakDirections, ...]:
    """Return the groups of free parameters of a problem that its runs cannot tell apart at the guesses.

    Parameters
    ----------
    problem
        The problem; its start values are free where the runs say so.
    """
    names = tuple(item.name for item in problem.free)
    if not names:
        return ()
    information = log_information(problem)
    size = np.sqrt(np.diag(information))
    rows = [np.eye(len(names))[i] for i in np.flatnonzero(~(size > BLIND * size.max(initial=0.0)))]
    seen = np.flatnonzero(size > BLIND * size.max(initial=0.0))
    values, vectors = np.linalg.eigh(information[np.ix_(seen, seen)])
    limit = max(1 / UNSEEN**2, BLIND * values.max(initial=0.0))
    rows += [np.eye(len(names))[seen].T @ vectors[:, k] for k in np.flatnonzero(values < limit)]
    if not rows:
        return ()
    reduced, pivots = _reduced(np.array(rows))
    return tuple(
        _group(problem.free, reduced, pivots, members, information) for members in _connected(np.abs(reduced) > 1e-3)
    )


def log_information(problem: Problem) -> np.ndarray:
    """Return the information on the logarithms of the free parameters, shape (n, n), start values eliminated.

    A parameter with the guess zero has no logarithm and counts in units of its scale.
    """
    grams = _gram(problem, 0.0)
    if not np.isfinite(grams).all():
        # a free simulation runs away; predictions from the measured past show the same directions
        grams = _gram(problem, 5 * dominant_frequency(problem.experiments))
    n = len(problem.free)
    logs = np.array([item.guess / item.scale or 1.0 for item in problem.free])
    own = grams[:n, :n] * np.outer(logs, logs)
    cross, starts = grams[:n, n:] * logs[:, None], grams[n:, n:]
    return own - cross @ np.linalg.pinv(starts, rcond=1e-12, hermitian=True) @ cross.T if starts.size else own


def _gram(problem: Problem, bandwidth: float) -> np.ndarray:
    return linearised(problem, {}, bandwidth, problem.prior_sd).grams.sum(axis=0)


def _reduced(rows: np.ndarray) -> tuple[np.ndarray, tuple[int, ...]]:
    """Bring the rows to reduced echelon form with the largest entries as pivots; return it and the pivot columns."""
    rows, pivots = rows.copy(), []
    for k in range(len(rows)):
        open_columns = [j for j in range(rows.shape[1]) if j not in pivots]
        # of equal entries the last: the parameter named first then stands above the line
        _, _, row, column = max(
            (round(abs(float(rows[i, j])), 6), j, i, j) for i in range(k, len(rows)) for j in open_columns
        )
        rows[[k, row]] = rows[[row, k]]
        rows[k] /= rows[k, column]
        others = [i for i in range(len(rows)) if i != k]
        rows[others] -= np.outer(rows[others, column], rows[k])
        pivots.append(column)
    return rows, tuple(pivots)


def _connected(touches: np.ndarray) -> list[list[int]]:
    """Group the rows that share a column; return the rows of each group."""
    groups: list[list[int]] = []
    for row in range(len(touches)):
        joined = [group for group in groups if (touches[group].any(axis=0) & touches[row]).any()]
        groups = [group for group in groups if group not in joined] + [[row, *(k for group in joined for k in group)]]
    return [sorted(group) for group in groups]


def _group(
    free: tuple[Free, ...], reduced: np.ndarray, pivots: tuple[int, ...], members: list[int], information: np.ndarray
) -> WeakDirections:
    names, block = [item.name for item in free], reduced[members]
    involved = np.flatnonzero((np.abs(block) > 1e-3).any(axis=0))
    own = [pivots[row] for row in members]
    combinations = tuple(
        _monomial([(names[i], 1.0), *((names[j], -float(block[k, i])) for k, j in enumerate(own))])
        for i in involved
        if i not in own
    )
    if len(members) == 1 and len(involved) == 2 and _is_sum([free[i] for i in involved], block[0, involved]):
        combinations = (" + ".join(names[i] for i in involved),)
    norm = block / np.linalg.norm(block, axis=1, keepdims=True)
    seen = float(np.einsum("ki,ij,kj->k", norm, information, norm).max())
    sd = 1 / np.sqrt(seen) if seen > BLIND * np.diag(information).max() else np.inf
    return WeakDirections(tuple(names[i] for i in involved), combinations, float(sd))


def _is_sum(pair: list[Free], direction: np.ndarray) -> bool:
    """Whether the direction adds to one parameter what it takes from another of the same unit."""
    (one, other), (up, down) = pair, direction
    return one.unit == other.unit and abs(up * one.guess + down * other.guess) < 0.02 * abs(up * one.guess)


def _monomial(factors: list[tuple[str, float]]) -> str:
    """Write a product of powers: `cart.m/motor.k`, `a.x^0.4*b.y/(c.z*d.w)`."""
    above = [_power(name, x) for name, x in factors if x > 1e-3]
    below = [_power(name, -x) for name, x in factors if x < -1e-3]
    bottom = "*".join(below) if len(below) < 2 else f"({'*'.join(below)})"
    return "*".join(above) + (f"/{bottom}" if below else "")


def _power(name: str, exponent: float) -> str:
    near = Fraction(exponent).limit_denominator(4)
    if abs(exponent - near) > 0.02:
        return f"{name}^{exponent:.2g}"
    if near == 1:
        return name
    return f"{name}^{near}" if near.denominator == 1 else f"{name}^({near})"


def _listing(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def too_slow(problem: Problem) -> str:
    """Say that the samples of a run cannot show any motion of the model at the guesses; empty if they can.

    Refused is only what must be a mistake, such as milliseconds read as seconds: the slowest motion is a vibration
    and has less than two samples a period.
    """
    system = problem.system
    step = float(np.median(np.diff(problem.experiments[0].time)))
    names = ("time", "x", "z", "u", "p")
    jacobian = ca.Function(
        "jacobian",
        [*(getattr(system, name) for name in names), system.frictions.force],
        [ca.jacobian(system.ode, system.x)],
    )
    p = parameter_vector(system, {item.name: item.guess for item in problem.free})
    zeros = [np.zeros(s.numel()) for s in (system.z, system.u)]
    value = np.asarray(jacobian(0.0, problem.starts[0].x, *zeros, p, np.zeros(system.frictions.force.numel())))
    if not value.size or not np.isfinite(value).all():
        return ""
    poles = np.linalg.eigvals(value)
    moving = poles[np.abs(poles) > 1e-9 * max(1e-9, np.abs(poles).max())]
    slowest = moving[np.argmin(np.abs(moving))] if moving.size else 0.0
    if abs(np.imag(slowest)) < 0.5 * abs(slowest) or abs(slowest) * step < np.pi:
        return ""
    return (
        f"the samples are {step:g} s apart, but the slowest motion of the model at the guesses is a vibration of "
        f"{2 * np.pi / abs(slowest):.3g} s; if the time is in `ms`, say so by `unit` in `time`, else mend the guesses."
    )
