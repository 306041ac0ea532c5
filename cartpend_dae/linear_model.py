"""A linear model with names, x' = A x + B u, y = C x + D u, of deviations from an operating point."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import StateSpace

from cartpend_dae.errors import ModelError
from cartpend_dae.quantities import is_number

FloatArray = NDArray[np.float64]
MOST_COLUMNS = 16
"""Up to this number of columns a matrix is printed in full."""


@dataclass(frozen=True, slots=True)
class Mode:
    """A pole with its natural frequency [rad/s] and damping ratio (nan for a pole that has no frequency).

    Of a sampled model `pole` lies in the plane of z, and the others belong to s = log(z)/period.
    """

    pole: complex
    frequency: float
    damping: float


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """A linear model of deviations, with names: x' = A x + B u, or x[k+1] = A x[k] + B u[k] if sampled; y = C x + D u.

    Parameters
    ----------
    name
        The model that was linearised.
    states, inputs, outputs
        Names of x, u and y.
    state_units, input_units, output_units
        Their SI units.
    A, B, C, D
        Matrices, shapes (n_x, n_x), (n_x, n_u), (n_y, n_x), (n_y, n_u).
    x, u, y
        The operating point: what the deviations are measured from.
    rate
        Derivatives of the states at the operating point, (n_x,); zero if it is a rest.
    period
        Sampling period [s] of a sampled model, else None.
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    x: FloatArray
    u: FloatArray
    y: FloatArray
    rate: FloatArray
    period: float | None = None

    def poles(self) -> NDArray[np.complex128]:
        """Return the eigenvalues of A, the least stable first [1/s; of a sampled model without unit]."""
        return sorted_poles(self.A, self.period)

    def damping(self) -> tuple[Mode, ...]:
        """Return each pole with its natural frequency and damping ratio, the least stable first."""
        return tuple(_mode(complex(pole), self.period) for pole in self.poles())

    def frequency_response(self, omega: Sequence[float] | FloatArray | float) -> NDArray[np.complex128]:
        """Return C (s I - A)^-1 B + D at s = j omega, of a sampled model at z = exp(j omega period).

        Parameters
        ----------
        omega
            Frequencies [rad/s], (n,) or one number.

        Returns
        -------
        numpy.ndarray
            Shape (n, n_y, n_u).

        Raises
        ------
        ModelError
            For frequencies that are no numbers, and for one at which there is a pole without damping.
        """
        try:
            omega = np.atleast_1d(np.asarray(omega, dtype=float))
        except (TypeError, ValueError):
            raise ModelError(f"The frequencies must be numbers in rad/s, not {omega!r}.") from None
        if omega.ndim != 1 or not np.all(np.isfinite(omega)):
            raise ModelError("The frequencies must be one row of finite numbers in rad/s.")
        where = 1j * omega if self.period is None else np.exp(1j * omega * self.period)
        pencil = where[:, None, None] * np.eye(len(self.states)) - self.A
        right = np.broadcast_to(self.B.astype(complex), (omega.size, *self.B.shape))
        try:
            return self.C @ np.linalg.solve(pencil, right) + self.D
        except np.linalg.LinAlgError:
            raise ModelError(
                f"{self.name} has a pole without damping at one of the frequencies, where the response is infinite; "
                f"leave it out (`poles()` lists them)."
            ) from None

    def to_scipy(self) -> StateSpace:
        """Return the same as a state space of scipy.signal, with `dt` if it is sampled."""
        return StateSpace(self.A, self.B, self.C, self.D, **({} if self.period is None else {"dt": self.period}))

    def discretize(self, period: float) -> "LinearModel":
        """Return the exact model at the samples, for inputs that are held between them (zero-order hold).

        Parameters
        ----------
        period
            Sampling period [s].

        Raises
        ------
        ModelError
            If the period is not positive, or the model sampled already.
        """
        if self.period is not None:
            raise ModelError(
                f"{self.name} is sampled already, with {self.period:g} s; discretise the continuous model."
            )
        if not is_number(period) or not 0 < period < math.inf:
            raise ModelError(f"The sampling period must be a positive number of seconds, not {period!r}.")
        n_x, n_u = self.B.shape
        both = expm(np.vstack([np.hstack([self.A, self.B]), np.zeros((n_u, n_x + n_u))]) * period)
        return replace(self, A=both[:n_x, :n_x], B=both[:n_x, n_x:], period=float(period))

    def __str__(self) -> str:
        """Return the operating point, the matrices with names, and the modes."""
        kind = "continuous" if self.period is None else f"sampled every {self.period:g} s"
        is_rest = np.all(np.abs(self.rate) <= 1e-6 * np.maximum(1.0, np.abs(self.x)))
        groups = [
            ("states", self.states, self.x, self.state_units),
            ("inputs", self.inputs, self.u, self.input_units),
            ("outputs", self.outputs, self.y, self.output_units),
        ]
        lines = [f"{self.name}, linear about {'a rest' if is_rest else 'a point of its motion'}, {kind}"]
        for head, names, values, units in groups:
            points = (f"{n} = {number_text(v)} {unit}" for n, v, unit in zip(names, values, units, strict=True))
            lines.append(f"  {head} ({len(names)}): {', '.join(points) or 'none'}")
        for letter, rows, columns, matrix in (
            ("A", self.states, self.states, self.A),
            ("B", self.states, self.inputs, self.B),
            ("C", self.outputs, self.states, self.C),
            ("D", self.outputs, self.inputs, self.D),
        ):
            lines += matrix_lines(letter, rows, columns, matrix)
        return "\n".join([*lines, *_mode_lines(self)])

    __repr__ = __str__


