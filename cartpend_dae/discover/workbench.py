"""Problems for a model with effects in it, made once and kept."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.data import Experiment
from cartpend_dae.discover.records import Setup
from cartpend_dae.effects import Insertion, insert
from cartpend_dae.identify import Fit, estimate
from cartpend_dae.language import Component
from cartpend_dae.problem import Problem, dominant_frequency, free_parameter, make_problem
from cartpend_dae.shooting import Linearisation, linearised
from cartpend_dae.unknowns import Free, tie

Report = Callable[[str, str, float], None]


@dataclass(slots=True)
class Workbench:
    """Builds and solves the estimation problems of one study; `report` hears of each fit.

    `problems` are those made so far, by the effects in them.
    """

    setup: Setup
    report: Report
    problems: dict[tuple[str, ...], Problem] = field(default_factory=dict)

    def problem(self, insertions: tuple[Insertion, ...], hints: Mapping[str, float] | None = None) -> Problem:
        """Return the problem of the model with effects; `hints` are sizes of the effects' parameters."""
        key = tuple(insertion.prefix for insertion in insertions)
        if key not in self.problems:
            self.problems[key] = self.build(insertions, self.setup.train, hints or {})
        return self.problems[key]

    def build(
        self,
        insertions: tuple[Insertion, ...],
        experiments: tuple[Experiment, ...],
        hints: Mapping[str, float],
    ) -> Problem:
        """Make a problem on given runs."""
        model = augmented(self.setup.model, insertions)
        system = assemble(model)
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
            for name, item in zip(insertion.parameter_names, insertion.card.parameters, strict=True):
                hint = abs(hints.get(name, 0.0)) or None
                free.append(
                    free_parameter(
                        system,
                        name,
                        guess=0.0,
                        lower=_finite(item.lower),
                        upper=_finite(item.upper),
                        scale=hint,
                    )
                )
        setup = self.setup
        ties = tuple(tie(system, name, text) for name, text in setup.ties)
        runs = renamed(experiments, insertions)
        return make_problem(system, tuple(free), runs, step=setup.step, ties=ties, huber=setup.huber)

    def fit(
        self,
        insertions: tuple[Insertion, ...],
        guess: Mapping[str, float],
        bandwidths: tuple[float, ...],
        sd: np.ndarray,
        hints: Mapping[str, float] | None = None,
        *,
        patient: bool = True,
    ) -> Fit:
        """Fit along decreasing output injection, each stage from the last; `patient` as of `estimate`."""
        problem = self.problem(insertions, hints)
        label = " + ".join(insertion.prefix for insertion in insertions) or "baseline"
        point = dict(guess)
        fit: Fit | None = None
        for bandwidth in bandwidths:
            fit = estimate(problem, bandwidth=bandwidth, guess=point, sd=sd, patient=patient)
            self.report(f"fit at {bandwidth:.3g} rad/s", label, float(np.sqrt(fit.chi2 / fit.n_residuals)))
            point = fit.point
        assert fit is not None
        return fit

    def linearised(
        self, insertions: tuple[Insertion, ...], point: Mapping[str, float], bandwidth: float, sd: np.ndarray
    ) -> Linearisation:
        """Return the normal equations of the model with effects, at a point of the model without them."""
        return linearised(self.build(insertions, self.setup.train, {}), point, bandwidth, sd)

    def solved(self, insertions: tuple[Insertion, ...], fit: Fit, sd: np.ndarray) -> Linearisation:
        """Return the normal equations at a solution of a problem made before."""
        return linearised(self.problem(insertions), fit.point, float(fit.bandwidth[0]), sd)

    @property
    def frequency(self) -> float:
        """Dominant angular frequency of the measured motion [rad/s]."""
        return dominant_frequency(self.setup.train)


def _finite(bound: float) -> float | None:
    return bound if np.isfinite(bound) else None


def augmented(model: Component, insertions: tuple[Insertion, ...]) -> Component:
    """Return the model with all insertions made, one after the other."""
    for insertion in insertions:
        model = insert(model, insertion)
    return model


def renamed(experiments: tuple[Experiment, ...], insertions: tuple[Insertion, ...]) -> tuple[Experiment, ...]:
    """Let measured variables be read behind the sensor effects that were put there."""
    names: dict[str, str] = {}
    for insertion in insertions:
        names |= insertion.measured
    if not names:
        return experiments
    return tuple(
        replace(
            experiment,
            outputs={names.get(name, name): channel for name, channel in experiment.outputs.items()},
        )
        for experiment in experiments
    )
