"""What is to be estimated, on which runs, from where: checked against the model once, solved as often as needed."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.continuous import without_events
from cartpend_dae.dae import parameter_vector
from cartpend_dae.data import Experiment, noise_sd
from cartpend_dae.errors import ModelError
from cartpend_dae.initialize import initialize
from cartpend_dae.language import Component
from cartpend_dae.programme import Programme, programme
from cartpend_dae.singular import check_regular
from cartpend_dae.system import System
from cartpend_dae.transcribe import SEGMENT, Free, Layout, Passes, RunStart, interval_inputs, passes, shown_state


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
    system = without_events(assemble(model), "An estimation")
    if not experiments:
        raise ModelError(f"There is no run to fit {system.name} to.")
    for item in free:
        system.parameter_index(item.name)
    loose = sorted({q.name for q in system.parameters if q.is_unknown} - {item.name for item in free})
    if loose:
        raise ModelError(
            f"{system.name} leaves {', '.join(f'`{name}`' for name in loose)} to the start of a simulation "
            f"(`unknown(...)`); an estimation needs a number in the model, or the parameter among the free ones."
        )
    outputs = tuple(dict.fromkeys(name for experiment in experiments for name in experiment.outputs))
    for name in outputs:
        system.index_of(name)
    for experiment in experiments:
        for name in experiment.inputs:
            if name not in system.inputs:
                listing = ", ".join(f"`{other}`" for other in system.inputs) or "none"
                raise ModelError(
                    f"{system.name} has no input `{name}` (run `{experiment.name}`); its inputs are: {listing}."
                )
        for name in system.inputs:
            if name not in experiment.inputs and system.variables[system.index_of(name)].declaration.default is None:
                raise ModelError(f"Run `{experiment.name}` gives no input `{name}`: name its column under `inputs`.")
    check_regular(system, parameter_vector(system, {item.name: item.guess for item in free}))
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
    begin = initialize(system, p, u, given, float(experiment.time[0]), unknown={})
    model_values = _outputs_at(system, begin.x, begin.z, u, p, float(experiment.time[0]))
    free = []
    for name, start in experiment.start.items():
        if not start.free:
            continue
        shown = shown_state(system, name) if name in {v.name for v in system.variables} else None
        if shown is None:
            states = ", ".join(f"`{state}`" for state in system.states)
            raise ModelError(
                f"The start of `{name}` in run `{experiment.name}` cannot be free: it is not a state of the model or "
                f"a multiple of one. The states are: {states}."
            )
        state, factor = shown[0], float(ca.Function("f", [system.p], [shown[1]])(p))
        # what else is in it, as the deflection of a shaft, stays where the model starts
        offset = float(model_values[system.index_of(name)] - factor * begin.x[state])
        guess = float(given.get(name, model_values[system.index_of(name)]) or 0.0)
        scale = _start_scale(experiment, system, name, guess)
        free.append(
            (
                state,
                factor,
                offset,
                Free(f"{experiment.name}:{name}", guess, -np.inf, np.inf, scale, system.unit_of(name)),
            )
        )
    return RunStart(begin.x, tuple(free))


def _outputs_at(system: System, x: np.ndarray, z: np.ndarray, u: np.ndarray, p: np.ndarray, time: float) -> np.ndarray:
    function = ca.Function(
        "outputs",
        [system.time, system.x, system.z, system.u, system.p, system.frictions.force],
        [system.outputs],
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
