"""Estimate parameters and start values of a model on measured runs, with their uncertainty."""

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cartpend_dae.collocation import collocated
from cartpend_dae.cuts import run_of
from cartpend_dae.errors import SolverError
from cartpend_dae.everyday import uncertain
from cartpend_dae.gauss_newton import ITERATIONS, Solution, bounds, gauss_newton, interior_point
from cartpend_dae.notebook import lines, table
from cartpend_dae.problem import Problem, dominant_frequency
from cartpend_dae.programme import Hessian
from cartpend_dae.residual_noise import NoiseModel
from cartpend_dae.shooting import (
    Sensitivities,
    filtered_nodes,
    run_from,
    run_through,
    scaled_values,
    sensitivities,
    start_states,
)
from cartpend_dae.transcribe import stack_data
from cartpend_dae.uncertainty import Estimate, uncertainty

Form = Literal["smooth", "time-stepping", "exact"]
Method = Literal["shooting", "collocation"]

# a point whose simulation leaves less than this share of what the solver ended at is kept for it
CLEARLY = 0.99
# the data lead a model with so many times their dominant frequency, or slower where that is unstable
FOLLOW, SLOWER = 5.0, (1.0, 3.0, 10.0)


@dataclass(frozen=True, slots=True)
class RunFit:
    """The fit of one run: residuals measured - model and predictions, shapes (n, n_outputs), NaN where not measured."""

    name: str
    time: np.ndarray
    residual: np.ndarray
    states: np.ndarray
    start: np.ndarray


