"""The unknown-input baseline: small random forces move a rig besides what its model knows.

To first order, along the trajectory of a fit, the states of the model and its residuals in units of the noise obey

    dx[k+1] = A dx[k] + M e[k] + B d[k],    r[k] = C dx[k] + e[k],

with white noise e and an Ornstein-Uhlenbeck force d at each connection: d[k+1] = a d[k] + s sqrt(1 - a^2) xi[k]. The
Kalman filter of this chain turns residuals, and what parameters would change of them, into white rows, and gives the
likelihood of sizes and correlation times. Where the forces vanish, both are those of noise alone.

References
----------
A. C. Harvey, "Forecasting, Structural Time Series Models and the Kalman Filter" (1989), section 3.4 (the likelihood
from innovations, with the scale of the noise concentrated out).
"""

from dataclasses import dataclass

import numpy as np

# the variance of the noise may be so many times that found in the raw data, whose sd scatters by 4 to 7 percent
KNOWN = (0.7, 1.4)


@dataclass(frozen=True, slots=True)
class Chain:
    """How states and residuals follow from sample to sample, to first order.

    Parameters
    ----------
    transition, noise, pushes
        A (n, n_x, n_x), M (n, n_x, n_y) and B (n, n_x, n_d), B for each of `names`.
    error
        C (n, n_y, n_x).
    measured
        Where there is a measured value (n, n_y).
    first
        Samples at which a run begins.
    width
        Time to the next sample [s], shape (n,).
    """

    names: tuple[str, ...]
    transition: np.ndarray
    noise: np.ndarray
    pushes: np.ndarray
    error: np.ndarray
    measured: np.ndarray
    first: tuple[int, ...]
    width: np.ndarray

    def only(self, names: tuple[str, ...]) -> "Chain":
        """Return the chain with some of its forces."""
        places = [self.names.index(name) for name in names]
        parts = self.transition, self.noise, self.pushes[:, :, places], self.error, self.measured
        return Chain(names, *parts, self.first, self.width)

    def spread(self, rows: np.ndarray) -> np.ndarray:
        """Put rows of measured values (n_measured, m) at their samples, shape (n, n_y, m)."""
        found = np.zeros((*self.measured.shape, rows.shape[1]))
        found[self.measured] = rows
        return found


@dataclass(frozen=True, slots=True)
class White:
    """Innovations (n_sets, n, n_y, m) of rows under sets of forces, ln det of their covariance (n_sets,).

    `gain` (n_sets, n_x, n_y) is the median gain of the filter.
    """

    rows: np.ndarray
    determinant: np.ndarray
    gain: np.ndarray


@np.errstate(over="ignore", invalid="ignore")
def whitened(chain: Chain, rows: np.ndarray, sizes: np.ndarray, times: np.ndarray) -> White:
    """Filter rows under several sets of forces at once.

    Parameters
    ----------
    chain
        The chain.
    rows
        Residuals and derivatives at the samples (n, n_y, m).
    sizes, times
        Standard deviation and correlation time [s] of each force, shapes (n_sets, n_d).
    """
    n, n_y, m = rows.shape
    n_x, n_d, n_sets = chain.transition.shape[1], chain.pushes.shape[2], len(sizes)
    whole = n_x + n_d
    out, determinant = np.empty((n_sets, n, n_y, m)), np.zeros(n_sets)
    gains = np.zeros((n, n_sets, n_x, n_y))
    start = np.zeros((n_sets, whole, whole))
    inner = np.arange(n_x, whole)
    start[:, inner, inner] = sizes**2
    step, eye, begins = np.zeros((n_sets, whole, whole)), np.eye(n_y), set(chain.first)
    variance, state = start, np.zeros((n_sets, whole, m))
    seen = np.zeros((n_y, whole))
    noise = np.zeros((whole, n_y))
    for k in range(n):
        if k in begins:
            variance, state = start, np.zeros((n_sets, whole, m))
        keep = np.exp(-chain.width[k] / times)
        step[:, :n_x, :n_x] = chain.transition[k]
        step[:, :n_x, n_x:] = chain.pushes[k]
        step[:, inner, inner] = keep
        seen[:, :n_x] = chain.error[k] * chain.measured[k][:, None]
        noise[:n_x] = chain.noise[k]
        across = variance @ seen.T
        spread = seen @ across + eye
        new = rows[k] - seen @ state
        if n_y == 1:
            root = np.sqrt(spread)
            out[:, k] = new / root
            determinant += np.log(spread[:, 0, 0])
            gain = (step @ across + noise) / spread
            lost = gain / (1 / spread)
        else:
            root = np.linalg.cholesky(spread)
            out[:, k] = np.linalg.solve(root, new)
            determinant += 2 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
            gain = np.linalg.solve(spread, np.swapaxes(step @ across + noise, 1, 2)).swapaxes(1, 2)
            lost = gain @ spread
        gains[k] = (
            across[:, :n_x] / spread
            if n_y == 1
            else np.linalg.solve(spread, across[:, :n_x].swapaxes(1, 2)).swapaxes(1, 2)
        )
        state = step @ state + gain @ new
        variance = step @ variance @ step.swapaxes(1, 2) + noise @ noise.T - lost @ gain.swapaxes(1, 2)
        variance[:, inner, inner] += sizes**2 * (1 - keep**2)
        variance = (variance + variance.swapaxes(1, 2)) / 2
    return White(out, determinant, np.median(gains, axis=0))


def likelihood(n: int, squares: np.ndarray | float, determinant: np.ndarray | float) -> np.ndarray:
    """Return -2 ln likelihood of n values up to a constant, the variance of the noise the likeliest within KNOWN."""
    mean = np.asarray(squares) / n
    scale = np.clip(mean, *KNOWN)
    return n * (np.log(scale) + mean / scale - 1) + np.asarray(determinant)


@np.errstate(over="ignore", invalid="ignore")
def left_over(rows: np.ndarray) -> float:
    """Return the sum of squares of the first column (n, m) that the others leave; infinite where rows are lost."""
    if not np.all(np.isfinite(rows)):
        return np.inf
    scale = np.linalg.norm(rows[:, 1:], axis=0)
    others = rows[:, 1:][:, scale > 0] / scale[scale > 0]
    found = np.linalg.lstsq(others, rows[:, 0], rcond=1e-10)[0]
    return float(np.sum((rows[:, 0] - others @ found) ** 2))
