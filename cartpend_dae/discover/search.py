"""Stage 4: add what the data ask for, one effect after the other, and take back what they no longer need."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cartpend_dae.discover.evidence import bic, robust, with_robust_sd
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.records import Candidate, Regime, Search, Step, Verdict
from cartpend_dae.discover.regime import best_bandwidth
from cartpend_dae.discover.screen import candidates, screen
from cartpend_dae.discover.trial import MIN_BIC_GAIN, MIN_SHARE, NEAR, Base, Rules, aliases, are_parallel, try_all
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, Place
from cartpend_dae.identify import Fit

# stages of decreasing output injection, in units of the dominant frequency
STAGES = (5.0, 2.0, 0.7, 0.0)
# so many effects together stand for the whole catalogue where the bandwidth of predictions is sought
RICH = 4
_Library = tuple[tuple[Card, ...], tuple[Place, ...]]


def search(
    bench: Workbench,
    cards: tuple[Card, ...],
    places: tuple[Place, ...],
    *,
    max_steps: int,
    regime: Regime | None = None,
) -> Search:
    """Find the effects that the training runs ask for.

    Parameters
    ----------
    bench
        The workbench with the runs.
    cards, places
        What may be added, and where.
    max_steps
        Largest number of additions.
    regime
        Forced regime; None finds out.
    """
    noise = _noise_rules(bench)
    base = _fit_base(bench, (), {}, noise)
    base = replace(base, bare=base.fit.chi2)
    gate = residuals(base.fit)
    if not gate.is_passed and regime != "disturbances":
        return Search("noise", 0.0, base.fit, gate, base.fit, gate, (), (), "no-discrepancy", False)
    if regime is None and any(run.score != "free" for run in bench.setup.train):
        regime = "disturbances"  # who scores predictions knows that a free simulation drifts
    log = _Log()
    rules, start = noise, base
    library = (cards, places)
    try:
        if regime != "disturbances":
            base = _grow(bench, start, rules, library, max_steps, log)
        if regime == "disturbances" or (regime is None and residuals(base.fit).is_passed):
            # no sum of effects leaves noise alone, so that something else moves the rig as well
            rules, start = _disturbed(bench, noise, start, log, library)
            log.steps, log.base = [], None
            base = _grow(bench, start, rules, library, max_steps, log)
    except KeyboardInterrupt:
        log.is_interrupted, base = True, log.base or start
    last_gate = residuals(base.fit)
    return Search(
        rules.regime,
        rules.stages[-1],
        _reported(bench, start, rules),
        residuals(start.fit),
        _reported(bench, base, rules),
        last_gate,
        tuple(log.steps),
        tuple(log.tried.values()),
        _verdict(bool(log.steps), last_gate.is_passed),
        log.is_interrupted,
    )


@dataclass(slots=True)
class _Log:
    """What a search has found so far, kept when it is interrupted; `tried` holds the last word on each candidate."""

    steps: list[Step] = field(default_factory=list)
    tried: dict[str, Candidate] = field(default_factory=dict)
    base: Base | None = None
    is_interrupted: bool = False


def _disturbed(bench: Workbench, noise: Rules, base: Base, log: _Log, library: _Library) -> tuple[Rules, Base]:
    """Weigh by predictions, with the bandwidth with which the most promising effects together predict best."""
    ranked = [c for c in log.tried.values() if not c.why_not or c.fit is not None]
    if not ranked:
        early = base.fits[noise.screening].point
        screened = screen(bench, (), early, candidates(*library, ()), noise.screening, noise.sd)
        ranked = [c for c in screened if not c.why_not]
    rich = _distinct([step.candidate for step in log.steps] + ranked)[:RICH]
    bandwidth = best_bandwidth(bench, rich, base.fits[noise.screening].point, noise.sd)
    return _disturbance_rules(bench, bandwidth, noise.sd)


def _distinct(ranked: list[Candidate]) -> list[Candidate]:
    """Leave out those that move the data as one before them does."""
    found: list[Candidate] = []
    for candidate in ranked:
        if not any(are_parallel(candidate, other) for other in found):
            found.append(candidate)
    return found


def _grow(bench: Workbench, base: Base, rules: Rules, library: _Library, max_steps: int, log: _Log) -> Base:
    """Add effects while there is structure; the free simulation has it, so there is always a first round."""
    while len(log.steps) < max_steps:
        ranked = try_all(bench, base, rules, candidates(*library, base.taken))
        log.tried |= {candidate.insertion.prefix: candidate for candidate in ranked}
        if not ranked or ranked[0].why_not:
            break
        winner = ranked[0]
        base = _base_of(bench, base, base.taken, winner, rules)
        steps = [*log.steps, Step(winner, residuals(base.fit), aliases(winner, ranked))]
        base, steps = _prune(bench, base, steps, rules)
        base, steps = _swap(bench, base, steps, rules, library)
        log.steps, log.base = steps, base
        if not residuals(base.fit).is_passed:
            break
    return base


def _reported(bench: Workbench, base: Base, rules: Rules) -> Fit:
    """Return the fit of a base with the standard deviations that its regime calls for."""
    if rules.regime == "noise":
        return base.fit
    return with_robust_sd(base.fit, bench.solved(base.taken, base.fit, rules.sd))


def _verdict(has_steps: bool, is_left: bool) -> Verdict:
    if not has_steps:
        return "unexplained"
    return "improved" if is_left else "explained"


def _noise_rules(bench: Workbench) -> Rules:
    frequency = bench.frequency
    stages = tuple(share * frequency for share in STAGES)
    return Rules("noise", stages, stages[1], bench.problem(()).prior_sd)


def _disturbance_rules(bench: Workbench, bandwidth: float, sd: np.ndarray) -> tuple[Rules, Base]:
    """Weight by the innovations of the baseline, so that costs are of order one."""
    fit = bench.fit((), {}, (bandwidth,), sd)
    rules = Rules("disturbances", (bandwidth,), bandwidth, fit.noise_sd)
    return rules, _fit_base(bench, (), fit.point, rules)


def _fit_base(bench: Workbench, taken: tuple[Insertion, ...], guess: Mapping[str, float], rules: Rules) -> Base:
    fits: dict[float, Fit] = {}
    point = dict(guess)
    for bandwidth in rules.stages:
        fits[bandwidth] = bench.fit(taken, point, (bandwidth,), rules.sd)
        point = fits[bandwidth].point
    return Base(taken, fits)


def _base_of(bench: Workbench, before: Base, taken: tuple[Insertion, ...], winner: Candidate, rules: Rules) -> Base:
    assert winner.fit is not None
    together = (*taken, winner.insertion)
    if rules.regime == "disturbances":
        return Base(together, {rules.screening: winner.fit}, before.bare)
    early = bench.fit(together, winner.fit.point, (rules.screening,), rules.sd)
    return Base(together, {rules.screening: early, 0.0: winner.fit}, before.bare)


def _prune(bench: Workbench, base: Base, steps: list[Step], rules: Rules) -> tuple[Base, list[Step]]:
    """Take back each earlier addition that the model with the last one does without."""
    for step in list(steps[:-1]):
        fewer = tuple(i for i in base.taken if i.prefix != step.candidate.insertion.prefix)
        trial = replace(_fit_base(bench, fewer, base.fits[rules.screening].point, rules), bare=base.bare)
        if rules.regime == "noise":
            is_needed = bic(trial.fit) - bic(base.fit) > MIN_BIC_GAIN
        else:
            before = robust(trial.fit, bench.solved(fewer, trial.fit, rules.sd))
            after = robust(base.fit, bench.solved(base.taken, base.fit, rules.sd))
            is_needed = 1 - after.cost / before.cost > MIN_SHARE
        if not is_needed:
            base = trial
            steps = [s for s in steps if s.candidate.insertion.prefix != step.candidate.insertion.prefix]
    return base, steps


def _swap(bench: Workbench, base: Base, steps: list[Step], rules: Rules, library: _Library) -> tuple[Base, list[Step]]:
    """Put another effect in the place of each earlier one if, with the last one in, it explains more.

    The first effect chosen soaks up a part of those still missing, and may be the wrong one of two alike.
    """
    cards, places = library
    for old in list(steps[:-1]):
        here = tuple(place for place in places if place.at == old.candidate.insertion.place.at)
        others = [s for s in steps if s is not old]
        fewer = tuple(s.candidate.insertion for s in others)
        without = replace(_fit_base(bench, fewer, base.fits[rules.screening].point, rules), bare=base.bare)
        ranked = try_all(bench, without, rules, candidates(cards, here, fewer))
        best = ranked[0] if ranked else None
        if best is None or best.why_not or best.fit is None or best.insertion.prefix == old.candidate.insertion.prefix:
            continue
        if _criterion(base.fit, rules) - _criterion(best.fit, rules) <= NEAR:
            continue
        base = _base_of(bench, base, fewer, best, rules)
        steps = [*others, Step(best, residuals(base.fit), aliases(best, ranked))]
    return base, steps


def _criterion(fit: Fit, rules: Rules) -> float:
    """Return what is compared between models of equal size: BIC, or percent of the cost of prediction."""
    return bic(fit) if rules.regime == "noise" else 100 * float(np.log(fit.chi2))
