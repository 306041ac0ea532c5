"""How far a search can be trusted on this very rig and with these runs.

Data are made from the final model with the inputs and the disturbances of the study. Placebo: nothing is missing; is
something added? Power: each accepted effect is taken out of the model; is it found again?
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy import signal

from cartpend_dae.data import Experiment
from cartpend_dae.discover.attempts import kept
from cartpend_dae.discover.records import FreeSpec, Search, Setup
from cartpend_dae.discover.workbench import Workbench, set_values
from cartpend_dae.effects import Insertion, insert_all
from cartpend_dae.errors import CartpendError
from cartpend_dae.identify import Fit
from cartpend_dae.problem import Problem
from cartpend_dae.shooting import scaled_values, start_states
from cartpend_dae.transcribe import sample_step, stack_data

Searcher = Callable[[Setup], Search]
# samples after which coloured noise has come to its steady state
SETTLING = 1000


@dataclass(frozen=True, slots=True)
class Rate:
    """Searches on data made from the final model: of `n`, so many `hits`, and what each named.

    Without `removed` nothing was missing, and a hit is an addition; else a hit is that the effect taken out, or one
    that the study's runs cannot tell from it, was named. Searches that failed are not counted.
    """

    removed: str | None
    n: int
    hits: int
    named: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The rate in words."""
        if self.removed is None:
            return f"Where nothing is missing, something was added in {self.hits} of {self.n} data sets made so."
        return f"Where `{self.removed}` is missing, it was found again in {self.hits} of {self.n} data sets made so."


def rates(
    bench: Workbench, search: Search, searcher: Searcher, *, placebo: int, power: int, seed: int = 0
) -> tuple[Rate, ...]:
    """Repeat the search on data made from its outcome.

    Parameters
    ----------
    bench
        The workbench of the search; repetitions run in as many processes as it has.
    search
        The outcome.
    searcher
        Searches in a setup, as it was done for the outcome, up to one addition.
    placebo, power
        Number of data sets with nothing missing, and for each accepted effect without it.
    seed
        Which noise.
    """
    *_, last = ((), *rates_so_far(bench, search, searcher, placebo=placebo, power=power, seed=seed))
    return last


def rates_so_far(
    bench: Workbench, search: Search, searcher: Searcher, *, placebo: int, power: int, seed: int
) -> Iterator[tuple[Rate, ...]]:
    """Yield the rates after each repetition, of those that are done; see `rates`."""
    taken = tuple(step.candidate.insertion for step in search.steps)
    tasks: list[tuple[int | None, int]] = [(None, k) for k in range(placebo)]
    tasks += [(i, k) for i in range(len(taken)) for k in range(power)]
    if not tasks:
        return
    problem, setup, store = bench.problem(taken), bench.setup, bench.store
    made = {k: made_anew(problem, search.final, [seed, k]) for k in sorted({k for _, k in tasks})}

    def left(without: int | None) -> tuple[Insertion, ...]:
        return tuple(item for i, item in enumerate(taken) if i != without)

    def again(task: tuple[int | None, int]) -> list[str] | None:
        without, k = task
        try:
            less = _setup(setup, taken, left(without), search.final, made[k])
            found = [f"{_name(step.candidate.insertion)}" for step in searcher(less).steps]
        except CartpendError:
            found = None
        return store.recall("again", depends[task], lambda: found)

    depends = {
        (without, k): ("again", [item.prefix for item in left(without)], search.final.values, seed, k)
        for without, k in tasks
    }
    results: list[list[str] | None] = []
    bench.begin("placebo and power", len(tasks))
    for done, result in enumerate(kept(bench, "again", [depends[task] for task in tasks], again, tasks), start=1):
        results.append(result)
        yield _counted(search, tasks[:done], results)
        bench.report("placebo and power", f"{done} of {len(tasks)}", 1.0)


def _counted(search: Search, tasks: list[tuple[int | None, int]], results: list[list[str] | None]) -> tuple[Rate, ...]:
    """Return the rates of the repetitions that are done, in their order."""
    taken = tuple(step.candidate.insertion for step in search.steps)
    found = []
    for without in dict.fromkeys(i for i, _ in tasks):
        mine = [r for (i, _), r in zip(tasks, results, strict=True) if i == without and r is not None]
        accepted = _accepted(search, without)
        hits = sum(bool(r) if without is None else bool(set(r) & accepted) for r in mine)
        removed = None if without is None else taken[without].prefix
        found.append(Rate(removed, len(mine), hits, tuple(", ".join(r) or "nothing" for r in mine)))
    return tuple(found)


def _name(insertion: Insertion) -> str:
    return f"{insertion.card.id} at {insertion.place.at}"


def _accepted(search: Search, number: int | None) -> set[str]:
    """Return the names under which an accepted effect counts as found again."""
    if number is None:
        return set()
    step = search.steps[number]
    return {_name(step.candidate.insertion), *step.aliases, *step.richer}


