"""Estimate parameters and start values of a model on measured runs, with their uncertainty."""

import itertools
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.data import Experiment, noise_sd
from cartpend_dae.dae import parameter_vector
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.initialize import initialize
from cartpend_dae.language import Component
from cartpend_dae.stepping import runge_kutta
from cartpend_dae.system import System
from cartpend_dae.transcribe import (
    SEGMENT,
    Free,
    Layout,
    Passes,
    Programme,
    RunStart,
    interval_inputs,
    passes,
    programme,
    stack_data,
)

log = logging.getLogger(__name__)
Status = Literal["ok", "at-bound", "unidentifiable", "fixed"]
Progress = Callable[[str, int, float], None]


@dataclass(frozen=True, slots=True)
class Estimate:
    """An estimated quantity: value and standard deviation in SI units."""

    name: str
    value: float
    sd: float
    unit: str
    status: Status


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

    `chi2` is the sum of squared residuals over the noise sds used as weights (`weights_sd`); `gram` and
    `gradient` are the Gauss-Newton Hessian and gradient over parameters and free starts, scaled variables.
    """

    parameters: tuple[Estimate, ...]
    starts: tuple[Estimate, ...]
    covariance: np.ndarray
    outputs: tuple[str, ...]
    noise_sd: np.ndarray
    weights_sd: np.ndarray
    chi2: float
    n_residuals: int
    runs: tuple[RunFit, ...]
    bandwidth: np.ndarray
    success: bool
    message: str
    iterations: int

    @property
    def values(self) -> dict[str, float]:
        """Estimated parameters by name, SI units."""
        return {estimate.name: estimate.value for estimate in self.parameters}

    @property
    def point(self) -> dict[str, float]:
        """Estimated parameters and free starts by name, SI units."""
        return self.values | {estimate.name: estimate.value for estimate in self.starts}


@dataclass(frozen=True, slots=True)
class Linearisation:
    """Normal equations by segment at `values` (scaled): `grams` (n_segments, n, n), `gradients` (n_segments, n)."""

    variables: tuple[Free, ...]
    values: np.ndarray
    grams: np.ndarray
    gradients: np.ndarray


@dataclass(frozen=True)
class Problem:
    """What is to be estimated, on which runs; assembled once and solved as often as needed."""

    system: System
    free: tuple[Free, ...]
    experiments: tuple[Experiment, ...]
    outputs: tuple[str, ...]
    step: float | None = None

    @cached_property
    def layout(self) -> Layout:
        """The structure that the transcription needs."""
        lengths = [experiment.time.size for experiment in self.experiments]
        length = min(SEGMENT, max(lengths))
        counts = [-(-n // length) for n in lengths]
        first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(int)
        return Layout(
            system=self.system,
            free=self.free,
            outputs=tuple(self.system.index_of(name) for name in self.outputs),
            output_names=self.outputs,
            substeps=_substeps(self),
            length=length,
            n_segments=int(sum(counts)),
            first=tuple(first.tolist()),
            run_lengths=tuple(lengths),
        )

    @cached_property
    def functions(self) -> Passes:
        """The passes over the data."""
        return passes(self.layout)

    @cached_property
    def starts(self) -> tuple[RunStart, ...]:
        """How each run starts."""
        return tuple(_run_start(self, experiment) for experiment in self.experiments)

    @property
    def variables(self) -> tuple[Free, ...]:
        """All that is estimated: parameters, then the free starts of all runs."""
        return self.free + tuple(item for start in self.starts for _, _, _, item in start.free)

    @cached_property
    def programme(self) -> Programme:
        """The nonlinear programme."""
        return programme(self.layout, self.starts, self.functions)

    @cached_property
    def prior_sd(self) -> np.ndarray:
        """Noise of each output as the raw data show it, or as the study states it; shape (n_y,)."""
        return np.array([_channel_sd(self.experiments, name) for name in self.outputs])


def make_problem(
    model: Component | System,
    free: tuple[Free, ...],
    experiments: tuple[Experiment, ...],
    *,
    step: float | None = None,
) -> Problem:
    """Check what is to be estimated against the model.

    Parameters
    ----------
    model
        The model.
    free
        Free parameters; see `free_parameter`.
    experiments
        The runs to be fitted.
    step
        Longest step of the Runge-Kutta method [s]; chosen from the model's fastest motion if None.

    Raises
    ------
    ModelError
        For unknown names, or if there is nothing to fit.
    """
    system = assemble(model)
    if not experiments:
        raise ModelError(f"There is no run to fit {system.name} to.")
    for item in free:
        system.parameter_index(item.name)
    outputs = tuple(dict.fromkeys(name for experiment in experiments for name in experiment.outputs))
    for name in outputs:
        system.index_of(name)
    for experiment in experiments:
        for name in experiment.inputs:
            if name not in system.inputs:
                listing = ", ".join(f"`{other}`" for other in system.inputs) or "none"
                raise ModelError(f"{system.name} has no input `{name}` (run `{experiment.name}`); its inputs are: {listing}.")
        for name in system.inputs:
            if name not in experiment.inputs and system.variables[system.index_of(name)].declaration.default is None:
                raise ModelError(f"Run `{experiment.name}` gives no input `{name}`: name its column under `inputs`.")
    return Problem(system, free, experiments, outputs, step)


def free_parameter(
    system: System,
    name: str,
    *,
    guess: float | None = None,
    lower: float | None = None,
    upper: float | None = None,
    scale: float | None = None,
) -> Free:
    """Return a free parameter; what is not given comes from the model's declaration (SI units).

    Raises
    ------
    ModelError
        If the model has no such independent parameter.
    """
    parameter = system.parameters[system.parameter_index(name)]
    declared = parameter.declaration
    start = parameter.value if guess is None else guess
    if start is None:
        raise ModelError(f"The free parameter `{name}` needs a `guess`.")
    low = -np.inf if declared.min is None and lower is None else max(x for x in (declared.min, lower) if x is not None)
    high = np.inf if declared.max is None and upper is None else min(x for x in (declared.max, upper) if x is not None)
    size = scale or abs(start) or declared.nominal or 1.0
    return Free(name, float(start), float(low), float(high), float(size), declared.unit)


def _channel_sd(experiments: tuple[Experiment, ...], name: str) -> float:
    stated = [e.outputs[name].sd for e in experiments if name in e.outputs]
    known = [sd for sd in stated if sd is not None]
    if known:
        return float(np.sqrt(np.mean(np.square(known))))
    raw = [noise_sd(e.outputs[name].values) for e in experiments if name in e.outputs]
    spread = max(float(np.nanstd(e.outputs[name].values)) for e in experiments if name in e.outputs)
    # data without any noise (a simulation) still needs a finite weight
    return max(float(np.nanmean(raw)), 1e-6 * spread, 1e-12)


def _substeps(problem: Problem) -> int:
    """Return steps per sample so that the step is short against the fastest motion of the model.

    The product of step and fastest eigenvalue stays below 0.25 (error of RK4 per step below 1e-5); with
    dry friction below 0.03, because reversals are resolved to second order only.
    """
    system = problem.system
    widths = np.concatenate([np.diff(experiment.time) for experiment in problem.experiments])
    width = float(np.median(widths))
    if problem.step is not None:
        return max(1, int(np.ceil(width / problem.step - 1e-9)))
    jacobian = ca.Function(
        "jacobian",
        [system.time, system.x, system.z, system.u, system.p, system.frictions.force],
        [ca.jacobian(system.ode, system.x)],
    )
    p = parameter_vector(system, {item.name: item.guess for item in problem.free})
    x = problem.starts[0].x
    zeros = [np.zeros(s.numel()) for s in (system.z, system.u)]
    value = np.asarray(jacobian(0.0, x, *zeros, p, np.zeros(system.frictions.force.numel())))
    fastest = float(np.abs(np.linalg.eigvals(value)).max(initial=0.0)) if value.size else 0.0
    limit = 0.03 if system.frictions.places else 0.25
    return int(np.clip(np.ceil(width * fastest / limit), 1, 100))


def _run_start(problem: Problem, experiment: Experiment) -> RunStart:
    """Fix the start states that the run or the model gives, and list those that are estimated."""
    system = problem.system
    p = parameter_vector(system, {item.name: item.guess for item in problem.free})
    u = np.array([interval_inputs(experiment, system, name)[0][0] for name in system.inputs])
    given: dict[str, float] = {}
    for name, start in experiment.start.items():
        value = start.value if start.value is not None else _start_guess(experiment, system, name)
        if value is not None:
            given[name] = value
    begin = initialize(system, p, u, given, float(experiment.time[0]))
    model_values = _outputs_at(system, begin.x, begin.z, u, p, float(experiment.time[0]))
    free = []
    for name, start in experiment.start.items():
        if not start.free:
            continue
        relation = system.state_relations.get(name)
        if relation is None:
            states = ", ".join(f"`{state}`" for state in system.states)
            raise ModelError(
                f"The start of `{name}` in run `{experiment.name}` cannot be free: it is not a state of the model or "
                f"a multiple of one. The states are: {states}."
            )
        factor, offset = (
            float(ca.Function("f", [system.p], [value])(p)) for value in (relation.factor, relation.offset)
        )
        guess = given.get(name, model_values[system.index_of(name)])
        scale = _start_scale(experiment, system, name, guess)
        free.append(
            (relation.state, factor, offset,
             Free(f"{experiment.name}:{name}", float(guess), -np.inf, np.inf, scale, system.unit_of(name)))
        )
    return RunStart(begin.x, tuple(free))


def _outputs_at(system: System, x: np.ndarray, z: np.ndarray, u: np.ndarray, p: np.ndarray, time: float) -> np.ndarray:
    function = ca.Function(
        "outputs", [system.time, system.x, system.z, system.u, system.p, system.frictions.force], [system.outputs]
    )
    return np.asarray(function(time, x, z, u, p, np.zeros(system.frictions.force.numel()))).ravel()


def _start_guess(experiment: Experiment, system: System, name: str) -> float | None:
    """Guess a start value from the first samples of a measured position or of the position it is the rate of."""
    if name in experiment.outputs:
        known = experiment.outputs[name].values
        return float(known[np.isfinite(known)][0])
    relation = system.state_relations.get(name)
    if relation is None:
        return None
    for measured, channel in experiment.outputs.items():
        other = system.state_relations.get(measured)
        if other is None or not ca.is_equal(system.ode[other.state], system.x[relation.state]):
            continue
        known = np.isfinite(channel.values)
        times, values = experiment.time[known][:20], channel.values[known][:20]
        p = system.parameter_values
        ratio = float(ca.Function("f", [system.p], [relation.factor / other.factor])(p))
        return float(np.polyfit(times - times[0], values, min(2, len(times) - 1))[-2]) * ratio
    return None


def _start_scale(experiment: Experiment, system: System, name: str, guess: float) -> float:
    if name in experiment.outputs:
        return max(abs(guess), float(np.nanstd(experiment.outputs[name].values)), 1e-9)
    return max(abs(guess), 1e-2)


def estimate(
    problem: Problem,
    *,
    bandwidth: float = 0.0,
    guess: Mapping[str, float] | None = None,
    observer: float | None = None,
    sd: np.ndarray | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Solve the estimation problem by IPOPT.

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
    progress
        Called with (stage, iteration, cost).

    Raises
    ------
    SolverError
        If the solver ends without a usable point.
    """
    layout = problem.layout
    weights_sd = problem.prior_sd if sd is None else sd
    data = stack_data(layout, problem.experiments, 1.0 / weights_sd)
    w = np.full(len(problem.outputs), float(bandwidth))
    everything = problem.variables
    values = np.array([(guess or {}).get(item.name, item.guess) / item.scale for item in everything])
    lower = np.array([item.lower / item.scale for item in everything])
    upper = np.array([item.upper / item.scale for item in everything])
    values = np.clip(values, lower, upper)
    follow = observer if observer is not None else max(bandwidth, dominant_frequency(problem.experiments) * 5)
    nodes = _nodes(problem, values, np.full_like(w, follow), data)
    point = np.concatenate([values, nodes.ravel(order="F")])
    bound_low = np.concatenate([lower, np.full(nodes.size, -np.inf)])
    bound_high = np.concatenate([upper, np.full(nodes.size, np.inf)])
    result = problem.programme.solver(
        x0=point, p=np.concatenate([w, data.ravel(order="F")]), lbx=bound_low, ubx=bound_high, lbg=0.0, ubg=0.0
    )
    stats = problem.programme.solver.stats()
    solution = np.asarray(result["x"]).ravel()
    if progress is not None:
        progress("fit", int(stats["iter_count"]), float(result["f"]))
    if not np.all(np.isfinite(solution)):
        raise SolverError(f"The fit of {problem.system.name} gave no finite parameters ({stats['return_status']}).")
    return _outcome(problem, solution, w, data, weights_sd, stats)


