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
    n_x, n_d, n_sets = chain.transition.shape[1], chain.pushes.shape[2], len(sizes)
    whole, inner = n_x + n_d, np.arange(n_x, n_x + n_d)
    seen, step, known = _with_forces(chain, rows)
    samples, is_on = side_by_side(chain)
    keep = np.exp(-chain.width[samples][:, None, :, None] / times)
    pushed = sizes**2 * (1 - keep**2)
    out = np.empty((n_sets, n, n_y, m))
    gains, scales = np.empty((n, n_sets, n_x, n_y)), np.empty((n, n_sets, n_y))
    n_runs = samples.shape[1]
    variance = np.zeros((n_sets, n_runs, whole, whole))
    variance[:, :, inner, inner] = sizes**2
    state, eye = np.zeros((n_sets, n_runs, whole, m)), np.eye(n_y)
    # the covariance of what is seen, then what is divided by its root: new rows, covariance with the states, and 1
    table = np.zeros((n_sets, n_runs, n_y, n_y + m + whole + n_y))
    moves = np.zeros((n_sets, n_runs, whole, whole))
    new, across, ones = (slice(n_y, n_y + m), slice(n_y + m, n_y + m + whole), slice(n_y + m + whole, None))
    for k, now in enumerate(samples):
        c = seen[now]
        table[..., across] = c @ variance
        table[..., :n_y] = table[..., across] @ c.swapaxes(1, 2) + eye
        table[..., new] = rows[now] - c @ state
        table[..., ones] = eye
        root = _divided(table)
        on = is_on[k]
        out[:, now[on]] = table[:, on, :, new]
        scales[now[on]] = root[:, on].swapaxes(0, 1)
        gain = table[..., across].swapaxes(2, 3)
        gains[now[on]] = (gain[:, :, :n_x] @ table[..., ones])[:, on].swapaxes(0, 1)
        moves[:] = step[now]
        moves[:, :, inner, inner] = keep[k]
        state = moves @ (state + gain @ table[..., new]) + known[now]
        variance = moves @ (variance - gain @ table[..., across]) @ moves.swapaxes(2, 3)
        variance[:, :, inner, inner] += pushed[k]
        variance = (variance + variance.swapaxes(2, 3)) / 2
    determinants = np.add.reduceat(2 * np.log(scales).sum(axis=2), list(chain.first), axis=0)
    return White(out, determinants.T, np.median(gains, axis=0))


def _with_forces(chain: Chain, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how states with the forces beside them are seen, the matrices of their step, and what is known of it.

    Shapes are (n, n_y, n_x + n_d), (n, n_x + n_d, n_x + n_d) and (n, n_x + n_d, m).
    """
    n, n_y, m = rows.shape
    n_x, whole = chain.transition.shape[1], chain.transition.shape[1] + chain.pushes.shape[2]
    seen = np.zeros((n, n_y, whole))
    seen[:, :, :n_x] = chain.error * chain.measured[:, :, None]
    step, known = np.zeros((n, whole, whole)), np.zeros((n, whole, m))
    step[:, :n_x, :n_x] = chain.transition - chain.noise @ seen[:, :, :n_x]
    step[:, :n_x, n_x:] = chain.pushes
    known[:, :n_x] = chain.noise @ rows
    return seen, step, known


def side_by_side(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of all runs side by side (longest, n_runs), and whether each is one.

    A run that has ended goes on with its last one.
    """
    ends = np.array([*chain.first[1:], len(chain.width)])
    samples = np.arange(max(ends - chain.first))[:, None] + np.array(chain.first)
    return np.minimum(samples, ends - 1), samples < ends


def _divided(table: np.ndarray) -> np.ndarray:
    """Divide rows (..., n_y, n_y + m), the first n_y columns a covariance, by its Cholesky factor; return its diagonal.

    Each row, divided by its own element of the diagonal, is taken out of those below it.
    """
    n_y = table.shape[-2]
    root = np.empty(table.shape[:-1])
    for i in range(n_y):
        row = table[..., i, :]
        root[..., i] = np.sqrt(row[..., i])
        row /= root[..., i, None]
        if i + 1 < n_y:
            table[..., i + 1 :, :] -= row[..., i + 1 : n_y, None] * row[..., None, :]
    return root


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