def made_anew(problem: Problem, fit: Fit, seed: list[int]) -> tuple[Experiment, ...]:
    """Return runs that the model of a fit makes, with innovations as those of the fit.

    With output injection the innovations also move the states: that is the disturbance which the filter of the fit
    was made for (innovations form). Without it they are noise of the sensors alone.

    References
    ----------
    L. Ljung, "System Identification: Theory for the User", 2nd ed. (1999), section 4.3 (innovations form).
    """
    generator = np.random.default_rng(seed)
    layout, values = problem.layout, scaled_values(problem, fit.point)
    data = stack_data(layout, problem.experiments, 1.0 / fit.weights_sd)
    n_y, runs = len(layout.outputs), []
    step = _step(problem)
    starts = start_states(problem, values)
    for k, (run, first, n) in enumerate(zip(problem.experiments, layout.first, layout.run_lengths, strict=True)):
        part = data[:-n_y, first * layout.length : first * layout.length + n]
        theta = values[layout.owners[k]]
        innovations = _innovations(fit, n, generator).T
        _, outputs = step.mapaccum(n)(starts[k], theta, fit.bandwidth, part[:-n_y], innovations)
        series = dict(zip(layout.output_names, np.asarray(outputs), strict=True))
        runs.append(_with_outputs(run, series))
    return tuple(runs)


def _step(problem: Problem) -> ca.Function:
    """Return (x, theta, w, data, innovation) -> (x at the next sample, measured)."""
    layout = problem.layout
    n_x, n_y, n_u = layout.n_state, len(layout.outputs), layout.system.u.numel()
    x, theta, gain = ca.SX.sym("x", n_x), ca.SX.sym("theta", len(layout.slots)), ca.SX.sym("w", n_y)
    known, innovation = ca.SX.sym("data", 2 + 2 * n_u), ca.SX.sym("e", n_y)
    p = problem.functions.parameters(theta)
    shown = problem.functions.step.measure(known[0], known[1], x, known[2 : 2 + n_u], p)[list(layout.outputs)]
    column = ca.vertcat(known, shown + innovation, ca.SX.ones(n_y))
    after, _ = sample_step(layout, theta, gain, x, column)
    return ca.Function("made", [x, theta, gain, known, innovation], [after, shown + innovation], {"cse": True})


def _innovations(fit: Fit, n: int, generator: np.random.Generator) -> np.ndarray:
    """Return innovations as coloured as those of the fit, shape (n, n_y), SI."""
    white = generator.multivariate_normal(np.zeros(len(fit.outputs)), fit.noise.covariance, SETTLING + n)
    columns = [np.asarray(signal.lfilter([1.0], a, white[:, i])) for i, a in enumerate(fit.noise.filters)]
    return np.column_stack(columns)[SETTLING:] * fit.weights_sd


def _with_outputs(run: Experiment, series: Mapping[str, np.ndarray]) -> Experiment:
    """Return a run with other measured values; what was not measured stays so."""
    outputs = {
        name: replace(channel, values=np.where(np.isfinite(channel.values), series[name], np.nan))
        for name, channel in run.outputs.items()
    }
    return replace(run, outputs=outputs, piece=None)


def _setup(
    setup: Setup, taken: tuple[Insertion, ...], kept: tuple[Insertion, ...], fit: Fit, runs: tuple[Experiment, ...]
) -> Setup:
    """Return a setup whose model has those effects that are kept, calibrated, on other runs of the model with all."""
    model = insert_all(setup.model, kept)
    values = fit.values_in()
    free = [replace(spec, guess=values.get(spec.name, spec.guess)) for spec in setup.free]
    for insertion in kept:
        kind = insertion.place.kind
        for name, item in zip(insertion.parameter_names, insertion.parameters, strict=True):
            low, high = (bound if np.isfinite(bound) else None for bound in item.bounds_at(kind))
            free.append(FreeSpec(name, values[name], low, high))
    own = {spec.name for spec in free}
    set_values(model, {name: value for name, value in values.items() if name in own})
    now, then = _read_at(taken), _read_at(kept)
    back = {now[name]: then.get(name, name) for name in now}
    runs = tuple(
        replace(
            run,
            inputs={back.get(name, name): channel for name, channel in run.inputs.items()},
            outputs={back.get(name, name): channel for name, channel in run.outputs.items()},
        )
        for run in runs
    )
    return replace(setup, model=model, free=tuple(free), train=runs, select=(), test=())


def _read_at(insertions: tuple[Insertion, ...]) -> dict[str, str]:
    """Return the names that measured variables and inputs have with effects at them."""
    found: dict[str, str] = {}
    for insertion in insertions:
        found |= insertion.measured | insertion.driven
    return found
