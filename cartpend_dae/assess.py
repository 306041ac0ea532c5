"""Errors of a fitted model on any run: simulation, horizon, innovation, and the study's own scores."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy import signal as filters

from cartpend_dae.cuts import shorter
from cartpend_dae.dae import parameter_vector
from cartpend_dae.data import Experiment, noise_sd
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.identify import Fit, estimate
from cartpend_dae.problem import Problem, dominant_frequency, make_problem
from cartpend_dae.shooting import predict
from cartpend_dae.study_schema import ScoreSpec
from cartpend_dae.system import System
from cartpend_dae.transcribe import injection_targets, interval_inputs

START_SAMPLES = 20
# a simulation that errs by more than so many standard deviations of what was measured has diverged
LOST = 100.0
# so often at most the steps of one are halved, until that changes it by less than this share of the standard deviation
HALVINGS, SETTLED = 6, 0.03


@dataclass(frozen=True, slots=True)
class OutputError:
    """Error of one output of one run: rmse in `unit`, nrmse relative to the signal's sd, noise of the sensor."""

    rmse: float
    nrmse: float
    noise_sd: float
    unit: str


@dataclass(frozen=True, slots=True)
class RunError:
    """Errors of a model on one run; `measured` and `predicted` have the shape (n, n_outputs)."""

    name: str
    role: str
    score: str
    outputs: dict[str, OutputError]
    time: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray


@dataclass(frozen=True, slots=True)
class Assessment:
    """A fitted model on all runs, and the study's own scores by name and run."""

    runs: tuple[RunError, ...]
    scores: dict[str, dict[str, float]]


def assess(
    system: System,
    fit: Fit,
    experiments: tuple[Experiment, ...],
    scores: tuple[ScoreSpec, ...] = (),
    *,
    bandwidth: float = 0.0,
    step: float | None = None,
    measured: Mapping[str, str] | None = None,
) -> Assessment:
    """Measure the errors of a model with given parameters; nothing but free start states is fitted.

    A run that is cut into pieces and scored by free simulation is simulated piece by piece, each from its own start.

    Parameters
    ----------
    system
        The assembled model.
    fit
        The fit, whose parameters are used.
    experiments
        The runs, whatever their role.
    scores
        Scores that the study defines.
    bandwidth
        Bandwidth of the observer for runs scored by horizon or innovation [rad/s]; five times the
        dominant frequency if 0.
    step
        Longest step of the Runge-Kutta method [s].
    measured
        Names under which outputs and inputs are reported, by the name in the model, where they differ.
    """
    in_run = {experiment.name: system_with(system, fit.values_in(experiment.name)) for experiment in experiments}
    runs = tuple(_run_error(in_run[run.name], run, bandwidth, step, measured or {}) for run in experiments)
    found: dict[str, dict[str, float]] = {}
    for score in scores:
        found[score.name] = {
            run.name: _score_or_nan(in_run[run.name], run, score, measured or {}) for run in experiments
        }
    return Assessment(runs, found)


def _score_or_nan(system: System, experiment: Experiment, score: ScoreSpec, measured: Mapping[str, str]) -> float:
    """Return a score of the study, and NaN where an effect with a memory of its own leaves it undefined."""
    try:
        return inverse_dynamics(system, experiment, score, measured)
    except ModelError:
        return float("nan")


def system_with(system: System, values: Mapping[str, float]) -> System:
    """Return a system whose parameters have other values."""
    numbers = parameter_vector(system, dict(values))
    parameters = tuple(replace(q, value=float(v)) for q, v in zip(system.parameters, numbers, strict=True))
    return replace(system, parameters=parameters)


def _run_error(
    system: System, experiment: Experiment, bandwidth: float, step: float | None, measured: Mapping[str, str]
) -> RunError:
    if experiment.score != "free":
        experiment = replace(experiment, piece=None)
    truth = np.column_stack([channel.values for channel in experiment.outputs.values()])
    prediction = _predicted(system, experiment, truth, bandwidth, step)
    outputs = {}
    for column, name in enumerate(experiment.outputs):
        error = truth[:, column] - prediction[:, column]
        rmse = float(np.sqrt(np.nanmean(error**2)))
        spread = float(np.nanstd(truth[:, column]))
        outputs[measured.get(name, name)] = OutputError(
            rmse,
            rmse / spread if spread > 0 else float("nan"),
            noise_sd(truth[:, column]),
            system.unit_of(name),
        )
    return RunError(experiment.name, experiment.role, experiment.score, outputs, experiment.time, truth, prediction)


def _predicted(
    system: System, experiment: Experiment, truth: np.ndarray, bandwidth: float, step: float | None
) -> np.ndarray:
    """Predict what a run has measured, shape (n, n_outputs), on finer steps if need be.

    A model whose fastest motion was met nowhere near the start, as a stiff contact is, may diverge on steps of fixed
    length: of the method, not of the model. Its steps are halved until it does not, and halving them once more changes
    no more than a share of what is measured.
    """
    spread = np.nanstd(truth, axis=0)
    spread[spread == 0] = np.inf  # of what stays as it is only that it does not diverge is asked
    before, left = None, HALVINGS
    while True:
        problem = make_problem(system, (), (experiment,), step=step)
        try:
            prediction = _prediction(problem, experiment, bandwidth, step)
        except SolverError:
            if not left:
                raise
            prediction = np.full_like(truth, np.inf)
        is_lost = _is_far(truth, prediction, LOST * spread)
        is_settled = before is None or not _is_far(before, prediction, SETTLED * spread)
        if not left or (is_settled and not is_lost):
            return prediction
        before, left = prediction, left - 1
        step = float(np.median(np.diff(experiment.time))) / problem.layout.substeps / 2