@dataclass(frozen=True, slots=True)
class Fit:
    """The outcome of an estimation.

    `chi2` is the sum of squared residuals over the noise sds used as weights (`weights_sd`), and `cost` what was
    minimised: half of it, with prior knowledge and robust loss; `covariance` is that of
    parameters and free starts, SI; `noise` is what the residuals show, in units of `weights_sd`. `tied` are parameters
    that follow from others, `blind` says along which directions the data leave the parameters open,
    `notes` what else is to be known of how it was found. `form` is that of the model that the figures rest on: `smooth`
    without events, else events stepped over in `time-stepping` or located exactly, from the fit `stepped`. `quanta` are
    the steps in which outputs are counted, SI; 0 where none is seen.
    """

    parameters: tuple[Estimate, ...]
    starts: tuple[Estimate, ...]
    tied: tuple[Estimate, ...]
    covariance: np.ndarray
    blind: tuple[str, ...]
    noise: NoiseModel
    outputs: tuple[str, ...]
    noise_sd: np.ndarray
    weights_sd: np.ndarray
    chi2: float
    cost: float
    n_residuals: int
    runs: tuple[RunFit, ...]
    bandwidth: np.ndarray
    success: bool
    message: str
    iterations: int
    notes: tuple[str, ...] = ()
    form: Form = "smooth"
    stepped: "Fit | None" = None
    quanta: tuple[float, ...] = ()

    def __repr__(self) -> str:
        return lines(*self._shown())

    def _repr_html_(self) -> str:
        """Show the estimates in a notebook."""
        title, rows, notes = self._shown()
        return table(title, ("estimate", "value ± sd", "unit", ""), rows, notes)

    def _shown(self) -> tuple[str, list[tuple[str, ...]], list[str]]:
        rows = [
            (e.name, uncertain(e.value, e.sd), e.unit, "" if e.status == "ok" else e.status)
            for e in (*self.parameters, *self.starts, *self.tied)
        ]
        blind = [f"These runs leave a direction open: {sentence}." for sentence in self.blind]
        end = "converged" if self.success else f"not converged ({self.message})"
        rms = float(np.sqrt(self.chi2 / self.n_residuals)) if self.n_residuals else 0.0
        title = f"Fit of {', '.join(run.name for run in self.runs)}: {end}, residuals of {rms:.3g} x noise"
        return title, rows, [*blind, *self.notes]

    @property
    def values(self) -> dict[str, float]:
        """Estimated parameters by name, SI units."""
        return {estimate.name: estimate.value for estimate in self.parameters}

    def values_in(self, run: str | None = None) -> dict[str, float]:
        """Return what the model's parameters are in a run, ties included, SI units.

        A parameter that each run has of its own is in any other run, and without one, what it is in the mean.
        """
        shared = {e.name: e.value for e in self.parameters if ":" not in e.name}
        own: dict[str, dict[str, float]] = {}
        for estimate in self.parameters:
            group, colon, name = estimate.name.partition(":")
            if colon:
                own.setdefault(name, {})[group] = estimate.value
        mean = {name: values.get(run or "", float(np.mean([*values.values()]))) for name, values in own.items()}
        return shared | mean | {estimate.name: estimate.value for estimate in self.tied}

    @property
    def point(self) -> dict[str, float]:
        """Estimated parameters and free starts by name, SI units."""
        return self.values | {estimate.name: estimate.value for estimate in self.starts}

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix of parameters and free starts; NaN for what has no finite variance."""
        sd = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.covariance / np.outer(sd, sd)


def estimate(
    problem: Problem,
    *,
    bandwidth: float = 0.0,
    guess: Mapping[str, float] | None = None,
    observer: float | None = None,
    sd: np.ndarray | None = None,
    patient: bool = True,
    iterations: int = ITERATIONS,
    method: Method = "shooting",
    hessian: Hessian = "gauss-newton",
) -> Fit:
    """Solve the estimation problem by Gauss and Newton's method, and by IPOPT where that does not get there.

    Parameters
    ----------
    problem
        The problem.
    bandwidth
        Bandwidth of the output injection [rad/s]; 0 fits the free simulation.
    guess
        Other start values of parameters and free starts by name, SI.
    observer
        Bandwidth with which the start states of the segments are filtered from the data [rad/s]; chosen if None.
    sd
        Noise of each output used as weight, shape (n_y,); from the raw data if None.
    patient
        False leaves it at Gauss and Newton's method, where another way may be tried next.
    iterations
        Largest number of its steps.
    method
        `collocation` solves one large programme by IPOPT instead, in which no simulation must come to its end; where
        there is dry friction that sticks, Gauss and Newton's method goes on from there.
    hessian
        The `exact` one is IPOPT's as well.

    Raises
    ------
    SolverError
        If the solver ends without a usable point.
    """
    layout = problem.layout
    weights_sd = problem.prior_sd if sd is None else sd
    data = stack_data(layout, problem.experiments, 1.0 / weights_sd)
    w = np.full(len(problem.outputs), float(bandwidth))
    lower, upper = bounds(problem)
    values = np.clip(scaled_values(problem, guess or {}), lower, upper)
    follow, nodes = _nodes(problem, values, bandwidth, observer, data)
    found = None
    if method == "collocation":
        _, states = run_through(problem, values, np.full_like(w, follow), data)
        found = collocated(problem, values, states, w, data, hessian=hessian)
        values, nodes = found.values, found.nodes
    elif hessian == "exact":
        found = interior_point(problem, values, nodes, w, data, hessian=hessian)
    if found is None or problem.system.frictions.places:
        found = _searched(problem, values, nodes, w, data, iterations)
    if not patient or found.success:
        return _concluded(problem, found, w, data, weights_sd)
    further = interior_point(problem, values, nodes, w, data)
    ends = further.cost if further.success else _simulated(problem, further.values, w, data).cost
    if _simulated(problem, found.values, w, data).cost < CLEARLY * ends:  # it ended where something changes at once
        return _concluded(problem, found, w, data, weights_sd)
    try:
        return _concluded(problem, further, w, data, weights_sd)
    except SolverError:  # it went where fixed steps do not follow
        if further.success:
            raise
        return _concluded(problem, found, w, data, weights_sd)


def _nodes(
    problem: Problem, values: np.ndarray, bandwidth: float, observer: float | None, data: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the bandwidth with which the data lead the model, and the start states of the segments on that way.

    A sensor that lags behind what corrects it makes a fast correction unstable; then a slower one does.
    """
    fast = dominant_frequency(problem.experiments) * FOLLOW
    tried = [max(bandwidth, fast / slower) for slower in SLOWER] if observer is None else [observer]
    ways = list(dict.fromkeys(tried))
    for follow in ways[:-1]:
        with contextlib.suppress(SolverError):
            return follow, filtered_nodes(problem, values, np.full(len(problem.outputs), follow), data)
    return ways[-1], filtered_nodes(problem, values, np.full(len(problem.outputs), ways[-1]), data)


