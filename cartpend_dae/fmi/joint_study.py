"""A study whose model has FMUs in it: the fit of `identify_with_fmus` in the terms of `cartpend identify`."""

from dataclasses import replace

import numpy as np

from cartpend_dae.assess import Assessment, OutputError, RunError
from cartpend_dae.data import Channel, Experiment, FloatArray, Trajectory, noise_sd
from cartpend_dae.directions import blind_directions
from cartpend_dae.errors import StudyError
from cartpend_dae.fmi.calibrate import JointFit, MeasuredRun, identify_with_fmus
from cartpend_dae.fmi.component import fmus_in, inner_units
from cartpend_dae.fmi.joint import run_system
from cartpend_dae.identify import Fit, RunFit
from cartpend_dae.inputs import Input
from cartpend_dae.residual_noise import meat, noise_model
from cartpend_dae.session import Opened
from cartpend_dae.uncertainty import NORMAL_95, Estimate, Status, seen_inverse

# a free start of a run that is not fitted is found on so many samples
START_SAMPLES = 20
# of the distance between the bounds: closer to one a value stands on it
ON_BOUND = 1e-6
RTOL, ATOL = 1e-8, 1e-10


def fit_with_fmus(opened: Opened) -> tuple[Fit, Assessment]:
    """Estimate the free parameters and start values of a study, and measure the errors on all its runs.

    Raises
    ------
    StudyError
        For what a study with FMUs cannot ask for.
    SolverError
        If a run or the estimation fails.
    """
    _refuse(opened)
    setup = opened.setup
    measured = [_measured(opened, run) for run in setup.train]
    free = {spec.name: _guess(opened, spec.name, spec.guess) for spec in setup.free}
    bounds = {
        spec.name: (-np.inf if spec.lower is None else spec.lower, np.inf if spec.upper is None else spec.upper)
        for spec in setup.free
    }
    found = identify_with_fmus(setup.model, measured, free, bounds=bounds)
    fit = _fit(opened, measured, found, bounds)
    return fit, _errors(opened, found)


def _refuse(opened: Opened) -> None:
    """Refuse what the estimation by joint runs does not know."""
    study, setup = opened.study, opened.setup
    options = study.identify
    runs = (*setup.train, *setup.select, *setup.test)
    asked = {
        "`model.add`": bool(study.model.add),
        "`tie`": bool(setup.ties),
        "`prior`": any(spec.prior is not None for spec in setup.free),
        "a parameter for each run": any(spec.is_per_run for spec in setup.free),
        "a logarithmic scale": any(spec.is_log for spec in setup.free),
        "a start value with `sd`": any(start.sd is not None for run in runs for start in run.start.values()),
        "a steady run": any(run.steady for run in runs),
        "pieces": any(run.piece is not None for run in runs),
        "a score other than `free`": any(run.score != "free" for run in runs) or bool(setup.scores),
        "several starts": options.starts > 1,
        "`huber`": options.huber is not None,
    }
    if wrong := [what for what, is_asked in asked.items() if is_asked]:
        raise StudyError(f"{study.path}: {', '.join(wrong)} cannot be used where parts of the model are FMUs.")
    if not setup.train:
        raise StudyError(f'{study.path}: there is no run with `role = "train"` to fit.')


def _guess(opened: Opened, name: str, guess: float | None) -> float:
    if guess is not None:
        return guess
    value = opened.system.parameters[opened.system.parameter_index(name)].value
    if value is None:
        raise StudyError(f'{opened.study.path}: `parameters."{name}"` has no `guess`, nor a value in the model.')
    return value


def _measured(opened: Opened, run: Experiment) -> MeasuredRun:
    """Return a run as the joint estimation takes it; a free start without a guess begins where the model does."""
    inputs: dict[str, Input] = {name: (run.time, c.values, c.hold) for name, c in run.inputs.items()}
    known = {name: start.value for name, start in run.start.items() if not start.free and start.value is not None}
    free = {name: start.value for name, start in run.start.items() if start.free}
    if any(value is None for value in free.values()):
        begun = _run(opened, MeasuredRun(run.time[:2], {}, inputs, known), {})
        free = {name: float(begun[name][0]) if value is None else value for name, value in free.items()}
    guesses = {name: value for name, value in free.items() if value is not None}
    return MeasuredRun(run.time, {name: c.values for name, c in run.outputs.items()}, inputs, known, guesses)


def _run(opened: Opened, run: MeasuredRun, parameters: dict[str, float]) -> Trajectory:
    placed = list(fmus_in(opened.model))
    start = {**run.start, **run.free}
    return run_system(opened.system, placed, run.times, run.inputs, start, parameters, RTOL, ATOL)


def _errors(opened: Opened, found: JointFit) -> Assessment:
    """Simulate all runs with the estimates; free starts of those that were not fitted are fitted alone."""
    setup = opened.setup
    runs = []
    for k, run in enumerate((*setup.train, *setup.select, *setup.test)):
        measured = _measured(opened, run)
        begun = found.starts[k] if k < len(setup.train) else _fitted_start(opened, measured, found.values)
        made = _run(opened, replace(measured, free=begun), found.values)
        predicted = np.column_stack([made[name] for name in run.outputs])
        truth = np.column_stack([channel.values for channel in run.outputs.values()])
        outputs = {
            name: _output_error(channel, predicted[:, i]) for i, (name, channel) in enumerate(run.outputs.items())
        }
        runs.append(RunError(run.name, run.role, run.score, outputs, run.time, truth, predicted))
    return Assessment(tuple(runs), {})


