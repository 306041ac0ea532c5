"""What is to be estimated, on which runs, from where: checked against the model once, solved as often as needed."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.continuous import without_events
from cartpend_dae.cuts import cut, owners_of, run_of
from cartpend_dae.dae import parameter_vector
from cartpend_dae.data import Experiment, noise_sd
from cartpend_dae.errors import ModelError
from cartpend_dae.language import Component
from cartpend_dae.passes import Passes
from cartpend_dae.programme import programme
from cartpend_dae.singular import check_regular
from cartpend_dae.starts import begin_function, run_start
from cartpend_dae.stepping import LONGEST, lags_of_inputs, shortest_times
from cartpend_dae.strides import substeps
from cartpend_dae.system import System
from cartpend_dae.transcribe import SEGMENT, Layout, RunStart, Slot
from cartpend_dae.unknowns import Free, Prior, Tie

# what is built of a problem and depends on where its runs start
_OF_STARTS = ("starts", "begins", "start_places", "programme")


@dataclass(frozen=True)
class Problem:
    """What is to be estimated, on which runs; assembled once and solved as often as needed.

    `system` is without events; `events` is the one with them.
    """

    system: System
    free: tuple[Free, ...]
    experiments: tuple[Experiment, ...]
    outputs: tuple[str, ...]
    step: float | None = None
    ties: tuple[Tie, ...] = ()
    huber: float = np.inf
    stride: float | None = None
    events: System | None = None

    @property
    def exact(self) -> System:
        """The system with its events, which an estimation steps over."""
        return self.events or self.system

    @property
    def has_events(self) -> bool:
        """Whether steps of fixed length are an approximation of events, such as those of dry friction."""
        return bool(self.exact.frictions.places or self.exact.hybrid.relation_places)

    @property
    def has_memory(self) -> bool:
        """Whether a component changes as fast as fixed steps can follow, such as hysteresis at high speed."""
        return bool(shortest_times(self.exact))

    @cached_property
    def layout(self) -> Layout:
        """The structure that the transcription needs."""
        lengths = [experiment.time.size for experiment in self.experiments]
        length = min(SEGMENT, max(lengths))
        counts = [-(-n // length) for n in lengths]
        first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(int)
        free, slots = _by_run(self.free, self.experiments)
        return Layout(
            system=self.system,
            free=free,
            slots=slots,
            ties=self.ties,
            outputs=tuple(self.system.index_of(name) for name in self.outputs),
            output_names=self.outputs,
            substeps=self._substeps(),
            length=length,
            n_segments=int(sum(counts)),
            first=tuple(first.tolist()),
            run_lengths=tuple(lengths),
            huber=self.huber,
            floors=self._floors(),
        )

    def _floors(self) -> tuple[tuple[int, float], ...]:
        """Return the shortest times of what is smooth, each with the least that steps can follow, rounded up [s].

        What jumps has none: a lag of an input that is held lets nothing of a jump pass at once, if it is long enough,
        however long the steps. Without the rounding, distances of samples that differ in their last digits would make
        passes of their own.
        """
        held = {name for run in self.experiments for name, channel in run.inputs.items() if channel.hold == "zoh"}
        jumps = [k for k, name in enumerate(self.system.inputs) if name in held]
        times = sorted({*shortest_times(self.system)} - lags_of_inputs(self.system, jumps))
        if not times:
            return ()
        shortest = self._width / self._substeps() / LONGEST
        unit = 10.0 ** (np.floor(np.log10(shortest)) - 1)
        least = float(np.ceil(shortest / unit - 1e-9) * unit)
        return tuple((i, least) for i in times)

    @property
    def _width(self) -> float:
        """The usual distance of samples [s]."""
        return float(np.median(np.concatenate([np.diff(experiment.time) for experiment in self.experiments])))

    def _substeps(self) -> int:
        width = self._width
        least = 1 if self.step is None else max(1, int(np.ceil(width / self.step - 1e-9)))
        if self.step is not None and self.stride is None:
            return least
        p = parameter_vector(self.system, {item.name: item.guess for item in self.free})
        return max(least, substeps(self.system, self.starts[0], p, width, self.stride))

    @cached_property
    def functions(self) -> Passes:
        """The passes over the data."""
        return Passes(self.layout)

    @cached_property
    def starts(self) -> tuple[RunStart, ...]:
        """How each run starts."""
        p = parameter_vector(self.system, {item.name: item.guess for item in self.free})
        return tuple(run_start(self.system, experiment, p) for experiment in self.experiments)

    @property
    def variables(self) -> tuple[Free, ...]:
        """All that is estimated: parameters, then the free starts of all runs."""
        return self.layout.free + tuple(item for start in self.starts for _, item in start.free)

    @cached_property
    def begins(self) -> tuple[ca.Function, ...]:
        """The start state of each run as a function of (theta, free starts), scaled."""
        return tuple(begin_function(self.layout, start) for start in self.starts)

    @cached_property
    def start_places(self) -> tuple[np.ndarray, ...]:
        """Where the free starts of each run stand among the variables."""
        counts = np.cumsum([len(self.layout.free), *(len(start.free) for start in self.starts)])
        return tuple(np.arange(a, b) for a, b in itertools.pairwise(counts))

    @cached_property
    def programme(self) -> ca.Function:
        """The solver of the nonlinear programme."""
        return programme(self.layout, self.variables, self.begins, self.start_places, self.functions)

    @cached_property
    def exact_programme(self) -> ca.Function:
        """The solver with the exact Hessian."""
        layout, functions = self.layout, self.functions
        return programme(layout, self.variables, self.begins, self.start_places, functions, hessian="exact")

    @cached_property
    def prior_sd(self) -> np.ndarray:
        """Noise of each output as the raw data show it, or as the study states it; shape (n_y,)."""
        return np.array([_channel_sd(self.experiments, name) for name in self.outputs])

    @property
    def quanta(self) -> tuple[float, ...]:
        """Largest step in which each output is counted in any run, SI; 0 where none is seen."""
        runs = self.experiments
        return tuple(max(run.outputs[n].quantum for run in runs if n in run.outputs) for n in self.outputs)

    def with_measured(self, experiments: tuple[Experiment, ...]) -> "Problem":
        """Return the same problem with other measured values at the same samples; what was built is kept."""
        return self._kept(replace(self, experiments=experiments), ("layout", "functions", *_OF_STARTS))

    def with_runs(self, experiments: tuple[Experiment, ...]) -> "Problem":
        """Return the same problem on other runs of the same lengths, which start elsewhere; what was built is kept."""
        return self._kept(replace(self, experiments=experiments), ("layout", "functions"))

    def holding(self, name: str, value: float) -> "Problem":
        """Return the same problem with one of its parameters held at a value [SI]; what was built is kept."""
        held = self._kept(replace(self), ("functions", *_OF_STARTS))
        free = tuple(
            replace(item, lower=value, upper=value, guess=value) if item.name == name else item
            for item in self.layout.free
        )
        held.__dict__["layout"] = replace(self.layout, free=free)
        return held

    def guessing(self, guesses: Mapping[str, float]) -> "Problem":
        """Return the same problem with other guesses by name [SI], from the starts of its own."""
        free = tuple(replace(item, guess=guesses.get(item.name, item.guess)) for item in self.free)
        return self._kept(replace(self, free=free), _OF_STARTS)

    def by_sample(self) -> "Problem":
        """Return the same problem with a segment for each sample; the samples are those of its own segments."""
        alone, own = self._kept(replace(self), _OF_STARTS), self.layout
        first = tuple(segment * own.length for segment in own.first)
        alone.__dict__["layout"] = replace(own, length=1, n_segments=own.n_segments * own.length, first=first)
        return alone

    def _kept(self, other: "Problem", names: tuple[str, ...]) -> "Problem":
        """Hand on what was built of this problem, which holds for the other as well."""
        other.__dict__.update({name: getattr(self, name) for name in names})
        return other


def make_problem(
    model: Component | System,
    free: tuple[Free, ...],
    experiments: tuple[Experiment, ...],
    *,
    step: float | None = None,
    ties: tuple[Tie, ...] = (),
    huber: float | None = None,
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
    ties
        Parameters that follow from others; see `unknowns.tie`.
    huber
        Residuals beyond so many standard deviations count linearly; all count squared if None.

    Raises
    ------
    ModelError
        For unknown names, contradictory ties, or if there is nothing to fit.
    """
    whole = assemble(model)
    system = without_events(whole, "An estimation")
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
    _check_starts(system, experiments)
    experiments = tuple(piece for experiment in experiments for piece in cut(experiment, system))
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
    _check_ties(ties, free)
    limit = np.inf if huber is None else huber
    return Problem(system, free, experiments, outputs, step, ties, limit, events=whole)


