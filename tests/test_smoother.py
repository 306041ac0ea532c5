"""The smoother of unknown inputs against the normal distribution of everything, written down as one matrix."""

import numpy as np
import pytest

from cartpend_dae.discover.linear_runs import Block, LinearRun, LinearRuns
from cartpend_dae.discover.smoother import LOOSE, imagined, likely, smooth

N_X, N_T, N_D, MEMORY, WIDTH = 2, 2, 2, 0.7, 0.1
SIZE = N_X + N_T + N_D


def random_runs(seed, n_blocks=(7, 5)):
    """Two runs with random blocks, and the rows of residuals behind them: error = offset + slope state + noise."""
    rng = np.random.default_rng(seed)
    runs, rows = [], []
    for n in n_blocks:
        blocks, seen = [], []
        for _ in range(n):
            step = np.eye(SIZE)
            step[:N_X] = 0.5 * rng.standard_normal((N_X, SIZE))
            rest = np.concatenate([0.3 * rng.standard_normal(N_X), np.zeros(N_T + N_D)])
            slope, offset = rng.standard_normal((3, SIZE)), rng.standard_normal(3)
            blocks.append(Block(step, rest, slope.T, offset, 0.0, WIDTH))
            seen.append((slope, offset))
        start = rng.standard_normal((N_X, N_T))
        runs.append(LinearRun("r", np.arange(n) * WIDTH, np.arange(n), start, tuple(blocks), None))
        rows.append(seen)
    return LinearRuns(("d1", "d2"), N_X, N_T, tuple(runs), None, np.zeros(0)), rows


def dense(linear, rows, variances):
    """Return log likelihood and expected inputs from the joint normal distribution of all that is random."""
    fade = np.exp(-WIDTH / MEMORY)
    n_all = sum(len(run.blocks) for run in linear.runs)
    n_random = N_T + n_all * N_D
    matrix, offsets, inputs, k = [], [], [], 0
    for run, seen in zip(linear.runs, rows, strict=True):
        # the state as a linear function of all that is random, and a constant
        state, rest = np.zeros((SIZE, n_random)), np.zeros(SIZE)
        state[N_X : N_X + N_T, :N_T] = LOOSE * np.eye(N_T)
        state[:N_X] = run.start @ state[N_X : N_X + N_T]
        for i, (block, (slope, offset)) in enumerate(zip(run.blocks, seen, strict=True)):
            share = np.sqrt(1 - fade**2) if i else 1.0
            column = N_T + k * N_D
            state[N_X + N_T :] *= fade if i else 0.0
            state[N_X + N_T :, column : column + N_D] = share * np.diag(np.sqrt(variances))
            inputs.append(state[N_X + N_T :].copy())
            matrix.append(slope @ state)
            offsets.append(slope @ rest + offset)
            k += 1
            kept = state[N_X + N_T :].copy()
            state, rest = block.step @ state, block.step @ rest + block.rest
            state[N_X + N_T :] = kept
    m, c = np.vstack(matrix), np.concatenate(offsets)
    cov = m @ m.T + np.eye(c.size)
    mean = -m.T @ np.linalg.solve(cov, c)
    likelihood = -(c @ np.linalg.solve(cov, c) + np.linalg.slogdet(cov)[1]) / 2
    return likelihood, np.array([row @ mean for row in inputs])


@pytest.mark.parametrize("seed", range(3))
def test_likelihood_and_inputs_are_those_of_the_joint_distribution(seed):
    linear, rows = random_runs(seed)
    choices = np.array([[0.4, 1.3], [0.0, 0.7], [2.0, 0.0]])
    found = smooth(linear, choices, MEMORY)
    for i, variances in enumerate(choices):
        likelihood, inputs = dense(linear, rows, variances)
        assert found.log_likelihood[i] == pytest.approx(likelihood, abs=1e-8)
        np.testing.assert_allclose(np.concatenate([part[i] for part in found.inputs]), inputs, atol=1e-8)


def test_the_slopes_in_the_variances_are_those_of_the_likelihood():
    linear, rows = random_runs(5)
    at, h = np.array([0.6, 0.9]), 1e-5
    found = smooth(linear, at[None], MEMORY)
    for i in range(N_D):
        high, low = (dense(linear, rows, at + sign * h * np.eye(N_D)[i])[0] for sign in (1, -1))
        # half the difference of pull and stiffness is the slope
        slope = (found.pulls - found.stiffness)[0, i] / 2
        assert slope == pytest.approx((high - low) / (2 * h), rel=1e-5)


def test_the_variances_of_made_data_are_found_again():
    linear, _ = random_runs(2, n_blocks=(400,))
    truth = np.array([[0.5, 0.0]])
    (offsets,) = imagined(linear, truth, MEMORY, np.random.default_rng(0))
    blocks = tuple(
        Block(b.step, np.zeros(SIZE), b.root, offset[0], 0.0, b.width)
        for b, offset in zip(linear.runs[0].blocks, offsets, strict=True)
    )
    (run,) = linear.runs
    made = LinearRuns(
        linear.unknown, N_X, N_T, (LinearRun("r", run.time, run.first, run.start, blocks, None),), None, 0
    )
    variances, _ = likely(made, np.ones((1, 2), dtype=bool), MEMORY, np.ones((1, 2)), steps=40)
    assert variances[0, 0] == pytest.approx(0.5, rel=0.5)  # some 60 independent values in 400 blocks
    # the steps end where the likelihood stands still, a little above 0
    assert variances[0, 1] < 0.1
