"""Stage 3: add what the data ask for, one effect after the other, and take back what they no longer need."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cartpend_dae.discover.evidence import bic, robust, with_robust_sd
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.records import Candidate, Regime, Search, Step, Verdict
from cartpend_dae.discover.regime import find_regime
from cartpend_dae.discover.screen import candidates, screen
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, Place
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# stages of decreasing output injection, in units of the dominant frequency
STAGES = (5.0, 2.0, 0.7, 0.0)
# the right effect was among the three best predictions in all trials; close ones are fitted as well, up to five
SHORTLIST, LONGLIST, CLOSE = 3, 5, 0.3
# noise alone: drop of BIC (largest on 90 data sets with nothing missing: 8.6)
MIN_BIC_GAIN = 20.0
# with disturbances: share of the cross-validated cost that one effect must explain. On the measured axis EMPS
# effects that are there explain 58 to 84 % at bandwidths of 30 to 1000 rad/s, imitations of a missing one at most 17 %.
MIN_SHARE = 0.2
MIN_T = 5.0
NEAR = 3.0
_Library = tuple[tuple[Card, ...], tuple[Place, ...]]


@dataclass(frozen=True, slots=True)
class _Base:
    """The model so far: its fits by bandwidth, the last of which decides."""

    taken: tuple[Insertion, ...]
    fits: dict[float, Fit]

    @property
    def fit(self) -> Fit:
        return list(self.fits.values())[-1]


@dataclass(frozen=True, slots=True)
class _Rules:
    """How the regime fits and decides: `stages` of the base, the stage of screening, weights."""

    regime: Regime
    stages: tuple[float, ...]
    screening: float
    sd: np.ndarray


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
    gate = residuals(base.fit)
    if not gate.is_passed and regime != "disturbances":
        return Search("noise", 0.0, base.fit, gate, base.fit, gate, (), (), "no-discrepancy", False)
    log = _Log()
    rules, start = noise, base
    try:
        rules, start = _settle_regime(bench, base, noise, (cards, places), regime)
        base = _grow(bench, start, rules, (cards, places), max_steps, log)
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
    base: _Base | None = None
    is_interrupted: bool = False


def _settle_regime(
    bench: Workbench, base: _Base, noise: _Rules, library: _Library, regime: Regime | None
) -> tuple[_Rules, _Base]:
    if regime == "noise":
        return noise, base
    early = base.fits[noise.screening].point
    screened = screen(bench, (), early, candidates(*library, ()), noise.screening, noise.sd)
    found, bandwidth = find_regime(bench, screened, early, noise.sd)
    if (regime or found) == "noise":
        return noise, base
    return _disturbance_rules(bench, bandwidth, noise.sd)


def _grow(bench: Workbench, base: _Base, rules: _Rules, library: _Library, max_steps: int, log: _Log) -> _Base:
    """Add effects while there is structure; the free simulation has it, so there is always a first round."""
    while len(log.steps) < max_steps:
        ranked = _try_all(bench, base, rules, candidates(*library, base.taken))
        log.tried |= {candidate.insertion.prefix: candidate for candidate in ranked}
        if not ranked or ranked[0].why_not:
            break
        winner = ranked[0]
        base = _base_of(bench, base.taken, winner, rules)
        steps = [*log.steps, Step(winner, residuals(base.fit), _aliases(winner, ranked))]
        base, steps = _prune(bench, base, steps, rules)
        base, steps = _swap(bench, base, steps, rules, library)
        log.steps, log.base = steps, base
        if not residuals(base.fit).is_passed:
            break
    return base


def _reported(bench: Workbench, base: _Base, rules: _Rules) -> Fit:
    """Return the fit of a base with the standard deviations that its regime calls for."""
    if rules.regime == "noise":
        return base.fit
    return with_robust_sd(base.fit, bench.solved(base.taken, base.fit, rules.sd))


def _verdict(has_steps: bool, is_left: bool) -> Verdict:
    if not has_steps:
        return "unexplained"
    return "improved" if is_left else "explained"


def _noise_rules(bench: Workbench) -> _Rules:
    frequency = bench.frequency
    stages = tuple(share * frequency for share in STAGES)
    return _Rules("noise", stages, stages[1], bench.problem(()).prior_sd)


def _disturbance_rules(bench: Workbench, bandwidth: float, sd: np.ndarray) -> tuple[_Rules, _Base]:
    """Weight by the innovations of the baseline, so that costs are of order one."""
    fit = bench.fit((), {}, (bandwidth,), sd)
    rules = _Rules("disturbances", (bandwidth,), bandwidth, fit.noise_sd)
    return rules, _fit_base(bench, (), fit.point, rules)


def _fit_base(bench: Workbench, taken: tuple[Insertion, ...], guess: Mapping[str, float], rules: _Rules) -> _Base:
    fits: dict[float, Fit] = {}
    point = dict(guess)
    for bandwidth in rules.stages:
        fits[bandwidth] = bench.fit(taken, point, (bandwidth,), rules.sd)
        point = fits[bandwidth].point
    return _Base(taken, fits)


def _base_of(bench: Workbench, taken: tuple[Insertion, ...], winner: Candidate, rules: _Rules) -> _Base:
    assert winner.fit is not None
    together = (*taken, winner.insertion)
    if rules.regime == "disturbances":
        return _Base(together, {rules.screening: winner.fit})
    early = bench.fit(together, winner.fit.point, (rules.screening,), rules.sd)
    return _Base(together, {rules.screening: early, 0.0: winner.fit})


def _try_all(bench: Workbench, base: _Base, rules: _Rules, options: list[Insertion]) -> list[Candidate]:
    """Screen all, fit the most promising, and judge; the accepted one, if any, comes first."""
    screened = screen(bench, base.taken, base.fits[rules.screening].point, options, rules.screening, rules.sd)
    possible = [c for c in screened if not c.why_not]
    close = [c for c in possible[SHORTLIST:LONGLIST] if c.predicted > CLOSE * possible[0].predicted]
    shortlist = possible[:SHORTLIST] + close
    rest = [c for c in screened if c.why_not]
    rest += [replace(c, why_not="others promise more") for c in screened if not c.why_not and c not in shortlist]
    fitted = []
    for candidate in shortlist:
        try:
            fitted.append(_judge(bench, base, rules, candidate))
        except SolverError as error:
            rest.append(replace(candidate, why_not=f"its fit failed: {error}"))
    fitted.sort(key=lambda c: -c.gain)
    if fitted and not fitted[0].why_not:
        first = fitted[0]
        fitted[1:] = [replace(c, why_not=c.why_not or f"`{first.insertion.prefix}` explains more") for c in fitted[1:]]
    return fitted + rest


def _judge(bench: Workbench, base: _Base, rules: _Rules, candidate: Candidate) -> Candidate:
    together = (*base.taken, candidate.insertion)
    guess = base.fits[rules.screening].point | candidate.parameters
    stages = (rules.screening,) if rules.regime == "disturbances" else (rules.screening, 0.0)
    fit = bench.fit(together, guess, stages, rules.sd, candidate.parameters)
    parameters = {name: fit.values[name] for name in candidate.insertion.parameter_names}
    if rules.regime == "noise":
        gain, t = bic(base.fit) - bic(fit), _white_t(fit, candidate.insertion)
        change = f"falls by {gain:.1f}, less than {MIN_BIC_GAIN:g}" if gain > 0 else f"rises by {-gain:.1f}"
        why = "" if gain > MIN_BIC_GAIN else f"BIC {change}"
    else:
        gain, t = _disturbed_gain(bench, base, together, fit, rules)
        why = ""
        if gain < 100 * MIN_SHARE:
            why = f"it explains {gain:.1f} % of the cross-validated cost, less than {100 * MIN_SHARE:g} %"
        elif abs(t) < MIN_T:
            why = f"its size differs between parts of the data: {abs(t):.1f} jackknife sds from zero"
    if any(e.status == "at-bound" for e in fit.parameters if e.name in parameters):
        why = "its parameter ends on its bound, where it has no effect"
    return replace(candidate, parameters=parameters, gain=gain, t=t, fit=fit, why_not=why)


def _white_t(fit: Fit, insertion: Insertion) -> float:
    ratios = [abs(e.value) / e.sd for e in fit.parameters if e.name in insertion.parameter_names and e.sd > 0]
    return float(min(ratios, default=0.0))


def _disturbed_gain(
    bench: Workbench, base: _Base, together: tuple[Insertion, ...], fit: Fit, rules: _Rules
) -> tuple[float, float]:
    before = robust(base.fit, bench.solved(base.taken, base.fit, rules.sd))
    after = robust(fit, bench.solved(together, fit, rules.sd))
    own = [fit.values[name] / max(after.sd.get(name, np.inf), 1e-300) for name in together[-1].parameter_names]
    return 100 * (1 - after.cost / before.cost), min(own, key=abs)


def _aliases(winner: Candidate, ranked: list[Candidate]) -> tuple[str, ...]:
    """Return what the data cannot tell from the winner: places that move alike, effects as good within NEAR."""
    same = [f"{winner.insertion.card.id} at {place}" for place in winner.insertion.place.same_motion]
    close = [
        f"{other.insertion.card.id} at {other.insertion.place.at}"
        for other in ranked[1:]
        if other.fit is not None and winner.gain - other.gain < NEAR
    ]
    return (*same, *close)


def _prune(bench: Workbench, base: _Base, steps: list[Step], rules: _Rules) -> tuple[_Base, list[Step]]:
    """Take back each earlier addition that the model with the last one does without."""
    for step in list(steps[:-1]):
        fewer = tuple(i for i in base.taken if i.prefix != step.candidate.insertion.prefix)
        trial = _fit_base(bench, fewer, base.fits[rules.screening].point, rules)
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


def _swap(
    bench: Workbench, base: _Base, steps: list[Step], rules: _Rules, library: _Library
) -> tuple[_Base, list[Step]]:
    """Put another effect in the place of each earlier one if, with the last one in, it explains more.

    The first effect chosen soaks up a part of those still missing, and may be the wrong one of two alike.
    """
    for old in list(steps[:-1]):
        others = [s for s in steps if s is not old]
        fewer = tuple(s.candidate.insertion for s in others)
        without = _fit_base(bench, fewer, base.fits[rules.screening].point, rules)
        ranked = _try_all(bench, without, rules, candidates(*library, fewer))
        best = ranked[0] if ranked else None
        if best is None or best.why_not or best.fit is None or best.insertion.prefix == old.candidate.insertion.prefix:
            continue
        if _criterion(base.fit, rules) - _criterion(best.fit, rules) <= NEAR:
            continue
        base = _base_of(bench, fewer, best, rules)
        steps = [*others, Step(best, residuals(base.fit), _aliases(best, ranked))]
    return base, steps


def _criterion(fit: Fit, rules: _Rules) -> float:
    """Return what is compared between models of equal size: BIC, or percent of the cost of prediction."""
    return bic(fit) if rules.regime == "noise" else 100 * float(np.log(fit.chi2))
