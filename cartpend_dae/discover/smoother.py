"""Unknown inputs of linear runs by a Kalman filter and smoother: how large they are, what they were, how likely.

Each input is an Ornstein-Uhlenbeck process; deviations of parameters and free starts are estimated along. The smoother
is the adjoint of the filter's likelihood, which also gives the slopes in the inputs' variances. Several choices of
variances are followed at once, in the first axis of all arrays.

References
----------
G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18 (1973), 65-75,
doi:10.1080/00207177308932487 (the adjoint form).
H. Zhou, L. Hu, J. Zhou, K. Lange, "MM algorithms for variance components models", J. Comput. Graph. Stat. 28 (2019),
350-361, doi:10.1080/10618600.2018.1529601 (the steps of the variances).
"""

from dataclasses import dataclass

import numpy as np

from cartpend_dae.discover.linear_runs import LinearRun, LinearRuns

# standard deviation of what was fitted before, of its size
LOOSE = 1.0
STEPS = 10
# relative change of the log likelihood [its units] at which the variances stand
STILL = 0.3
TINY = 1e-100
# variance of what is expected over that of the noise beyond which rounding is larger than the noise
DROWNED = 1e14


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Log likelihood (n_b,) up to a constant, and the inputs by run, (n_b, n_blocks, n_d).

    `pulls` and `stiffness` (n_b, n_d) are twice the positive and negative part of the likelihood's slope in the
    inputs' variances, `squares` (n_b,) the sum of squared innovations over their variances.
    """

    log_likelihood: np.ndarray
    inputs: tuple[np.ndarray, ...]
    pulls: np.ndarray
    stiffness: np.ndarray
    squares: np.ndarray

    def only(self, row: int) -> "Smoothed":
        """Return what belongs to one choice of variances."""
        one = slice(row, row + 1)
        inputs = tuple(part[one] for part in self.inputs)
        return Smoothed(self.log_likelihood[one], inputs, self.pulls[one], self.stiffness[one], self.squares[one])

    def but(self, rows: np.ndarray, other: "Smoothed") -> "Smoothed":
        """Return the same, for some choices of variances that of another."""
        inputs = tuple(np.where(rows[:, None, None], b, a) for a, b in zip(self.inputs, other.inputs, strict=True))
        likelihood = np.where(rows, other.log_likelihood, self.log_likelihood)
        pulls, stiffness = (
            np.where(rows[:, None], getattr(other, n), getattr(self, n)) for n in ("pulls", "stiffness")
        )
        return Smoothed(likelihood, inputs, pulls, stiffness, np.where(rows, other.squares, self.squares))


def smooth(
    linear: LinearRuns, variances: np.ndarray, memory: float, data: tuple[list[np.ndarray], ...] | None = None
) -> Smoothed:
    """Filter and smooth all runs, one after the other, so that what they share is learned from all of them.

    Parameters
    ----------
    linear
        The runs.
    variances
        Stationary variances of the inputs, (n_b, n_d), SI.
    memory
        Correlation time of the inputs [s].
    data
        Offsets of the blocks of each run in the place of their own, (n_b, n), as made by `imagined`.
    """
    n_x, n_t, n_d = linear.n_x, linear.n_theta, len(linear.unknown)
    n_b, size = variances.shape[0], n_x + n_t + n_d
    mean, cov = np.zeros((n_b, size)), np.zeros((n_b, size, size))
    cov[:, n_x : n_x + n_t, n_x : n_x + n_t] = LOOSE**2 * np.eye(n_t)
    tape: list[_Node] = []
    lost = np.zeros(n_b, dtype=bool)
    total, squares = np.zeros(n_b), np.zeros(n_b)
    for r, run in enumerate(linear.runs):
        begin = _beginning(run, n_x, n_t, n_d)
        step, rest, share = begin, np.zeros(size), 1.0
        for k, block in enumerate(run.blocks):
            mean = mean @ step.T + rest
            cov = step @ cov @ step.T
            cov[:, n_x + n_t :, n_x + n_t :] += share * _diagonal(variances)
            lost |= ~(np.abs(block.root.T @ cov @ block.root).max(axis=(1, 2)) < DROWNED)
            mean[lost], cov[lost] = 0.0, 0.0
            offset = block.offset if data is None else data[r][k]
            node, mean, cov, square, logdet = _update(mean, cov, block.root, offset, _Way(step, share, r))
            tape.append(node)
            squares += square + block.constant
            total -= (square + block.constant + logdet) / 2
            fade = np.exp(-block.width / memory)
            step, share = block.step.copy(), 1 - fade**2
            rest = block.rest if data is None else np.zeros(size)
            step[n_x + n_t :] *= fade
    total[lost] = -np.inf
    return _backwards(linear, tape, total, squares)


@dataclass(frozen=True, slots=True)
class _Way:
    """How a block was reached: the step to it, the share of the inputs' variance that is new, and its run."""

    step: np.ndarray
    share: float
    run: int


@dataclass(frozen=True, slots=True)
class _Node:
    """What the way back needs: predicted moments, d(updated)/d(predicted), slope and curvature of a block's cost."""

    mean: np.ndarray
    before: np.ndarray
    turn: np.ndarray
    slope: np.ndarray
    curve: np.ndarray
    way: _Way


