"""A work on each of several candidates, in several processes if the workbench has them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.errors import UNSOLVED
from cartpend_dae.parallel import executor, in_parallel, is_shared

# what a work on a candidate finds out
FOUND = ("parameters", "gain", "t", "fit", "why_not", "early", "begun")
Item = TypeVar("Item")
Result = TypeVar("Result")


def each(
    bench: Workbench, items: list[Candidate], work: Callable[[Workbench, Candidate], Candidate], stage: str
) -> list[Candidate]:
    """Do a work on each candidate, in several processes if the workbench has them; failures say why."""
    bench.begin(stage, len(items))
    is_quiet = is_shared(bench.jobs)
    at = bench.quiet() if is_quiet else bench

    def attempt(candidate: Candidate) -> dict[str, Any]:
        try:
            done = work(at, candidate)
        except (*UNSOLVED, np.linalg.LinAlgError) as error:  # or numbers grow beyond all bounds
            done = replace(candidate, gain=0.0, t=0.0, fit=None, why_not=f"its fit failed: {error}")
        return {name: getattr(done, name) for name in FOUND}

    depends = [(stage, content(candidate)) for candidate in items]
    found = []
    for candidate, result in zip(items, kept(bench, "candidate", depends, attempt, items), strict=True):
        found.append(replace(candidate, **result))
        fit = result["fit"]
        if is_quiet and fit is not None:
            bench.report(stage, candidate.insertion.prefix, float(np.sqrt(fit.chi2 / fit.n_residuals)))
    return found


def kept(
    bench: Workbench, stage: str, depends: Sequence[Any], work: Callable[[Item], Result], items: Sequence[Item]
) -> Iterator[Result]:
    """Yield the work on each item, in their order; what workers without this disk have done is kept here by itself.

    Parameters
    ----------
    bench
        The workbench, with the store.
    stage
        The name under which results are kept.
    depends
        What the result of each item depends on, besides the study.
    work
        The work.
    items
        The items.
    """
    store = bench.store
    missing = [k for k in range(len(items)) if not store.has(stage, depends[k])]

    def keep(number: int, result: Result) -> None:
        store.recall(stage, depends[missing[number]], lambda: result)

    arrived = keep if executor(bench.jobs).is_remote else None
    fresh = in_parallel(work, [items[k] for k in missing], jobs=bench.jobs, arrived=arrived)
    for k in range(len(items)):
        yield next(fresh) if k in missing else store.recall(stage, depends[k], lambda k=k: work(items[k]))


def content(candidate: Candidate) -> tuple[Any, ...]:
    """Return what was found out of a candidate before; to the last bit it depends on all fits that it follows."""
    c, fit = candidate, candidate.fit
    values = str(dict(c.insertion.values))
    point = None if fit is None else fit.point
    return c.insertion.prefix, values, c.parameters, c.predicted, c.gain, c.t, c.early, c.response, point
