"""The last steps of a fit on the exact form of the model: simulated with its events, and differentiated through them.

The estimation steps over friction and other events in fixed steps, to second order. Here the runs are simulated by
error-controlled integrators that locate each event, and Gauss and Newton's method goes on from where that fit ended.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.gauss_newton import Solution, bounded_step, bounds, prior_errors
from cartpend_dae.identify import Fit, outcome
from cartpend_dae.inputs import Input
from cartpend_dae.problem import Problem
from cartpend_dae.sensitivity import sensitivities
from cartpend_dae.shooting import (
    Sensitivities,
    parameters_of_run,
    run_through,
    scaled_values,
    start_slopes,
    start_states,
)
from cartpend_dae.shooting import sensitivities as stepped_sensitivities
from cartpend_dae.simulate import simulate
from cartpend_dae.transcribe import stack_data

STEPS, HALVINGS = 6, 4
# of the cost: what a step promises when it is the last one, 0.2 standard deviations of any estimate; what is left then
# is of second order
LAST = 2e-2
# of the cost: what is not worth a step, 0.0014 standard deviations
NOTHING = 1e-6
# so many steps are tried with the derivatives of the fixed steps, from where they promise no more than this: some
# standard deviations
CHORDS, NEAR = 3, 5.0
# part of what it promises by which a step must lower the cost, and rounding of the integration
ARMIJO, ROUNDING = 1e-2, 1e-6
# samples times steps between them times directions, and what a run costs by itself in these: measured at 7 to 55 us
# each, so that the derivatives of so many take up to ten seconds
BEARABLE, PER_RUN = 150_000, 5000
RTOL, ATOL = 1e-8, 1e-10


@dataclass(frozen=True, slots=True)
class _Run:
    """One run as it is simulated: its samples in the data, its inputs, and what it is differentiated by."""

    name: str
    index: int
    place: slice
    times: np.ndarray
    inputs: dict[str, Input]
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Work:
    """What stays the same in all steps: runs, data, which measured outputs and states are simulated, bounds."""

    problem: Problem
    runs: tuple[_Run, ...]
    data: np.ndarray
    shown: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray


@dataclass(frozen=True, slots=True)
class _Point:
    """Scaled variables (n_all,), weighted residuals (n, n_y), states (n_state, n), and the cost there."""

    values: np.ndarray
    residuals: np.ndarray
    states: np.ndarray
    cost: float


def reason_against(problem: Problem, fit: Fit) -> str:
    """Say why the exact form is not worth its cost or has no meaning for a fit; empty where it has."""
    if np.any(fit.bandwidth > 0):
        return "the fit is of predictions, which follow the measured motion"
    layout = problem.layout
    directions = len(layout.slots) + len(layout.ties) + problem.system.x.numel()
    work = sum(layout.run_lengths) * layout.substeps * directions + PER_RUN * len(layout.run_lengths)
    if work > BEARABLE:
        return (
            f"{sum(layout.run_lengths)} samples of {layout.substeps} steps in {directions} directions, in "
            f"{len(layout.run_lengths)} runs or pieces, would take long (`exact = true` under `identify` wants them "
            f"nevertheless)"
        )
    return ""


def refined(problem: Problem, fit: Fit) -> Fit:
    """Continue a fit by Gauss and Newton's method on the exact form of the model.

    Parameters
    ----------
    problem
        The problem.
    fit
        Its solution by steps of fixed length, of the free simulation; it becomes `stepped` of what is returned.

    Raises
    ------
    ModelError
        Where there are no derivatives, as where two events meet whose instants the parameters move apart.
    SolverError
        Where the exact form cannot be simulated, or its steps do not converge.
    """
    work = _work(problem, fit)
    start = np.clip(scaled_values(problem, fit.point), work.lower, work.upper)
    if (near := _adjusted(work, fit, start)) is not None:
        return near
    point, slopes = _differentiated(work, start)
    for iteration in range(STEPS):
        hessian, pull = _normal_equations(problem, point, slopes)
        step = bounded_step(hessian, pull, work.lower - point.values, work.upper - point.values)
        promised = -float(pull @ step + step @ hessian @ step / 2)
        if promised < NOTHING:
            return _fit_of(work, fit, point, slopes, iteration)
        found = _searched(work, point, step, promised)
        if promised < LAST:
            best = found if found is not None and found.cost <= point.cost else point
            return _fit_of(work, fit, best, slopes, iteration + 1)
        if found is None:
            raise SolverError("its exact form has another optimum, towards which no step lowers the cost")
        point, slopes = _differentiated(work, found.values)
    raise SolverError(f"{STEPS} steps on its exact form did not suffice")


def _adjusted(work: _Work, fit: Fit, values: np.ndarray) -> Fit | None:
    """Take a few steps with the derivatives of the fixed steps, which are right to second order in their length.

    None where these do not lead to where they promise nothing more: the exact form is differentiated then.
    """
    point = _evaluated(work, values)
    nodes = run_through(work.problem, values, fit.bandwidth, work.data)[1][:, :: work.problem.layout.length]
    slopes = stepped_sensitivities(work.problem, values, nodes, fit.bandwidth, work.data).slopes
    for iteration in range(CHORDS):
        hessian, pull = _normal_equations(work.problem, point, slopes)
        step = bounded_step(hessian, pull, work.lower - point.values, work.upper - point.values)
        promised = -float(pull @ step + step @ hessian @ step / 2)
        if promised < NOTHING:
            return _fit_of(work, fit, point, slopes, iteration)
        found = _searched(work, point, step, promised)
        if promised < LAST:
            best = found if found is not None and found.cost <= point.cost else point
            return _fit_of(work, fit, best, slopes, iteration + 1)
        if found is None or promised > NEAR:
            return None
        point = found
    return None


def _work(problem: Problem, fit: Fit) -> _Work:
    layout, system = problem.layout, problem.exact
    data = stack_data(layout, problem.experiments, 1.0 / fit.weights_sd)
    moved = [slot.parameter for slot in layout.slots] + [tie.name for tie in layout.ties]
    runs = []
    for index, (experiment, first, n) in enumerate(
        zip(problem.experiments, layout.first, layout.run_lengths, strict=True)
    ):
        begin = first * layout.length
        inputs: dict[str, Input] = {
            name: (experiment.time, channel.values, channel.hold) for name, channel in experiment.inputs.items()
        }
        names = (*moved, *system.states)
        runs.append(_Run(experiment.name, index, slice(begin, begin + n), experiment.time, inputs, names))
    shown = (*problem.outputs, *system.states, *system.algebraics)
    return _Work(problem, tuple(runs), data, shown, *bounds(problem))


def _differentiated(work: _Work, values: np.ndarray) -> tuple[_Point, np.ndarray]:
    """Return a point, and the derivatives of its residuals (n, n_y, n_all) in the scaled variables."""
    problem, n_y = work.problem, len(work.problem.outputs)
    shown, slopes = np.zeros((work.data.shape[1], len(work.shown))), np.zeros((work.data.shape[1], n_y, values.size))
    begins, following = start_states(problem, values), start_slopes(problem, values)
    for run in work.runs:
        known, start = _given(work, run, values, begins)
        found = sensitivities(
            problem.exact, run.names, times=run.times, outputs=work.shown, inputs=run.inputs, start=start,
            values=known, rtol=RTOL, atol=ATOL,
        )  # fmt: skip
        follow = np.vstack([_parameter_slopes(work, run, values), following[run.index][: len(start)]])
        shown[run.place] = found.values
        slopes[run.place] = -found.slopes[:, :n_y] @ follow * work.data[-n_y:].T[run.place, :, None]
    return _point(work, values, shown), slopes


def _evaluated(work: _Work, values: np.ndarray) -> _Point:
    begins = start_states(work.problem, values)
    shown = np.zeros((work.data.shape[1], len(work.shown)))
    for run in work.runs:
        known, start = _given(work, run, values, begins)
        found = simulate(
            work.problem.exact, times=run.times, inputs=run.inputs, start=start, parameters=known, rtol=RTOL, atol=ATOL
        )
        shown[run.place] = np.column_stack([found[name] for name in work.shown])
    return _point(work, values, shown)


def _point(work: _Work, values: np.ndarray, shown: np.ndarray) -> _Point:
    n_y = len(work.problem.outputs)
    measured, weight = work.data[-2 * n_y : -n_y].T, work.data[-n_y:].T
    residuals = weight * (measured - shown[:, :n_y])
    size, huber = np.abs(residuals), work.problem.huber
    loss = np.where(size <= huber, size**2 / 2, huber * (size - huber / 2) if np.isfinite(huber) else 0.0)
    cost = float(loss.sum()) + float(np.sum(prior_errors(work.problem, values)[0] ** 2)) / 2
    return _Point(values, residuals, shown[:, n_y:].T, cost)


def _given(
    work: _Work, run: _Run, values: np.ndarray, begins: Sequence[np.ndarray]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the parameters of a run that move, and its start."""
    system, p = work.problem.exact, parameters_of_run(work.problem, values, run.index)
    known = {name: float(p[system.parameter_index(name)]) for name in run.names if name not in system.states}
    return known, dict(zip(system.states, begins[run.index].tolist(), strict=False))


