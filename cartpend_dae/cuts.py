"""Runs cut into pieces with starts of their own, so that what happened long ago does not count."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.errors import ModelError
from cartpend_dae.system import System
from cartpend_dae.transcribe import shown_state

# a run `a` that is cut into pieces has the pieces `a#1`, `a#2`, ...
MARK = "#"
MIN_SAMPLES = 5


def run_of(experiment: Experiment) -> str:
    """Return the name of the run that an experiment is, or is a piece of."""
    return experiment.name.partition(MARK)[0]


def owners_of(experiments: tuple[Experiment, ...]) -> tuple[int, ...]:
    """Return which run each experiment is, or is a piece of: 0 for the first run, and so on."""
    names = [run_of(experiment) for experiment in experiments]
    numbers = {name: k for k, name in enumerate(dict.fromkeys(names))}
    return tuple(numbers[name] for name in names)


def cut(experiment: Experiment, system: System) -> tuple[Experiment, ...]:
    """Cut a run into pieces of its length `piece`, each with all states free at its start; or leave it whole.

    An unstable or chaotic motion forgets its start, and small disturbances carry any motion away from that of the
    model; over pieces that are short against both, the model must only be right for so long.

    Parameters
    ----------
    experiment
        The run.
    system
        The model.

    Raises
    ------
    ModelError
        If a piece would hold too few samples.
    """
    if experiment.piece is None:
        return (experiment,)
    time = experiment.time
    number = np.floor((time - time[0]) / experiment.piece + 1e-9).astype(int)
    parts = [np.flatnonzero(number == k) for k in np.unique(number)]
    parts = _without_short_ends(parts)
    if min(part.size for part in parts) < MIN_SAMPLES:
        raise ModelError(
            f"Run `{experiment.name}` is cut into pieces of {experiment.piece:g} s, of which one has "
            f"{min(part.size for part in parts)} samples; at least {MIN_SAMPLES} are needed, so choose longer pieces."
        )
    states = {name: Start(None, True) for name in system.states}
    # a model with an effect in it may have other states, but the names of the run stay
    named = {name: Start(None, True) for name in experiment.start if shown_state(system, name) is not None}
    first, later = _merged(experiment.start, states, system), _merged(named, states, system)
    return tuple(
        replace(
            shorter(experiment, part),
            name=f"{experiment.name}{MARK}{k + 1}",
            start=later if k else first,
            piece=None,
            steady=experiment.steady and k == 0,
        )
        for k, part in enumerate(parts)
    )


def shorter(experiment: Experiment, part: slice | np.ndarray) -> Experiment:
    """Return the samples of a run that `part` selects."""

    def selected(channels: Mapping[str, Channel]) -> dict[str, Channel]:
        return {name: replace(channel, values=channel.values[part]) for name, channel in channels.items()}

    return replace(
        experiment,
        time=experiment.time[part],
        inputs=selected(experiment.inputs),
        outputs=selected(experiment.outputs),
    )


def _without_short_ends(parts: list[np.ndarray]) -> list[np.ndarray]:
    """Join the last piece to the one before it where it is less than half as long."""
    if len(parts) > 1 and parts[-1].size < parts[-2].size / 2:
        return [*parts[:-2], np.concatenate(parts[-2:])]
    return parts


def _merged(given: Mapping[str, Start], free: Mapping[str, Start], system: System) -> dict[str, Start]:
    """Return the start of a piece: what is given, and the other states free."""
    named = {shown[0] for name in given if (shown := shown_state(system, name)) is not None}
    others = {name: start for k, (name, start) in enumerate(free.items()) if k not in named}
    return {**given, **others}
