"""Which experiment would tell two answers apart that the runs of a study cannot.

For each pair, candidate inputs and releases are ranked by how far the outputs of both models would lie apart, after the
rival has been allowed to move its parameters as far as the runs so far let it.

References
----------
A. C. Atkinson, V. V. Fedorov, "The design of experiments for discriminating between two rival models", Biometrika 62
(1975), 57-70, doi:10.1093/biomet/62.1.57.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.data import Experiment
from cartpend_dae.discover.attempts import content, kept
from cartpend_dae.discover.choice import named
from cartpend_dae.discover.records import Candidate, Search, Step
from cartpend_dae.discover.workbench import ROUGH, Workbench, assembled, renamed
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import UNSOLVED, SolverError
from cartpend_dae.experiment_design import Plan, candidates
from cartpend_dae.identify import Fit
from cartpend_dae.parallel import is_shared
from cartpend_dae.problem import Problem, dominant_frequency
from cartpend_dae.shooting import linearised, predict, run_through, scaled_values, sensitivities
from cartpend_dae.transcribe import stack_data

# twice the log likelihood ratio at which one of two models is as good as refuted
CLEAR = 20.0
# largest inputs and releases over those of the runs
FARTHER = 2.0
DURATION, MOST_SAMPLES = 10.0, 2000
# so many rivals of an effect, the closest ones, are compared with it: experiments are simulated for each
MOST_RIVALS = 3
# after so many steps of a rough fit of a rival, so many times the chi^2 of the answer: the runs tell them apart
EARLY, APART = 5, 4.0
# where they do not, so many more steps: experiments that are far apart do not ask for the rival's last digits
NEARLY = 4
# evidence that differs from zero by rounding alone: both are one law in other words
SAME = 0.01


@dataclass(frozen=True, slots=True)
class Split:
    """What would tell an answer from a rival: experiments by the distance of both, in twice the log likelihood.

    Where the runs do so already, `times` says how many times the chi^2 of the answer the rival leaves in its place.
    """

    chosen: str
    rival: str
    ranking: tuple[tuple[str, float], ...]
    times: float | None = None

    @property
    def sentence(self) -> str:
        """What to do next, in words."""
        if self.times is not None:
            return (
                f"`{self.rival}` was expected to act like `{self.chosen}`; in its place it leaves "
                f"{float(f'{self.times:.2g}'):,g} times the chi^2, so that these runs tell them apart."
            )
        if not self.ranking:
            return f"No experiment could be simulated that tells `{self.chosen}` from `{self.rival}`."
        name, distance = self.ranking[0]
        if distance < SAME:
            return f"`{self.rival}` is `{self.chosen}` in other words: none of {len(self.ranking)} experiments differs."
        if distance < CLEAR:
            return (
                f"None of {len(self.ranking)} experiments tells `{self.chosen}` from `{self.rival}` "
                f"(evidence of {distance:.1f} at most, where {CLEAR:g} would tell): another sensor is needed."
            )
        evidence = f"{float(f'{distance:.3g}'):,.0f}"
        return f"To tell `{self.chosen}` from `{self.rival}`, record: {name} (evidence about {evidence})."


def splits(bench: Workbench, search: Search, *, plan: Plan | None = None) -> tuple[Split, ...]:
    """Rank experiments for each accepted effect and each rival that the runs cannot tell from it.

    Parameters
    ----------
    bench
        The workbench of the search.
    search
        Its outcome.
    plan
        What experiments may be; from the runs, up to twice as large, if None.
    """
    taken = tuple(step.candidate.insertion for step in search.steps)
    pairs = [(step.candidate.insertion, rival) for step in search.steps for rival in _rivals(search, step)]
    if not pairs:
        return ()
    plan = plan or _plan(bench)
    bench.begin("experiments", len(pairs))
    at = bench.quiet() if is_shared(bench.jobs) else bench

    def split(pair: tuple[Insertion, Candidate]) -> Split | None:
        chosen, rival = pair
        together = (*(i for i in taken if i.prefix != chosen.prefix), rival.insertion)
        try:
            answer, fit = _fits_of(at, search, taken, together, rival)
            if fit.chi2 > APART * answer.chi2:
                return Split(chosen.prefix, rival.insertion.prefix, (), fit.chi2 / answer.chi2)
            ranking = _ranked(at, (taken, answer), (together, fit), plan)
        except UNSOLVED:
            return None
        return Split(chosen.prefix, rival.insertion.prefix, ranking)

    depends = [(chosen.prefix, content(rival), search.final.point, search.bandwidth, plan) for chosen, rival in pairs]
    return tuple(found for found in kept(bench, "split", depends, split, pairs) if found is not None)


def still_alike(search: Search, found: tuple[Split, ...]) -> Search:
    """Return a search whose steps no longer name the rivals that the runs were seen to tell from them."""
    told = {(split.chosen, split.rival) for split in found if split.times is not None}
    names = {c.insertion.prefix: named(c) for c in search.candidates}
    steps = [
        replace(
            step,
            aliases=tuple(
                name
                for name in step.aliases
                if name not in {names.get(rival) for chosen, rival in told if chosen == step.candidate.insertion.prefix}
            ),
        )
        for step in search.steps
    ]
    return replace(search, steps=tuple(steps))


def _fits_of(
    bench: Workbench,
    search: Search,
    taken: tuple[Insertion, ...],
    together: tuple[Insertion, ...],
    rival: Candidate,
) -> tuple[Fit, Fit]:
    """Return the fits of the answer and of a rival in its place, both on the same kind of steps.

    One that was not judged to the end is fitted roughly, in few steps where the runs tell it from the answer already.
    """
    if (known := _fit_known(search, together, rival)) is not None:
        return search.final, known

    def fitted(effects: tuple[Insertion, ...], point: Mapping[str, float], iterations: int) -> Fit:
        at, sd = (search.bandwidth,), search.final.weights_sd
        return bench.fit(effects, point, at, sd, patient=False, iterations=iterations, stride=ROUGH)

    answer = fitted(taken, search.final.point, EARLY)
    first = fitted(together, search.final.point | rival.parameters, EARLY)
    return answer, first if first.chi2 > APART * answer.chi2 else fitted(together, first.point, NEARLY)


def _fit_known(search: Search, together: tuple[Insertion, ...], rival: Candidate) -> Fit | None:
    """Return the fit with which a rival was judged, if that was of the same model as in the place of the answer."""
    fit = rival.fit
    if fit is None or float(fit.bandwidth[0]) != search.bandwidth or fit.n_residuals != search.final.n_residuals:
        return None
    own = {name for insertion in together for name in insertion.parameter_names}
    known = {e.name for e in search.baseline.parameters} | own
    is_same = {e.name for e in fit.parameters} == known and np.array_equal(fit.weights_sd, search.final.weights_sd)
    return fit if is_same else None


def _rivals(search: Search, step: Step) -> list[Candidate]:
    """Return the closest candidates that an accepted effect cannot be told from, apart from places that move alike."""
    names = set(step.aliases)
    found = [
        c
        for c in search.candidates
        if named(c) in names and c.insertion.prefix != step.candidate.insertion.prefix and c.parameters
    ]
    return sorted(found, key=lambda c: (-c.gain, -c.predicted))[:MOST_RIVALS]


def _plan(bench: Workbench) -> Plan:
    """Return what experiments may be: as the runs, twice as large."""
    runs = bench.setup.train
    rate = 1 / float(np.median(np.concatenate([np.diff(run.time) for run in runs])))
    duration = min(DURATION, max(float(np.ptp(run.time)) for run in runs), MOST_SAMPLES / rate)
    high = min(5 * dominant_frequency(runs) / (2 * np.pi), rate / 10)
    limits: dict[str, float] = {}
    for run in runs:
        for name, channel in run.inputs.items():
            limits[name] = max(limits.get(name, 0.0), FARTHER * float(np.abs(channel.values).max()))
        for name, start in run.start.items():
            value = abs(start.value or 0.0)
            if name in run.outputs and value > 0:
                limits[name] = max(limits.get(name, 0.0), FARTHER * value)
    if not limits:
        name = next(iter(runs[0].outputs))
        limits[name] = FARTHER * max(float(np.nanmax(np.abs(run.outputs[name].values))) for run in runs)
    problem = bench.problem(())
    noise = dict(zip(problem.outputs, problem.prior_sd.tolist(), strict=True))
    return Plan(limits, noise, duration, rate, min(2 / duration, high / 2), high)


def _ranked(
    bench: Workbench,
    one: tuple[tuple[Insertion, ...], Fit],
    other: tuple[tuple[Insertion, ...], Fit],
    plan: Plan,
) -> tuple[tuple[str, float], ...]:
    """Return the experiments of a plan by the distance of two models."""
    base = assembled(bench.setup.model, (), bench.setup.train)
    runs = candidates(base, plan)
    sd = np.array([plan.noise[name] for name in bench.problem(()).outputs])
    problems = _on_the_same_steps([bench.build(effects, (runs[0],), ROUGH) for effects, _ in (one, other)])
    values = [fit.values_in() for _, fit in (one, other)]
    known = _information(bench, *other, problems[1])
    found = []
    for run in runs:
        made = [
            problem.with_runs(renamed((run,), effects))
            for problem, (effects, _) in zip(problems, (one, other), strict=True)
        ]
        try:
            distance = _distance(made[0], values[0], made[1], values[1], known, sd)
        except SolverError:
            continue
        if np.isfinite(distance):
            found.append((run.name, distance))
    return tuple(sorted(found, key=lambda item: -item[1]))


def _on_the_same_steps(problems: list[Problem]) -> list[Problem]:
    """Return problems on the shortest of their steps, so that errors of integration are no difference of models."""
    times = problems[0].experiments[0].time
    step = float(np.median(np.diff(times))) / max(problem.layout.substeps for problem in problems)
    return [replace(problem, step=step, stride=None) for problem in problems]


def _information(bench: Workbench, effects: tuple[Insertion, ...], fit: Fit, problem: Problem) -> np.ndarray:
    """Return what the runs so far say of the scaled parameters of a problem on other runs, starts taken out."""
    linear = linearised(bench.problem(effects, ROUGH), fit.point, float(fit.bandwidth[0]), fit.noise_sd)
    gram, n = linear.grams.sum(axis=0), len(fit.parameters)
    inside = gram[:n, :n] - gram[:n, n:] @ np.linalg.pinv(gram[n:, n:], hermitian=True) @ gram[n:, :n]
    names = [item.name for item in linear.variables[:n]]
    scales = np.array([item.slope(value) for item, value in zip(linear.variables[:n], linear.values, strict=False)])
    rows = [names.index(item.name) if item.name in names else -1 for item in problem.layout.free]
    point = scaled_values(problem, fit.values_in())
    own = np.array([item.slope(value) for item, value in zip(problem.layout.free, point, strict=False)])
    found = np.zeros((len(rows), len(rows)))
    for i, a in enumerate(rows):
        for j, b in enumerate(rows):
            if a >= 0 and b >= 0:
                found[i, j] = inside[a, b] / (scales[a] * scales[b]) * own[i] * own[j]
    return found


def _distance(
    one: Problem,
    at_one: Mapping[str, float],
    other: Problem,
    at_other: Mapping[str, float],
    known: np.ndarray,
    sd: np.ndarray,
) -> float:
    """Return the squared distance of two models on a run, in noise sds, the other's parameters moved to the first."""
    truth = predict(one, at_one, 0.0)
    if not np.all(np.isfinite(truth)):
        raise SolverError("It diverges.")
    values, w = scaled_values(other, at_other), np.zeros(len(other.outputs))
    data = stack_data(other.layout, _measured(other.experiments, other.outputs, truth), 1.0 / sd)
    layout = other.layout
    nodes = run_through(other, values, w, data)[1][:, :: layout.length]
    found = sensitivities(other, values, nodes, w, data)
    residual, slopes = found.residuals.ravel(), found.slopes.reshape(-1, values.size)
    pull, n = slopes.T @ residual, len(layout.free)
    gram = slopes.T @ slopes
    gram[:n, :n] += known
    moved = np.linalg.lstsq(gram, pull, rcond=1e-12)[0]
    return float(residual @ residual - pull @ moved)


def _measured(runs: tuple[Experiment, ...], names: tuple[str, ...], values: np.ndarray) -> tuple[Experiment, ...]:
    (run,) = runs
    outputs = {name: replace(run.outputs[name], values=values[:, column]) for column, name in enumerate(names)}
    return (replace(run, outputs=outputs),)
