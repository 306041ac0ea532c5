"""Stage 5: the error before and after, on all runs; the test runs are opened here for the first time."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from cartpend_dae.assess import Assessment, assess
from cartpend_dae.discover.asked import check_numbers, check_places, check_runs, forced_regime, named_places
from cartpend_dae.discover.closure import KINDS
from cartpend_dae.discover.open_set import OpenSet, open_set_so_far
from cartpend_dae.discover.rates import Rate, rates_so_far
from cartpend_dae.discover.records import Base, Regime, Search, Setup
from cartpend_dae.discover.search import search
from cartpend_dae.discover.split import Split, splits, still_alike
from cartpend_dae.discover.store import Store
from cartpend_dae.discover.workbench import (
    Workbench,
    assembled,
    fine_step,
    last_bandwidth,
    measured_by,
    renamed,
    set_values,
)
from cartpend_dae.effects import Card, Insertion, Place, catalogue, insert_all, places
from cartpend_dae.effects.catalogue import checked
from cartpend_dae.errors import UNSOLVED, ModelError
from cartpend_dae.everyday import quantity
from cartpend_dae.identify import Fit
from cartpend_dae.language import Component
from cartpend_dae.notebook import lines, table
from cartpend_dae.parallel import Workers
from cartpend_dae.stepping import shortest_times
from cartpend_dae.system import System


@dataclass(frozen=True, slots=True)
class Beyond:
    """What a search left unexplained, what would tell its answers apart, and how far it can be trusted.

    `placebo` and `power` are the numbers of repetitions that were asked for. Where these stages were `interrupted`,
    what was finished of them is here.
    """

    open_set: OpenSet | None
    splits: tuple[Split, ...]
    rates: tuple[Rate, ...]
    placebo: int = 0
    power: int = 0
    interrupted: bool = False


@dataclass(frozen=True, slots=True)
class Discovery:
    """Everything that was found, before and after."""

    setup: Setup
    search: Search
    before: Assessment
    after: Assessment
    model_plus: Component
    beyond: Beyond = Beyond(None, (), ())

    @property
    def interrupted(self) -> bool:
        """Whether the search, or what follows it, was interrupted."""
        return self.search.interrupted or self.beyond.interrupted

    def __repr__(self) -> str:
        title, rows = self._shown()
        return lines(title, [(name, output, before, "->", after) for name, output, before, after in rows])

    def _repr_html_(self) -> str:
        """Show in a notebook what was added, and the errors before and after."""
        title, rows = self._shown()
        return table(title, ("run", "output", "error before", "error after"), rows)

    def _shown(self) -> tuple[str, list[tuple[str, str, str, str]]]:
        added = [f"`{step.candidate.insertion.prefix}`" for step in self.search.steps]
        last = {run.name: run for run in self.after.runs}
        rows = [
            (f"{run.name} ({run.role})", name, quantity(e.rmse, e.unit), quantity(after.rmse, after.unit))
            for run in self.before.runs
            for name, e, after in zip(run.outputs, run.outputs.values(), last[run.name].outputs.values(), strict=True)
        ]
        title = f"{type(self.setup.model).__name__}: {self.search.verdict}, added {', '.join(added) or 'nothing'}"
        return title, rows


def _silent(stage: str, label: str, error: float) -> None:
    return None


def discover(
    setup: Setup,
    *,
    cards: Sequence[Card] | None = None,
    only_at: str | Sequence[str] | None = None,
    max_steps: int = 5,
    regime: Regime | Literal["auto"] | None = None,
    report: Callable[[str, str, float], None] = _silent,
    jobs: Workers = 1,
    store: Store | None = None,
    placebo: int = 0,
    power: int = 0,
    seed: int = 0,
    beyond: bool = True,
) -> Discovery:
    """Find what a model lacks, add it, refit, and measure the error before and after.

    Parameters
    ----------
    setup
        The model, its free parameters and the runs.
    cards
        The catalogue; the package's own if None.
    only_at
        Names of the places to look at, or that of one; all if None.
    max_steps
        Largest number of additions.
    regime
        Forced regime; None, or `auto`, finds out.
    report
        Called with (stage, candidate, error) after each fit.
    jobs
        Number of processes in which candidates are fitted, or an executor; the result does not depend on it.
    store
        Where finished stages are kept, and taken up again.
    placebo, power
        How often the search is repeated on data made from its outcome: with nothing missing, and for each accepted
        effect without it; see `rates`.
    seed
        Which noise those data, and the placebo of the places, are made with; the search draws none.
    beyond
        False leaves out what follows the search: closures for what is left, and experiments that split rivals.

    Raises
    ------
    ModelError
        If a place does not exist, nothing may be tried, or a run does not belong to the model or is no run.
    ValueError
        If there is no such regime, or a number is no count.
    """
    asked = _Asked(
        catalogue() if cards is None else tuple(checked(cards)),
        named_places(only_at),
        forced_regime(regime),
        placebo,
        power,
        seed,
    )
    check_numbers(jobs, {"max_steps": max_steps, "placebo": placebo, "power": power, "seed": seed})
    if not asked.cards:
        raise ModelError("`cards` is empty, so that nothing may be tried; give cards, or None for the whole catalogue.")
    based, system = _with_base(setup)
    check_runs(setup, system)
    open_places = _places(setup, asked.cards)
    if asked.only_at is not None:
        check_places(asked.only_at, [place.at for place in open_places], "for an effect")
    bench = Workbench(based, report, jobs=jobs, store=(store or Store()).for_cards(asked.cards))
    outcome = search(bench, asked.cards, asked.among(open_places), max_steps=max_steps, regime=asked.regime)
    found = Beyond(None, (), (), placebo, power)
    if beyond and not outcome.interrupted:
        try:
            for so_far in _beyond(bench, outcome, asked):
                found = so_far
        except KeyboardInterrupt:
            found = replace(found, interrupted=True)
    return prove(setup, still_alike(outcome, found.splits), found)


def _with_base(setup: Setup) -> tuple[Setup, System]:
    """Return the setup with its model assembled as the first fit needs it, and that system."""
    base, names = setup.base, measured_by(setup.train)
    if base is None or base.model is not setup.model or base.names != names:
        base = Base(setup.model, names, assembled(setup.model, (), setup.train))
    return replace(setup, base=base), base.system


@dataclass(frozen=True, slots=True)
class _Asked:
    """What may be tried, and where; and what is asked for after the search."""

    cards: tuple[Card, ...]
    only_at: tuple[str, ...] | None
    regime: Regime | None
    placebo: int
    power: int
    seed: int

    def among(self, found: tuple[Place, ...], moved: Mapping[str, str] | None = None) -> tuple[Place, ...]:
        """Return the places that may be looked at; those `moved` have a new name."""
        if self.only_at is None:
            return found
        names = {*self.only_at, *(new for old, new in (moved or {}).items() if old in self.only_at)}
        return tuple(place for place in found if place.at in names)


def _places(setup: Setup, cards: tuple[Card, ...]) -> tuple[Place, ...]:
    measured = tuple(dict.fromkeys(name for experiment in setup.train for name in experiment.outputs))
    return places(setup.model, measured, cards)


def _beyond(bench: Workbench, outcome: Search, asked: _Asked) -> Iterator[Beyond]:
    """Look at what a search could not explain or tell apart, and at how far it can be trusted; yield what there is."""
    moved: dict[str, str] = {}
    for step in outcome.steps:
        moved |= step.candidate.insertion.measured | step.candidate.insertion.driven

    def searcher(setup: Setup) -> Search:
        allowed = asked.among(_places(setup, asked.cards), moved)
        return search(Workbench(setup), asked.cards, allowed, max_steps=1, regime=asked.regime)

    found = Beyond(None, (), (), asked.placebo, asked.power)
    yield found
    if outcome.verdict in ("unexplained", "improved"):
        # where disturbances move the rig something is always left: more closures only until one leaves none of it
        is_soon = outcome.regime != "noise"
        try:
            for left in open_set_so_far(bench, outcome, kinds=KINDS, until_noise=is_soon, seed=asked.seed):
                found = replace(found, open_set=left)
                yield found
        except UNSOLVED as error:
            bench.report("what is left", str(error), float("nan"))
    found = replace(found, splits=splits(bench, outcome))
    yield found
    counts = {"placebo": asked.placebo, "power": asked.power}
    for counted in rates_so_far(bench, outcome, searcher, **counts, seed=asked.seed):
        yield replace(found, rates=counted)


def prove(setup: Setup, outcome: Search, beyond: Beyond | None = None) -> Discovery:
    """Assess the model before and after on every run, the test runs included.

    Parameters
    ----------
    setup
        The model and the runs.
    outcome
        What the search found on the training runs.
    beyond
        What else was found out; a closure in it is assessed as well.
    """
    insertions = tuple(step.candidate.insertion for step in outcome.steps)
    before = _assess(setup, (), outcome.baseline, outcome)
    after = _assess(setup, insertions, outcome.final, outcome) if insertions else before
    model_plus = insert_all(setup.model, insertions)  # a copy, also without any
    set_values(model_plus, outcome.final.values_in())
    beyond = beyond or Beyond(None, (), ())
    if beyond.open_set is not None and beyond.open_set.closures:
        best = beyond.open_set.closures[0]
        errors = _assess(setup, (*insertions, best.insertion), best.fit, outcome)
        beyond = replace(beyond, open_set=replace(beyond.open_set, errors=errors))
    return Discovery(setup, outcome, before, after, model_plus, beyond)


def _assess(setup: Setup, insertions: tuple[Insertion, ...], fit: Fit, outcome: Search) -> Assessment:
    every = (*setup.train, *setup.select, *setup.test)
    system, runs = assembled(setup.model, insertions, every), renamed(every, insertions)
    measured: dict[str, str] = {}
    for insertion in insertions:
        measured |= {new: old for old, new in (insertion.measured | insertion.driven).items()}
    is_rough = bool(system.frictions.places or shortest_times(system))
    # what decided was fitted on fine steps: in noise alone always, be it by predictions where a gap rattles
    is_last = outcome.regime == "noise" or outcome.bandwidth == last_bandwidth(setup.train)
    step = fine_step(setup) if is_rough and is_last else setup.step
    return assess(system, fit, runs, setup.scores, bandwidth=outcome.bandwidth, step=step, measured=measured)