def _parameter_slopes(work: _Work, run: _Run, values: np.ndarray) -> np.ndarray:
    """Return d(parameters that move)/d(scaled variables) of a run, shape (n_moved, n_all)."""
    problem = work.problem
    owners = problem.layout.owners[run.index]
    jacobian = problem.functions.parameters.jacobian()
    slope = np.asarray(ca.DM(jacobian(values[owners], np.zeros(problem.exact.p.numel()))))
    rows = [problem.exact.parameter_index(name) for name in run.names if name not in problem.exact.states]
    found = np.zeros((len(rows), values.size))
    found[:, owners] = slope[rows]
    return found


def _normal_equations(problem: Problem, point: _Point, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Hessian of Gauss and Newton and gradient of the cost."""
    weight = np.minimum(1.0, problem.huber / np.maximum(np.abs(point.residuals), 1e-300))
    flat = slopes.reshape(-1, point.values.size)
    error, prior_slope = prior_errors(problem, point.values)
    hessian = flat.T @ (flat * weight.reshape(-1, 1)) + np.diag(prior_slope**2)
    return hessian, flat.T @ (weight * point.residuals).ravel() + prior_slope * error


def _searched(work: _Work, point: _Point, step: np.ndarray, promised: float) -> _Point | None:
    """Halve the step until the cost falls as it should; None if it does not."""
    share = 1.0
    for _ in range(HALVINGS):
        values = np.clip(point.values + share * step, work.lower, work.upper)
        try:
            found = _evaluated(work, values)
        except SolverError:
            found = None
        if found is not None and found.cost <= point.cost - ARMIJO * share * promised + ROUNDING * point.cost:
            return found
        share /= 2
    return None


def _fit_of(work: _Work, fit: Fit, point: _Point, slopes: np.ndarray, iterations: int) -> Fit:
    problem = work.problem
    nodes = point.states[:, :: problem.layout.length]
    solution = Solution(point.values, nodes, point.cost, True, fit.message, fit.iterations + iterations)
    made = outcome(
        problem,
        solution,
        fit.bandwidth,
        work.data,
        fit.weights_sd,
        Sensitivities(point.residuals, slopes),
        point.states,
    )
    return replace(made, form="exact", stepped=fit, notes=fit.notes)


def farthest(fit: Fit) -> tuple[str, float]:
    """Return which estimate the exact form moved most, and by how many of its standard deviations."""
    assert fit.stepped is not None
    before = {e.name: e.value for e in (*fit.stepped.parameters, *fit.stepped.starts)}
    moved = {
        e.name: abs(e.value - before[e.name]) / e.sd
        for e in (*fit.parameters, *fit.starts)
        if e.status == "ok" and e.sd > 0
    }
    return max(moved.items(), key=lambda pair: pair[1], default=("", 0.0))


def finished(problem: Problem, fit: Fit, *, exact: bool | None = None) -> Fit:
    """Return a fit on the exact form of its model where that can be had, with a note on which form its figures rest.

    Parameters
    ----------
    problem, fit
        The problem, and its solution by steps of fixed length.
    exact
        False leaves it at that; None leaves it where the exact form would take long.
    """
    if exact is False or not problem.has_events:
        return fit
    reason = reason_against(problem, fit)
    if reason and not (exact and not np.any(fit.bandwidth > 0)):
        return _kept(fit, reason)
    try:
        found = refined(problem, fit)
    except (ModelError, SolverError) as error:
        return _kept(fit, str(error).rstrip("."))
    name, size = farthest(found)
    what = f"; the last steps moved `{name}` most, by {size:.2g} sd" if name else ""
    return replace(
        found, notes=(*found.notes, f"The figures rest on the exact form of the model, with its events located{what}.")
    )


def _kept(fit: Fit, reason: str) -> Fit:
    sentence = f"The figures rest on steps of fixed length over the model's events, not on its exact form: {reason}."
    return replace(fit, notes=(*fit.notes, sentence))
