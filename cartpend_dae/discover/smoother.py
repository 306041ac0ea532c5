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


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Log likelihood (n_b,) up to a constant, and the inputs by run, (n_b, n_blocks, n_d).

    `pulls` and `stiffness` (n_b, n_d) are twice the positive and negative part of the likelihood's slope in the
    inputs' variances.
    """

    log_likelihood: np.ndarray
    inputs: tuple[np.ndarray, ...]
    pulls: np.ndarray
    stiffness: np.ndarray

    def only(self, row: int) -> "Smoothed":
        """Return what belongs to one choice of variances."""
        one = slice(row, row + 1)
        inputs = tuple(part[one] for part in self.inputs)
        return Smoothed(self.log_likelihood[one], inputs, self.pulls[one], self.stiffness[one])


def smooth(
    linear: LinearRuns, variances: np.ndarray, memory: float, data: tuple[np.ndarray, ...] | None = None
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
        Pulls of the blocks of each run in their place, (n_b, n_blocks, n), of data made by `imagined`.
    """
    n_x, n_t, n_d = linear.n_x, linear.n_theta, len(linear.unknown)
    n_b, size = variances.shape[0], n_x + n_t + n_d
    mean, cov = np.zeros((n_b, size)), np.zeros((n_b, size, size))
    cov[:, n_x : n_x + n_t, n_x : n_x + n_t] = LOOSE**2 * np.eye(n_t)
    tape: list[_Node] = []
    total = np.zeros(n_b)
    for r, run in enumerate(linear.runs):
        begin = _beginning(run, n_x, n_t, n_d)
        step, rest, share = begin, np.zeros(size), 1.0
        for k, block in enumerate(run.blocks):
            mean = mean @ step.T + rest
            cov = step @ cov @ step.T
            cov[:, n_x + n_t :, n_x + n_t :] += share * _diagonal(variances)
            pull = block.pull if data is None else data[r][:, k]
            node, gain = _update(mean, cov, block.gram, pull, step, share, r)
            tape.append(node)
            total += gain - block.constant / 2 * (data is None)
            mean, cov = mean - np.einsum("bij,bj->bi", node.after, node.slope), node.after
            fade = np.exp(-block.width / memory)
            step, share = block.step.copy(), 1 - fade**2
            rest = block.rest if data is None else np.zeros(size)
            step[n_x + n_t :] *= fade
    return _backwards(linear, tape, total, variances)


@dataclass(frozen=True, slots=True)
class _Node:
    """What the way back needs of a block: predicted and updated moments, slope of its cost, how it was reached."""

    mean: np.ndarray
    before: np.ndarray
    after: np.ndarray
    slope: np.ndarray
    gram: np.ndarray
    step: np.ndarray
    share: float
    run: int


def _beginning(run: LinearRun, n_x: int, n_t: int, n_d: int) -> np.ndarray:
    """Return the step to the begin of a run, which keeps nothing but what the runs share."""
    step = np.zeros((n_x + n_t + n_d, n_x + n_t + n_d))
    step[:n_x, n_x : n_x + n_t] = run.start
    step[n_x : n_x + n_t, n_x : n_x + n_t] = np.eye(n_t)
    return step


def _diagonal(variances: np.ndarray) -> np.ndarray:
    return variances[:, :, None] * np.eye(variances.shape[1])


def _update(
    mean: np.ndarray, cov: np.ndarray, gram: np.ndarray, pull: np.ndarray, step: np.ndarray, share: float, run: int
) -> tuple[_Node, np.ndarray]:
    """Weigh what a block says; return the node and the log likelihood of the block, without its constant."""
    size = gram.shape[0]
    system = np.eye(size) + gram @ cov
    after = np.linalg.solve(system, np.broadcast_to(np.eye(size), cov.shape).copy())
    after = cov @ after
    after = (after + after.transpose(0, 2, 1)) / 2
    slope = pull + mean @ gram
    _, logdet = np.linalg.slogdet(system)
    bent = np.einsum("bij,bj->bi", after, slope)
    cost = np.sum((pull + slope) * mean, axis=1) - np.sum(slope * bent, axis=1) + logdet
    return _Node(mean, cov, after, slope, gram, step, share, run), -cost / 2


def _backwards(linear: LinearRuns, tape: list[_Node], total: np.ndarray, variances: np.ndarray) -> Smoothed:
    n_d, (n_b, size) = len(linear.unknown), tape[0].mean.shape
    eye = np.eye(size)
    push, curve = np.zeros((n_b, size)), np.zeros((n_b, size, size))
    pulls, stiffness = np.zeros((n_b, n_d)), np.zeros((n_b, n_d))
    inputs: list[list[np.ndarray]] = [[] for _ in linear.runs]
    for node in reversed(tape):
        turn = eye - node.after @ node.gram  # d(updated mean)/d(predicted mean)
        turned = turn.transpose(0, 2, 1)
        push = np.einsum("bij,bj->bi", turned, push - node.slope)
        curve = turned @ (node.gram + curve @ turn)
        curve = (curve + curve.transpose(0, 2, 1)) / 2
        smoothed = node.mean + np.einsum("bij,bj->bi", node.before, push)
        inputs[node.run].append(smoothed[:, size - n_d :])
        pulls += node.share * push[:, size - n_d :] ** 2
        stiffness += node.share * np.diagonal(curve, axis1=1, axis2=2)[:, size - n_d :]
        push = push @ node.step
        curve = node.step.T @ curve @ node.step
    series = tuple(np.array(part[::-1]).transpose(1, 0, 2) for part in inputs)
    return Smoothed(total, series, pulls, stiffness)


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
        ratio = np.clip(found.pulls / np.maximum(found.stiffness, 1e-300), 1e-4, 1e4)
        last = found.log_likelihood
        trial = variances * ratio
        after = smooth(linear, trial, memory)
        worse = ~(after.log_likelihood >= last - STILL)
        if worse.any():  # the square root of the ratio never makes it worse
            trial = np.where(worse[:, None], variances * np.sqrt(ratio), trial)
            after = smooth(linear, trial, memory)
        variances, found = trial, after
        if np.all(np.abs(found.log_likelihood - last) < STILL):
            break
    return variances, found


def imagined(
    linear: LinearRuns, variances: np.ndarray, memory: float, generator: np.random.Generator
) -> tuple[np.ndarray, ...]:
    """Return the pulls of data that follow the linear model with inputs of given variances (n_b, n_d), for `smooth`."""
    n_x, n_t, n_d = linear.n_x, linear.n_theta, len(linear.unknown)
    n_b, found = len(variances), []
    for run in linear.runs:
        state = np.zeros((n_b, n_x + n_t + n_d))
        state[:, n_x + n_t :] = np.sqrt(variances) * generator.standard_normal(variances.shape)
        pulls = []
        for block in run.blocks:
            noise = generator.standard_normal((n_b, len(block.gram))) @ _root(block.gram).T
            pulls.append(state @ block.gram + noise)
            fade = np.exp(-block.width / memory)
            state = state @ block.step.T
            fresh = np.sqrt(1 - fade**2) * np.sqrt(variances) * generator.standard_normal(variances.shape)
            state[:, n_x + n_t :] = fade * state[:, n_x + n_t :] + fresh
        found.append(np.array(pulls).transpose(1, 0, 2))
    return tuple(found)


def _root(gram: np.ndarray) -> np.ndarray:
    """Return R with R R' = gram."""
    values, vectors = np.linalg.eigh(gram)
    return vectors * np.sqrt(np.clip(values, 0.0, None))
