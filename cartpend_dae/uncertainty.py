"""How sure estimates are: covariance, status, intervals, and the directions that the data leave open."""

from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np

from cartpend_dae.directions import blind_directions
from cartpend_dae.errors import SolverError
from cartpend_dae.piece_scatter import with_piece_scatter
from cartpend_dae.problem import Problem
from cartpend_dae.residual_noise import NoiseModel, meat, noise_model
from cartpend_dae.unknowns import Free

Status = Literal["ok", "at-bound", "unidentifiable", "fixed"]

# singular values relative to the largest below which the data do not see a direction: 1e-5 of the sensitivity
BLIND = 1e-10
_SEVERITY: tuple[Status, ...] = ("ok", "fixed", "at-bound", "unidentifiable")
NORMAL_95 = 1.959963984540054
# of the standard deviation with all else known: closer to its bound a value stands on it
ON_BOUND = 1e-3


@dataclass(frozen=True, slots=True)
class Estimate:
    """An estimated quantity in SI units: value, standard deviation, and the interval that holds it with 95 %."""

    name: str
    value: float
    sd: float
    unit: str
    status: Status
    interval: tuple[float, float] = (-np.inf, np.inf)

    def with_sd(self, sd: float) -> "Estimate":
        """Return the same estimate with another standard deviation, and the interval that goes with it."""
        return replace(self, sd=sd, interval=(self.value - NORMAL_95 * sd, self.value + NORMAL_95 * sd))


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """What is known of all variables of a problem: `covariance` (n_all, n_all) in SI; see `identify.Fit`."""

    estimates: tuple[Estimate, ...]
    tied: tuple[Estimate, ...]
    covariance: np.ndarray
    blind: tuple[str, ...]
    noise: NoiseModel


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def uncertainty(
    problem: Problem, values: np.ndarray, residuals: list[np.ndarray], slopes: list[np.ndarray]
) -> Uncertainty:
    """Say how sure the variables of a problem are at its solution.

    The covariance is the sandwich G^-1 M G^-1 with the Hessian G of Gauss and Newton and the covariance M of the
    gradient under the noise that the residuals show, coloured where they are; where runs are in pieces, at least the
    scatter of the jackknife over these. Directions that the data do not see have infinite variance; a variable on its
    bound is held there.

    Parameters
    ----------
    problem
        The problem.
    values
        Scaled variables at the solution (n_all,).
    residuals, slopes
        Of each run: weighted residuals (n, n_y), NaN where not measured, and their derivatives (n, n_y, n_all).

    Raises
    ------
    SolverError
        The derivatives grew beyond all bounds.

    References
    ----------
    H. White, Econometrica 50 (1982), 1-25, doi:10.2307/1912526 (the sandwich).
    """
    everything = problem.variables
    slope = np.array([item.slope(value) for item, value in zip(everything, values, strict=True)])
    known = np.array(
        [(k / item.prior.sd) ** 2 if item.prior else 0.0 for k, item in zip(slope, everything, strict=True)]
    )
    information = known + sum((np.sum(run**2, axis=(0, 1)) for run in slopes), np.zeros(len(everything)))
    status: list[Status] = [_bound_status(*given) for given in zip(everything, values, information, strict=True)]
    inside = [i for i, state in enumerate(status) if state == "ok"]
    noise = noise_model(residuals, len(inside))
    flat = [run.reshape(-1, len(everything))[:, inside] for run in slopes]
    prior = np.diag(known[inside])
    gram = sum((part.T @ part for part in flat), np.zeros((len(inside), len(inside)))) + prior
    middle = meat([run[:, :, inside] for run in slopes], noise) + prior
    inverse, null, unseen = seen_inverse(gram)
    covariance = np.zeros((len(everything), len(everything)))
    sandwich = inverse @ middle @ inverse
    covariance[np.ix_(inside, inside)] = with_piece_scatter(problem, inside, residuals, slopes, gram, sandwich)
    covariance *= np.outer(slope, slope)
    for i in np.flatnonzero(unseen):
        status[inside[i]] = "unidentifiable"
        covariance[inside[i], inside[i]] = np.inf
    for i, state in enumerate(status):
        if state == "at-bound":
            covariance[i, i] = np.nan
    numbers = np.array([item.value(value) for item, value in zip(everything, values, strict=True)], dtype=float)
    estimates = tuple(
        _estimate(item, number, covariance[i, i], state)
        for i, (item, number, state) in enumerate(zip(everything, numbers, status, strict=True))
    )
    names = tuple(everything[i].name for i in inside)
    blind = blind_directions(names, numbers[inside], null * slope[inside][:, None])
    return Uncertainty(estimates, _tied(problem, values, covariance, slope, status), covariance, blind, noise)