def _check_starts(system: System, experiments: tuple[Experiment, ...]) -> None:
    for experiment in experiments:
        for name in experiment.start:
            try:
                system.index_of(name)
            except ModelError as error:
                raise ModelError(f"The start of run `{experiment.name}` names `{name}`: {error}") from None


def _check_ties(ties: tuple[Tie, ...], free: tuple[Free, ...]) -> None:
    names = {item.name for item in free}
    for tie in ties:
        if tie.name in names:
            raise ModelError(f"`{tie.name}` is tied to `{tie.text}` and free; it can be one of the two only.")
        for other in ties:
            if ca.depends_on(tie.value, other.symbol):
                raise ModelError(
                    f"The tie `{tie.text}` of `{tie.name}` names `{other.name}`, which is tied itself; "
                    f"put `{other.text}` in its place."
                )


def _by_run(free: tuple[Free, ...], experiments: tuple[Experiment, ...]) -> tuple[tuple[Free, ...], tuple[Slot, ...]]:
    """Give each run its own parameter where one is wanted, named `run:parameter`; pieces of a run share it."""
    everything, slots = list[Free](), list[Slot]()
    for item in free:
        if not item.is_per_run:
            slots.append(Slot(item.name, (len(everything),) * len(experiments)))
            everything.append(item)
            continue
        groups = list(dict.fromkeys(run_of(experiment) for experiment in experiments))
        slots.append(Slot(item.name, tuple(len(everything) + owner for owner in owners_of(experiments))))
        everything += [replace(item, name=f"{group}:{item.name}") for group in groups]
    return tuple(everything), tuple(slots)


