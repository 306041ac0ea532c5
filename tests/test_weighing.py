"""Random forces: predictions within bounds, forces near known ones, and models as far fitted as what they meet."""

from types import SimpleNamespace

import numpy as np
import pytest

from cartpend_dae.discover import disturbed, weigh
from cartpend_dae.discover.disturbed import _bounded, polished
from cartpend_dae.discover.gate import is_noise_alone, most_of_noise


def test_a_size_that_nothing_tells_stays_small():
    """The viscous part of a law, beside a free viscous friction, ran off to 3e8 and stood first of all effects."""
    # products of the residual and columns of length one; of the last nothing is left but rounding (rod, tuning seed 50)
    upper = np.array(
        [
            [6.97e7, 1465.23, 308.59, -3.85e-10],
            [0.0, 0.3363, 0.09787, -4.31e-13],
            [0.0, 0.0, 0.9992, -1.037e-12],
            [0.0, 0.0, 0.0, 1.5e-24],
        ]
    )
    products = upper + np.triu(upper, 1).T
    squares, sizes = _bounded(np.vstack([products, np.ones(4)]), [1, 2, 3], [(0.0, np.inf)] * 3)
    assert sizes.max() < 1.0 and squares == pytest.approx(6.97e7)
    # what the data tell is as it would be without
    products[0, 1:3] = products[1:3, 0] = (-1465.23, -308.59)
    told = _bounded(np.vstack([products, np.ones(4)]), [1, 2, 3], [(0.0, np.inf)] * 3)[1]
    assert told[:2] == pytest.approx(np.linalg.solve(products[1:3, 1:3], -products[1:3, 0]).clip(0.0), rel=0.05)


def test_forces_near_known_ones_are_tried_as_they_are_and_with_a_little_of_those_that_were_nothing():
    sizes, times = np.array([[3.0, 0.0], [4.0, 0.0]]), np.array([[0.05, 0.7], [0.2, 0.7]])
    chain = SimpleNamespace(names=("a", "b"), first=(0, 2))
    found = SimpleNamespace(residual=np.full(4, 5.0), sizes={"a": np.ones(4)}, rough={"b": np.full(4, 0.5)})
    tried, widths = weigh.first_sets(found, chain, weigh.Forces(("a", "b"), sizes, times))
    assert np.array_equal(tried[0], sizes) and np.array_equal(widths[0], times)
    assert np.array_equal(tried[1], [[3.0, weigh.AGAIN * 10.0], [4.0, weigh.AGAIN * 10.0]]) and np.array_equal(
        widths[1], times
    )


def test_a_model_is_fitted_until_it_gains_nothing_by_itself(monkeypatch):
    """Adding nothing had gained up to 23 of -2 ln likelihood, more than an effect of one parameter must."""
    fit = SimpleNamespace(point={}, bandwidth=np.array([3.0]))
    made = [SimpleNamespace(criterion=value, forces=None) for value in (100.0, 77.0, 76.5, 70.0)]
    calls = []

    def fitted(*args, near=None):
        calls.append(args)
        return fit, made[len(calls)]

    monkeypatch.setattr(disturbed, "fitted", fitted)
    assert polished(None, (), (), (fit, made[0]), np.ones(1))[1] is made[2]  # the last step gained half
    assert len(calls) == 2
    made[1] = SimpleNamespace(criterion=100.5, forces=None)
    calls.clear()
    assert polished(None, (), (), (fit, made[0]), np.ones(1))[1] is made[0]


@pytest.mark.parametrize(("n", "share"), [(1602, 1.239), (3002, 1.175), (9006, 1.12)])
def test_noise_is_known_the_better_the_more_samples_there_are(monkeypatch, n, share):
    assert most_of_noise(n) == pytest.approx(share * n, rel=1e-3)
    monkeypatch.setattr("cartpend_dae.discover.gate.is_clean", lambda fit: True)
    fit = SimpleNamespace(chi2=0.0, n_residuals=n)
    assert is_noise_alone(SimpleNamespace(**vars(fit) | {"chi2": (share - 0.01) * n}))
    assert not is_noise_alone(SimpleNamespace(**vars(fit) | {"chi2": (share + 0.01) * n}))
