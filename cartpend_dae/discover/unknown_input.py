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

from cartpend_dae.discover.recursion import TOGETHER, filters

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
        Samples at which a run begins, or a piece of one.
    width
        Time to the next sample [s], shape (n,).
    owners
        Which run each of these is, or is a piece of; each a run of its own where there are none.
    """

    names: tuple[str, ...]
    transition: np.ndarray
    noise: np.ndarray
    pushes: np.ndarray
    error: np.ndarray
    measured: np.ndarray
    first: tuple[int, ...]
    width: np.ndarray
    owners: tuple[int, ...] = ()

    def only(self, names: tuple[str, ...]) -> "Chain":
        """Return the chain with some of its forces."""
        places = [self.names.index(name) for name in names]
        parts = self.transition, self.noise, self.pushes[:, :, places], self.error, self.measured
        return Chain(names, *parts, self.first, self.width, self.owners)

    def spread(self, rows: np.ndarray) -> np.ndarray:
        """Put rows of measured values (n_measured, m) at their samples, shape (n, n_y, m)."""
        found = np.zeros((*self.measured.shape, rows.shape[1]))
        found[self.measured] = rows
        return found


@dataclass(frozen=True, slots=True)
class White:
    """Innovations (n_sets, n, n_y, m) of rows under sets of forces, ln det of their covariance (n_sets, n_runs).

    `gain` (n_sets, n_x, n_y) is the median gain of the filter.
    """

    rows: np.ndarray
    determinant: np.ndarray
    gain: np.ndarray


@np.errstate(over="ignore", invalid="ignore")
def whitened(chain: Chain, rows: np.ndarray, sizes: np.ndarray, times: np.ndarray) -> White:
    """Filter rows under several sets of forces at once, and all runs at once.

    As e[k] = r[k] - C x[k] is the innovation of noise alone, M e[k] is taken out of what is uncertain: the states obey
    dx[k+1] = (A - M C) dx[k] + B d[k] + M r[k], in which only the forces are random.

    Parameters
    ----------
    chain
        The chain.
    rows
        Residuals and derivatives at the samples (n, n_y, m).
    sizes, times
        Standard deviation and correlation time [s] of each force in each run, shapes (n_sets, n_runs, n_d).
    """
    n, n_y, m = rows.shape
    n_x, (n_sets, n_runs, n_d) = chain.transition.shape[1], sizes.shape
    samples, is_on = side_by_side(chain)
    seen = np.where(chain.measured[:, :, None], chain.error, 0.0)
    keep = np.exp(-chain.width[samples][:, None, :, None] / times)
    transition = chain.transition - chain.noise @ seen
    found = filters(transition[samples], chain.pushes[samples], seen[samples], keep, sizes)
    found.push[:, :, :, :n_x] += chain.noise[samples][:, None]
    side, c = rows[samples][:, None], seen[samples][:, None]
    out, now = np.empty((n_sets, n, n_y, m)), np.zeros((n_sets, n_runs, n_x + n_d, m))
    states = np.empty((TOGETHER, n_sets, n_runs, n_x, m))
    for first in range(0, len(samples), TOGETHER):
        part = slice(first, first + TOGETHER)
        for k, (step, push, row) in enumerate(zip(found.step[part], found.push[part], side[part], strict=True)):
            states[k] = now[:, :, :n_x]
            now = step @ now + push @ row
        white = found.root[part] @ (side[part] - c[part] @ states[: len(side[part])])
        out[:, samples[part][is_on[part]]] = white.swapaxes(1, 2)[is_on[part]].swapaxes(0, 1)
    scales = np.empty((n, n_sets, n_y))
    scales[samples[is_on]] = np.diagonal(found.root, axis1=3, axis2=4).swapaxes(1, 2)[is_on]
    determinants = np.add.reduceat(-2 * np.log(scales).sum(axis=2), list(chain.first), axis=0)
    gains = found.gain[:, :, :, :n_x].swapaxes(1, 2)[is_on]
    return White(out, determinants.T, np.median(gains, axis=0))


def side_by_side(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of all runs side by side (longest, n_runs), and whether each is one.

    A run that has ended goes on with its last one.
    """
    ends = np.array([*chain.first[1:], len(chain.width)])
    samples = np.arange(max(ends - chain.first))[:, None] + np.array(chain.first)
    return np.minimum(samples, ends - 1), samples < ends


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
