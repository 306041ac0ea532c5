"""What drives a simulation: numbers, functions of time, samples."""

import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError
from cartpend_dae.quantities import is_number
from cartpend_dae.system import System

Sampled = tuple[Sequence[float] | np.ndarray, Sequence[float] | np.ndarray]


Input = float | int | Callable[[ca.SX], ca.SX] | Sampled | tuple[np.ndarray, np.ndarray, Literal["zoh", "foh"]]


@dataclass(frozen=True, slots=True)
class DrivenInputs:
    """Inputs over the intervals of a grid: value at the left end and slope, shapes (n_u, n_intervals)."""

    left: np.ndarray
    slope: np.ndarray
    expressions: dict[int, Callable[[ca.SX], ca.SX]]


def jumps_of(driven: DrivenInputs, grid: np.ndarray) -> np.ndarray:
    """Return 1 for each interval of the grid (n,) [s] at whose begin an input jumps, else 0; shape (n - 1,)."""
    if not driven.left.size:
        return np.zeros(grid.size - 1)
    ends = driven.left + driven.slope * np.diff(grid)
    steps = np.abs(driven.left[:, 1:] - ends[:, :-1])
    scale = np.abs(driven.left).max(axis=1, initial=0.0, keepdims=True)
    return np.append(0.0, (steps > 1e-12 * scale).any(axis=0).astype(float))


def checked_inputs(system: System, inputs: Mapping[str, Input]) -> dict[str, Input]:
    """Return what drives each input of a system, by name; an input left out takes its declared default.

    Raises
    ------
    ModelError
        For an unknown input, one that nothing drives, or what is no number, function of time or samples.
    """
    for name in inputs:
        if name not in system.inputs:
            listing = ", ".join(f"`{other}`" for other in system.inputs) or "none"
            raise ModelError(f"{system.name} has no input `{name}`; its inputs are: {listing}.")
    return {name: _checked(system, name, inputs.get(name)) for name in system.inputs}


def _checked(system: System, name: str, given: Input | None) -> Input:
    value = system.variables[system.index_of(name)].declaration.default if given is None else given
    if value is None:
        raise ModelError(
            f"Nothing drives the input `{name}` of {system.name}: give `inputs={{'{name}': ...}}`, on the command line "
            f"`--input {name}=VALUE`."
        )
    return checked_input(name, value)


def checked_input(name: str, value: Input) -> Input:
    """Return what drives an input; samples are returned as arrays, with how they are held.

    Raises
    ------
    ModelError
        For what is no number, function of time or samples.
    """
    if callable(value):
        _check_function(name, value)
    elif isinstance(value, tuple):
        return _checked_samples(name, value)
    elif not is_number(value):
        raise ModelError(
            f"The input `{name}` must be a number, a function of time or a tuple (times, values), "
            f"not {reprlib.repr(value)}."
        )
    elif not math.isfinite(value):
        raise ModelError(f"The input `{name}` is {value}: it must be finite.")
    return value


def _check_function(name: str, function: Callable[[ca.SX], ca.SX]) -> None:
    symbol = ca.SX.sym("time")
    try:
        result = ca.SX(function(symbol))
        ca.Function("input", [symbol], [result])
    except Exception as error:  # the caller's function may raise anything
        raise ModelError(
            f"The function for input `{name}` fails on a symbol ({type(error).__name__}): write it in CasADi's "
            f"functions, such as `lambda t: casadi.sin(t)`, without `if`."
        ) from error
    if not result.is_scalar():
        raise ModelError(f"The function for input `{name}` must return one value, not {result.shape}.")


