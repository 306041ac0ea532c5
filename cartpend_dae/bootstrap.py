"""Bootstrap: the estimates on data made anew from the fit, with noise drawn from its model or from its residuals."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy import signal

from cartpend_dae.cuts import run_of
from cartpend_dae.data import Experiment
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.identify import Fit, estimate
from cartpend_dae.parallel import Workers, in_parallel
from cartpend_dae.problem import Problem


class Kind(StrEnum):
    """Where the noise of data made anew comes from."""

    parametric = "parametric"
    block = "block"


# samples before the first, in which coloured noise comes to its steady state, over its memory
SETTLING = 10


@dataclass(frozen=True, slots=True)
class Bootstrap:
    """Estimates on data made anew: `values` (n_converged, n) of the parameters and starts `names`, SI.

    `sd` is their standard deviation, `intervals` (n, 2) hold the middle 95 %; `failed` fits did not converge.
    """

    kind: Kind
    names: tuple[str, ...]
    values: np.ndarray
    sd: np.ndarray
    intervals: np.ndarray
    failed: int
    block: int | None


def bootstrap(
    problem: Problem,
    fit: Fit,
    number: int,
    *,
    kind: Kind = Kind.parametric,
    block: int | None = None,
    seed: int = 0,
    jobs: Workers = 1,
) -> Bootstrap:
    """Fit data made anew so many times.

    Parameters
    ----------
    problem
        The problem.
    fit
        Its solution, of the free simulation; around one on the exact form of friction lie the fits of `stepped`.
    number
        How many times; 1,000 for intervals, 100 for standard deviations.
    kind
        Noise from the autoregressive model of the residuals, or blocks of the residuals in any order, which keeps
        whatever distribution and correlation they have.
    block
        Samples in a block; by default twice the cube root of their number, or the memory of the noise if longer.
    seed
        Which noise.
    jobs
        Number of processes, or an executor; the result does not depend on it.

    Raises
    ------
    ModelError
        For a fit of predictions, whose noise goes through the model, or for blocks longer than a run.
    SolverError
        If fewer than two fits converge.

    References
    ----------
    B. Efron, R. J. Tibshirani, "An Introduction to the Bootstrap" (1993), chapters 6 and 13.
    H. R. Kuensch, Ann. Statist. 17 (1989), 1217-1241, doi:10.1214/aos/1176347265 (moving blocks).
    """
    if np.any(fit.bandwidth > 0):
        raise ModelError(
            "The bootstrap makes data anew from a free simulation; this fit is of predictions, in which noise goes "
            "through the observer. Its standard deviations are those of the block jackknife."
        )
    best, fit = fit, fit.stepped or fit  # data are made and fitted in steps of fixed length
    shortest = min(run.time.size for run in fit.runs)
    length = None if kind is Kind.parametric else block or _block_length(fit, shortest)
    if length is not None and not 1 <= length <= shortest:
        raise ModelError(f"A block of {length} samples does not fit into the shortest run of {shortest}.")

    def again(k: int) -> np.ndarray | None:
        generator = np.random.default_rng([seed, k])
        made = problem.with_measured(_made_anew(problem, fit, length, generator))
        try:
            found = estimate(made, guess=fit.point, sd=fit.weights_sd)
        except SolverError:
            return None
        return np.array([e.value for e in (*found.parameters, *found.starts)]) if found.success else None

    problem.programme  # noqa: B018 - built once, before the processes part
    values = [row for row in in_parallel(again, range(number), jobs=jobs) if row is not None]
    if len(values) < 2:
        raise SolverError(f"Of {number} fits of the bootstrap {len(values)} converged: too few to say anything.")
    pairs = zip((*best.parameters, *best.starts), (*fit.parameters, *fit.starts), strict=True)
    rows = np.array(values) + np.array([end.value - begin.value for end, begin in pairs])
    return Bootstrap(
        kind,
        tuple(e.name for e in (*fit.parameters, *fit.starts)),
        rows,
        rows.std(axis=0, ddof=1),
        np.quantile(rows, [0.025, 0.975], axis=0).T,
        number - len(values),
        length,
    )


def _block_length(fit: Fit, shortest: int) -> int:
    memory = max(_memory(a) for a in fit.noise.filters)
    return int(min(max(2 * np.ceil(shortest ** (1 / 3)), 3 * memory), max(1, shortest // 2)))


def _memory(a: np.ndarray) -> int:
    """Return after how many samples coloured noise has forgotten all but 1/e."""
    slowest = np.abs(np.roots(a)).max(initial=0.0)
    return int(np.ceil(-1 / np.log(slowest))) if 0 < slowest < 1 else 1


def _made_anew(
    problem: Problem, fit: Fit, length: int | None, generator: np.random.Generator
) -> tuple[Experiment, ...]:
    """Return the runs with new noise on what the fit predicts; what was not measured stays so."""
    noise = {run.name: _noise(fit, run.residual, length, generator) for run in fit.runs}
    old = {run.name: run.residual for run in fit.runs}
    begin: dict[str, int] = {}
    made = []
    for experiment in problem.experiments:
        name, n = run_of(experiment), experiment.time.size
        first = begin.get(name, 0)
        begin[name] = first + n
        change = (noise[name] - old[name])[first : first + n]
        outputs = {
            output: replace(channel, values=channel.values + change[:, fit.outputs.index(output)])
            for output, channel in experiment.outputs.items()
        }
        made.append(replace(experiment, outputs=outputs))
    return tuple(made)


def _noise(fit: Fit, residual: np.ndarray, length: int | None, generator: np.random.Generator) -> np.ndarray:
    if length is None:
        return _coloured(fit, len(residual), generator)
    centred = residual - np.nanmean(residual, axis=0)
    # fitted residuals are smaller than the noise that they come from
    n = fit.n_residuals
    centred *= np.sqrt(n / max(1, n - len(fit.parameters) - len(fit.starts)))
    starts = generator.integers(0, len(residual) - length + 1, -(-len(residual) // length))
    drawn = np.concatenate([centred[k : k + length] for k in starts])[: len(residual)]
    # what falls on a sample that was not measured in the block is drawn again from all
    for column in drawn.T:
        holes = np.flatnonzero(~np.isfinite(column))
        known = centred[:, 0] if drawn.shape[1] == 1 else centred.ravel()
        column[holes] = generator.choice(known[np.isfinite(known)], holes.size)
    return drawn


def _coloured(fit: Fit, n: int, generator: np.random.Generator) -> np.ndarray:
    """Return noise by the model of the residuals, shape (n, n_y), SI."""
    before = SETTLING * max(_memory(a) for a in fit.noise.filters)
    white = generator.multivariate_normal(np.zeros(len(fit.outputs)), fit.noise.covariance, before + n)
    columns = [np.asarray(signal.lfilter([1.0], a, white[:, i])) for i, a in enumerate(fit.noise.filters)]
    return np.column_stack(columns)[before:] * fit.weights_sd
