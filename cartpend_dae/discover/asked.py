"""What is asked of a discovery, checked before the first fit: all mistakes are said at once."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Literal, get_args

import numpy as np

from cartpend_dae.data import Channel, Experiment
from cartpend_dae.discover.records import Regime, Setup
from cartpend_dae.errors import ModelError, unknown_name
from cartpend_dae.explain import listed_findings, nearest
from cartpend_dae.parallel import Workers
from cartpend_dae.system import System

REGIMES: tuple[Regime, ...] = get_args(Regime)
ROLES, SCORES = ("train", "select", "test"), ("free", "horizon", "innovation")


def forced_regime(word: Regime | Literal["auto"] | None) -> Regime | None:
    """Return the regime that is forced; None, as `auto`, finds out.

    Raises
    ------
    ValueError
        If there is no such regime.
    """
    if word is None or word == "auto":
        return None
    if word not in REGIMES:
        listing = ", ".join(f"`{known}`" for known in ("auto", *REGIMES))
        raise ValueError(f"`regime` is {word!r}; give one of: {listing}.")
    return word


def check_numbers(jobs: Workers, counts: Mapping[str, int]) -> None:
    """Check that counts are whole numbers from 0, and that there is a process to work in.

    Raises
    ------
    ValueError
        Naming each, and its value.
    """
    wrong = [
        f"`{name}` is {count!r}; give a whole number, 0 or more."
        for name, count in counts.items()
        if not isinstance(count, int | np.integer) or count < 0
    ]
    if isinstance(jobs, int) and jobs < 1:
        wrong.append(f"`jobs` is {jobs!r}; give a number of processes, 1 or more, or an executor.")
    if wrong:
        raise ValueError(listed_findings("The call", wrong))


def named_places(only_at: str | Sequence[str] | None) -> tuple[str, ...] | None:
    """Return the names of places; a text is one of them."""
    if only_at is None:
        return None
    return (only_at,) if isinstance(only_at, str) else tuple(only_at)


def check_places(only_at: tuple[str, ...], known: Collection[str], what: str) -> None:
    """Check the names of places in a model against those known, which are places `what`.

    Raises
    ------
    ModelError
        Naming each that is none, with those that are like it; or if none is named.
    """
    names = list(dict.fromkeys(known))
    listing = f"the places are: {', '.join(f'`{name}`' for name in names)}."
    wrong = [
        f"`{name}` is no place {what} in this model{nearest(name, names, listing)}"
        for name in only_at
        if name not in known
    ]
    if not only_at:
        wrong = [f"`only_at` names no place, so that nothing may be tried; {listing}"]
    if wrong:
        raise ModelError(listed_findings("`only_at`", wrong))


def check_runs(setup: Setup, system: System) -> None:
    """Check all runs of a setup against its model, those included that are opened at the end only.

    Raises
    ------
    ModelError
        With one line for each finding.
    """
    runs = (*setup.train, *setup.select, *setup.test)
    names = [run.name for run in runs]
    findings = [] if setup.train else ["There is no training run, and so nothing to fit; give one in `train`."]
    findings += [
        f"{names.count(name)} runs have the name `{name}`; give each a name of its own."
        for name in dict.fromkeys(names)
        if names.count(name) > 1
    ]
    for run in runs:
        findings += [f"Run `{run.name}` {finding}" for finding in (*_of_words(run), *_of_names(run, system))]
        findings += [f"Run `{run.name}` {finding}" for finding in _of_series(run)]
    if findings:
        raise ModelError(listed_findings(f"The setup of {system.name}", findings))


def _of_words(run: Experiment) -> Iterator[str]:
    for key, word, known in (("role", run.role, ROLES), ("score", run.score, SCORES)):
        if word not in known:
            listing = ", ".join(f"`{other}`" for other in known)
            yield f"has the {key} `{word}`{nearest(str(word), known, f'give one of: {listing}.')}"
    if run.score == "horizon" and run.horizon is None:
        yield "is scored over a horizon and has none; give `horizon` in seconds."


def _of_names(run: Experiment, system: System) -> Iterator[str]:
    known = [variable.name for variable in system.variables]
    for doing, names in (("measures", run.outputs), ("starts from", run.start)):
        for name in names:
            if name not in known:
                yield f"{doing} `{name}`: {unknown_name('variable', name, known, system.name)}"
    for name in run.inputs:
        if name not in system.inputs:
            listing = ", ".join(f"`{other}`" for other in system.inputs) or "none"
            yield f"drives `{name}`: {system.name} has no such input; its inputs are: {listing}."
    for name in system.inputs:
        if name not in run.inputs and system.variables[system.index_of(name)].declaration.default is None:
            yield f"gives no input `{name}`; add it to its `inputs`."


def _of_series(run: Experiment) -> Iterator[str]:
    n = len(run.time)
    if not run.outputs:
        yield "measures nothing; give it an output."
    series: list[tuple[str, Channel]] = [*run.inputs.items(), *run.outputs.items()]
    for name, channel in series:
        if len(channel.values) != n:
            yield f"has {len(channel.values)} values of `{name}` and {n} times; give one value for each time."
        elif name in run.outputs and not np.isfinite(channel.values).any():
            yield f"has no finite value of `{name}` in {n} samples; leave that output out, or mend its data."
