"""The next experiment of a study: what it may be, from the study and its runs, and the ranking of the candidates."""

import math

import numpy as np

from cartpend_dae.discover import FreeSpec
from cartpend_dae.errors import StudyError
from cartpend_dae.experiment_design import Plan, Ranking, known_from, nothing_known, rank
from cartpend_dae.identify import Fit
from cartpend_dae.parallel import Workers
from cartpend_dae.problem import Problem, dominant_frequency, free_parameter
from cartpend_dae.session import Opened, Report, solve_study
from cartpend_dae.study_schema import DesignSpec
from cartpend_dae.unknowns import Free, tie

# sampling rate of a study without runs [Hz]; highest frequency of inputs over the dominant one, and over the rate
RATE, ABOVE, BELOW = 100.0, 5.0, 0.1


def design_study(opened: Opened, *, report: Report | None = None, jobs: Workers = 1) -> Ranking:
    """Rank the experiments that a study allows, at the parameters fitted to its runs; without runs at the guesses.

    Parameters
    ----------
    opened
        A study with `[design]`.
    report
        Called with (stage, what is fitted, residual in noise sds) after each fit.
    jobs
        Number of processes, or an executor, where the study asks for several starts.

    Raises
    ------
    StudyError
        If the study does not say what experiments are possible, or what they would measure.
    """
    spec, path = opened.study.design, opened.study.path
    if spec is None:
        raise StudyError(
            f'{path}: the study has no `[design]`; give one with `max = {{ "input or state" = largest }}`.'
        )
    if not opened.setup.free:
        raise StudyError(f"{path}: the study has no free parameter, so that no experiment can say anything of one.")
    ties = tuple(tie(opened.system, name, text) for name, text in opened.setup.ties)
    if opened.setup.train:
        problem, fit = solve_study(opened, report=report, jobs=jobs)
        known, plan = known_from(problem, fit), _plan(opened, spec, problem, fit)
    else:
        if not spec.noise:
            raise StudyError(f'{path}: `design` of a study without runs needs `noise = {{ "output" = sd }}` [SI].')
        free = tuple(_free(opened, item) for item in opened.setup.free)
        known, plan = nothing_known(free, {item.name: item.guess for item in free}), _plan(opened, spec, None, None)
    unknown = [name for name in plan.noise if name not in {v.name for v in opened.system.variables}]
    if unknown:
        raise StudyError(f"{path}: `design.noise` names `{unknown[0]}`, which is no variable of the model.")
    return rank(opened.system, known, plan, ties=ties, weak=spec.parameters)


def _free(opened: Opened, item: FreeSpec) -> Free:
    return free_parameter(
        opened.system,
        item.name,
        guess=item.guess,
        lower=item.lower,
        upper=item.upper,
        is_log=item.is_log,
        prior=item.prior,
    )


def _plan(opened: Opened, spec: DesignSpec, problem: Problem | None, fit: Fit | None) -> Plan:
    """Fill in from the runs what the study leaves out."""
    train = opened.setup.train
    rate, starts, noise = spec.sample_rate or RATE, (), dict(spec.noise)
    high = BELOW * rate
    if train and problem is not None and fit is not None:
        rate = spec.sample_rate or 1 / float(np.median(np.concatenate([np.diff(run.time) for run in train])))
        high = min(ABOVE * dominant_frequency(train) / (2 * math.pi), BELOW * rate)
        starts = tuple(name for name, start in train[0].start.items() if start.free)
        noise = noise or dict(zip(fit.outputs, fit.noise_sd.tolist(), strict=True))
    low, high = spec.band or (min(2 / spec.duration, high / 2), high)
    return Plan(dict(spec.max), noise, spec.duration, rate, low, high, starts, spec.seed)
