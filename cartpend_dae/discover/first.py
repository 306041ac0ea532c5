"""The first fit of an effect that was screened, rough, at the stage of screening: from there it is judged."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from cartpend_dae.discover.gate import is_clean
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.shortlist import corrected
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.workbench import ROUGH, Workbench
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# so many steps
EARLY = 6
# what has gone less than this share of the way to another start has stayed where it began
STAYED = 0.01


def first_fit(bench: Workbench, base: Base, rules: Rules, stage: float, candidate: Candidate) -> Candidate:
    """Fit a candidate at the stage of screening.

    What corrects its law is held at first: it goes far to make up for sizes that are not yet right. One that stays
    where it begins when it is free, as the hardening of a spring does, which to first order changes nothing near 0,
    begins elsewhere.
    """
    together = (*base.taken, candidate.insertion)
    begin = base.fits[stage].point | candidate.insertion.starts | candidate.parameters
    held = candidate.insertion.corrections

    def fitted(guess: Mapping[str, float], held: tuple[str, ...] = ()) -> Fit:
        at = (stage,)
        return bench.fit(together, guess, at, rules.sd, patient=False, iterations=EARLY, stride=ROUGH, held=held)

    fit = fitted(begin, held)
    if not np.isfinite(fit.chi2):
        raise SolverError("its simulation diverges")
    if held and not is_clean(fit):
        found = [fit, free := fitted(fit.point)]
        for start in [] if is_clean(free) else _elsewhere(candidate, begin, free.point):
            with suppress(SolverError):
                found.append(fitted(fitted(begin | start, held).point))
        fit = min(found, key=lambda one: one.chi2 if np.isfinite(one.chi2) else np.inf)
    return replace(candidate, fit=fit, early=fit.chi2, begun=fit.point)


def _elsewhere(candidate: Candidate, begin: Mapping[str, float], end: Mapping[str, float]) -> list[dict[str, float]]:
    """Return other starts of each of the corrections that stayed where it began, by name."""
    starts = [
        {name: value for name, value in other.parameters.items() if value != begin[name]}
        for other in corrected(candidate)
    ]
    return [
        start
        for start in starts
        if start
        and all(abs(end[name] - begin[name]) < STAYED * abs(value - begin[name]) for name, value in start.items())
    ]