def _beginning(run: LinearRun, n_x: int, n_t: int, n_d: int) -> np.ndarray:
    """Return the step to the begin of a run, which keeps nothing but what the runs share."""
    step = np.zeros((n_x + n_t + n_d, n_x + n_t + n_d))
    step[:n_x, n_x : n_x + n_t] = run.start
    step[n_x : n_x + n_t, n_x : n_x + n_t] = np.eye(n_t)
    return step


def _diagonal(variances: np.ndarray) -> np.ndarray:
    return variances[:, :, None] * np.eye(variances.shape[1])


def _update(
    mean: np.ndarray, cov: np.ndarray, root: np.ndarray, offset: np.ndarray, way: _Way
) -> tuple[_Node, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Weigh what a block says; return the node, the updated moments, squared innovations and their log variance."""
    crossed = cov @ root
    spread = np.eye(root.shape[1]) + root.T @ crossed
    error = offset + mean @ root
    values, vectors = np.linalg.eigh(spread)
    values = np.maximum(values, 1.0)  # that of the noise
    inverse = (vectors / values[:, None, :]) @ vectors.transpose(0, 2, 1)
    gain = crossed @ inverse
    weighed = np.einsum("bij,bj->bi", inverse, error)
    turn = np.eye(root.shape[0]) - gain @ root.T
    # the form that stays positive whatever the rounding (Joseph)
    after = turn @ cov @ turn.transpose(0, 2, 1) + gain @ gain.transpose(0, 2, 1)
    node = _Node(mean, cov, turn, weighed @ root.T, root @ inverse @ root.T, way)
    logdet = np.sum(np.log(values), axis=1)
    return node, mean - np.einsum("bij,bj->bi", gain, error), after, np.sum(error * weighed, axis=1), logdet


def _backwards(linear: LinearRuns, tape: list[_Node], total: np.ndarray, squares: np.ndarray) -> Smoothed:
    n_d, (n_b, size) = len(linear.unknown), tape[0].mean.shape
    push, curve = np.zeros((n_b, size)), np.zeros((n_b, size, size))
    pulls, stiffness = np.zeros((n_b, n_d)), np.zeros((n_b, n_d))
    inputs: list[list[np.ndarray]] = [[] for _ in linear.runs]
    for node in reversed(tape):
        turned, way = node.turn.transpose(0, 2, 1), node.way
        push = np.einsum("bij,bj->bi", turned, push) - node.slope
        curve = node.curve + turned @ curve @ node.turn
        curve = (curve + curve.transpose(0, 2, 1)) / 2
        smoothed = node.mean + np.einsum("bij,bj->bi", node.before, push)
        inputs[way.run].append(smoothed[:, size - n_d :])
        pulls += way.share * push[:, size - n_d :] ** 2
        stiffness += way.share * np.diagonal(curve, axis1=1, axis2=2)[:, size - n_d :]
        push = push @ way.step
        curve = way.step.T @ curve @ way.step
    series = tuple(np.array(part[::-1]).transpose(1, 0, 2) for part in inputs)
    return Smoothed(total, series, pulls, stiffness, squares)


def likely(
    linear: LinearRuns, allowed: np.ndarray, memory: float, begin: np.ndarray, *, steps: int = STEPS
) -> tuple[np.ndarray, Smoothed]:
    """Return the variances of largest likelihood (n_b, n_d), those not allowed being 0, and what they give.

    Parameters
    ----------
    linear
        The runs.
    allowed
        Which inputs there may be, (n_b, n_d).
    memory
        Correlation time of the inputs [s].
    begin
        Variances to begin with, (n_b, n_d).
    steps
        Largest number of steps.
    """
    variances = np.where(allowed, begin, 0.0)
    found = smooth(linear, variances, memory)
    for _ in range(steps):
        ratio = np.clip(found.pulls / np.maximum(found.stiffness, TINY), 1e-4, 1e4)
        last = found.log_likelihood
        trial = variances * ratio
        after = smooth(linear, trial, memory)
        worse = ~(after.log_likelihood >= last - STILL)
        if worse.any():  # the square root of the ratio never makes it worse
            trial = np.where(worse[:, None], variances * np.sqrt(ratio), trial)
            after = smooth(linear, trial, memory)
            worse = ~(after.log_likelihood >= last - STILL)
        variances, found = np.where(worse[:, None], variances, trial), after.but(worse, found)
        if np.all((found.log_likelihood <= last + STILL) | np.isinf(last)):
            break
    return variances, found


def imagined(
    linear: LinearRuns, variances: np.ndarray, memory: float, generator: np.random.Generator
) -> tuple[list[np.ndarray], ...]:
    """Return the offsets of data that follow the linear model with inputs of given variances (n_b, n_d)."""
    n_x, n_t, n_d = linear.n_x, linear.n_theta, len(linear.unknown)
    n_b, found = len(variances), []
    for run in linear.runs:
        state = np.zeros((n_b, n_x + n_t + n_d))
        state[:, n_x + n_t :] = np.sqrt(variances) * generator.standard_normal(variances.shape)
        offsets = []
        for block in run.blocks:
            # a residual is what was measured less what is predicted: the state makes it with the other sign
            offsets.append(generator.standard_normal((n_b, block.root.shape[1])) - state @ block.root)
            fade = np.exp(-block.width / memory)
            state = state @ block.step.T
            fresh = np.sqrt(1 - fade**2) * np.sqrt(variances) * generator.standard_normal(variances.shape)
            state[:, n_x + n_t :] = fade * state[:, n_x + n_t :] + fresh
        found.append(offsets)
    return tuple(found)
