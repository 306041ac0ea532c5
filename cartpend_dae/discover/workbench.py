"""Problems for a model with effects in it, made once and kept."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.data import Experiment
from cartpend_dae.discover.records import Setup
from cartpend_dae.discover.store import Store
from cartpend_dae.effects import Insertion, insert_all
from cartpend_dae.effects.walk import component_at
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.gauss_newton import ITERATIONS
from cartpend_dae.identify import Fit, estimate
from cartpend_dae.language import Component, bindings_of
from cartpend_dae.library.laws import SHORTEST
from cartpend_dae.parallel import Workers
from cartpend_dae.problem import Problem, dominant_frequency, free_parameter, make_problem
from cartpend_dae.shooting import Linearisation, linearised
from cartpend_dae.stepping import LONGEST, shortest_times
from cartpend_dae.strides import usual_stride
from cartpend_dae.system import System
from cartpend_dae.unknowns import Free, tie

Report = Callable[[str, str, float], None]
# product of step and fastest eigenvalue where integration need not be exact; Runge-Kutta is stable up to 2.8
COARSE = 1.0
# the same where candidates are compared for the first time
ROUGH = 0.25
# where effects go that act on a signal
SIGNALS = ("input", "sensor")
# steps for each sample where laws of dry friction are told apart: with fewer the error of integration looks like law
# (a Stribeck curve on steps of 5 ms: chi^2 of 9,200 for 3,000 residuals, of 3,000 on steps eight times as fine)
FINEST = 16
# an observer of bandwidth w has forgotten 95 % after so many times 1/w: s^2 + 1.4 w s + w^2 decays as exp(-0.7 w t)
FORGETS = 4.3
# a largest product of step and eigenvalue, the steps of a problem as it is made (None), `FINEST` steps a sample, or
# those of `weighing_step`
Stride = float | Literal["fine", "weighed"] | None


def _silent(stage: str, label: str, error: float) -> None:
    return None


@dataclass(slots=True)
class Workbench:
    """Builds and solves the estimation problems of one study; `report` hears of each fit.

    `problems` are those made so far, by the effects in them, and `sizes` what parameters of effects were predicted to
    be when they were first tried, by which they are scaled; `scales` are those of each problem. Candidates are fitted
    in `jobs` processes, or by that executor. Finished stages are kept in a `store`. What is weighed against random
    forces is fitted and weighed on steps as `weighing` says: models can be compared that stand on the same ones. They
    are compared with at `least` so much injection [rad/s].
    """

    setup: Setup
    report: Report = _silent
    problems: dict[tuple[Stride, tuple[str, ...]], Problem] = field(default_factory=dict)
    sizes: dict[str, float] = field(default_factory=dict)
    jobs: Workers = 1
    store: Store = field(default_factory=Store)
    scales: dict[tuple[Stride, tuple[str, ...]], dict[str, float]] = field(default_factory=dict)
    weighing: Stride = None
    least: float = 0.0

    def quiet(self) -> "Workbench":
        """Return the same workbench without reports, as for another process."""
        return replace(self, report=_silent)

    def on(self, weighing: Stride) -> "Workbench":
        """Return the same workbench with other steps for what is weighed against random forces."""
        return replace(self, weighing=weighing)

    def predicting(self, least: float) -> "Workbench":
        """Return the same workbench for models that are compared by predictions, with at least so much injection.

        What was judged by free simulations is kept apart.
        """
        return replace(self, least=least, store=replace(self.store, study=f"{self.store.study} from {least!r} rad/s"))

    def __reduce__(self) -> tuple[type["Workbench"], tuple[Any, ...]]:
        """Leave reports, problems, executor and store here: elsewhere problems are made anew, on the same scales."""
        return Workbench, (self.setup, _silent, {}, self.sizes, 1, Store(), self.scales, self.weighing, self.least)

    def begin(self, stage: str, number: int) -> None:
        """Say that so many candidates follow in a stage, to a `report` that has a method `begin`."""
        announce = getattr(self.report, "begin", None)
        if announce is not None:
            announce(stage, number)

    def expect(self, sizes: Mapping[str, float]) -> None:
        """Remember how large parameters are about to be; the first word counts."""
        for name, value in sizes.items():
            self.sizes.setdefault(name, abs(value))

    def problem(self, insertions: tuple[Insertion, ...], stride: Stride = None) -> Problem:
        """Return the problem of the model with effects on the training runs; for `stride` see `build`."""
        key = stride, _key(insertions)
        if key not in self.problems:
            scales = self.scales_of(insertions, stride)
            self.problems[key] = self.build(insertions, self.setup.train, stride, scales=scales)
        return self.problems[key]

    def coarse(self, insertions: tuple[Insertion, ...]) -> Problem:
        """Return the problem of the model with effects in coarse steps, which no sizes scale that come to be known."""
        key = COARSE, _key(insertions)
        if key not in self.problems:
            self.problems[key] = self.build(insertions, self.setup.train, COARSE, scales={})
        return self.problems[key]

    def scales_of(self, insertions: tuple[Insertion, ...], stride: Stride = None) -> dict[str, float]:
        """Return the sizes by which the problem of effects is scaled, which do not change once it was asked for."""
        names = {name for insertion in insertions for name in insertion.starts}
        known = {name: size for name, size in self.sizes.items() if name in names}
        return self.scales.setdefault((stride, _key(insertions)), known)

    def build(
        self,
        insertions: tuple[Insertion, ...],
        experiments: tuple[Experiment, ...],
        stride: Stride = None,
        *,
        scales: Mapping[str, float] | None = None,
    ) -> Problem:
        """Make a problem on given runs; see `Stride`."""
        base = self.setup.base
        if base and not insertions and base.model is self.setup.model and base.names == measured_by(experiments):
            system = base.system
        else:
            system = assembled(self.setup.model, insertions, experiments)
        free = self._free(system, insertions, scales)
        problem = self._problem(system, free, renamed(experiments, insertions), self.setup.step)
        is_late = _is_late(system, insertions)
        knocks = any(insertion.card.knocks for insertion in insertions)
        if stride == "fine" or (stride == ROUGH and (is_late or knocks)):
            return replace(problem, step=fine_step(self.setup), stride=ROUGH)
        if stride == "weighed":
            return replace(problem, step=weighing_step(self.setup), stride=ROUGH)
        if stride is None:
            return replace(problem, step=fine_step(self.setup)) if is_late else problem
        return replace(problem, step=None, stride=stride)

    def with_weights(
        self, taken: tuple[Insertion, ...], closure: Insertion, weights: Callable[[System], tuple[Free, ...]]
    ) -> Problem:
        """Make a problem with a closure on the training runs, whose free weights are those of its system."""
        inside = (*taken, closure)
        system = assembled(self.setup.model, inside, self.setup.train)
        free = (*self._free(system, taken), *weights(system))
        return self._problem(system, free, renamed(self.setup.train, inside), self.setup.step)

    def problem_of(self, system: System, taken: tuple[Insertion, ...], inside: tuple[Insertion, ...]) -> Problem:
        """Make a problem of a system with effects `inside` on the training runs, of which those `taken` are free."""
        runs = renamed(self.setup.train, inside)
        free = self._free(system, taken)
        return self._problem(system, free, runs, self.setup.step)

    def _problem(
        self,
        system: System,
        free: tuple[Free, ...],
        runs: tuple[Experiment, ...],
        step: float | None,
    ) -> Problem:
        setup = self.setup
        ties = tuple(tie(system, name, text) for name, text in setup.ties)
        problem = make_problem(system, free, runs, step=step, ties=ties, huber=setup.huber)
        # what the shortest times ask for is left to fits on fine steps
        return replace(problem, stride=usual_stride(problem.system)) if problem.has_memory else problem

    def _free(
        self, system: System, insertions: tuple[Insertion, ...], scales: Mapping[str, float] | None = None
    ) -> tuple[Free, ...]:
        sizes = self.sizes if scales is None else scales
        free: list[Free] = []
        for spec in self.setup.free:
            free.append(
                free_parameter(
                    system,
                    spec.name,
                    guess=spec.guess,
                    lower=spec.lower,
                    upper=spec.upper,
                    is_log=spec.is_log,
                    prior=spec.prior,
                    is_per_run=spec.is_per_run,
                )
            )
        for insertion in insertions:
            for (name, start), item in zip(insertion.starts.items(), insertion.parameters, strict=True):
                known = sizes.get(name) or None
                lower, upper = (_finite(bound) for bound in item.bounds_at(insertion.place.kind))
                free.append(free_parameter(system, name, guess=start, lower=lower, upper=upper, scale=known))
        return tuple(free)

    def fit(
        self,
        insertions: tuple[Insertion, ...],
        guess: Mapping[str, float],
        bandwidths: tuple[float, ...],
        sd: np.ndarray,
        *,
        patient: bool = True,
        iterations: int | None = None,
        stride: Stride = None,
        held: tuple[str, ...] = (),
    ) -> Fit:
        """Fit along decreasing output injection, each stage from the last; `patient` as of `estimate`.

        Parameters that are `held` stay at their guesses. What decides, at the `last` bandwidth, is fitted on fine
        steps, where friction or a memory needs them.
        """
        scales = self.scales_of(insertions, stride)
        label = _label(insertions)
        point = dict(guess)
        most = self.setup.max_iterations or ITERATIONS if iterations is None else iterations
        fit: Fit | None = None
        for bandwidth in bandwidths:
            steps = self._usual_steps(insertions, bandwidth) if stride is None else stride
            options = (bandwidth, point, sd, patient, most, steps, held)
            depends = _key(insertions), scales, options
            fit = self.store.recall("fit", depends, lambda o=options: self._fit(insertions, *o))
            self.report(f"fit at {bandwidth:.3g} rad/s", label, float(np.sqrt(fit.chi2 / fit.n_residuals)))
            point = fit.point
        assert fit is not None
        return fit

    def deciding(self, insertions: tuple[Insertion, ...], bandwidth: float) -> Problem:
        """Return the problem on the steps on which it is fitted at a bandwidth, fine ones where that decides."""
        return self.problem(insertions, self._usual_steps(insertions, bandwidth))

    def _usual_steps(self, insertions: tuple[Insertion, ...], bandwidth: float) -> Stride:
        if bandwidth not in (0.0, self.last):
            return self.weighing
        problem = self.problem(insertions)
        return "fine" if self.setup.step is None and (problem.has_events or problem.has_memory) else None

    def _fit(
        self,
        insertions: tuple[Insertion, ...],
        bandwidth: float,
        guess: Mapping[str, float],
        sd: np.ndarray,
        patient: bool,
        most: int,
        stride: Stride,
        held: tuple[str, ...],
    ) -> Fit:
        problem = self.problem(insertions, stride)
        for name in held:
            problem = problem.holding(name, guess[name])
        try:
            return estimate(
                problem,
                bandwidth=bandwidth,
                guess=guess,
                sd=sd,
                patient=patient,
                iterations=most,
                method=self.setup.method,
                hessian=self.setup.hessian,
            )
        except ModelError as error:
            raise SolverError(f"The fit with `{_label(insertions)}` cannot be done: {error}") from error
        except (np.linalg.LinAlgError, ValueError) as error:  # sensitivities beyond all numbers
            label = _label(insertions)
            raise SolverError(f"The fit with `{label}` ended where the simulation diverges ({error}).") from error

    def linearised(
        self, insertions: tuple[Insertion, ...], point: Mapping[str, float], bandwidth: float, sd: np.ndarray
    ) -> Linearisation:
        """Return the normal equations of the model with effects, at a point of the model without them."""
        return linearised(self.build(insertions, self.setup.train), point, bandwidth, sd)

    def solved(self, insertions: tuple[Insertion, ...], fit: Fit, sd: np.ndarray) -> Linearisation:
        """Return the normal equations at a solution of a problem made before, on the steps that it was fitted on."""
        bandwidth = float(fit.bandwidth[0])
        return linearised(self.deciding(insertions, bandwidth), fit.point, bandwidth, sd)

    @property
    def last(self) -> float:
        """Bandwidth at which models are compared where noise is all that is left: 0 is the free simulation [rad/s]."""
        return max(self.least, last_bandwidth(self.setup.train))

    @property
    def frequency(self) -> float:
        """Dominant angular frequency of the measured motion [rad/s]."""
        return dominant_frequency(self.setup.train)


def last_bandwidth(experiments: tuple[Experiment, ...]) -> float:
    """Return 0 where free simulations are scored [rad/s]; an observer of predictions forgets within their horizon."""
    return max((FORGETS / run.horizon for run in experiments if run.horizon is not None), default=0.0)


def fine_step(setup: Setup) -> float:
    """Return the step with which laws of friction are told apart [s], unless the study has its own."""
    width = float(np.median(np.concatenate([np.diff(run.time) for run in setup.train])))
    return setup.step or width / FINEST


def weighing_step(setup: Setup) -> float:
    """Return the step on which models are weighed where forces as fast as the samples explain everything else [s].

    It is that of `fine_step`, but need not be shorter than can follow the shortest times of the library's memories.
    """
    return setup.step or max(fine_step(setup), LONGEST * SHORTEST)


def _is_late(system: System, insertions: tuple[Insertion, ...]) -> bool:
    """Return whether an effect delays a signal: steps that are longer than it would delay it by half of one."""
    prefixes = tuple(f"{i.prefix}." for i in insertions if i.card.insertion in SIGNALS)
    return any(system.parameters[k].name.startswith(prefixes) for k in shortest_times(system))


def _key(insertions: tuple[Insertion, ...]) -> tuple[str, ...]:
    return tuple(insertion.content for insertion in insertions)


def _label(insertions: tuple[Insertion, ...]) -> str:
    return " + ".join(insertion.prefix for insertion in insertions) or "baseline"


def _finite(bound: float) -> float | None:
    return bound if np.isfinite(bound) else None


def assembled(model: Component, insertions: tuple[Insertion, ...], experiments: tuple[Experiment, ...]) -> System:
    """Return the system with all insertions made, with what the runs measure or start from as states.

    An effect in series parts positions that were one; the start of a run stays that of the one it names.
    """
    return assemble(augmented(model, insertions), states=dict.fromkeys(measured_by(experiments), "prefer"))


def measured_by(experiments: Iterable[Experiment]) -> frozenset[str]:
    """Return what the runs measure or start from."""
    return frozenset(name for run in experiments for name in (*run.outputs, *run.start))


def augmented(model: Component, insertions: tuple[Insertion, ...]) -> Component:
    """Return the model with all insertions made, one after the other."""
    return insert_all(model, insertions) if insertions else model


def renamed(experiments: tuple[Experiment, ...], insertions: tuple[Insertion, ...]) -> tuple[Experiment, ...]:
    """Let variables be read behind the sensor effects that were put there, and inputs drive the effects before them."""
    read: dict[str, str] = {}
    driven: dict[str, str] = {}
    for insertion in insertions:
        read |= insertion.measured
        driven |= insertion.driven
    if not read and not driven:
        return experiments
    return tuple(
        replace(
            experiment,
            inputs={driven.get(name, name): channel for name, channel in experiment.inputs.items()},
            outputs={read.get(name, name): channel for name, channel in experiment.outputs.items()},
        )
        for experiment in experiments
    )


def set_values(model: Component, values: Mapping[str, float]) -> None:
    """Set parameters of a model by their dotted names, SI."""
    for name, value in values.items():
        path, _, parameter = name.rpartition(".")
        bindings_of(component_at(model, path))[parameter] = value
