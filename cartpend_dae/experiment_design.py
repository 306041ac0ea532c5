"""Which experiment next: candidate inputs and releases, ranked by what they would say of the weak parameters.

The information of a candidate is S' W S, with the sensitivities S of its simulation and the weights W of the sensors'
noise; free start states are taken out. It is added to what is known: the runs of the study, and prior knowledge.

References
----------
G. C. Goodwin, R. L. Payne, "Dynamic System Identification: Experiment Design and Data Analysis" (1977), chapter 6.
F. Pukelsheim, "Optimal Design of Experiments" (1993), chapter 6 (the criteria D and E).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.excitation import binary, chirp, multisine, steps
from cartpend_dae.identify import Fit
from cartpend_dae.problem import Problem, make_problem
from cartpend_dae.shooting import linearised, scaled_values
from cartpend_dae.system import System
from cartpend_dae.unknowns import Free, Tie

# parameters known worse than this [of their size] are weak
WEAK = 0.01
SHARES = (0.5, 1.0)
RELEASES = (0.25, 0.5, 0.75, 1.0)
# information relative to the largest that counts as none
NOTHING = 1e-12


@dataclass(frozen=True, slots=True)
class Plan:
    """What experiments may be: largest `limits` of inputs, or of the states that a run is released from [SI].

    `noise` is that of the sensors that will be read [SI]; `rate` [Hz] of samples; frequencies [Hz] of the inputs.
    """

    limits: Mapping[str, float]
    noise: Mapping[str, float]
    duration: float
    rate: float
    low: float
    high: float
    free_starts: tuple[str, ...] = ()
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Known:
    """What is known before: the parameters, their values [SI], and the information on them, over relative changes."""

    free: tuple[Free, ...]
    values: Mapping[str, float]
    information: np.ndarray


@dataclass(frozen=True, slots=True)
class Ranked:
    """A candidate: relative standard deviations that would be left of each weak parameter, and the two criteria.

    `d` is their geometric mean over the axes of the ellipsoid of confidence, `e` its longest axis; `message` says why
    a candidate has none.
    """

    name: str
    sd: dict[str, float]
    d: float
    e: float
    message: str = ""


@dataclass(frozen=True, slots=True)
class Ranking:
    """All candidates, the best by the D-criterion first; `before` is what holds without a new experiment."""

    weak: tuple[str, ...]
    before: Ranked
    candidates: tuple[Ranked, ...]

    @property
    def best_by_e(self) -> str:
        """The candidate with the shortest longest axis."""
        return min(self.candidates, key=lambda c: c.e).name


def known_from(problem: Problem, fit: Fit | None) -> Known:
    """Return what the runs of a problem say of its parameters, starts taken out; per run, the mean counts."""
    values = {item.name: item.guess for item in problem.free} | (fit.values_in() if fit else {})
    if fit is None:
        return nothing_known(problem.free, values)
    linear = linearised(problem, fit.point, float(fit.bandwidth[0]), fit.noise_sd)
    slope = np.array([item.slope(value) for item, value in zip(linear.variables, linear.values, strict=True)])
    gram = linear.grams.sum(axis=0) / np.outer(slope, slope)
    n = len(problem.layout.free)
    inside = gram[:n, :n] - _explained(gram, n)
    names = [item.name.rpartition(":")[2] for item in problem.layout.free]
    gather = np.array([[name == item.name for name in names] for item in problem.free], dtype=float)
    size = np.array([_size(item, values) for item in problem.free])
    base = nothing_known(problem.free, values)
    return replace(base, information=base.information + gather @ inside @ gather.T * np.outer(size, size))


def nothing_known(free: tuple[Free, ...], values: Mapping[str, float]) -> Known:
    """Return prior knowledge alone."""
    own = [(_size(item, values) / item.prior.sd) ** 2 if item.prior else 0.0 for item in free]
    return Known(free, values, np.diag(own))


def rank(
    system: System, known: Known, plan: Plan, *, ties: tuple[Tie, ...] = (), weak: Sequence[str] | None = None
) -> Ranking:
    """Rank the candidates of a plan by what they would say of the weak parameters.

    Parameters
    ----------
    system
        The system.
    known
        What is known before.
    plan
        What experiments may be.
    ties
        Parameters that follow from others.
    weak
        The parameters that matter; those known worse than 1 % if None, or all if there is none.

    Raises
    ------
    ModelError
        If the plan names what the model does not have, or `weak` what is not estimated.
    """
    runs = candidates(system, plan)
    names = [item.name for item in known.free]
    if unknown := [name for name in weak or () if name not in names]:
        listing = ", ".join(f"`{name}`" for name in names)
        raise ModelError(f"`{unknown[0]}` is not estimated, so no experiment is designed for it; these are: {listing}.")
    left = _relative_sd(known.information)
    chosen = [i for i, sd in enumerate(left) if (names[i] in weak if weak is not None else sd > WEAK)]
    chosen = chosen or list(range(len(names)))
    free = tuple(replace(item, guess=known.values[item.name], prior=None, is_per_run=False) for item in known.free)
    first = make_problem(system, free, (runs[0],), ties=ties)
    sd = np.array([plan.noise[name] for name in first.outputs])
    found = []
    for run in runs:
        try:
            gain = _information(first.with_runs((run,)), known, sd)
            found.append(_ranked(run.name, known, known.information + gain, chosen))
        except SolverError as error:
            found.append(Ranked(run.name, {}, np.inf, np.inf, str(error)))
    found.sort(key=lambda c: (c.d, c.e))
    before = _ranked("nothing new", known, known.information, chosen)
    return Ranking(tuple(names[i] for i in chosen), before, tuple(found))


def candidates(system: System, plan: Plan) -> tuple[Experiment, ...]:
    """Return the experiments of a plan, with zeros where measured values will be."""
    time = np.arange(round(plan.duration * plan.rate) + 1) / plan.rate
    rest = {name: Start(None, True) for name in plan.free_starts}
    outputs = {
        name: Channel(np.zeros(time.size), "zoh", sd, system.unit_of(name), 0.0) for name, sd in plan.noise.items()
    }
    runs = []
    for name, limit in plan.limits.items():
        if name not in system.inputs:
            if name not in system.state_relations:
                listing = ", ".join(f"`{other}`" for other in (*system.inputs, *system.states))
                raise ModelError(f"`design.max` names `{name}`; expected an input or a state of the model: {listing}.")
            for share in RELEASES:
                start = rest | {name: Start(share * limit, name in plan.free_starts)}
                label = f"release of {name} from {share * limit:.4g} {system.unit_of(name)}"
                runs.append(Experiment(label, "train", time, {}, outputs, start, "free", None))
            continue
        for kind, values in _shapes(time, plan).items():
            for share in SHARES:
                drive = {name: Channel(share * limit * values, "zoh", None, system.unit_of(name), 0.0)}
                label = f"{kind} of {name}, {share * limit:.4g} {system.unit_of(name)}"
                runs.append(Experiment(label, "train", time, drive, outputs, dict(rest), "free", None))
    others = [name for name in system.inputs if system.variables[system.index_of(name)].declaration.default is None]
    return tuple(_with_rest(run, others, system) for run in runs)


def _with_rest(run: Experiment, names: list[str], system: System) -> Experiment:
    """Hold the inputs that a candidate does not drive at 0."""
    still = np.zeros(run.time.size)
    idle = {name: Channel(still, "zoh", None, system.unit_of(name), 0.0) for name in names if name not in run.inputs}
    return replace(run, inputs={**run.inputs, **idle})


def _shapes(time: np.ndarray, plan: Plan) -> dict[str, np.ndarray]:
    return {
        "multisine": multisine(time, plan.low, plan.high, np.random.default_rng([plan.seed, 0])),
        "chirp": chirp(time, plan.low, plan.high),
        "random binary signal": binary(time, plan.high, np.random.default_rng([plan.seed, 1])),
        "steps": steps(time),
    }


def _information(problem: Problem, known: Known, sd: np.ndarray) -> np.ndarray:
    """Return the information of a run over relative changes of the parameters, its free starts taken out."""
    point = dict(known.values)
    linear = linearised(problem, point, 0.0, sd)
    gram = linear.grams.sum(axis=0)
    if not np.all(np.isfinite(gram)):
        raise SolverError("it cannot be simulated: the model diverges.")
    n = len(known.free)
    values = scaled_values(problem, point)
    change = np.array(
        [_size(item, point) / item.slope(value) for item, value in zip(known.free, values[:n], strict=True)]
    )
    return (gram[:n, :n] - _explained(gram, n)) * np.outer(change, change)


def _explained(gram: np.ndarray, n: int) -> np.ndarray:
    """Return the part of the first n variables' information that the others could explain as well."""
    return gram[:n, n:] @ np.linalg.pinv(gram[n:, n:], hermitian=True) @ gram[n:, :n]


