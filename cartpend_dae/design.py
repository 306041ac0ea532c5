"""State feedback for a linear model, u = -K x, by a quadratic cost or by the places of the poles."""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import (
    LinAlgError,
    matrix_balance,
    solve_continuous_are,
    solve_continuous_lyapunov,
    solve_discrete_are,
    solve_discrete_lyapunov,
    svd,
)
from scipy.signal import place_poles

from cartpend_dae.errors import ModelError, SolverError, unknown_name
from cartpend_dae.linear_model import FloatArray, LinearModel, matrix_lines, pole_text, sorted_poles
from cartpend_dae.quantities import is_number

Weights = Mapping[str, float] | Sequence[Sequence[float]] | FloatArray
EDGE = 1e-8
"""A pole this close to the edge of stability, against the size of A, counts as on it: a double one is as inexact."""
BLIND = 1e-7
"""A mode that the columns of B, or the weights, meet with no more than this is out of their reach."""


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """State feedback u = u_0 - K (x - x_0) about the operating point of `model`, by names.

    Parameters
    ----------
    model
        The linear model that the gains are for; sampled if they are.
    K
        Gains, shape (n_u, n_x) [unit of the input / unit of the state].
    poles
        Poles of the closed loop, the least stable first.
    """

    model: LinearModel
    K: FloatArray
    poles: NDArray[np.complex128]

    def of(self, name: str) -> dict[str, float]:
        """Return the gains from each state to an input.

        Raises
        ------
        ModelError
            If the model has no such input.
        """
        if name not in self.model.inputs:
            raise ModelError(unknown_name("input", name, list(self.model.inputs), self.model.name))
        row = self.K[self.model.inputs.index(name)]
        return dict(zip(self.model.states, row.tolist(), strict=True))

    def __str__(self) -> str:
        """Return the gains with names, and the poles of the closed loop."""
        kind = "continuous" if self.model.period is None else f"every {self.model.period:g} s"
        lines = [f"{self.model.name}, state feedback u = u_0 - K (x - x_0), {kind}"]
        lines += matrix_lines("K", self.model.inputs, self.model.states, self.K)
        poles = ", ".join(pole_text(complex(pole)) for pole in self.poles)
        return "\n".join([*lines, f"poles of the closed loop [{'1/s' if self.model.period is None else 'z'}]: {poles}"])

    __repr__ = __str__


def lqr(linear: LinearModel, *, Q: Weights, R: Weights, period: float | None = None) -> Gains:
    """Return the state feedback with the least cost: the integral, or sum over the samples, of x' Q x + u' R u.

    Parameters
    ----------
    linear
        The model; a continuous one gives continuous feedback, unless there is a `period`.
    Q
        The largest deviations to be tolerated, by the name of a state or output, SI units: each costs 1 at that size
        (weight 1/largest^2, Bryson's rule), what is not named costs nothing. Or the weights of the states as a
        matrix (n_x, n_x), symmetric and not negative.
    R
        The same for all inputs; a matrix (n_u, n_u) is positive.
    period
        Sampling period [s] of a controller whose output is held between the samples: the gains are those for the
        exactly discretised model.

    Raises
    ------
    ModelError
        For an unknown name, weights of another shape or sign, a mode that does not decay and that no input reaches, or
        one that neither grows nor decays and costs nothing.
    SolverError
        If the Riccati equation has no stabilising solution within rounding.

    References
    ----------
    A. E. Bryson, Y.-C. Ho (1975), Applied Optimal Control, Hemisphere, section 5.2 (weights).
    W. F. Arnold, A. J. Laub (1984), Proc. IEEE 72(12), 1746-1754, doi:10.1109/PROC.1984.13083 (Riccati equations).
    """
    model = linear if period is None else linear.discretize(period)
    q, n, r = _weights(model, Q, R)
    _check_reach(model)
    # with cross weights the cost is that of the states under the feedback u = -R^-1 N' x
    inner = model.A - model.B @ np.linalg.solve(r, n.T)
    _check_seen(model, inner, q - n @ np.linalg.solve(r, n.T))
    return _closed(model, _optimal(model, q, n, r))


