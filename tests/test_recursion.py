"""What goes from sample to sample is the textbook's Kalman filter, and a sum of what was pushed before."""

import numpy as np

from cartpend_dae.discover.recursion import TOGETHER, carried_along, filters

N, N_OWN, N_D, N_Y, RUNS = 2 * TOGETHER + 9, 2, 1, 2, 2


def test_states_are_the_sum_of_what_was_pushed_before():
    generator = np.random.default_rng(0)
    step, push = 0.5 * generator.standard_normal((7, 3, 3)), generator.standard_normal((7, 3, 2))
    begin = {0: np.ones((3, 2)), 4: np.zeros((3, 2))}
    found = carried_along(step, push, begin)
    np.testing.assert_array_equal(found[0], begin[0])
    np.testing.assert_array_equal(found[4], begin[4])
    np.testing.assert_allclose(found[3], step[2] @ (step[1] @ (step[0] @ begin[0] + push[0]) + push[1]) + push[2])
    np.testing.assert_allclose(found[6], step[5] @ push[4] + push[5])


def test_the_filter_is_that_of_the_textbook_beyond_what_one_call_goes_through():
    generator = np.random.default_rng(1)
    own = np.array([[1.0, 0.02], [-0.4, 0.9]]) + 0.01 * generator.standard_normal((N, RUNS, N_OWN, N_OWN))
    pushes, seen = (generator.standard_normal((N, RUNS, *shape)) for shape in ((N_OWN, N_D), (N_Y, N_OWN)))
    seen[5, 1] = 0.0  # nothing is measured there
    keep, sizes = np.full((N, 3, RUNS, N_D), 0.9), generator.uniform(0.1, 2.0, (3, RUNS, N_D))
    found = filters(own, pushes, seen, keep, sizes)
    for i in range(3):
        for j in range(RUNS):
            p = np.diag([0.0, 0.0, sizes[i, j, 0] ** 2])
            for k in range(N):
                f = np.block([[own[k, j], pushes[k, j]], [np.zeros((1, 2)), keep[k, i, j][:, None]]])
                c = np.hstack([seen[k, j], np.zeros((2, 1))])
                s = c @ p @ c.T + np.eye(N_Y)
                gain = p @ c.T @ np.linalg.inv(s)
                at = k, i, j
                np.testing.assert_allclose(found.covariance[at], p, rtol=1e-9, atol=1e-12)
                np.testing.assert_allclose(found.gain[at], gain, rtol=1e-9, atol=1e-12)
                np.testing.assert_allclose(found.step[at], f @ (np.eye(3) - gain @ c), rtol=1e-9, atol=1e-12)
                np.testing.assert_allclose(found.push[at], f @ gain, rtol=1e-9, atol=1e-12)
                np.testing.assert_allclose(found.root[at], np.linalg.inv(np.linalg.cholesky(s)), rtol=1e-9, atol=1e-12)
                p = f @ (np.eye(3) - gain @ c) @ p @ f.T
                p[2, 2] += sizes[i, j, 0] ** 2 * (1 - keep[k, i, j, 0] ** 2)
