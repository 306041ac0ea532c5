"""The filter that whitens is generalised least squares with the covariance written out, and it finds random forces."""

from dataclasses import replace

import numpy as np
import pytest

from cartpend_dae.discover import weigh as weigh_module
from cartpend_dae.discover.disturbed import MIN_T, _least_t, penalty
from cartpend_dae.discover.unknown_input import Chain, left_over, likelihood, whitened
from cartpend_dae.effects import insertion_at
from models.linear_damp_mod import LinearDampMod

WIDTH, N = 0.02, 120


def chain_of(n_y: int) -> Chain:
    """Two runs of a damped oscillator with injection, pushed by two forces; the second output shows the speed."""
    step = np.array([[1.0, WIDTH], [-20.0 * WIDTH, 0.9]])
    seen = np.array([[2.0, 0.0], [0.0, 1.0]])[:n_y]
    injected = np.array([[0.05, 0.0], [0.3, 0.02]])[:, :n_y]
    measured = np.ones((N, n_y), dtype=bool)
    measured[17] = False
    tile = lambda matrix: np.tile(matrix, (N, 1, 1))  # noqa: E731
    pushes = np.array([[0.0, 0.001], [WIDTH, 0.0]])
    width = np.full(N, WIDTH)
    return Chain(("a", "b"), tile(step), tile(injected), tile(pushes), tile(seen), measured, (0, 70), width)