def sorted_poles(matrix: FloatArray, period: float | None) -> NDArray[np.complex128]:
    """Return the eigenvalues of a matrix, the least stable first; of a pair the one above the real axis first."""
    poles: NDArray[np.complex128] = np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)
    growth = np.round(poles.real if period is None else np.abs(poles), 12)
    return poles[np.lexsort((-poles.imag, np.abs(poles.imag), -growth))]


def matrix_lines(letter: str, rows: Sequence[str], columns: Sequence[str], matrix: FloatArray) -> list[str]:
    """Return a matrix as text with the names of its rows and columns; of a large one only what is not zero."""
    if not matrix.size:
        return []
    if len(columns) > MOST_COLUMNS:
        entries = [f"  {rows[i]}, {columns[j]}: {matrix[i, j]:.6g}" for i, j in zip(*np.nonzero(matrix), strict=True)]
        return [f"{letter} (row, column: value; the others are 0):", *entries]
    cells = [[number_text(value) for value in row] for row in matrix]
    widths = [max(len(name), *(len(row[j]) for row in cells)) for j, name in enumerate(columns)]
    first = max(len(name) for name in rows)
    table = [f"{letter}:".ljust(first + 2), *(name.rjust(w) for name, w in zip(columns, widths, strict=True))]
    body = [
        "  ".join([f"  {name}".ljust(first + 2), *(cell.rjust(w) for cell, w in zip(row, widths, strict=True))])
        for name, row in zip(rows, cells, strict=True)
    ]
    return ["  ".join(table), *body]


def pole_text(pole: complex) -> str:
    """Return a pole in six digits, without a part that is rounding."""
    real, imag = (part if abs(part) > 1e-12 * abs(pole) else 0.0 for part in (pole.real, pole.imag))
    return number_text(real) if imag == 0 else f"{number_text(real)}{imag:+.6g}j"


def number_text(value: float) -> str:
    """Return a number in six digits; what no quantity can be, such as -0 and 1e-50, is 0."""
    return "0" if abs(value) < 1e-40 else f"{value:.6g}"


def _mode_lines(linear: LinearModel) -> list[str]:
    modes = linear.damping()
    if not modes:
        return []
    unit = "1/s" if linear.period is None else "z"
    rows = [
        (pole_text(m.pole), f"{m.frequency:.6g}", "-" if math.isnan(m.damping) else f"{round(m.damping, 9) + 0.0:.6g}")
        for m in modes
    ]
    heads = (f"pole [{unit}]", "frequency [rad/s]", "damping ratio")
    widths = [max(len(head), *(len(row[k]) for row in rows)) for k, head in enumerate(heads)]
    return ["  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in (heads, *rows)]


def _mode(pole: complex, period: float | None) -> Mode:
    if period is not None and pole == 0:  # it is gone after one sample
        return Mode(pole, math.inf, 1.0)
    s = pole if period is None else cmath.log(pole) / period
    return Mode(pole, abs(s), -s.real / abs(s) if abs(s) > 0 else math.nan)