def _is_far(one: np.ndarray, other: np.ndarray, most: np.ndarray) -> bool:
    """Return whether two courses (n, n_outputs) differ by more than `most` (n_outputs,) anywhere, or one diverges."""
    if not (np.all(np.isfinite(other)) and not np.any(np.isinf(one))):
        return True
    return bool(np.any(np.abs(one - other) > most))


def _prediction(problem: Problem, experiment: Experiment, bandwidth: float, step: float | None) -> np.ndarray:
    """Predict a run as it is scored, shape (n, n_outputs)."""
    system = problem.system
    start = estimate(problem, patient=False).point if experiment.piece else _fitted_start(system, experiment, step)
    observer = bandwidth or 5 * dominant_frequency((experiment,))
    if experiment.score == "free":
        return predict(problem, start, 0.0)
    if experiment.score == "innovation":
        return predict(problem, start, observer)
    return _over_horizons(system, experiment, start, observer, step)


def _fitted_start(system: System, experiment: Experiment, step: float | None) -> dict[str, float]:
    """Fit the free start states alone, on the first samples: 20, or an eighth of a period if that is longer."""
    if not any(start.free for start in experiment.start.values()):
        return {}
    period = 2 * np.pi / max(dominant_frequency((experiment,)), 1e-12)
    n = int(np.searchsorted(experiment.time - experiment.time[0], period / 8))
    n = min(max(START_SAMPLES, n), experiment.time.size)
    short = replace(shorter(experiment, slice(0, n)), piece=None)
    problem = make_problem(system, (), (short,), step=step)
    return estimate(problem, patient=False).point


def _over_horizons(
    system: System, experiment: Experiment, start: Mapping[str, float], observer: float, step: float | None
) -> np.ndarray:
    """Simulate piece by piece over the run's horizon, each from the state that the observer has filtered."""
    problem = make_problem(system, (), (experiment,), step=step)
    assert experiment.horizon is not None
    edges = np.searchsorted(experiment.time, np.arange(experiment.time[0], experiment.time[-1], experiment.horizon))
    return predict(problem, start, observer, restarts=tuple(int(k) for k in np.unique(edges)))


def inverse_dynamics(system: System, experiment: Experiment, score: ScoreSpec, measured: Mapping[str, str]) -> float:
    """Return the relative error of the input that the model needs for the measured motion, ||u - u_model|| / ||u||.

    The position passes a Butterworth filter forwards and backwards and is differentiated twice by central
    differences; the input and the model's are decimated alike (Chebyshev filter of order 8, zero phase), as
    in inverse-dynamics identification of robots.

    Raises
    ------
    ModelError
        If the model is not one position with its speed driven by one input.

    References
    ----------
    M. Gautier, "Dynamic identification of robots with power model", ICRA (1997), 1922-1927,
    doi:10.1109/ROBOT.1997.606850.
    """
    names = {reported: name for name, reported in measured.items()}
    output, driven = names.get(score.output, score.output), names.get(score.input, score.input)
    index = system.index_of(output)
    targets = injection_targets(system, (index,))
    if (
        output not in system.state_relations
        or driven not in system.inputs
        or not targets
        or targets[0][2] is None
        or system.x.numel() != 2
    ):
        raise ModelError(
            f"The score `{score.name}` needs a model whose only states are `{score.output}` and its speed, "
            f"driven by `{score.input}`; {system.name} has the states {', '.join(system.states)}."
        )
    _, position, rate, _ = targets[0]
    assert rate is not None
    p = system.parameter_values
    relation = system.state_relations[output]
    factor, offset = (float(ca.Function("f", [system.p], [e])(p)) for e in (relation.factor, relation.offset))
    width = float(np.median(np.diff(experiment.time)))
    sections = filters.butter(score.order, score.cutoff * 2 * width, output="sos")
    s = filters.sosfiltfilt(sections, (experiment.outputs[output].values - offset) / factor)
    v = np.gradient(s, width)
    acceleration = np.gradient(v, width)
    x = np.zeros((2, s.size))
    x[position], x[rate] = s, v
    u = np.array([interval_inputs(experiment, system, name)[0] for name in system.inputs])
    row = system.inputs.index(driven)
    # the filter swings at both ends of the record; five of its time constants are left out there
    edge = int(np.ceil(5 / (score.cutoff * width)))
    needed = _needed_input(system, x, u, p, acceleration, row, rate)[edge:-edge]
    true = u[row][edge:-edge]
    if score.decimate > 1:
        needed, true = (filters.decimate(series, score.decimate) for series in (needed, true))
    return float(np.linalg.norm(true - needed) / np.linalg.norm(true))


def _needed_input(
    system: System, x: np.ndarray, u: np.ndarray, p: np.ndarray, acceleration: np.ndarray, row: int, rate: int
) -> np.ndarray:
    """Solve the equation of motion, linear in the input, for the input; dry friction slides at its level."""
    f = system.frictions
    sliding = ca.if_else(f.speed >= 0, f.level_pos, -f.level_neg) * ca.fabs(ca.sign(f.speed))
    motion = ca.substitute(system.ode[rate], f.force, sliding)
    slope = ca.jacobian(motion, system.u[row])
    rest = ca.substitute(motion, system.u[row], 0)
    function = ca.Function("motion", [system.x, system.u, system.p], [rest, slope])
    values, gains = function.map(x.shape[1])(x, u, np.tile(p[:, None], x.shape[1]))
    return (acceleration - np.asarray(values).ravel()) / np.asarray(gains).ravel()
