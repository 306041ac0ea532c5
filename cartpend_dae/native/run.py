"""A model with the engine as machine code, over output times."""

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import casadi as ca
import numpy as np

from cartpend_dae.compiled import compiled_library
from cartpend_dae.events import Machine
from cartpend_dae.native.model import NativeModel, engine_part, native_model, native_outputs, native_source
from cartpend_dae.system import System

METHODS = {"erk": 0.0, "rosenbrock": 1.0}
MOST_STEPS = 100_000_000
STOPPED = 2
FAILURES = {
    -1: "a rate is not finite",
    -2: "the step has become too small",
    -3: "too many steps",
    -4: "the algebraic equations have no solution after an event",
}


@dataclass(frozen=True, slots=True)
class Settings:
    """Integrator, tolerances and longest step [s]."""

    method: Literal["erk", "rosenbrock"]
    rtol: float
    atol: float
    longest: float


@dataclass(frozen=True, slots=True)
class NativeRun:
    """States (n_x, n), algebraic variables (n_z, n) and memory (n_m, n) at n times, and what it took.

    `variables` (n_v, n) are the distinct ones of all variables, and variable k of the system is row ``columns[k]``.
    `lowest` and `largest` (n_g,) are the least value and the largest magnitude of each indicator at these times.
    """

    x: np.ndarray
    z: np.ndarray
    memory: np.ndarray
    variables: np.ndarray
    columns: np.ndarray
    lowest: np.ndarray
    largest: np.ndarray
    n_steps: int
    n_rejected: int
    n_trials: int
    n_events: int


@dataclass(frozen=True, slots=True)
class Engine:
    """A model as a library that is loaded."""

    model: NativeModel
    library: ctypes.CDLL
    n_v: int
    columns: np.ndarray

    @property
    def depends_on_time(self) -> bool:
        """Whether the rates depend on time by itself."""
        return self.model.depends_on_time

    def run(
        self,
        settings: Settings,
        start: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
        grid: np.ndarray,
        inputs: tuple[np.ndarray, np.ndarray],
    ) -> NativeRun:
        """Run over a grid.

        Parameters
        ----------
        settings
            Integrator and tolerances.
        start
            States (n_x,), algebraic variables (n_z,), memory (n_m,) and parameters (n_p,).
        grid
            Times (n,) [s].
        inputs
            What the inputs are over the intervals, shape (n - 1, n_w), and whether one jumps at their begin (n - 1,).

        Raises
        ------
        RuntimeError
            If it fails; the reason.
        """
        model, n = self.model, grid.size
        x, z, memory, p = start
        first = np.concatenate([x, np.zeros(model.n_shadow), z, memory, p])
        values, jumps = np.ascontiguousarray(inputs[0], dtype=float), np.ascontiguousarray(inputs[1], dtype=np.int8)
        options = np.array([settings.rtol, settings.atol, settings.longest, MOST_STEPS, METHODS[settings.method]])
        ys, ms, found = np.empty((n, model.n_y)), np.empty((n, model.n_m)), np.zeros(5)
        variables = np.empty((self.n_v, n))
        times = np.ascontiguousarray(grid, dtype=float)
        lowest, largest = np.zeros(model.n_g), np.zeros(model.n_g)
        arrays = [options, first, times, values, jumps, ys, ms, variables, found, lowest, largest]
        # by address: `data_as` makes a cycle of references, in which the results of earlier runs would stay
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        outcome = self.library.run_over_grid(*pointers[:2], ctypes.c_long(n), *pointers[2:])
        if outcome < 0:
            raise RuntimeError(f"{FAILURES[outcome]} at {found[4]:.9g} s")
        counts = (round(number) for number in found[:4])
        states = ys[:, : x.size].T, ys[:, model.n_x :].T, ms.T
        return NativeRun(*states, variables, self.columns, lowest, largest, *counts)


def loaded(
    system: System, made: Machine | None, expressions: Mapping[int, Callable[[ca.SX], ca.SX]] | None = None
) -> Engine | None:
    """Return a system as machine code with the engine; None without a compiler.

    Parameters
    ----------
    system, made, expressions
        As `native_model` takes them.
    """
    model = native_model(system, made, expressions)
    more = engine_part("over_grid.c")
    outputs, columns = native_outputs(system, made, expressions)
    path = compiled_library(lambda: native_source(model, outputs, more), system.name)
    return None if path is None else Engine(model, _opened(path), outputs.numel_out(0), columns)


def _opened(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    library.run_over_grid.restype = ctypes.c_int
    return library