def _optimal(model: LinearModel, q: FloatArray, n: FloatArray, r: FloatArray) -> FloatArray:
    """Return the gains of least cost, (n_u, n_x): by the Riccati equation, then refined.

    With the factor of r as the unit of the inputs, and the cost in a unit s that makes B B'/s and q/s alike, the
    equation is solved to rounding whatever the weights are counted in. Each refinement takes the cost of the feedback
    by Lyapunov's equation, and the best feedback for this cost (D. L. Kleinman, IEEE Trans. Automat. Control 13
    (1968), 114-115, doi:10.1109/TAC.1968.1098829).
    """
    unit = np.linalg.inv(np.linalg.cholesky(r)).T
    reach = float(np.linalg.norm(model.B @ unit, 2)) or 1.0
    size = (float(np.linalg.norm(q, 2)) ** 0.5 or 1 / reach) / reach
    unit = unit * size**0.5
    problem = _Problem(model.A, model.B @ unit, q / size, n @ unit / size, model.period is not None)
    try:
        with warnings.catch_warnings(action="ignore"):  # what rounding spoils is found below
            K = problem.solution()
            for _ in range(10):
                _check_stable(model, sorted_poles(problem.A - problem.B @ K, model.period))
                last, K = K, problem.refined(K)
                if np.abs(K - last).max() <= 1e-9 * np.abs(K).max():
                    return np.asarray(unit @ K, dtype=float)
    except (LinAlgError, ValueError) as error:
        raise SolverError(f"{model.name}: no state feedback was found ({error}). Choose other weights.") from None
    raise SolverError(f"{model.name}: no state feedback was found (rounding is too large). Choose other weights.")


@dataclass(frozen=True, slots=True)
class _Problem:
    """Least cost of x' q x + 2 x' n u + u' u, by the letters of Riccati's equation."""

    A: FloatArray
    B: FloatArray
    q: FloatArray
    n: FloatArray
    is_sampled: bool

    def solution(self) -> FloatArray:
        solve = solve_discrete_are if self.is_sampled else solve_continuous_are
        return self._best(solve(self.A, self.B, self.q, np.eye(self.B.shape[1]), s=self.n))

    def refined(self, K: FloatArray) -> FloatArray:
        """Return the best feedback for the cost that the feedback u = -K x has."""
        loop = self.A - self.B @ K
        cost = self.q - self.n @ K - (self.n @ K).T + K.T @ K
        if self.is_sampled:
            return self._best(solve_discrete_lyapunov(loop.T, cost))
        return self._best(solve_continuous_lyapunov(loop.T, -cost))

    def _best(self, cost: FloatArray) -> FloatArray:
        if not self.is_sampled:
            return self.B.T @ cost + self.n.T
        size = np.eye(self.B.shape[1]) + self.B.T @ cost @ self.B
        return np.asarray(np.linalg.solve(size, self.B.T @ cost @ self.A + self.n.T), dtype=float)


def place(linear: LinearModel, poles: Sequence[complex], *, period: float | None = None) -> Gains:
    """Return the state feedback that gives the closed loop these poles, those of least sensitivity with several inputs.

    Parameters
    ----------
    linear
        The model; a continuous one gives continuous feedback, unless there is a `period`.
    poles
        One pole for each state, complex ones in pairs [1/s]; with a `period` too they are those in time, and
        z = exp(pole period). None may stand more often than there are inputs.
    period
        Sampling period [s] of a controller whose output is held between the samples.

    Raises
    ------
    ModelError
        For another number of poles, one without its pair, or a mode that no input reaches.

    References
    ----------
    A. L. Tits, Y. Yang (1996), IEEE Trans. Automat. Control 41(10), 1432-1452, doi:10.1109/9.539425.
    """
    model = linear if period is None else linear.discretize(period)
    wanted = np.array(poles, dtype=complex)
    if wanted.shape != (len(model.states),) or not np.all(np.isfinite(wanted)):
        raise ModelError(
            f"{model.name} has {len(model.states)} states: give as many finite `poles`, not {wanted.size}."
        )
    _check_reach(model, every_mode=True)
    wanted = wanted if period is None else np.exp(wanted * period)
    try:
        K = np.asarray(getattr(place_poles(model.A, model.B, wanted), "gain_matrix"), dtype=float)  # noqa: B009 (untyped)
    except ValueError as error:
        raise ModelError(f"{model.name}: these poles cannot be placed: {' '.join(str(error).split())}.") from None
    return _closed(model, K)


def _closed(model: LinearModel, K: FloatArray) -> Gains:
    return Gains(model, K, sorted_poles(model.A - model.B @ K, model.period))


def _check_stable(model: LinearModel, poles: NDArray[np.complex128]) -> None:
    if np.any(_margins(poles, model.period) <= 0):
        raise SolverError(
            f"{model.name}: rounding leaves the closed loop with the pole {pole_text(complex(poles[0]))}, which does "
            f"not decay. Scale the weights to what is tolerable, or leave out states that no output needs."
        )


def _margins(poles: NDArray[np.complex128], period: float | None) -> FloatArray:
    """Return how far poles are inside the region of stability."""
    return -poles.real if period is None else 1.0 - np.abs(poles)


