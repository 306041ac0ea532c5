"""Stage 5: the error before and after, on all runs; the test runs are opened here for the first time."""

from collections.abc import Callable

from cartpend_dae.assess import Assessment, assess
from cartpend_dae.discover.records import Discovery, Regime, Search, Setup
from cartpend_dae.discover.search import search
from cartpend_dae.discover.workbench import Workbench, assembled, augmented, renamed
from cartpend_dae.effects import Card, Insertion, catalogue, places
from cartpend_dae.effects.walk import component_at
from cartpend_dae.errors import ModelError
from cartpend_dae.identify import Fit
from cartpend_dae.language import Component, bindings_of


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
    jobs: int = 1,
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
        Number of processes in which candidates are fitted; the result does not depend on it.

    Raises
    ------
    ModelError
        If a place does not exist, or nothing may be tried.
    """
    measured = tuple(dict.fromkeys(name for experiment in setup.train for name in experiment.outputs))
    found = places(setup.model, measured, cards)
    if only_at is not None:
        known = [place.at for place in found]
        for name in only_at:
            if name not in known:
                listing = ", ".join(f"`{place}`" for place in known)
                raise ModelError(f"`{name}` is no place for an effect in this model; the places are: {listing}.")
        found = tuple(place for place in found if place.at in only_at)
    bench = Workbench(setup, report, jobs=jobs)
    outcome = search(bench, cards or catalogue(), found, max_steps=max_steps, regime=regime)
    return prove(setup, outcome)


def prove(setup: Setup, outcome: Search) -> Discovery:
    """Assess the model before and after on every run, the test runs included.

    Parameters
    ----------
    setup
        The model and the runs.
    outcome
        What the search found on the training runs.
    """
    insertions = tuple(step.candidate.insertion for step in outcome.steps)
    before = _assess(setup, (), outcome.baseline, outcome.bandwidth)
    after = _assess(setup, insertions, outcome.final, outcome.bandwidth) if insertions else before
    model_plus = augmented(setup.model, insertions)
    set_values(model_plus, outcome.final.values_in())
    return Discovery(setup, outcome, before, after, model_plus)


def _assess(setup: Setup, insertions: tuple[Insertion, ...], fit: Fit, bandwidth: float) -> Assessment:
    every = (*setup.train, *setup.select, *setup.test)
    system, runs = assembled(setup.model, insertions, every), renamed(every, insertions)
    measured: dict[str, str] = {}
    for insertion in insertions:
        measured |= {new: old for old, new in (insertion.measured | insertion.driven).items()}
    return assess(system, fit, runs, setup.scores, bandwidth=bandwidth, step=setup.step, measured=measured)


def set_values(model: Component, values: dict[str, float]) -> None:
    """Set parameters of a model by their dotted names, SI."""
    for name, value in values.items():
        path, _, parameter = name.rpartition(".")
        bindings_of(component_at(model, path))[parameter] = value