def _nodes(problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray) -> np.ndarray:
    """Filter the start state of each segment from the data, shape (n_x, n_segments)."""
    layout = problem.layout
    _, states = _series(problem, values, w, data)
    nodes = states[:, :: layout.length]
    if not np.all(np.isfinite(nodes)):
        raise SolverError(f"{problem.system.name} cannot be simulated with the start values of the parameters: it diverges.")
    return nodes


def predict(
    problem: Problem, point: Mapping[str, float], bandwidth: float, *, restarts: tuple[int, ...] = ()
) -> np.ndarray:
    """Predict the outputs of a problem with one run, shape (n, n_outputs).

    Parameters
    ----------
    problem
        A problem with a single run.
    point
        Parameters and free starts by name, SI; what is missing keeps its guess.
    bandwidth
        Bandwidth of the output injection [rad/s]; 0 simulates freely.
    restarts
        Samples at which a free simulation starts again from the state that the injection has filtered;
        without any, the prediction itself is filtered.
    """
    values = np.array([point.get(item.name, item.guess) / item.scale for item in problem.variables])
    data = stack_data(problem.layout, problem.experiments, np.ones(len(problem.outputs)))
    w = np.full(len(problem.outputs), float(bandwidth))
    n = problem.experiments[0].time.size
    measured = np.column_stack([problem.experiments[0].outputs[name].values for name in problem.outputs])
    # a sample that was not measured has no residual; its prediction comes from the states
    states = _series(problem, values, w, data)[1][:, :n]
    if restarts:
        states = _free_pieces(problem, values, data, states, restarts)
    system, layout = problem.system, problem.layout
    p = parameter_vector(system, {item.name: values[i] * item.scale for i, item in enumerate(layout.free)})
    outputs = ca.Function(
        "measured",
        [system.time, system.x, system.u, system.p, system.frictions.force],
        [system.outputs[list(layout.outputs)]],
    ).map(n)
    n_u = system.u.numel()
    forces = np.zeros((system.frictions.force.numel(), n))
    result = outputs(data[:1, :n], states, data[2 : 2 + n_u, :n], np.tile(p[:, None], n), forces)
    return np.asarray(result).T.reshape(measured.shape)


