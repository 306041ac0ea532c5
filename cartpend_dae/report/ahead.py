"""The errors over horizons that a result holds: how far off the model is, by how far it looks ahead."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from cartpend_dae.assess import system_with
from cartpend_dae.data import Experiment, noise_sd
from cartpend_dae.discover import Discovery
from cartpend_dae.discover.records import Setup
from cartpend_dae.discover.workbench import assembled, renamed
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.horizons import Ahead, error_ahead
from cartpend_dae.identify import Fit

MOST_RUNS, FEWEST_SAMPLES = 4, 50


def ahead_of_discovery(discovery: Discovery) -> list[dict[str, Any]]:
    """Return the errors over horizons of the model before, and after if anything was added."""
    search, setup = discovery.search, discovery.setup
    insertions = tuple(step.candidate.insertion for step in search.steps)
    found = {"before": _ahead(setup, (), search.baseline, search.bandwidth)}
    if insertions:
        found["after"] = _ahead(setup, insertions, search.final, search.bandwidth)
    return _entries(setup, found)


def ahead_of_fit(setup: Setup, fit: Fit) -> list[dict[str, Any]]:
    """Return the errors over horizons of a fitted model."""
    return _entries(setup, {"before": _ahead(setup, (), fit, float(fit.bandwidth[0]))})


def _chosen(setup: Setup) -> tuple[Experiment, ...]:
    """Return the runs that decide: those of test; where there are none those of selection, else those of training."""
    chosen = setup.test or setup.select or setup.train
    return tuple(run for run in chosen if run.time.size >= FEWEST_SAMPLES)[:MOST_RUNS]


def _ahead(setup: Setup, insertions: tuple[Insertion, ...], fit: Fit, bandwidth: float) -> Mapping[str, Ahead]:
    """Measure the errors of a model; a run that it cannot be simulated on from any instant is left out."""
    chosen = _chosen(setup)
    if not chosen:
        return {}
    system = assembled(setup.model, insertions, (*setup.train, *setup.select, *setup.test))
    found = {}
    for run in renamed(chosen, insertions):
        with suppress(ModelError, SolverError):
            model = system_with(system, fit.values_in(run.name))
            found[run.name] = error_ahead(model, run, bandwidth=bandwidth, step=setup.step)
    return found


def _entries(setup: Setup, found: Mapping[str, Mapping[str, Ahead]]) -> list[dict[str, Any]]:
    return [
        {
            "run": run.name,
            "role": run.role,
            "output": name,
            "unit": channel.unit,
            "noise_sd": noise_sd(channel.values),
            "seconds": found["before"][run.name].seconds.tolist(),
            "errors": {moment: ahead[run.name].error[:, column].tolist() for moment, ahead in found.items()},
        }
        for run in _chosen(setup)
        if all(run.name in ahead for ahead in found.values())
        for column, (name, channel) in enumerate(run.outputs.items())
    ]
