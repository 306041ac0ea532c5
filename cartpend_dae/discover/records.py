"""The data that the stages of discovery hand on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from cartpend_dae.data import Experiment
from cartpend_dae.effects import Insertion
from cartpend_dae.identify import Fit, Method
from cartpend_dae.language import Component
from cartpend_dae.programme import Hessian
from cartpend_dae.study_schema import ScoreSpec
from cartpend_dae.system import System
from cartpend_dae.unknowns import Prior

Regime = Literal["noise", "disturbances", "forces"]
Verdict = Literal["explained", "improved", "no-discrepancy", "unexplained"]


@dataclass(frozen=True, slots=True)
class FreeSpec:
    """A free parameter as the user states it; None leaves a number to the model's declaration. SI units."""

    name: str
    guess: float | None = None
    lower: float | None = None
    upper: float | None = None
    is_log: bool = False
    prior: Prior | None = None
    is_per_run: bool = False


@dataclass(frozen=True, slots=True)
class Base:
    """A model that was assembled already, with `names` as states where that is possible."""

    model: Component
    names: frozenset[str]
    system: System


@dataclass(frozen=True, slots=True)
class Setup:
    """What an estimation works on: the model, what is free in it, and the runs by role.

    `ties` are parameters that follow from others, with the text that says how. Residuals beyond `huber` standard
    deviations count linearly; a fit takes at most `max_iterations` steps; `method` and `hessian` as of `estimate`.
    `base` saves to assemble the model again.
    """

    model: Component
    free: tuple[FreeSpec, ...]
    train: tuple[Experiment, ...]
    select: tuple[Experiment, ...]
    test: tuple[Experiment, ...]
    scores: tuple[ScoreSpec, ...] = ()
    step: float | None = None
    ties: tuple[tuple[str, str], ...] = ()
    huber: float | None = None
    max_iterations: int | None = None
    method: Method = "shooting"
    hessian: Hessian = "gauss-newton"
    base: Base | None = None


@dataclass(frozen=True, slots=True)
class Gate:
    """Whether residuals are more than noise: von Neumann's z of each run and output, and the largest."""

    z: tuple[tuple[str, str, float], ...]
    largest: float
    is_passed: bool


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect at a place, and what the data say of it.

    `gain` is the drop of the criterion (BIC in the regime of noise; -2 ln likelihood against random forces with
    disturbances); `t` is estimate over sd, there that of the block jackknife; `why_not` is empty for the one
    accepted. `response` is the direction in which it was predicted to move the residuals, `early` the chi^2 of the
    first, rough fit, where there was one, and `begun` its point. `others` are the same effect from other starts that
    promise about as much.
    """

    insertion: Insertion
    parameters: dict[str, float]
    predicted: float
    gain: float
    t: float
    fit: Fit | None
    why_not: str
    response: np.ndarray | None = field(default=None, compare=False, repr=False)
    early: float | None = None
    begun: Mapping[str, float] = field(default_factory=dict[str, float], compare=False, repr=False)
    others: "tuple[Candidate, ...]" = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Prediction:
    """What a screen says of the option with a number, from `values` of its shapes, as it is kept; see `Candidate`."""

    number: int
    values: dict[str, float]
    parameters: dict[str, float]
    predicted: float
    why_not: str
    response: np.ndarray | None


@dataclass(frozen=True, slots=True)
class Step:
    """One accepted addition, what the data cannot tell from it, and `richer` laws that hold it and explain no more."""

    candidate: Candidate
    gate: Gate
    aliases: tuple[str, ...]
    richer: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Search:
    """The outcome on the training runs; `judged` says in which regime the candidates were, and so what they gained."""

    regime: Regime
    judged: Regime
    bandwidth: float
    baseline: Fit
    baseline_gate: Gate
    final: Fit
    final_gate: Gate
    steps: tuple[Step, ...]
    candidates: tuple[Candidate, ...]
    verdict: Verdict
    interrupted: bool