def _free_pieces(
    problem: Problem, values: np.ndarray, data: np.ndarray, states: np.ndarray, restarts: tuple[int, ...]
) -> np.ndarray:
    """Simulate freely between restarts, each from the state given there."""
    step = runge_kutta(problem.system, substeps=problem.layout.substeps).function
    p = parameter_vector(
        problem.system, {item.name: values[i] * item.scale for i, item in enumerate(problem.layout.free)}
    )
    n, n_u = states.shape[1], problem.system.u.numel()
    free = states.copy()
    edges = [*restarts, n]
    for first, last in itertools.pairwise(edges):
        if last - first < 2:
            continue
        part = data[:, first : last - 1]
        run = step.mapaccum("piece", last - first - 1, ["x"], ["x_next"])
        out = run(
            t=part[:1],
            h=part[1:2],
            x=states[:, first],
            u_a=part[2 : 2 + n_u],
            u_b=part[2 + n_u : 2 + 2 * n_u],
            p=np.tile(p[:, None], last - first - 1),
        )
        free[:, first + 1 : last] = np.asarray(out["x_next"])
    return free


def _start_states(problem: Problem, values: np.ndarray) -> list[np.ndarray]:
    position, found = len(problem.layout.free), []
    for start in problem.starts:
        x = start.x.copy()
        for state, factor, offset, free in start.free:
            x[state] = (values[position] * free.scale - offset) / factor
            position += 1
        found.append(x)
    return found


