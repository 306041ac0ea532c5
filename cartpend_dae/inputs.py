"""What drives a simulation: numbers, functions of time, samples."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError
from cartpend_dae.system import System

Sampled = tuple[Sequence[float] | np.ndarray, Sequence[float] | np.ndarray]


Input = float | int | Callable[[ca.SX], ca.SX] | Sampled | tuple[np.ndarray, np.ndarray, Literal["zoh", "foh"]]


@dataclass(frozen=True, slots=True)
class DrivenInputs:
    """Inputs over the intervals of a grid: value at the left end and slope, shapes (n_u, n_intervals)."""

    left: np.ndarray
    slope: np.ndarray
    expressions: dict[int, Callable[[ca.SX], ca.SX]]


def with_knots(grid: np.ndarray, inputs: Mapping[str, Input]) -> np.ndarray:
    """Add the sample times of inputs, where slopes or values jump, to the output times."""
    knots = [np.asarray(value[0], dtype=float) for value in inputs.values() if isinstance(value, tuple)]
    if not knots:
        return grid
    inside = np.concatenate(knots)
    inside = inside[(inside > grid[0]) & (inside < grid[-1])]
    merged = np.union1d(grid, inside)
    # two knots closer than rounding would make an empty interval; output times win
    close = np.flatnonzero(np.diff(merged) < 1e-12 * max(1.0, float(np.abs(merged).max())))
    drop = [k + 1 if merged[k] in grid else k for k in close]
    return np.delete(merged, drop)


def driven_inputs(system: System, inputs: Mapping[str, Input], grid: np.ndarray) -> DrivenInputs:
    """Bring the caller's inputs onto the intervals of a grid.

    Parameters
    ----------
    system
        The system; an input that the caller leaves out takes its declared default.
    inputs
        By input name, see `simulate`.
    grid
        Times (n,) [s] that contain all sample times inside the simulation.

    Raises
    ------
    ModelError
        For an unknown input, one that nothing drives, or samples that do not increase in time.
    """
    n_intervals = grid.size - 1
    left, slope = np.zeros((len(system.inputs), n_intervals)), np.zeros((len(system.inputs), n_intervals))
    expressions: dict[int, Callable[[ca.SX], ca.SX]] = {}
    known = dict(zip(system.inputs, range(len(system.inputs)), strict=True))
    for name in inputs:
        if name not in known:
            listing = ", ".join(f"`{other}`" for other in system.inputs) or "none"
            raise ModelError(f"{system.name} has no input `{name}`; its inputs are: {listing}.")
    for name, row in known.items():
        default = system.variables[system.index_of(name)].declaration.default
        value = inputs.get(name, default)
        if value is None:
            raise ModelError(f"Nothing drives the input `{name}` of {system.name}: give `inputs={{'{name}': ...}}`.")
        if callable(value):
            expressions[row] = value
        elif isinstance(value, tuple):
            left[row], slope[row] = _sampled(name, value, grid)
        else:
            left[row] = float(value)
    return DrivenInputs(left, slope, expressions)


def _sampled(name: str, value: tuple, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    knots, samples = np.asarray(value[0], dtype=float), np.asarray(value[1], dtype=float)
    hold = value[2] if len(value) == 3 else "foh"
    if knots.shape != samples.shape or knots.ndim != 1 or knots.size < 1 or np.any(np.diff(knots) <= 0):
        raise ModelError(
            f"The samples of input `{name}` must be two rows of equal length with increasing times: "
            f"found {knots.shape} times and {samples.shape} values."
        )
    if hold == "zoh":
        # a sample holds from its own time on; the small shift keeps grid points that differ by rounding
        index = np.searchsorted(knots, grid[:-1] + 1e-9 * (grid[1:] - grid[:-1]), side="right") - 1
        return samples[np.clip(index, 0, None)], np.zeros(grid.size - 1)
    values = np.interp(grid, knots, samples)
    return values[:-1], np.diff(values) / np.diff(grid)


def input_values(driven: DrivenInputs, times: np.ndarray, sampled: np.ndarray) -> np.ndarray:
    """Return inputs at `times` (n,): `sampled` (n_u, n), with functions of time put in their rows."""
    values = sampled.copy()
    for row, expression in driven.expressions.items():
        symbol = ca.SX.sym("time")
        function = ca.Function("input", [symbol], [ca.SX(expression(symbol))])
        values[row] = np.asarray(function(times.reshape(1, -1))).ravel()
    return values


def inputs_at(driven: DrivenInputs, grid: np.ndarray) -> np.ndarray:
    """Return inputs at all grid points, shape (n_u, n); a jump belongs to the interval that it opens."""
    last = driven.left[:, -1:] + driven.slope[:, -1:] * (grid[-1] - grid[-2])
    return input_values(driven, grid, np.hstack([driven.left, last]))