def _fitted_start(opened: Opened, run: MeasuredRun, parameters: dict[str, float]) -> dict[str, float]:
    if not run.free:
        return {}
    n = min(START_SAMPLES, len(run.times))
    inputs: dict[str, Input] = dict(run.inputs)
    first = replace(run, times=run.times[:n], outputs={k: v[:n] for k, v in run.outputs.items()}, inputs=inputs)
    return identify_with_fmus(opened.model, [first], {}, parameters=parameters).starts[0]


def _output_error(channel: Channel, predicted: FloatArray) -> OutputError:
    rmse = float(np.sqrt(np.nanmean((channel.values - predicted) ** 2)))
    spread = float(np.nanstd(channel.values))
    return OutputError(rmse, rmse / spread if spread > 0 else float("nan"), noise_sd(channel.values), channel.unit)


def _fit(opened: Opened, measured: list[MeasuredRun], found: JointFit, bounds: dict[str, tuple[float, float]]) -> Fit:
    """Return the fit with the covariance of the noise that the residuals show, as every other fit has it."""
    setup, outputs = opened.setup, tuple(found.residual_sd)
    sd = np.array([found.residual_sd[name] for name in outputs])
    weighed = [values / sd for values in found.residuals]
    slopes = [values / sd[:, None] for values in found.slopes]
    starts = [(run.name, name) for run, known in zip(setup.train, found.starts, strict=True) for name in known]
    names = [*found.values, *(f"{run}:{name}" for run, name in starts)]
    values = np.array([*found.values.values(), *(v for known in found.starts for v in known.values())])
    on_bound = [_is_on_bound(opened, name, value, bounds[name]) for name, value in found.values.items()]
    inside = [i for i in range(values.size) if i >= len(on_bound) or not on_bound[i]]
    noise = noise_model(weighed, len(inside))
    flat = [part.reshape(-1, values.size)[:, inside] for part in slopes]
    gram = sum((part.T @ part for part in flat), np.zeros((len(inside), len(inside))))
    inverse, null, unseen = seen_inverse(gram)
    covariance = np.zeros((values.size, values.size))
    covariance[np.ix_(inside, inside)] = inverse @ meat([part[:, :, inside] for part in slopes], noise) @ inverse
    status: list[Status] = ["ok" if i in inside else "at-bound" for i in range(values.size)]
    for i in np.flatnonzero(unseen):
        status[inside[i]] = "unidentifiable"
        covariance[inside[i], inside[i]] = np.inf
    for i, state in enumerate(status):
        if state == "at-bound":
            covariance[i, i] = np.nan
    units = dict(inner_units(opened.model)) | {v.name: v.declaration.unit for v in opened.system.variables}
    units |= {q.name: q.declaration.unit for q in opened.system.parameters}
    own = [*found.values, *(name for _, name in starts)]
    estimates = tuple(
        _estimate(name, float(value), float(np.sqrt(covariance[i, i])), units[short], status[i])
        for i, (name, short, value) in enumerate(zip(names, own, values, strict=True))
    )
    chi2 = float(sum(np.nansum(part**2) for part in weighed))
    how = {"directional": "directional derivatives of the FMUs", "differences": "central differences of whole runs"}
    return Fit(
        parameters=estimates[: len(found.values)],
        starts=estimates[len(found.values) :],
        tied=(),
        covariance=covariance,
        blind=blind_directions(tuple(names[i] for i in inside), values[inside], null),
        noise=noise,
        outputs=outputs,
        noise_sd=sd,
        weights_sd=sd,
        chi2=chi2,
        cost=chi2 / 2,
        n_residuals=int(sum(np.isfinite(part).sum() for part in weighed)),
        runs=tuple(
            RunFit(run.name, run.time, residual, np.zeros((run.time.size, 0)), np.zeros(0))
            for run, residual in zip(setup.train, found.residuals, strict=True)
        ),
        bandwidth=np.zeros(len(outputs)),
        success=True,
        message="converged",
        iterations=found.n_runs,
        notes=(f"Parts of the model are FMUs: slopes by {how[found.derivatives]}, {found.n_runs} runs in all.",),
        form="exact",
    )


def _is_on_bound(opened: Opened, name: str, value: float, bounds: tuple[float, float]) -> bool:
    d = opened.system.parameters[opened.system.parameter_index(name)].declaration
    ends = [bound for bound in (*bounds, d.min, d.max) if bound is not None and np.isfinite(bound)]
    return any(abs(value - end) <= ON_BOUND * max(abs(value), abs(end), 1e-12) for end in ends)


def _estimate(name: str, value: float, sd: float, unit: str, status: Status) -> Estimate:
    return Estimate(name, value, sd, unit, status, (value - NORMAL_95 * sd, value + NORMAL_95 * sd))
