"""What the residuals of a fit say of the noise: how alike neighbouring samples are, and what that does to estimates."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal
from scipy.linalg import solve_toeplitz

# what is left of an impulse [of its start] when the memory of the noise counts as over
FORGOTTEN = 1e-4


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Coloured noise of the outputs: each is white noise through 1/(1 + a_1 q^-1 + ...), all whites correlated.

    `filters` holds [1, a_1, ...] of each output, `covariance` (n_y, n_y) that of the white noises.
    """

    filters: tuple[np.ndarray, ...]
    covariance: np.ndarray

    @property
    def sd(self) -> np.ndarray:
        """Standard deviation of each output's noise, shape (n_y,)."""
        gains = [np.sum(_impulse(a) ** 2) for a in self.filters]
        return np.sqrt(np.diag(self.covariance) * gains)

    @property
    def is_white(self) -> bool:
        """Whether neighbouring samples know nothing of each other."""
        return all(len(a) == 1 for a in self.filters)


def noise_model(runs: list[np.ndarray], n_estimated: int = 0) -> NoiseModel:
    """Estimate the noise from the residuals of runs, arrays (n, n_y) with NaN where nothing was measured.

    Each output is autoregressive, by the equations of Yule and Walker over all runs, of the order with the
    smallest BIC. One that is measured at each second sample only follows from its own samples, so that every second
    coefficient is zero.

    Parameters
    ----------
    runs
        Residuals.
    n_estimated
        Number of quantities that were fitted to them.

    References
    ----------
    G. U. Yule, Phil. Trans. R. Soc. A 226 (1927), 267-298, doi:10.1098/rsta.1927.0007.
    G. Schwarz, Ann. Statist. 6 (1978), 461-464, doi:10.1214/aos/1176344136 (the order).
    """
    n_y = runs[0].shape[1]
    filters = tuple(_of_own_samples([run[:, i] for run in runs]) for i in range(n_y))
    whites = [np.column_stack([_whitened(run[:, i], filters[i]) for i in range(n_y)]) for run in runs]
    together = np.vstack(whites)
    known = np.isfinite(together)
    filled = np.where(known, together, 0.0)
    pairs = np.maximum(known.T.astype(float) @ known, 1.0)
    n = int(known.sum())
    return NoiseModel(filters, filled.T @ filled / pairs * n / max(1, n - n_estimated))


def meat(slopes: list[np.ndarray], noise: NoiseModel) -> np.ndarray:
    """Return sum J_i' cov(r) J_j, the covariance of the gradient under the noise, shape (n_all, n_all).

    Parameters
    ----------
    slopes
        Derivatives of the residuals of each run, shapes (n, n_y, n_all), zero where nothing was measured.
    noise
        The noise.

    Notes
    -----
    With r = H e, e white, this is (H'J)' cov(e) (H'J), and H' is the filter of the noise run backwards in time.
    """
    n_all = slopes[0].shape[2]
    total = np.zeros((n_all, n_all))
    if not n_all:  # all stand on their bounds
        return total
    longest = max(_impulse(a).size for a in noise.filters)
    for run in slopes:
        before = np.zeros((longest - 1, *run.shape[1:]))  # the noise did not begin with the run
        whole = np.concatenate([before, run])
        parts = [_filtered([1.0], a, whole[::-1, i])[::-1] for i, a in enumerate(noise.filters)]
        for i, one in enumerate(parts):
            for j, other in enumerate(parts):
                if noise.covariance[i, j]:
                    total += noise.covariance[i, j] * (one.T @ other)
    return total


def _of_own_samples(series: list[np.ndarray]) -> np.ndarray:
    """Return [1, a_1, ...] of an output in steps of the samples of all, of which it may have each k-th only."""
    rows = [np.flatnonzero(np.isfinite(one)) for one in series]
    gaps = np.concatenate([np.diff(known) for known in rows])
    k = int(np.median(gaps)) if gaps.size else 1
    if k <= 1:
        return _autoregression(series)
    own = _autoregression([one[known[0] :: k] for one, known in zip(series, rows, strict=True) if known.size])
    filter_ = np.zeros(k * (len(own) - 1) + 1)
    filter_[::k] = own
    return filter_


def _autoregression(series: list[np.ndarray]) -> np.ndarray:
    known = sum(int(np.isfinite(s).sum()) for s in series)
    largest = int(min(10 * np.log10(max(known, 2)), known / 20))
    r = _autocovariance(series, largest)
    if not r[0] > 0:
        return np.ones(1)
    best, best_cost = np.ones(1), known * np.log(r[0])
    for order in range(1, largest + 1):
        a = -np.asarray(solve_toeplitz(r[:order], r[1 : order + 1]))
        left = r[0] + a @ r[1 : order + 1]
        if not left > 0:
            break
        cost = known * np.log(left) + order * np.log(known)
        if cost < best_cost and np.abs(np.roots(np.concatenate([[1.0], a]))).max(initial=0.0) < 1:
            best, best_cost = np.concatenate([[1.0], a]), cost
    return best


def _autocovariance(series: list[np.ndarray], largest: int) -> np.ndarray:
    """Return the sums of products of samples 0 to `largest` apart, about zero, over the number of samples.

    The common divisor keeps it the sequence of some noise, as the mean over the pairs at hand would not.
    """
    sums, count = np.zeros(largest + 1), 0
    for values in series:
        filled = np.nan_to_num(values)
        count += int(np.isfinite(values).sum())
        for lag in range(min(largest, len(values) - 1) + 1):
            sums[lag] += filled[: len(values) - lag] @ filled[lag:]
    return sums / max(count, 1)


def _whitened(values: np.ndarray, a: np.ndarray) -> np.ndarray:
    if len(a) == 1:
        return values
    filled = np.where(np.isfinite(values), values, np.nan)
    out = _filtered(a, [1.0], np.nan_to_num(filled))
    broken = _filtered(a != 0, [1.0], ~np.isfinite(filled)) > 0.5
    broken[: len(a) - 1] = True
    return np.where(broken, np.nan, out)


def _impulse(a: np.ndarray) -> np.ndarray:
    """Return the impulse response of 1/a until it is forgotten, at most 100,000 samples."""
    if len(a) == 1:
        return np.ones(1)
    slowest = np.abs(np.roots(a)).max(initial=0.0)
    n = int(np.clip(np.log(FORGOTTEN) / np.log(min(max(slowest, 0.1), 0.9999)), 10, 100_000))
    return _filtered([1.0], a, np.eye(1, n)[0])


def _filtered(b: ArrayLike, a: ArrayLike, values: np.ndarray) -> np.ndarray:
    """Filter along the first axis."""
    return np.asarray(signal.lfilter(np.asarray(b), np.asarray(a), values, axis=0))