def _size(item: Free, values: Mapping[str, float]) -> float:
    return abs(values[item.name]) or item.scale


def _covariance(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance on what is known at all, and the directions of which nothing is known."""
    values, vectors = np.linalg.eigh(information)
    good = values > NOTHING * max(values.max(initial=0.0), 1e-300)
    return (vectors[:, good] / values[good]) @ vectors[:, good].T, vectors[:, ~good]


def _relative_sd(information: np.ndarray) -> np.ndarray:
    covariance, open_ = _covariance(information)
    sd = np.sqrt(np.diag(covariance))
    return np.where(np.abs(open_).max(axis=1, initial=0.0) > 1e-6, np.inf, sd)


def _ranked(name: str, known: Known, information: np.ndarray, chosen: list[int]) -> Ranked:
    covariance, open_ = _covariance(information)
    left = _relative_sd(information)
    sd = {known.free[i].name: float(left[i]) for i in chosen}
    if np.abs(open_[chosen]).max(initial=0.0) > 1e-6:
        return Ranked(name, sd, np.inf, np.inf, "it leaves a direction of the weak parameters open")
    axes = np.linalg.eigvalsh(covariance[np.ix_(chosen, chosen)])
    return Ranked(name, sd, float(np.exp(np.mean(np.log(axes)) / 2)), float(np.sqrt(axes[-1])))