def _bound_status(item: Free, value: float, information: float) -> Status:
    """Say whether a value stands on a bound: closer than a thousandth of what the data could tell with all else known.

    The scale of the variable is the solver's and says nothing of that; what the data do not see at all must be closer
    than the solver's tolerance.
    """
    span = min(ON_BOUND / np.sqrt(max(information, 1e-300)), 1e-6 * max(1.0, abs(value)))
    is_inside = item.scaled(item.lower) + span < value < item.scaled(item.upper) - span
    return "ok" if is_inside else "at-bound"


def seen_inverse(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the inverse on what the data see, the directions (n, n_null) that they do not see, and who is in them.

    A variable is in a direction by what it would do to the residuals, whatever its scale.

    Raises
    ------
    SolverError
        The sensitivities grew beyond all bounds.
    """
    if not np.all(np.isfinite(gram)):
        raise SolverError("The fit ended where the sensitivities of the simulation grow beyond all bounds.")
    size = np.sqrt(np.clip(np.diag(gram), 1e-300, None))
    eigenvalues, vectors = np.linalg.eigh(gram / np.outer(size, size))
    good = eigenvalues > BLIND * max(1.0, eigenvalues.max(initial=0.0))
    inverse = (vectors[:, good] / eigenvalues[good]) @ vectors[:, good].T
    unseen = np.abs(vectors[:, ~good]).max(axis=1, initial=0.0) > 1e-3
    null = vectors[:, ~good] / size[:, None]
    # a variable that moves nothing has no size of its own
    null /= np.maximum(np.abs(null).max(axis=0, initial=0.0), 1e-300)
    return inverse / np.outer(size, size), null, unseen


def _estimate(item: Free, value: float, variance: float, status: Status) -> Estimate:
    sd = float(np.sqrt(variance))
    if item.is_log and np.isfinite(sd):
        factor = float(np.exp(NORMAL_95 * sd / value))
        interval = (float(value / factor), float(value * factor))
    else:
        interval = (float(value - NORMAL_95 * sd), float(value + NORMAL_95 * sd))
    return Estimate(item.name, float(value), sd, item.unit, status, interval)


def _tied(
    problem: Problem, values: np.ndarray, covariance: np.ndarray, slope: np.ndarray, status: list[Status]
) -> tuple[Estimate, ...]:
    """Return the parameters that follow from others, as they are in the first run."""
    layout = problem.layout
    if not layout.ties:
        return ()
    theta = ca.SX.sym("theta", len(layout.slots))
    p = problem.functions.parameters(theta)[[tie.index for tie in layout.ties]]
    function = ca.Function("tied", [theta], [p, ca.jacobian(p, theta)])
    owners = layout.owners[0]
    numbers, slopes = (np.asarray(part) for part in function(values[owners]))
    found = []
    for tie, number, row in zip(layout.ties, numbers.ravel(), slopes, strict=True):
        used = np.flatnonzero(row)
        states = [status[owners[i]] for i in used]
        worst = _SEVERITY[max((_SEVERITY.index(state) for state in states), default=0)]
        part = covariance[np.ix_(owners[used], owners[used])]
        gradient = row[used] / slope[owners[used]]
        with np.errstate(invalid="ignore"):
            sd = float(np.sqrt(gradient @ part @ gradient)) if worst == "ok" else float("inf")
        unit = problem.system.parameters[tie.index].declaration.unit
        interval = (float(number) - NORMAL_95 * sd, float(number) + NORMAL_95 * sd)
        found.append(Estimate(tie.name, float(number), sd, unit, worst, interval))
    return tuple(found)
