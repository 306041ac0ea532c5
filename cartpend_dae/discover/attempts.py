"""A work on each of several candidates, in several processes if the workbench has them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.identify import Fit
from cartpend_dae.parallel import in_parallel


def each(
    bench: Workbench, items: list[Candidate], work: Callable[[Workbench, Candidate], Candidate], stage: str
) -> list[Candidate]:
    """Do a work on each candidate, in several processes if the workbench has them; failures say why."""
    bench.begin(stage, len(items))
    is_shared = bench.jobs > 1
    at = bench.quiet() if is_shared else bench

    def attempt(candidate: Candidate) -> tuple[dict[str, float], float, float, Fit | None, str, float | None]:
        try:
            done = work(at, candidate)
        except (SolverError, ModelError) as error:
            return candidate.parameters, 0.0, 0.0, None, f"its fit failed: {error}", candidate.early
        return done.parameters, done.gain, done.t, done.fit, done.why_not, done.early

    found = []
    for candidate, result in zip(items, in_parallel(attempt, items, jobs=bench.jobs), strict=True):
        parameters, gain, t, fit, why_not, early = result
        new = {"parameters": parameters, "gain": gain, "t": t, "fit": fit, "why_not": why_not, "early": early}
        found.append(replace(candidate, **new))
        if is_shared and fit is not None:
            bench.report(stage, candidate.insertion.prefix, float(np.sqrt(fit.chi2 / fit.n_residuals)))
    return found
