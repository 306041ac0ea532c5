"""Linear systems given by matrices, with lists of inputs, states and outputs; units as in `signals`."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from cartpend_dae.language import Component, Statements, connect, signal
from cartpend_dae.library.signals import Integrator

Matrix = Sequence[Sequence[float]] | np.ndarray


class Entry(Component):
    """One of several inputs, u = what drives it."""

    u = signal("in", unit="1", doc="input")


class Combination(Component):
    """Sum of signals with weights, y = sum over k of weights[k] of[k]; `of` are signals of other components."""

    y = signal("out", unit="1", doc="sum")
    weights: tuple[float, ...]
    of: tuple[ca.SX, ...]

    def equations(self) -> Statements:
        terms = (weight * x for weight, x in zip(self.weights, self.of, strict=True) if weight != 0)
        yield self.y == sum(terms, ca.SX(0))


class StateSpace(Component):
    """Linear system, der(x) = A x + B u, y = C x + D u, with matrices of numbers as nested lists or arrays.

    Its inputs are `u[k].u`, its states `x[k].y` and its outputs `y[k].y`, counted from 0; D is zero if left out.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix | None = None

    def __post_init__(self) -> None:
        a, b, c, d = self._matrices()
        self.u = [Entry() for _ in range(b.shape[1])]
        self.x = [Integrator() for _ in range(a.shape[0])]
        signals = (*(part.y for part in self.x), *(part.u for part in self.u))
        self.rates = [Combination(weights=tuple(row), of=signals) for row in np.hstack([a, b]).tolist()]
        self.y = [Combination(weights=tuple(row), of=signals) for row in np.hstack([c, d]).tolist()]

    def equations(self) -> Statements:
        for rate, state in zip(self.rates, self.x, strict=True):
            yield connect(rate.y, state.u)

    def _matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the four matrices as arrays of numbers that fit together."""
        try:
            a, b, c = (np.array(m, dtype=float) for m in (self.A, self.B, self.C))
            d = np.zeros((len(c), b.shape[-1])) if self.D is None else np.array(self.D, dtype=float)
        except (TypeError, ValueError, IndexError):
            raise ValueError("StateSpace: `A`, `B`, `C` and `D` are matrices of numbers, [[a, b], [c, d]].") from None
        shapes = [m.shape for m in (a, b, c, d)]
        if any(len(shape) != 2 for shape in shapes) or not all(np.isfinite(m).all() for m in (a, b, c, d)):
            raise ValueError("StateSpace: `A`, `B`, `C` and `D` are matrices of finite numbers, [[a, b], [c, d]].")
        (n, m), (n_y, _) = b.shape, c.shape
        if shapes != [(n, n), (n, m), (n_y, n), (n_y, m)]:
            shown = ", ".join(
                f"{name} {rows} by {columns}" for name, (rows, columns) in zip("ABCD", shapes, strict=True)
            )
            raise ValueError(
                f"StateSpace: the matrices do not fit together: {shown}. With n states, m inputs and r outputs, A is "
                f"n by n, B n by m, C r by n and D r by m."
            )
        return a, b, c, d
