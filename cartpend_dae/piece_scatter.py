"""How far estimates scatter from piece to piece of a run: what disturbances and model errors do to them.

The residuals of short pieces look small and nearly white whatever the model lacks, for each piece has a start of its
own that takes up most of it. What is left shows between the pieces: each alone would move the parameters another way.
"""

import math

import numpy as np
from scipy.optimize import brentq
from scipy.special import digamma, polygamma
from scipy.stats import norm, t

from cartpend_dae.cuts import MARK, run_of
from cartpend_dae.problem import Problem

# below three, what is left without one piece says nothing of how the pieces differ
MIN_PIECES = 3
LEVEL = 0.975
# degrees of freedom with which a variance counts as known
MANY = 1e6


def with_piece_scatter(
    problem: Problem,
    inside: list[int],
    residuals: list[np.ndarray],
    slopes: list[np.ndarray],
    gram: np.ndarray,
    covariance: np.ndarray,
) -> np.ndarray:
    """Enlarge a covariance where the estimates without one piece after the other scatter more than it says.

    The scatter is that of the jackknife over all pieces and whole runs, the shift by each to first order. Of K pieces
    it has K - 1 degrees of freedom, so it is stretched until the normal interval of 95 % is that of Student. A
    direction that looks quiet by chance is as loud as the others are, see `_moderated`. In each direction the largest
    of these variances holds; starts follow the parameters. Without pieces nothing changes.

    Parameters
    ----------
    problem
        The problem.
    inside
        The variables that `gram` and `covariance` are about.
    residuals, slopes
        Of each run: weighted residuals (n, n_y), NaN where not measured, and their derivatives (n, n_y, n_all).
    gram, covariance
        Hessian of the cost and covariance, shapes (n_inside, n_inside), of the scaled variables.

    References
    ----------
    J. G. MacKinnon, M. O. Nielsen, M. D. Webb, J. Appl. Econometrics 38 (2023), 671-694, doi:10.1002/jae.2969
    (the cluster jackknife, CV3).
    """
    if len(problem.experiments) < MIN_PIECES or not any(MARK in e.name for e in problem.experiments):
        return covariance
    position = {variable: i for i, variable in enumerate(inside)}
    own = [[position[i] for i in places if i in position] for places in problem.start_places]
    starts = {i for group in own for i in group}
    shared = [i for i in range(len(inside)) if i not in starts]
    if not shared:
        return covariance
    # how the starts follow the shared parameters: d(start) = follow d(shared)
    follow = np.zeros((len(inside), len(shared)))
    follow[shared] = np.eye(len(shared))
    for group in own:
        follow[group] = -np.linalg.lstsq(gram[np.ix_(group, group)], gram[np.ix_(group, shared)], rcond=None)[0]
    total = gram[np.ix_(shared, shared)] + gram[np.ix_(shared, sorted(starts))] @ follow[sorted(starts)]
    shifts = []
    for error, slope in _pieces(problem, inside, residuals, slopes):
        moved = slope @ follow
        shifts.append(_solved(total - moved.T @ moved, moved.T @ error))
    certain = covariance[np.ix_(shared, shared)]
    enlarged = certain
    for scatter in (_jackknife(np.array(shifts)), _moderated(np.array(shifts), certain)):
        enlarged = enlarged + _beyond(scatter, enlarged)
    extra = enlarged - certain
    return covariance + follow @ extra @ follow.T


def _pieces(
    problem: Problem, inside: list[int], residuals: list[np.ndarray], slopes: list[np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return residuals (n,) and their derivatives (n, n_inside) of each piece, zero where nothing was measured."""
    names = list(dict.fromkeys(run_of(experiment) for experiment in problem.experiments))
    begins = dict.fromkeys(names, 0)
    found = []
    for experiment, n in zip(problem.experiments, problem.layout.run_lengths, strict=True):
        name = run_of(experiment)
        part = slice(begins[name], begins[name] + n)
        begins[name] += n
        error = np.nan_to_num(residuals[names.index(name)][part]).ravel()
        found.append((error, slopes[names.index(name)][part][:, :, inside].reshape(error.size, -1)))
    return found


def _solved(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Solve for a shift; along what only the left out piece tells there is none."""
    size = np.sqrt(np.clip(np.diag(matrix), 1e-300, None))
    return np.linalg.lstsq(matrix / np.outer(size, size), vector / size, rcond=1e-9)[0] / size


def _jackknife(shifts: np.ndarray) -> np.ndarray:
    k = len(shifts)
    spread = shifts - shifts.mean(axis=0)
    return _stretch(k - 1) ** 2 * (k - 1) / k * spread.T @ spread


def _stretch(degrees: float) -> float:
    return float(t.ppf(LEVEL, min(degrees, MANY)) / norm.ppf(LEVEL))


def _moderated(shifts: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the covariance of the jackknife over shifts (k, n), drawn towards what is common to all directions.

    In one direction k pieces show a variance with k - 1 degrees of freedom: a combination of parameters may look far
    quieter than it is. How many times the scatter is what `covariance` says, in uncorrelated directions as near as can
    be to the single parameters, tells how alike these are, and so how many degrees of freedom their common scatter is
    worth beside the own one.

    References
    ----------
    G. K. Smyth, Stat. Appl. Genet. Mol. Biol. 3 (2004), 3, doi:10.2202/1544-6115.1027 (moderated variances).
    A. Kessy, A. Lewin, K. Strimmer, Am. Stat. 72 (2018), 309-314, doi:10.1080/00031305.2016.1277159 (ZCA-cor).
    """
    k = len(shifts)
    spread = shifts - shifts.mean(axis=0)
    size = np.sqrt(np.clip(np.diag(covariance), 1e-300, None))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    seen = values > 1e-12 * values.max(initial=0.0)
    whitened = (spread / size) @ (vectors[:, seen] / np.sqrt(values[seen])) @ vectors[:, seen].T
    more, common = _moderation((k - 1) / k * np.sum(whitened**2, axis=0), k - 1)
    share = more / (more + k - 1)
    own = (k - 1) / k * spread.T @ spread
    return _stretch(more + k - 1) ** 2 * (share * common * covariance + (1 - share) * own)


def _moderation(variances: np.ndarray, degrees: int) -> tuple[float, float]:
    """Return how many degrees of freedom a common variance is worth beside each of some, and that variance.

    Their logarithms scatter by trigamma(degrees/2) if all are estimates of one, and by more if they differ.
    """
    if variances.size < 2 or not np.all(variances > 0):
        return 0.0, 1.0
    logs = np.log(variances) - digamma(degrees / 2) + np.log(degrees / 2)
    excess = float(np.var(logs, ddof=1) - polygamma(1, degrees / 2))
    if excess <= float(polygamma(1, MANY / 2)):
        return MANY, float(np.exp(logs.mean()))
    half = math.exp(
        float(np.asarray(brentq(lambda x: float(polygamma(1, math.exp(x))) - excess, -20.0, math.log(MANY))))
    )
    return 2 * half, float(np.exp(logs.mean() + digamma(half) - np.log(half)))


def _beyond(scatter: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return what must be added to a covariance so that it is at least `scatter` in each common principal direction."""
    size = np.sqrt(np.clip(np.diag(covariance), 1e-300, None))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    root = size[:, None] * vectors * np.sqrt(np.clip(values, 1e-14, None))
    inverse = (vectors / np.sqrt(np.clip(values, 1e-14, None))).T / size
    ratios, directions = np.linalg.eigh(inverse @ scatter @ inverse.T)
    larger = root @ directions
    return (larger * np.clip(ratios - 1, 0, None)) @ larger.T
