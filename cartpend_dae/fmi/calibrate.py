"""Parameters of a model with foreign FMUs, estimated from measured runs by nonlinear least squares.

The residuals come from joint simulation; their slopes from the directional derivatives of the FMU where it gives them
and the run has no events, else from central differences of whole runs.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from cartpend_dae.assemble import assemble
from cartpend_dae.data import FloatArray
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.fmi.component import fmus_in
from cartpend_dae.fmi.joint import Joint, run_system
from cartpend_dae.fmi.march import Tolerance, march
from cartpend_dae.fmi.slopes import JointSlopes, gives_directional
from cartpend_dae.inputs import Input
from cartpend_dae.language import Component

# part of a parameter by which runs are made to differ, and how far the two kinds of slopes may be apart
STEP, ALIKE = 1e-4, 1e-2


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """A measured run: times (n,) [s], outputs by name (n,), NaN where nothing was measured, and what is known of it.

    `start` holds known start values, `free` the guesses of those that are to be found.
    """

    times: FloatArray
    outputs: Mapping[str, FloatArray]
    inputs: Mapping[str, Input] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    free: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class JointFit:
    """Estimates and their standard deviations by name, those of the residuals by output, and how slopes were found.

    `starts` are the start values that were found, by run; `residuals` (n, n_outputs) and their `slopes`
    (n, n_outputs, n_unknowns) those of each run, the outputs as in `residual_sd`, the unknowns parameters and then
    starts; NaN and zero where nothing was measured.
    """

    values: dict[str, float]
    sd: dict[str, float]
    residual_sd: dict[str, float]
    derivatives: Literal["directional", "differences"]
    n_runs: int
    starts: tuple[dict[str, float], ...]
    residuals: tuple[FloatArray, ...]
    slopes: tuple[FloatArray, ...]


def identify_with_fmus(
    model: Component,
    runs: Sequence[MeasuredRun],
    free: Mapping[str, float],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, float] | None = None,
    rtol: float = 1e-8,
) -> JointFit:
    """Estimate parameters of a model with FMUs in it, of the FMUs and of native parts.

    Parameters
    ----------
    model
        The model, as for `simulate_with_fmus`.
    runs
        The measured runs; each output is weighted by the sd of its residuals, found in a second pass.
    free
        The parameters to be found and where the search begins, SI units.
    bounds
        Lower and upper bounds of some of them; those that the model declares hold as well.
    parameters
        Other values of further parameters.
    rtol
        Relative tolerance of the simulations.

    Raises
    ------
    ModelError
        For an unknown name, no parameter or no measured value.
    SolverError
        If the simulations at the guesses fail, or the search does not converge.
    """
    problem = _Problem(model, runs, dict(free), dict(parameters or {}), rtol)
    low, high = problem.limits(dict(bounds or {}))
    scale = np.array([abs(value) or 1.0 for value in problem.guess])
    found = np.clip(problem.guess, low, high)
    weights = {name: 1.0 for name in problem.outputs}
    for _ in range(min(len(weights), 2)):  # several outputs are comparable only once their noise is known
        solved = least_squares(
            problem.residuals,
            found,
            problem.slopes,  # type: ignore[arg-type]  # scipy's stub knows only the texts
            args=(weights,),
            bounds=(low, high),
            x_scale=scale,
            xtol=1e-7,
            ftol=1e-9,
        )
        if not solved.success and solved.status < 1:
            raise SolverError(f"{problem.system.name}: the estimation does not converge: {solved.message}")
        found = solved.x
        weights = {name: 1 / max(value, 1e-300) for name, value in problem.residual_sd(found).items()}
    plain = {name: 1.0 for name in problem.outputs}
    misses, slopes = problem.residuals(found, plain), problem.slopes(found, plain)
    weight = problem.per_residual(weights)
    freedom = max(slopes.shape[0] - found.size, 1)
    weighed = slopes * weight[:, None]
    variance = float(np.sum((misses * weight) ** 2)) / freedom
    sd = np.sqrt(np.diag(np.linalg.pinv(weighed.T @ weighed) * variance))
    return JointFit(
        dict(zip(free, found[: len(free)].tolist(), strict=True)),
        dict(zip(free, sd[: len(free)].tolist(), strict=True)),
        problem.residual_sd(found),
        "directional" if problem.how == "directional" else "differences",
        problem.n_runs,
        problem.starts(found),
        problem.spread(misses[:, None], np.nan, -1.0),
        problem.spread(slopes, 0.0, -1.0),
    )


class _Problem:
    """Residuals of all runs and their slopes."""

    def __init__(
        self,
        model: Component,
        runs: Sequence[MeasuredRun],
        free: dict[str, float],
        fixed: dict[str, float],
        rtol: float,
    ) -> None:
        self.system, self.placed = assemble(model), list(fmus_in(model))
        self.runs, self.free, self.fixed, self.rtol = runs, list(free), fixed, rtol
        self.begun = [(k, name) for k, run in enumerate(runs) for name in run.free]
        self.guess = np.array([*free.values(), *(runs[k].free[name] for k, name in self.begun)], dtype=float)
        self.outputs = list(dict.fromkeys(name for run in runs for name in run.outputs))
        self.how: Literal["directional", "differences", "unknown"] = "unknown"
        self.n_runs = 0
        if not self.guess.size:
            raise ModelError(f"{self.system.name}: name at least one parameter to be found.")
        for name in free:
            self.system.parameter_index(name)
        if not any(np.isfinite(values).any() for run in runs for values in run.outputs.values()):
            raise ModelError(f"{self.system.name}: the runs hold no measured value.")

    def limits(self, bounds: dict[str, tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the free parameters, shape (n,) each."""
        declared = [self.system.parameters[self.system.parameter_index(name)].declaration for name in self.free]
        low = [
            max(bounds.get(n, (-np.inf, 0))[0], -np.inf if d.min is None else d.min)
            for n, d in zip(self.free, declared, strict=True)
        ]
        high = [
            min(bounds.get(n, (0, np.inf))[1], np.inf if d.max is None else d.max)
            for n, d in zip(self.free, declared, strict=True)
        ]
        more = np.full(len(self.begun), np.inf)
        return np.array([*low, *-more]), np.array([*high, *more])

    def parameters(self, x: FloatArray) -> dict[str, float]:
        """Return the values of all parameters that are given, by name."""
        return self.fixed | dict(zip(self.free, x[: len(self.free)].tolist(), strict=True))

    def starts(self, x: FloatArray) -> tuple[dict[str, float], ...]:
        """Return the start values that are found, for each run."""
        found: list[dict[str, float]] = [{} for _ in self.runs]
        for (k, name), value in zip(self.begun, x[len(self.free) :].tolist(), strict=True):
            found[k][name] = value
        return tuple(found)

    def per_residual(self, weights: Mapping[str, float]) -> FloatArray:
        """Return the weight of each residual (n_residuals,)."""
        counts = [(weights[name], np.isfinite(v).sum()) for run in self.runs for name, v in run.outputs.items()]
        return np.concatenate([np.full(n, weight) for weight, n in counts])

    def spread(self, rows: FloatArray, empty: float, sign: float) -> tuple[FloatArray, ...]:
        """Return rows (n_residuals, m) by run as (n, n_outputs, m), m left out if it is 1; `sign` multiplies them."""
        found, at = [], 0
        for run in self.runs:
            values = np.full((len(run.times), len(self.outputs), rows.shape[1]), empty)
            for name, measured in run.outputs.items():
                known = np.isfinite(measured)
                n = int(known.sum())
                values[known, self.outputs.index(name)] = sign * rows[at : at + n]
                at += n
            found.append(values)
        return tuple(values[:, :, 0] if np.isnan(empty) else values for values in found)

    def _simulated(self, x: FloatArray) -> list[dict[str, FloatArray]]:
        parameters = self.parameters(x)
        rows = []
        for run, begun in zip(self.runs, self.starts(x), strict=True):
            self.n_runs += 1
            made = run_system(
                self.system, self.placed, np.asarray(run.times, dtype=float), run.inputs, {**run.start, **begun},
                parameters, self.rtol, 1e-2 * self.rtol,
            )  # fmt: skip
            if made.time.size < len(run.times):
                raise SolverError(
                    f"{self.system.name}: an FMU ends the run at {made.time[-1]:g} s, before the data end."
                )
            rows.append({name: made[name] for name in run.outputs})
        return rows

    def residuals(self, x: FloatArray, weights: Mapping[str, float]) -> FloatArray:
        """Return the weighted residuals of what was measured."""
        parts = []
        for run, made in zip(self.runs, self._simulated(x), strict=True):
            for name, values in run.outputs.items():
                known = np.isfinite(values)
                parts.append(weights[name] * (made[name] - values)[known])
        return np.concatenate(parts)

    def residual_sd(self, x: FloatArray) -> dict[str, float]:
        """Return the root mean square of the residuals, by output."""
        made = self._simulated(x)
        found = {}
        for name in self.outputs:
            pairs = [
                (m[name], run.outputs[name]) for run, m in zip(self.runs, made, strict=True) if name in run.outputs
            ]
            misses = np.concatenate([(a - b)[np.isfinite(b)] for a, b in pairs])
            found[name] = float(np.sqrt(np.mean(misses**2)))
        return found

    def slopes(self, x: FloatArray, weights: Mapping[str, float]) -> FloatArray:
        """Return the slopes of the residuals, a column for each free parameter.

        The first time those of the FMU are compared with differences: some FMUs leave out what depends on parameters.
        """
        if self.how == "unknown":
            self.how = "differences"
            found = self._directional(x, weights)
            differences = self._differences(x, weights)
            if found is not None and np.linalg.norm(found - differences) <= ALIKE * np.linalg.norm(differences):
                self.how = "directional"
            return differences
        if self.how == "directional" and (found := self._directional(x, weights)) is not None:
            return found
        return self._differences(x, weights)

    def _directional(self, x: FloatArray, weights: Mapping[str, float]) -> FloatArray | None:
        """Return the slopes by directional derivatives, None where an FMU has none of them or a run has events."""
        if not set(self.outputs) <= set(self.system.positions[0]):
            return None
        parts = []
        try:
            for k, run in enumerate(self.runs):
                slopes = self._along(k, x)
                if slopes is None:
                    return None
                for column, (name, values) in enumerate(run.outputs.items()):
                    parts.append(weights[name] * slopes[np.isfinite(values), :, column])
        except SolverError:
            return None
        return np.concatenate(parts)

    def _along(self, k: int, x: FloatArray) -> FloatArray | None:
        """Return the slopes of the outputs of run k, shape (n_times, n_unknowns, n_outputs)."""
        run = self.runs[k]
        grid = np.asarray(run.times, dtype=float)
        own = [*range(len(self.free)), *(len(self.free) + i for i, (r, _) in enumerate(self.begun) if r == k)]
        begins = [(self._begin(k, self._moved(x, i, 1)), self._begin(k, self._moved(x, i, -1))) for i in own]
        widths = [2 * self._width(x, i) for i in own]
        self.n_runs += 1
        with ExitStack() as stack:
            joint = self._joint(k, x, stack)
            state = joint.begin(grid)
            if not gives_directional(joint):
                return None
            plant = JointSlopes(joint, self.free, list(run.outputs), n_starts=len(own) - len(self.free))
            moved = [(high - low) / width for (high, low), width in zip(begins, widths, strict=True)]
            whole = np.concatenate([state, *moved])
            rows, _ = march(plant, whole, grid, Tolerance(self.rtol, np.full(whole.size, 1e-2 * self.rtol)))
        found = np.zeros((grid.size, x.size, len(run.outputs)))
        found[:, own] = rows.reshape(grid.size, len(own), len(run.outputs))
        return found

    def _joint(self, k: int, x: FloatArray, stack: ExitStack) -> Joint:
        run, grid = self.runs[k], np.asarray(self.runs[k].times, dtype=float)
        start = {**run.start, **self.starts(x)[k]}
        return Joint(self.system, self.placed, grid, dict(run.inputs), start, self.parameters(x), stack)

    def _begin(self, k: int, x: FloatArray) -> FloatArray:
        """Return all states of run k where it begins."""
        with ExitStack() as stack:
            return self._joint(k, x, stack).begin(np.asarray(self.runs[k].times, dtype=float))

    def _width(self, x: FloatArray, i: int) -> float:
        return STEP * (abs(x[i]) or 1.0)

    def _moved(self, x: FloatArray, i: int, sign: int) -> FloatArray:
        moved = x.copy()
        moved[i] += sign * self._width(x, i)
        return moved

    def _differences(self, x: FloatArray, weights: Mapping[str, float]) -> FloatArray:
        """Return the slopes by central differences of whole runs."""
        columns = []
        for i in range(x.size):
            ends = [self.residuals(self._moved(x, i, sign), weights) for sign in (1, -1)]
            columns.append((ends[0] - ends[1]) / (2 * self._width(x, i)))
        return np.column_stack(columns)
