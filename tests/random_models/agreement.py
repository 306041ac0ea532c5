"""Whether the assembled system of a network is the same as the one that its laws give."""

import numpy as np

from cartpend_dae.system import System
from random_models.pencil import POINTS, Network, StateSpace, state_space

# Rounding, of at most a hundred equations with a condition of up to 1e6.
CLOSE = 1e-9


def assert_agrees(network: Network, system: System) -> None:
    """Compare order, characteristic polynomial, responses to inputs, and motions from a random state.

    The motions of the assembled system satisfy the laws, and their order is that of the laws: the two systems have
    the same motions. That does not depend on the choice of states.
    """
    found = state_space(system)
    assert len(found.A) == network.pencil.degree
    for matrix in (found.A, found.B, found.C, found.D):
        assert np.isfinite(matrix).all()
    _assert_same_characteristic_polynomial(network, found.A)
    columns = [system.inputs.index(name) for name in network.inputs]
    for s in POINTS:
        response = found.C @ np.linalg.solve(s * np.eye(len(found.A)) - found.A, found.B) + found.D
        _assert_motion(
            network, found, [s**k * response[:, columns] for k in range(3)], np.eye(len(columns) + 1, len(columns))
        )
    generator = np.random.default_rng(0)
    x, u = generator.normal(size=len(found.A)), generator.normal(size=len(system.inputs) + 1)
    u[-1] = 1.0
    rate = found.A @ x + found.B @ u
    motion = [found.C @ x + found.D @ u, found.C @ rate, found.C @ found.A @ rate]
    _assert_motion(network, found, [m[:, None] for m in motion], u[[*columns, -1], None])


def _assert_same_characteristic_polynomial(network: Network, A: np.ndarray) -> None:
    """det P(s) / det(s - A) is the same at three points in general position: both have the same roots."""
    determinants = [
        (np.linalg.slogdet(network.pencil.at(s)), np.linalg.slogdet(s * np.eye(len(A)) - A)) for s in POINTS
    ]
    ratios = [ours[0] / theirs[0] * np.exp(ours[1] - theirs[1]) for ours, theirs in determinants]
    np.testing.assert_allclose(ratios, ratios[0], rtol=CLOSE)


def _assert_motion(network: Network, found: StateSpace, motion: list[np.ndarray], given: np.ndarray) -> None:
    """Check all variables and their first two derivatives against the laws."""
    place = {name: i for i, name in enumerate(found.names)}
    first = {node: place[potential] for node, _, potential, _ in reversed(network.ends)}
    for node, _, potential, _ in network.ends:
        a, b = motion[0][place[potential]], motion[0][first[node]]
        np.testing.assert_allclose(a, b, rtol=CLOSE, atol=CLOSE * np.abs(motion[0]).max(initial=0.0))
    chosen = [first[node] for node in network.nodes] + [place[flow] for *_, flow in network.ends]
    terms = [P @ y[chosen] for P, y in zip(network.pencil.P, motion, strict=True)]
    sizes = [np.abs(P) @ np.abs(y[chosen]) for P, y in zip(network.pencil.P, motion, strict=True)]
    right = network.pencil.Q @ given
    scale = max((part.max(initial=0.0) for part in (*sizes, np.abs(right))), default=0.0)
    np.testing.assert_allclose(sum(terms), right, rtol=0, atol=CLOSE * scale)
