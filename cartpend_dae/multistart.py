"""The fit of a study: from one start or several, by the shortest way that ends in residuals without structure."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.discover.evidence import with_robust_sd
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.records import Setup
from cartpend_dae.discover.refit import STAGES
from cartpend_dae.discover.regime import best_bandwidth
from cartpend_dae.discover.workbench import Report, Workbench
from cartpend_dae.errors import SolverError
from cartpend_dae.exact_form import finished
from cartpend_dae.identify import Fit
from cartpend_dae.parallel import Workers, in_parallel, is_shared
from cartpend_dae.problem import Problem
from cartpend_dae.starting import best_of, check_reach, off_the_bounds, shifted, start_points


@dataclass(frozen=True, slots=True)
class Route:
    """How a study is fitted: from how many starts, in how many processes or by which executor, scattered by which seed.

    `exact` as of `exact_form.finished`.
    """

    starts: int = 1
    seed: int = 0
    jobs: Workers = 1
    exact: bool | None = None


def fit_study(setup: Setup, route: Route, report: Report) -> tuple[Problem, Fit]:
    """Estimate what is free in a study on its training runs; return the problem and the best fit.

    Parameters
    ----------
    setup
        What is to be estimated, on which runs.
    route
        How.
    report
        Called with (stage, what is fitted, residual in noise sds) after each fit.

    Raises
    ------
    ModelError
        If a parameter reaches no output.
    SolverError
        If no start leads to a solution.
    """
    bench = Workbench(setup, report)
    problem = bench.problem(())
    free, notes = off_the_bounds(problem.free)
    if notes:
        problem = replace(problem, free=free)
        bench = replace(bench, problems={(None, ()): problem})
    check_reach(problem)
    sd = problem.prior_sd
    points = [shifted(problem.layout.free, point) for point in start_points(free, route.starts, route.seed)]

    at = bench.quiet() if is_shared(route.jobs) else bench

    def attempt(point: Mapping[str, float]) -> Fit | SolverError:
        try:
            return _fit(at, point, sd)
        except SolverError as error:
            return error

    fits = list(in_parallel(attempt, points, jobs=route.jobs))
    best, outcome = best_of(fits)
    if best is None:
        raise _failure(bench, fits[0])
    notes += (str(outcome),) if route.starts > 1 else ()
    best = finished(problem, best, exact=route.exact)
    return problem, replace(best, notes=(*best.notes, *notes))


def _fit(bench: Workbench, point: Mapping[str, float], sd: np.ndarray) -> Fit:
    """Fit from a point: freely at once, and where that leaves structure in the residuals by way of the stages.

    Where a training run is scored over a horizon or by its innovations, the bandwidth of the best predictions is used
    instead, and standard deviations are those of the block jackknife.
    """
    if not all(run.score == "free" for run in bench.setup.train):
        fit = bench.fit((), point, (best_bandwidth(bench, [], point, sd),), sd)
        return with_robust_sd(fit, bench.solved((), fit, sd))
    try:
        direct = bench.fit((), point, (0.0,), sd, patient=False)
    except SolverError:
        direct = None
    if direct is not None and direct.success and not residuals(direct).is_passed:
        return direct
    staged = bench.fit((), point, tuple(share * bench.frequency for share in STAGES), sd)
    if direct is not None and direct.success and (direct.cost < staged.cost or not staged.success):
        return direct
    return staged


def _failure(bench: Workbench, first: Fit | SolverError) -> SolverError:
    if isinstance(first, SolverError):
        return first
    size = float(np.sqrt(first.chi2 / max(1, first.n_residuals)))
    return SolverError(
        f"The fit of {bench.problem(()).system.name} did not converge ({first.message.replace('_', ' ').lower()} after "
        f"{first.iterations} iterations, residuals of {size:.3g} x noise): check the guesses and bounds under "
        f"`parameters` and the start values of the runs. A model that lacks something may end so too: "
        f"`cartpend discover` looks for it."
    )