def _searched(
    problem: Problem, values: np.ndarray, nodes: np.ndarray, w: np.ndarray, data: np.ndarray, iterations: int
) -> Solution:
    """Search from segments that start where the data are, and, if that ends above it, from the simulation.

    Where friction holds for good, or a gap is passed in another order, what is filtered from the data moves on, and
    the first steps lose a point that is right.
    """
    found = gauss_newton(problem, values, nodes, w, data, iterations=iterations)
    begun = _simulated(problem, values, w, data)
    if not begun.cost < found.cost:
        return found
    again = gauss_newton(problem, values, begun.nodes, w, data, iterations=iterations)
    return again if again.cost < found.cost else found


def _simulated(problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray) -> Solution:
    """Return a point with segments that start where the one before ends; its cost is infinite where that diverges."""
    nodes = run_through(problem, values, w, data)[1][:, :: problem.layout.length]
    found = gauss_newton(problem, values, nodes, w, data, iterations=0)
    return found if np.isfinite(found.cost) else replace(found, cost=np.inf)


def _concluded(problem: Problem, found: Solution, w: np.ndarray, data: np.ndarray, weights_sd: np.ndarray) -> Fit:
    """Return the fit that a solution is, its segments joined by a simulation if it is an unfinished one."""
    if not found.success:
        nodes = run_through(problem, found.values, w, data)[1][:, :: problem.layout.length]
        found = replace(found, nodes=nodes)
    states = run_from(problem, found.values, found.nodes, w, data)[1]
    slopes = sensitivities(problem, found.values, found.nodes, w, data)
    return outcome(problem, found, w, data, weights_sd, slopes, states)


def outcome(
    problem: Problem,
    found: Solution,
    w: np.ndarray,
    data: np.ndarray,
    weights_sd: np.ndarray,
    slopes: Sensitivities,
    states: np.ndarray,
) -> Fit:
    """Return the fit that a solution is, with residuals, their derivatives, and states (n_state, n) there."""
    layout, values = problem.layout, found.values
    is_measured = data[-len(problem.outputs) :].T > 0
    by_run = _samples_by_run(problem)
    parts = [part for _, part in by_run.values()]
    residuals = np.where(is_measured, slopes.residuals, np.nan)
    certain = uncertainty(problem, values, [residuals[part] for part in parts], [slopes.slopes[part] for part in parts])
    starts = start_states(problem, values)
    runs = tuple(
        RunFit(name, data[0, part], residuals[part] * weights_sd, states[:, part].T, starts[first])
        for name, (first, part) in by_run.items()
    )
    per_channel = np.nansum(residuals**2, axis=0) / np.maximum(1, is_measured.sum(axis=0))
    return Fit(
        parameters=certain.estimates[: len(layout.free)],
        starts=certain.estimates[len(layout.free) :],
        tied=certain.tied,
        covariance=certain.covariance,
        blind=certain.blind,
        noise=certain.noise,
        outputs=problem.outputs,
        noise_sd=weights_sd * np.sqrt(per_channel),
        weights_sd=weights_sd,
        chi2=float(np.nansum(residuals**2)),
        cost=found.cost,
        n_residuals=int(is_measured.sum()),
        runs=runs,
        bandwidth=w,
        success=found.success,
        message=found.message,
        iterations=found.iterations,
        form="time-stepping" if problem.has_events else "smooth",
        quanta=problem.quanta,
    )


def _samples_by_run(problem: Problem) -> dict[str, tuple[int, np.ndarray]]:
    """Return by the name of each run its first piece, and where its samples stand in the data."""
    layout = problem.layout
    found: dict[str, tuple[int, np.ndarray]] = {}
    for k, (experiment, first, n) in enumerate(zip(problem.experiments, layout.first, layout.run_lengths, strict=True)):
        name, samples = run_of(experiment), first * layout.length + np.arange(n)
        begin, before = found.get(name, (k, np.zeros(0, dtype=int)))
        found[name] = begin, np.concatenate([before, samples])
    return found