def _series(
    problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Run through all data from the start states; return weighted residuals (n_y, n) and states (n_x, n)."""
    layout = problem.layout
    n_c, n_x = len(layout.free) + w.size, layout.system.x.numel()
    carried = np.concatenate([values[: len(layout.free)], w])
    errors, states = [], []
    begin = dict(zip(layout.first, _start_states(problem, values), strict=True))
    x = np.zeros(n_x)
    for k in range(layout.n_segments):
        x = begin.get(k, x)
        block = data[:, k * layout.length : (k + 1) * layout.length]
        after, error, state = problem.functions.series(np.concatenate([carried, x]), block)
        x = np.asarray(after)[n_c:, -1]
        errors.append(np.asarray(error))
        states.append(np.asarray(state))
    return np.hstack(errors), np.hstack(states)


def normal_equations(
    problem: Problem, values: np.ndarray, w: np.ndarray, data: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return Gram matrices (n_segments, n, n) and gradients (n_segments, n) of the weighted residuals.

    They are over parameters and free starts (scaled). The segments are run through one after the other,
    so that their sums are those of single shooting.
    """
    layout = problem.layout
    n_x, n_p = layout.system.x.numel(), len(layout.free)
    size, n_all = n_x + n_p, values.size
    n_c = n_p + w.size
    carried = np.concatenate([values[:n_p], w])
    seeds = np.hstack([np.eye(n_x), np.zeros((n_x, n_p))])
    grams, gradients = np.zeros((layout.n_segments, n_all, n_all)), np.zeros((layout.n_segments, n_all))
    begin = dict(
        zip(layout.first, zip(_start_states(problem, values), _start_slopes(problem, n_all), strict=True), strict=True)
    )
    x, slope = np.zeros(n_x), np.zeros((n_x, n_all))
    theta_rows = np.eye(n_p, n_all)
    for k in range(layout.n_segments):
        x, slope = begin.get(k, (x, slope))
        block = data[:, k * layout.length : (k + 1) * layout.length]
        packed = np.concatenate([carried, x, seeds.ravel(order="F"), np.zeros(size * size + size)])
        out = np.asarray(problem.functions.slope(packed, block)).ravel()[n_c:]
        x = out[:n_x]
        step = out[n_x : n_x + n_x * size].reshape(n_x, size, order="F")
        local = out[n_x + n_x * size :][: size * size].reshape(size, size, order="F")
        to_local = np.vstack([slope, theta_rows])
        grams[k] = to_local.T @ local @ to_local
        gradients[k] = to_local.T @ out[-size:]
        slope = step @ to_local
    return grams, gradients


def linearised(problem: Problem, point: Mapping[str, float], bandwidth: float, sd: np.ndarray) -> Linearisation:
    """Return the normal equations of a problem at a point, without solving it.

    Parameters
    ----------
    problem
        The problem.
    point
        Parameters and free starts by name, SI; what is missing keeps its guess.
    bandwidth
        Bandwidth of the output injection [rad/s].
    sd
        Noise used as weight, shape (n_y,).
    """
    everything = problem.variables
    values = np.array([point.get(item.name, item.guess) / item.scale for item in everything])
    data = stack_data(problem.layout, problem.experiments, 1.0 / sd)
    w = np.full(len(problem.outputs), float(bandwidth))
    grams, gradients = normal_equations(problem, values, w, data)
    return Linearisation(everything, values, grams, gradients)


def _start_slopes(problem: Problem, n_all: int) -> list[np.ndarray]:
    """Return d(start state)/d(scaled variables) of each run, shape (n_x, n_all)."""
    position, found = len(problem.layout.free), []
    for start in problem.starts:
        slope = np.zeros((start.x.size, n_all))
        for state, factor, _, free in start.free:
            slope[state, position] = free.scale / factor
            position += 1
        found.append(slope)
    return found


def _outcome(
    problem: Problem, solution: np.ndarray, w: np.ndarray, data: np.ndarray, weights_sd: np.ndarray, stats: dict
) -> Fit:
    layout = problem.layout
    everything = problem.variables
    values = solution[: len(everything)]
    errors, states = _series(problem, values, w, data)
    gram = normal_equations(problem, values, w, data)[0].sum(axis=0)
    weight_rows = data[-len(problem.outputs) :]
    n_residuals = int(np.count_nonzero(weight_rows))
    chi2 = float(np.sum(errors**2))
    per_channel = np.array([np.sum(errors[i] ** 2) / max(1, np.count_nonzero(weight_rows[i])) for i in range(len(errors))])
    covariance, status = _covariance(gram, everything, values, chi2 / max(1, n_residuals - len(everything)))
    scale = np.array([item.scale for item in everything])
    covariance = covariance * np.outer(scale, scale)
    estimates = tuple(
        Estimate(item.name, float(values[i] * item.scale), float(np.sqrt(covariance[i, i])), item.unit, status[i])
        for i, item in enumerate(everything)
    )
    runs = []
    starts = _start_states(problem, values)
    for run, experiment in enumerate(problem.experiments):
        part = slice(layout.first[run] * layout.length, layout.first[run] * layout.length + layout.run_lengths[run])
        mask = weight_rows[:, part] > 0
        residual = np.where(mask, errors[:, part] * weights_sd[:, None], np.nan).T
        runs.append(RunFit(experiment.name, experiment.time, residual, states[:, part].T, starts[run]))
    status_text = str(stats["return_status"])
    return Fit(
        parameters=estimates[: len(layout.free)],
        starts=estimates[len(layout.free) :],
        covariance=covariance,
        outputs=problem.outputs,
        noise_sd=weights_sd * np.sqrt(per_channel),
        weights_sd=weights_sd,
        chi2=chi2,
        n_residuals=n_residuals,
        runs=tuple(runs),
        bandwidth=w,
        success=status_text in ("Solve_Succeeded", "Solved_To_Acceptable_Level"),
        message=status_text,
        iterations=int(stats["iter_count"]),
    )


def _covariance(
    gram: np.ndarray, everything: tuple[Free, ...], values: np.ndarray, variance: float
) -> tuple[np.ndarray, list[Status]]:
    """Return the covariance of scaled variables, and what each is worth.

    The inverse of the Gauss-Newton Hessian times the residual variance; directions that the data do not
    see (relative singular value below 1e-10) have infinite variance. A variable on its bound is held there.
    """
    n = len(everything)
    status: list[Status] = ["ok"] * n
    inside = []
    for i, item in enumerate(everything):
        span = 1e-6 * max(1.0, abs(values[i]))
        if values[i] <= item.lower / item.scale + span or values[i] >= item.upper / item.scale - span:
            status[i] = "at-bound"
        else:
            inside.append(i)
    covariance = np.zeros((n, n))
    block = gram[np.ix_(inside, inside)]
    size = np.sqrt(np.clip(np.diag(block), 1e-300, None))
    eigenvalues, vectors = np.linalg.eigh(block / np.outer(size, size))
    good = eigenvalues > 1e-10 * max(1.0, eigenvalues.max(initial=0.0))
    inverse = (vectors[:, good] / eigenvalues[good]) @ vectors[:, good].T
    covariance[np.ix_(inside, inside)] = variance * inverse / np.outer(size, size)
    blind = np.flatnonzero((np.abs(vectors[:, ~good]) > 1e-3).any(axis=1)) if (~good).any() else []
    for i in blind:
        status[inside[i]] = "unidentifiable"
        covariance[inside[i], inside[i]] = np.inf
    for i, state in enumerate(status):
        if state == "at-bound":
            covariance[i, i] = np.nan
    return covariance, status


def dominant_frequency(experiments: tuple[Experiment, ...]) -> float:
    """Return the angular frequency of the strongest line in any measured output [rad/s]."""
    found = []
    for experiment in experiments:
        for channel in experiment.outputs.values():
            known = np.isfinite(channel.values)
            grid = np.linspace(experiment.time[0], experiment.time[-1], experiment.time.size)
            values = np.interp(grid, experiment.time[known], channel.values[known])
            values = values - np.polyval(np.polyfit(grid, values, 1), grid)
            power = np.abs(np.fft.rfft(values * np.hanning(values.size))) ** 2
            frequency = 2 * np.pi * np.fft.rfftfreq(values.size, grid[1] - grid[0])
            found.append(float(frequency[1:][np.argmax(power[1:])]))
    return max(found)


def rescaled(free: Free, value: float) -> Free:
    """Return a free parameter with another guess and the scale that fits it."""
    return replace(free, guess=value, scale=abs(value) or free.scale)
