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
    """A measured run: times (n,) [s], outputs by name (n,), NaN where nothing was measured, and what is known of it."""

    times: FloatArray
    outputs: Mapping[str, FloatArray]
    inputs: Mapping[str, Input] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class JointFit:
    """Estimates and their standard deviations by name, those of the residuals by output, and how slopes were found."""

    values: dict[str, float]
    sd: dict[str, float]
    residual_sd: dict[str, float]
    derivatives: Literal["directional", "differences"]
    n_runs: int


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
    scale = np.array([abs(value) or 1.0 for value in free.values()])
    found = np.clip(np.array(list(free.values()), dtype=float), low, high)
    weights = {name: 1.0 for name in problem.outputs}
    for _ in range(2):  # outputs of different units are comparable only once their noise is known
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
    slopes = problem.slopes(found, weights)
    freedom = max(slopes.shape[0] - found.size, 1)
    variance = float(np.sum(problem.residuals(found, weights) ** 2)) / freedom
    covariance = np.linalg.pinv(slopes.T @ slopes) * variance
    sd = dict(zip(free, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    return JointFit(
        dict(zip(free, found.tolist(), strict=True)),
        sd,
        problem.residual_sd(found),
        "directional" if problem.how == "directional" else "differences",
        problem.n_runs,
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
        self.outputs = list(dict.fromkeys(name for run in runs for name in run.outputs))
        self.how: Literal["directional", "differences", "unknown"] = "unknown"
        self.n_runs = 0
        if not free:
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
        return np.array(low), np.array(high)

    def _simulated(self, x: FloatArray) -> list[dict[str, FloatArray]]:
        parameters = self.fixed | dict(zip(self.free, x.tolist(), strict=True))
        rows = []
        for run in self.runs:
            self.n_runs += 1
            made = run_system(
                self.system, self.placed, np.asarray(run.times, dtype=float), run.inputs, run.start, parameters,
                self.rtol, 1e-2 * self.rtol,
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
        parameters = self.fixed | dict(zip(self.free, x.tolist(), strict=True))
        parts = []
        try:
            for run in self.runs:
                slopes = self._along(run, parameters)
                if slopes is None:
                    return None
                for k, (name, values) in enumerate(run.outputs.items()):
                    parts.append(weights[name] * slopes[np.isfinite(values), :, k])
        except SolverError:
            return None
        return np.concatenate(parts)

    def _along(self, run: MeasuredRun, parameters: dict[str, float]) -> FloatArray | None:
        """Return the slopes of a run's outputs, shape (n_times, n_free, n_outputs)."""
        grid = np.asarray(run.times, dtype=float)
        self.n_runs += 1
        with ExitStack() as stack:
            joint = Joint(self.system, self.placed, grid, dict(run.inputs), dict(run.start), parameters, stack)
            state = joint.begin(grid)
            if not gives_directional(joint):
                return None
            plant = JointSlopes(joint, self.free, list(run.outputs))
            whole = np.concatenate([state, np.zeros(state.size * len(self.free))])
            rows, _ = march(plant, whole, grid, Tolerance(self.rtol, np.full(whole.size, 1e-2 * self.rtol)))
        return rows.reshape(grid.size, len(self.free), len(run.outputs))

    def _differences(self, x: FloatArray, weights: Mapping[str, float]) -> FloatArray:
        """Return the slopes by central differences of whole runs."""
        columns = []
        for i in range(x.size):
            width = STEP * (abs(x[i]) or 1.0)
            ends = []
            for sign in (1, -1):
                moved = x.copy()
                moved[i] += sign * width
                ends.append(self.residuals(moved, weights))
            columns.append((ends[0] - ends[1]) / (2 * width))
        return np.column_stack(columns)
