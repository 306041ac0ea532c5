"""Profile likelihood: how well the data can be fitted with one parameter held, and the interval that follows."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.identify import Fit, estimate
from cartpend_dae.parallel import Workers, in_parallel
from cartpend_dae.problem import Problem
from cartpend_dae.shooting import linearised
from cartpend_dae.uncertainty import NORMAL_95

# step in standard deviations, how far the profile is followed, and at most how many fits that may take on one side
STEP, FAR, MOST = 0.5, 2.6, 30


@dataclass(frozen=True, slots=True)
class Profile:
    """A parameter's values (n,) [SI], and how far the best fit with each is from the best of all, in sds `z` (n,).

    `z` is negative below the estimate; it is a straight line where the model is linear. An end of the `interval` that
    the data leave open is infinite, or the bound.
    """

    name: str
    unit: str
    values: np.ndarray
    z: np.ndarray
    interval: tuple[float, float]


def profile(problem: Problem, fit: Fit, name: str, *, jobs: Workers = 1) -> Profile:
    """Follow the profile of the cost along one parameter, with all others fitted again.

    z^2 is twice the rise of the cost, over the ratio of the reported variance to that of uncorrelated noise of the
    assumed size: so near the estimate it agrees with the standard deviation, for coloured noise as well.

    Parameters
    ----------
    problem
        The problem.
    fit
        Its solution; of one on the exact form of friction the profile is that of `stepped`, moved to where it ended.
    name
        The parameter.
    jobs
        Number of processes, or an executor; two workers at most are of use.

    Raises
    ------
    ModelError
        If there is no such parameter, or it stands on its bound.

    References
    ----------
    D. M. Bates, D. G. Watts, "Nonlinear Regression Analysis and Its Applications" (1988), section 6.1.2 (profile t).
    R. E. Chandler, S. Bate, Biometrika 94 (2007), 167-183, doi:10.1093/biomet/asm015 (the ratio of variances).
    """
    names = [e.name for e in fit.parameters]
    if name not in names:
        listing = ", ".join(f"`{other}`" for other in names)
        raise ModelError(f"There is no estimated parameter `{name}` to profile; those of the fit are: {listing}.")
    best, fit = fit.values[name], fit.stepped or fit  # other values are fitted in steps of fixed length
    found = fit.parameters[names.index(name)]
    if found.status == "at-bound":
        raise ModelError(f"`{name}` stands on its bound, {found.value:g} {found.unit}; there is no profile around it.")
    ratio, step = _scales(problem, fit, names.index(name))

    def side(sign: int) -> tuple[np.ndarray, np.ndarray, bool]:
        return _follow(problem, fit, name, sign * step, ratio)

    (low, z_low, low_ends), (high, z_high, high_ends) = in_parallel(side, (-1, 1), jobs=jobs)
    low, high = low + (best - found.value), high + (best - found.value)
    values = np.concatenate([low[::-1], [best], high])
    z = np.concatenate([-z_low[::-1], [0.0], z_high])
    item = next(item for item in problem.layout.free if item.name == name)
    interval = (
        _crossing(best, low, z_low, item.lower if low_ends else -np.inf),
        _crossing(best, high, z_high, item.upper if high_ends else np.inf),
    )
    return Profile(name, found.unit, values, z, interval)


def _scales(problem: Problem, fit: Fit, index: int) -> tuple[float, float]:
    """Return the reported variance over that of white noise of the assumed size, and the first step [SI]."""
    item, found = problem.layout.free[index], fit.parameters[index]
    if found.status != "ok":
        return float(max(fit.chi2 / fit.n_residuals, 1e-300)), STEP * 0.1 * (abs(found.value) or item.scale)
    linear = linearised(problem, fit.point, float(fit.bandwidth[0]), fit.weights_sd)
    slope = np.array([free.slope(value) for free, value in zip(linear.variables, linear.values, strict=True)])
    prior = [(k / v.prior.sd) ** 2 if v.prior else 0.0 for k, v in zip(slope, linear.variables, strict=True)]
    estimates = (*fit.parameters, *fit.starts)
    inside = [i for i, e in enumerate(estimates) if e.status == "ok"]
    gram = (linear.grams.sum(axis=0) + np.diag(prior))[np.ix_(inside, inside)]
    size = np.sqrt(np.diag(gram))
    inverse = np.linalg.inv(gram / np.outer(size, size)) / np.outer(size, size)
    white = inverse[inside.index(index), inside.index(index)] * slope[index] ** 2
    return float(found.sd**2 / white), STEP * found.sd


def _follow(problem: Problem, fit: Fit, name: str, step: float, ratio: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """Go outward until the profile is far from the best; return values, distances in sds, and whether a bound ended it.

    The step grows where the cost hardly does.
    """
    item = next(item for item in problem.layout.free if item.name == name)
    values, z = list[float](), list[float]()
    here, point, before = fit.values[name], dict(fit.point), 0.0
    for _ in range(MOST):
        ahead = min(max(here + step, item.lower), item.upper)
        if ahead == here:
            return np.array(values), np.array(z), True
        here = ahead
        try:
            held = estimate(problem.holding(name, here), guess=point | {name: here}, sd=fit.weights_sd,
                            bandwidth=float(fit.bandwidth[0]))  # fmt: skip
        except SolverError:
            break
        values.append(here)
        z.append(float(np.sqrt(max(0.0, 2 * (held.cost - fit.cost) / ratio))))
        point = held.point
        if z[-1] > FAR:
            break
        step *= 2 if z[-1] - before < STEP / 2 else 1
        before = z[-1]
    return np.array(values), np.array(z), False


def _crossing(value: float, values: np.ndarray, z: np.ndarray, beyond: float) -> float:
    """Return where the profile reaches the 95 % level; `beyond` if it does not."""
    above = np.flatnonzero(z > NORMAL_95)
    if not above.size:
        return float(beyond)
    last = above[0] + 1
    z_all, all_values = np.concatenate([[0.0], z[:last]]), np.concatenate([[value], values[:last]])
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(z_all)) > 0])
    return float(PchipInterpolator(z_all[rising], all_values[rising])(NORMAL_95))
