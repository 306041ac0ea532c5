"""How much an addition is worth: information criterion, cross-validated cost, block jackknife."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from cartpend_dae.directions import unreached
from cartpend_dae.effects import Insertion
from cartpend_dae.identify import Fit
from cartpend_dae.shooting import Linearisation
from cartpend_dae.uncertainty import Estimate

BLOCKS = 30
# blocks of all runs together where what is left is compared
LONG = 10
# a fit that leaves more than so many times what another one does is far behind, in however many blocks
FAR_LESS = 2.0
# standard deviations, from block to block, by which one model must explain the runs better to stand against another
CLEARLY = 3.0
# correlation of two parameters above which the variance of each is a hundred times what it were without the other
ONE = 0.995

# ends of names of the speed above which a peak at rest has gone
SPEEDS = (".w_s", ".v_s")


@dataclass(frozen=True, slots=True)
class Robust:
    """Cross-validated cost over blocks of time, and jackknife sd of each parameter [SI]."""

    cost: float
    sd: dict[str, float]


def peaks_alone(insertion: Insertion) -> dict[str, str]:
    """Return the names of peaks at rest that no speed goes with, and of the levels below them.

    How high one is shows by where runs stop for good, which changes at once, so that no slope leads there.
    """
    names, before = insertion.parameter_names, insertion.prefix
    if any(name.endswith(SPEEDS) for name in names):
        return {}
    peaks = {f"{before}.{peak}": f"{before}.{level}" for peak, level in insertion.card.peaks.items()}
    return {peak: level for peak, level in peaks.items() if peak in names}


def determined(fit: Fit | None) -> int:
    """Return how many numbers describe a fit: its parameters, less the directions that the data leave open.

    One on its bound counts: which of several end there is found from the data as well.
    """
    return 0 if fit is None else len(fit.parameters) - len(fit.blind)


def described(fit: Fit | None, insertion: Insertion) -> int:
    """Return how many numbers describe a fit as the law of an effect that is last in it: without its corrections."""
    corrections = [] if fit is None else [name for name in insertion.corrections if unreached(name) not in fit.blind]
    return determined(fit) - len(corrections)


def free_corrections(fit: Fit, insertion: Insertion) -> list[Estimate]:
    """Return the corrections of a law that are not on a bound in a fit."""
    return [e for e in fit.parameters if e.name in insertion.correction_starts and e.status != "at-bound"]


def price_of_corrections(fit: Fit, insertion: Insertion) -> float:
    """Return by how much the free corrections of a law may have raised its likelihood by chance, of -2 ln likelihood.

    Without one chi^2 would be larger by the square of its ratio to its standard deviation; what the data call for costs
    a parameter.
    """
    without = {name: starts[0] for name, starts in insertion.correction_starts.items()}
    free, most = free_corrections(fit, insertion), float(np.log(fit.n_residuals))
    return sum(min(((e.value - without[e.name]) / e.sd) ** 2, most) if e.sd > 0 else 0.0 for e in free)


def ended_at_zero(fit: Fit, insertion: Insertion) -> frozenset[str]:
    """Return the parameters of an effect that end on a bound, if that is not the other end of how much can be."""
    kind = insertion.place.kind
    bounds = {f"{insertion.prefix}.{item.names[kind]}": item.bounds_at(kind) for item in insertion.parameters}

    def is_nothing(e: Estimate) -> bool:
        low, high = bounds[e.name]
        is_full = low == 0 and np.isfinite(high) and e.value > high / 2
        return e.status == "at-bound" and not is_full

    return frozenset(e.name for e in fit.parameters if e.name in bounds and is_nothing(e))


def bic(fit: Fit) -> float:
    """Return the Bayesian information criterion of a fit, with the noise estimated from it.

    References
    ----------
    G. Schwarz, Ann. Statist. 6 (1978), 461-464, doi:10.1214/aos/1176344136.
    """
    n = fit.n_residuals
    free = sum(estimate.status != "at-bound" for estimate in (*fit.parameters, *fit.starts))
    return float(n * np.log(fit.chi2 / n) + free * np.log(n))


def plain_bic(fit: Fit | None, *insertions: Insertion) -> float:
    """Return BIC of a fit in which corrections of its laws have no price; infinite without a fit."""
    if fit is None:
        return np.inf
    at_bound = {estimate.name for estimate in fit.parameters if estimate.status == "at-bound"}
    free = [name for insertion in insertions for name in insertion.corrections if name not in at_bound]
    return bic(fit) - len(free) * float(np.log(fit.n_residuals))


def coloured_bic(fit: Fit) -> float:
    """Return the Bayesian information criterion of a fit whose residuals are as coloured as they are.

    Each output's residual is predicted from its past by the autoregression of `fit.noise`, whose coefficients count as
    parameters. Where neighbouring residuals are alike, this does not take them for independent evidence.
    """
    n = fit.n_residuals / len(fit.outputs)
    free = sum(estimate.status != "at-bound" for estimate in (*fit.parameters, *fit.starts))
    free += sum(np.count_nonzero(a) - 1 for a in fit.noise.filters)
    innovations = np.clip(np.diag(fit.noise.covariance), 1e-300, None)
    return float(n * np.sum(np.log(innovations)) + free * np.log(fit.n_residuals))


def cancelled(fit: Fit, one: Insertion, others: tuple[Insertion, ...]) -> str:
    """Return why an effect is none beside one of some others that it takes back; empty if there is none.

    Of two effects whose contributions are opposite and nearly parallel the runs show the difference alone. That is a
    law which neither has: a spring and a clock that runs wrong by 3 % left noise alone of a cubic spring.
    """
    for other in others:
        r = taken_back(fit, one.parameter_names, other.parameter_names)[1]
        if r:
            return f"it takes back `{other.prefix}` (correlation {r:.4f}): the runs show their difference alone"
    return ""


def taken_back(
    fit: Fit, some: Iterable[str], others: Iterable[str], left: float = 1.0
) -> tuple[tuple[str, str], float]:
    """Return the first two parameters that take each other back, and their correlation; 0 where none do.

    Their contributions are opposite and nearly parallel, and no more than `left` of the larger one remains.
    """
    at, correlation = {e.name: i for i, e in enumerate(fit.parameters)}, fit.correlation
    for j, i in product((at[n] for n in others if n in at), (at[n] for n in some if n in at)):
        r, one, other = float(correlation[i, j]), fit.parameters[i], fit.parameters[j]
        if i != j and abs(r) > ONE and r * one.value * other.value > 0 and _remains(one, other) <= left:
            return (one.name, other.name), r
    return ("", ""), 0.0


def _remains(one: Estimate, other: Estimate) -> float:
    """Return what two opposite contributions leave of the larger one.

    Where they are parallel the standard deviation of each is one over the length of what it changes, but for a factor
    that both have in common; without one nothing is known to remain.
    """
    if not all(0 < e.sd < np.inf for e in (one, other)):
        return 0.0
    smaller, larger = sorted(abs(e.value) / e.sd for e in (one, other))
    return 1 - smaller / larger if larger > 0 else 0.0


def lead(one: Fit, other: Fit) -> float:
    """Return by how many standard deviations one fit leaves less than another of the same runs, at the same bandwidth.

    What both leave is compared block by block; blocks are so long that they know little of each other.
    """
    left = [
        [
            float(np.nansum((part / fit.weights_sd) ** 2))
            for run in fit.runs
            for part in np.array_split(run.residual, max(2, LONG // len(fit.runs)))
        ]
        for fit in (one, other)
    ]
    less = np.array(left[1]) - np.array(left[0])
    return float(less.mean() / max(less.std(ddof=1) / np.sqrt(less.size), 1e-300))


def leaves_clearly_less(one: Fit, other: Fit) -> bool:
    """Return whether one fit leaves clearly less than another of the same runs, at the same bandwidth.

    It leads clearly from block to block, or leaves far less: where a few blocks of time have most of it, their spread
    would hide that.
    """
    return FAR_LESS * one.chi2 < other.chi2 or lead(one, other) > CLEARLY


def robust(fit: Fit, linear: Linearisation) -> Robust:
    """Judge a fit by leaving out one block of time after the other, to first order.

    Disturbances make neighbouring residuals alike, so that the usual standard deviations are far too
    small; what changes from block to block tells how sure a parameter is. Start states, which only the
    first block determines, are held.

    Parameters
    ----------
    fit
        The fit.
    linear
        Its normal equations at the solution, by segment.

    References
    ----------
    H. R. Kuensch, Ann. Statist. 17 (1989), 1217-1241, doi:10.1214/aos/1176347265 (the block jackknife).
    """
    n = len(fit.parameters)
    held = [i for i, estimate in enumerate(fit.parameters) if estimate.status != "at-bound"]
    groups = [g for g in np.array_split(np.arange(len(linear.grams)), BLOCKS) if g.size]
    grams = np.array([linear.grams[g][:, :n, :n].sum(axis=0)[np.ix_(held, held)] for g in groups])
    gradients = np.array([linear.gradients[g][:, :n].sum(axis=0)[held] for g in groups])
    total = grams.sum(axis=0)
    cost, moved = fit.chi2, []
    for gram, gradient in zip(grams, gradients, strict=True):
        shift = np.linalg.lstsq(total - gram, gradient, rcond=1e-12)[0]
        moved.append(shift)
        cost += 2 * gradient @ shift + shift @ gram @ shift
    spread = np.array(moved)
    b = len(groups)
    sd = np.sqrt((b - 1) / b * np.sum((spread - spread.mean(axis=0)) ** 2, axis=0))
    scaled = {
        fit.parameters[i].name: float(sd[k] * linear.variables[i].slope(linear.values[i])) for k, i in enumerate(held)
    }
    return Robust(float(cost), scaled)


def with_robust_sd(fit: Fit, linear: Linearisation) -> Fit:
    """Replace standard deviations by those of the block jackknife where these are larger.

    The formula for white residuals holds when the sensors are the only imperfection; residuals that are
    alike over some time carry less information than their number says.
    """
    sd = robust(fit, linear).sd
    return replace(
        fit, parameters=tuple(e.with_sd(max(e.sd, sd[e.name])) if e.name in sd else e for e in fit.parameters)
    )
