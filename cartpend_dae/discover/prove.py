"""Stage 5: the error before and after, on all runs; the test runs are opened here for the first time."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from cartpend_dae.assess import Assessment, assess
from cartpend_dae.discover.closure import KINDS
from cartpend_dae.discover.open_set import OpenSet, open_set
from cartpend_dae.discover.rates import Rate, rates
from cartpend_dae.discover.records import Regime, Search, Setup
from cartpend_dae.discover.search import search
from cartpend_dae.discover.split import Split, splits, still_alike
from cartpend_dae.discover.store import Store
from cartpend_dae.discover.workbench import Workbench, assembled, fine_step, last_bandwidth, renamed, set_values
from cartpend_dae.effects import Card, Insertion, Place, catalogue, insert_all, places
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.everyday import quantity
from cartpend_dae.identify import Fit
from cartpend_dae.language import Component
from cartpend_dae.notebook import lines, table
from cartpend_dae.parallel import Workers
from cartpend_dae.stepping import shortest_times


@dataclass(frozen=True, slots=True)
class Beyond:
    """What a search left unexplained, what would tell its answers apart, and how far it can be trusted."""

    open_set: OpenSet | None
    splits: tuple[Split, ...]
    rates: tuple[Rate, ...]


@dataclass(frozen=True, slots=True)
class Discovery:
    """Everything that was found, before and after."""

    setup: Setup
    search: Search
    before: Assessment
    after: Assessment
    model_plus: Component
    beyond: Beyond = Beyond(None, (), ())

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
    cards: tuple[Card, ...] | None = None,
    only_at: tuple[str, ...] | None = None,
    max_steps: int = 5,
    regime: Regime | None = None,
    report: Callable[[str, str, float], None] = _silent,
    jobs: Workers = 1,
    store: Store | None = None,
    placebo: int = 0,
    power: int = 0,
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
        Names of the places to look at; all if None.
    max_steps
        Largest number of additions.
    regime
        Forced regime; None finds out.
    report
        Called with (stage, candidate, error) after each fit.
    jobs
        Number of processes in which candidates are fitted, or an executor; the result does not depend on it.
    store
        Where finished stages are kept, and taken up again.
    placebo, power
        How often the search is repeated on data made from its outcome: with nothing missing, and for each accepted
        effect without it; see `rates`.
    beyond
        False leaves out what follows the search: closures for what is left, and experiments that split rivals.

    Raises
    ------
    ModelError
        If a place does not exist, or nothing may be tried.
    """
    cards = cards or catalogue()
    bench = Workbench(setup, report, jobs=jobs, store=store or Store())
    outcome = search(bench, cards, _places(setup, cards, only_at), max_steps=max_steps, regime=regime)
    found = Beyond(None, (), ())
    if beyond and not outcome.interrupted:
        try:
            found = _beyond(bench, outcome, cards, only_at, regime, placebo, power)
        except KeyboardInterrupt:
            outcome = replace(outcome, interrupted=True)
    return prove(setup, still_alike(outcome, found.splits), found)


def _places(setup: Setup, cards: tuple[Card, ...], only_at: tuple[str, ...] | None) -> tuple[Place, ...]:
    measured = tuple(dict.fromkeys(name for experiment in setup.train for name in experiment.outputs))
    found = places(setup.model, measured, cards)
    if only_at is not None:
        known = [place.at for place in found]
        for name in only_at:
            if name not in known:
                listing = ", ".join(f"`{place}`" for place in known)
                raise ModelError(f"`{name}` is no place for an effect in this model; the places are: {listing}.")
        found = tuple(place for place in found if place.at in only_at)
    return found


def _beyond(
    bench: Workbench,
    outcome: Search,
    cards: tuple[Card, ...],
    only_at: tuple[str, ...] | None,
    regime: Regime | None,
    placebo: int,
    power: int,
) -> Beyond:
    """Look at what a search could not explain or tell apart, and at how far it can be trusted."""

    def searcher(setup: Setup) -> Search:
        quiet = Workbench(setup)
        return search(quiet, cards, _places(setup, cards, None), max_steps=1, regime=regime)

    left = None
    if outcome.verdict in ("unexplained", "improved"):
        try:
            # where disturbances move the rig something is always left: one closure tells whether it is a law
            left = open_set(bench, outcome, kinds=KINDS if outcome.regime == "noise" else ("spline",))
        except (ModelError, SolverError) as error:
            bench.report("what is left", str(error), float("nan"))
    return Beyond(left, splits(bench, outcome), rates(bench, outcome, searcher, placebo=placebo, power=power))


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