def free_parameter(
    system: System,
    name: str,
    *,
    guess: float | None = None,
    lower: float | None = None,
    upper: float | None = None,
    scale: float | None = None,
    is_log: bool = False,
    prior: Prior | None = None,
    is_per_run: bool = False,
) -> Free:
    """Return a free parameter; what is not given comes from the model's declaration (SI units).

    Parameters
    ----------
    system
        The assembled system.
    name
        The parameter.
    guess, lower, upper
        Start and bounds; the bounds of the model hold as well.
    scale
        Typical size; the guess, or the nominal value of the model, if None.
    is_log
        Whether its logarithm is estimated.
    prior
        What is known of it before.
    is_per_run
        Whether each run has a value of its own.

    Raises
    ------
    ModelError
        If the model has no such independent parameter, or no positive start on a logarithmic scale.
    """
    parameter = system.parameters[system.parameter_index(name)]
    declared = parameter.declaration
    start = parameter.value if guess is None else guess
    if start is None:
        raise ModelError(f"The free parameter `{name}` needs a `guess`.")
    low = -np.inf if declared.min is None and lower is None else max(x for x in (declared.min, lower) if x is not None)
    high = np.inf if declared.max is None and upper is None else min(x for x in (declared.max, upper) if x is not None)
    size = scale or abs(start) or declared.nominal or 1.0
    if is_log and not start > 0:
        raise ModelError(f"`{name}` starts at {start:g} {declared.unit}; on a logarithmic scale it must be positive.")
    return Free(name, float(start), float(low), float(high), float(size), declared.unit, is_log, prior, is_per_run)


def _channel_sd(experiments: tuple[Experiment, ...], name: str) -> float:
    stated = [e.outputs[name].sd for e in experiments if name in e.outputs]
    known = [sd for sd in stated if sd is not None]
    if known:
        return float(np.sqrt(np.mean(np.square(known))))
    raw = [noise_sd(e.outputs[name].values) for e in experiments if name in e.outputs]
    spread = max(float(np.nanstd(e.outputs[name].values)) for e in experiments if name in e.outputs)
    # data without any noise (a simulation) still needs a finite weight
    return max(float(np.nanmean(raw)), 1e-6 * spread, 1e-12)


def dominant_frequency(experiments: tuple[Experiment, ...]) -> float:
    """Return the angular frequency of the strongest line in any measured output [rad/s].

    Raises
    ------
    ModelError
        If nothing is measured, or an output has another number of values than there are times.
    """
    found = []
    for experiment in experiments:
        for name, channel in experiment.outputs.items():
            known = np.isfinite(channel.values)
            if known.size != experiment.time.size:
                raise ModelError(
                    f"Run `{experiment.name}` has {known.size} values of `{name}` and {experiment.time.size} times; "
                    f"give one value for each time."
                )
            if not known.any():
                continue
            grid = np.linspace(experiment.time[0], experiment.time[-1], experiment.time.size)
            values = np.interp(grid, experiment.time[known], channel.values[known])
            values = values - np.polyval(np.polyfit(grid, values, 1), grid)
            power = np.abs(np.fft.rfft(values * np.hanning(values.size))) ** 2
            frequency = 2 * np.pi * np.fft.rfftfreq(values.size, grid[1] - grid[0])
            found.append(float(frequency[1:][np.argmax(power[1:])]))
    if not found:
        names = ", ".join(f"`{experiment.name}`" for experiment in experiments) or "none"
        raise ModelError(f"Nothing is measured in the training runs ({names}); give a run with an output.")
    return max(found)