def _weights(model: LinearModel, Q: Weights, R: Weights) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the weights of states (n_x, n_x), of states with inputs (n_x, n_u), and of inputs (n_u, n_u)."""
    n_x, n_u = model.B.shape
    if not n_x or not n_u:
        raise ModelError(f"{model.name} has {n_x} states and {n_u} inputs here: there is nothing to feed back.")
    if isinstance(R, Mapping):
        costs = _costs("R", R, model, "input", model.inputs)
        missing = [name for name in model.inputs if name not in R]
        if missing:
            raise ModelError(f"`R` gives no largest value of {_listed(missing)}: every input has a cost.")
        r = np.diag([costs[name] for name in model.inputs])
    else:
        r = _matrix("R", R, n_u)
    if np.linalg.eigvalsh(r)[0] <= 0:
        raise ModelError("`R` must be positive definite: every input has a cost.")
    if not isinstance(Q, Mapping):
        return _matrix("Q", Q, n_x), np.zeros((n_x, n_u)), r
    known = (*model.states, *model.outputs)
    weight = np.array([*_costs("Q", Q, model, "state or output", known).values()], dtype=float)
    rows = [known.index(name) for name in Q]
    of_x = np.vstack([np.eye(n_x), model.C])[rows]
    of_u = np.vstack([np.zeros((n_x, n_u)), model.D])[rows]
    scaled = weight[:, None] * of_x
    return of_x.T @ scaled, scaled.T @ of_u, r + of_u.T @ (weight[:, None] * of_u)


def _costs(
    argument: str, given: Mapping[str, float], model: LinearModel, kind: str, known: Sequence[str]
) -> dict[str, float]:
    """Return 1/largest^2 by name."""
    for name, value in given.items():
        if name not in known:
            raise ModelError(unknown_name(kind, name, list(dict.fromkeys(known)), f"The linear model of {model.name}"))
        if not is_number(value) or not 0 < value < math.inf:
            raise ModelError(
                f"`{argument}` gives for `{name}` the largest tolerable value {value!r}; it must be a positive number."
            )
    return {name: float(value) ** -2.0 for name, value in given.items()}


def _matrix(argument: str, given: object, n: int) -> FloatArray:
    try:
        matrix = np.array(given, dtype=float)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (n, n) or not np.all(np.isfinite(matrix)):
        raise ModelError(f"`{argument}` must be a dictionary of names, or a matrix of {n} x {n} finite numbers.")
    size = np.abs(matrix).max()
    if np.abs(matrix - matrix.T).max() > 1e-12 * size or np.linalg.eigvalsh(matrix)[0] < -1e-12 * size:
        raise ModelError(f"`{argument}` must be symmetric, and no deviation may have a negative cost.")
    return matrix


def _check_reach(model: LinearModel, *, every_mode: bool = False) -> None:
    """Refuse modes that no input reaches; those that decay only if `every_mode` is to be moved."""
    blind = _blind_modes(model.A.T, model.B.T, model.period, -math.inf, math.inf if every_mode else EDGE)
    if blind:
        raise ModelError(
            f"{model.name} cannot be controlled: no input of {_listed(model.inputs)} reaches {_modes(model, blind)}. "
            f"Add an input that acts there, or take these states out of the model."
        )


def _check_seen(model: LinearModel, matrix: FloatArray, q: FloatArray) -> None:
    """Refuse modes that neither grow nor decay and that cost nothing: the feedback would leave them as they are."""
    blind = _blind_modes(matrix, q, model.period, -EDGE, EDGE)
    if blind:
        raise ModelError(
            f"{model.name}: `Q` gives no cost to a motion of {_modes(model, blind)}, which the feedback would leave as "
            f"it is. Give the largest tolerable value of one of these states, or of an output that shows it."
        )


def _blind_modes(
    matrix: FloatArray, rows: FloatArray, period: float | None, low: float, high: float
) -> list[tuple[complex, list[int]]]:
    """Return modes that `rows` do not show, with where they stand, of margins between low and high times the size.

    By the test of Popov, Belevitch and Hautus on balanced matrices: a mode v with matrix v = pole v and rows v = 0.
    """
    balanced, scale = matrix_balance(matrix, permute=False, separate=True)
    rows = rows * scale[0]
    size = max(float(np.abs(balanced).max()), 1e-300) if period is None else 1.0
    rows = rows * (size / max(float(np.abs(rows).max()), 1e-300))
    found: list[tuple[complex, list[int]]] = []
    for pole in np.linalg.eigvals(balanced).astype(complex):
        margin = float(_margins(np.array([pole]), period)[0])
        if pole.imag < 0 or not low * size <= margin <= high * size:
            continue
        _, values, directions = svd(np.vstack([balanced - pole * np.eye(len(balanced)), rows]))
        if values[-1] <= BLIND * size:
            shape = np.abs(directions[-1])
            found.append((complex(pole), np.flatnonzero(shape > 0.1 * shape.max()).tolist()))
    return found


def _modes(model: LinearModel, blind: list[tuple[complex, list[int]]]) -> str:
    where = {tuple(places): pole for pole, places in blind}
    parts = [f"{_listed([model.states[i] for i in places])} (pole {pole_text(pole)})" for places, pole in where.items()]
    return " and ".join(parts)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "none"