def _checked_samples(name: str, value: tuple) -> tuple[np.ndarray, np.ndarray, Literal["zoh", "foh"]]:
    if len(value) not in (2, 3):
        raise ModelError(
            f"The input `{name}` is a tuple of {len(value)}; samples are (times, values) or (times, values, 'zoh')."
        )
    hold = value[2] if len(value) == 3 else "foh"
    if not isinstance(hold, str) or hold not in ("zoh", "foh"):
        raise ModelError(f"The samples of input `{name}` are held as {hold!r}: choose `zoh` (held) or `foh` (joined).")
    try:
        knots, samples = np.asarray(value[0], dtype=float), np.asarray(value[1], dtype=float)
    except (TypeError, ValueError):
        raise ModelError(f"The samples of input `{name}` must be two rows of numbers: (times, values).") from None
    if knots.shape != samples.shape or knots.ndim != 1 or knots.size < 1 or np.any(np.diff(knots) <= 0):
        raise ModelError(
            f"The samples of input `{name}` must be two rows of equal length with increasing times: "
            f"found {knots.shape} times and {samples.shape} values."
        )
    bad = np.flatnonzero(~(np.isfinite(knots) & np.isfinite(samples)))
    if bad.size:
        raise ModelError(
            f"{bad.size} of the {knots.size} samples of input `{name}` are not finite, the first at index {bad[0]}: "
            f"leave them out."
        )
    return knots, samples, hold


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


def driven_inputs(inputs: Mapping[str, Input], grid: np.ndarray) -> DrivenInputs:
    """Bring inputs onto the intervals of a grid.

    Parameters
    ----------
    inputs
        All inputs of a system in its order, from `checked_inputs`.
    grid
        Times (n,) [s] that contain all sample times inside the simulation.

    Raises
    ------
    ModelError
        For a function that gives no finite number at one of the times.
    """
    left, slope = np.zeros((len(inputs), grid.size - 1)), np.zeros((len(inputs), grid.size - 1))
    expressions: dict[int, Callable[[ca.SX], ca.SX]] = {}
    for row, value in enumerate(inputs.values()):
        if isinstance(value, tuple):
            left[row], slope[row] = _sampled(value, grid)
        elif callable(value):
            expressions[row] = value
        else:
            left[row] = value
    driven = DrivenInputs(left, slope, expressions)
    values = inputs_at(driven, grid) if expressions else left
    for name, row in zip(inputs, values, strict=True):
        bad = np.flatnonzero(~np.isfinite(row))
        if bad.size:
            raise ModelError(
                f"The function for input `{name}` gives no finite number at {grid[bad[0]]:g} s: write it in CasADi's "
                f"functions, such as `lambda t: casadi.sin(t)`; those of `math` know no symbols."
            )
    return driven


def _sampled(value: tuple, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    knots, samples, hold = value
    if hold == "zoh":
        # a sample holds from its own time on; the small shift keeps grid points that differ by rounding
        index = np.searchsorted(knots, grid[:-1] + 1e-9 * (grid[1:] - grid[:-1]), side="right") - 1
        return samples[np.clip(index, 0, None)], np.zeros(grid.size - 1)
    values = np.interp(grid, knots, samples)
    return values[:-1], np.diff(values) / np.diff(grid)


def refined(driven: DrivenInputs, grid: np.ndarray, step: float) -> tuple[np.ndarray, DrivenInputs, np.ndarray]:
    """Divide each interval of a grid into equal steps no longer than `step` [s].

    Returns
    -------
    tuple
        The times (n_steps + 1,) [s], the inputs over the steps, and where the grid stands in the times (n,).
    """
    widths = np.diff(grid)
    # a width that is a multiple of the step but for rounding gets no step more
    counts = np.maximum(1, np.ceil(widths / step - 1e-9)).astype(int)
    where = np.concatenate([[0], np.cumsum(counts)])
    since = (np.arange(where[-1]) - np.repeat(where[:-1], counts)) * np.repeat(widths / counts, counts)
    times = np.append(np.repeat(grid[:-1], counts) + since, grid[-1])
    slope = np.repeat(driven.slope, counts, axis=1)
    left = np.repeat(driven.left, counts, axis=1) + slope * since
    return times, DrivenInputs(left, slope, driven.expressions), where


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