def dense_covariance(chain: Chain, sizes: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the covariance of all residuals, from the response to each single disturbance, (n_runs, n_d) forces."""
    n, n_y, n_x = chain.error.shape
    keep = np.exp(-WIDTH / times)
    columns = []
    for k in range(n):
        end, run = (70, 0) if k < 70 else (n, 1)
        for j in range(n_y):  # a unit of sensor noise at sample k
            row, x = np.zeros((n, n_y)), np.zeros(n_x)
            for i in range(k, end):
                e = np.eye(n_y)[j] * (i == k)
                row[i] = chain.error[i] @ x + e
                x = chain.transition[i] @ x + chain.noise[i] @ e
            columns.append(row)
        for d in range(sizes.shape[1]):  # a unit of what is new in a force at sample k
            row, x = np.zeros((n, n_y)), np.zeros(n_x)
            is_first = k in chain.first
            force = sizes[run, d] * (1.0 if is_first else np.sqrt(1 - keep[run, d] ** 2))
            for i in range(k, end):
                row[i] = chain.error[i] @ x
                x = chain.transition[i] @ x + chain.pushes[i][:, d] * force
                force *= keep[run, d]
            columns.append(row)
    flat = np.array([c[chain.measured] for c in columns])
    return flat.T @ flat


@pytest.mark.parametrize("n_y", [1, 2])
def test_the_filter_is_least_squares_with_the_whole_covariance(n_y):
    chain = chain_of(n_y)
    # a value that was not measured says nothing, neither by the injection
    chain.noise[17] = 0.0
    sizes = np.array([[[3.0, 40.0], [6.0, 10.0]], np.zeros((2, 2))])
    times = np.array([[[0.1, 0.5], [0.3, 0.2]], np.full((2, 2), 0.1)])
    generator = np.random.default_rng(1)
    rows = chain.spread(generator.standard_normal((int(chain.measured.sum()), 3)))
    white = whitened(chain, rows, sizes, times)
    for one, determinant, size, time in zip(white.rows, white.determinant, sizes, times, strict=True):
        covariance = dense_covariance(chain, size, time)
        flat = rows[chain.measured]
        expected = flat.T @ np.linalg.solve(covariance, flat)
        # rounding of two ways to the same numbers
        np.testing.assert_allclose(one[chain.measured].T @ one[chain.measured], expected, rtol=1e-7)
        assert determinant.sum() == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-8, abs=1e-7)


def test_without_injection_and_forces_rows_stay_as_they_are():
    chain = chain_of(2)
    chain.noise[:] = 0.0
    rows = chain.spread(np.random.default_rng(2).standard_normal((int(chain.measured.sum()), 2)))
    white = whitened(chain, rows, np.zeros((1, 2, 2)), np.ones((1, 2, 2)))
    np.testing.assert_allclose(white.rows[0], rows, atol=1e-12)
    assert white.determinant[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_the_likelihood_finds_the_force_that_was_there():
    chain = chain_of(1).only(("a",))
    chain.noise[17] = 0.0
    covariance = dense_covariance(chain, np.full((2, 1), 30.0), np.full((2, 1), 0.1))
    generator, mean = np.random.default_rng(3), np.zeros(9)
    grid = 30.0 * np.geomspace(0.1, 10.0, 9)
    for _ in range(40):
        values = np.linalg.cholesky(covariance) @ generator.standard_normal(len(covariance))
        sizes = np.tile(grid[:, None, None], (1, 2, 1))
        white = whitened(chain, chain.spread(values[:, None]), sizes, np.full((9, 2, 1), 0.1))
        squares = np.array([left_over(one[chain.measured]) for one in white.rows])
        mean += likelihood(len(values), squares, white.determinant.sum(axis=1)) / 40
    # the expected likelihood is largest at the truth, the middle of the grid; a step is a factor of 1.8
    assert abs(int(np.argmin(mean)) - 4) <= 1
    assert mean[0] - mean.min() > 10


def test_a_larger_library_costs_more():
    # 2 ln(n/0.01): chi-squared of one in a hundred libraries
    assert penalty(100) == pytest.approx(2 * np.log(1e4))
    assert penalty(200) - penalty(100) == pytest.approx(2 * np.log(2))


def test_forces_are_looked_for_until_a_round_gains_little(monkeypatch):
    chain, values = chain_of(1), np.random.default_rng(2).standard_normal(N)
    first = np.full((1, 2, 2), 1.0), np.full((1, 2, 2), 0.1)
    gains = iter([100.0, 99.0, 98.0, 97.8, 97.7, 50.0, 40.0])  # of the first sets, then of each force in each round
    monkeypatch.setattr(weigh_module, "_tried", lambda *_: (None, [next(gains)]))
    monkeypatch.setattr(weigh_module, "_best_of_runs", lambda *_: np.zeros(2, dtype=int))  # all alike
    _, criterion = weigh_module.most_likely(chain, chain.spread(values[chain.measured.ravel()][:, None]), first, 5)
    assert criterion == 97.7  # the second round, which gained 0.3, was the last


@pytest.mark.parametrize("is_alike", [True, False])
def test_forces_of_each_run_are_its_own_where_the_data_tell(is_alike):
    """With one correlation time for all runs, springs gained 96 of -2 ln likelihood where nothing was missing."""
    chain = chain_of(1).only(("a",))
    chain.noise[17] = 0.0
    sizes, times = np.array([[60.0], [60.0 if is_alike else 5.0]]), np.full((2, 1), 0.2)
    root, generator = np.linalg.cholesky(dense_covariance(chain, sizes, times)), np.random.default_rng(5)
    ratios = []
    for _ in range(20):
        rows = chain.spread((root @ generator.standard_normal(len(root)))[:, None])
        start = np.full((1, 2, 1), 30.0), np.full((1, 2, 1), 0.2)
        forces, criterion = weigh_module.most_likely(chain, rows, start, 4)
        assert criterion <= weigh_module.most_likely(chain, rows, start, 0)[1]
        ratios.append(float(forces.sizes[1, 0] / forces.sizes[0, 0]))
    if is_alike:
        assert np.mean(np.array(ratios) == 1.0) > 0.7
    else:
        assert 0.0 < np.median(ratios) < 0.2  # a twelfth; the least steps are a factor of 1.4


def test_pieces_of_a_run_have_the_same_forces():
    """With forces of each piece, five of 0.8 s of a measured pendulum had four effects too many."""
    chain = replace(chain_of(1).only(("a",)), owners=(0, 0))
    chain.noise[17] = 0.0
    sizes, times = np.array([[60.0], [5.0]]), np.full((2, 1), 0.2)
    root, generator = np.linalg.cholesky(dense_covariance(chain, sizes, times)), np.random.default_rng(5)
    rows = chain.spread((root @ generator.standard_normal(len(root)))[:, None])
    found = weigh_module.most_likely(chain, rows, (np.full((1, 2, 1), 30.0), np.full((1, 2, 1), 0.2)), 4)[0]
    assert np.all(found.sizes == found.sizes[0])
    assert np.all(found.times == found.times[0])


def test_a_single_parameter_must_pass_by_its_spread_what_it_must_by_its_likelihood():
    """Losses in gears gained 27 of -2 ln likelihood with 1.4 jackknife standard deviations, where nothing was there."""
    one, two = (insertion_at(LinearDampMod(), name, "rail") for name in ("coulomb_friction", "asymmetric_friction"))
    needed = penalty(170)
    assert _least_t(one, needed, 2 * needed) ** 2 == pytest.approx(needed)
    assert _least_t(one, needed, 0.0) > MIN_T
    assert _least_t(two, 2 * needed, 0.0) == MIN_T
    assert _least_t(two, 2 * needed, 2 * needed) == 0.0
