"""The fits that make up the model so far, and which of several places of an effect leaves most to others."""

import contextlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cartpend_dae.discover.choice import is_tied
from cartpend_dae.discover.disturbed import fitted, polished, reweighed
from cartpend_dae.discover.gate import is_noise_alone, residuals
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.screen import candidates, screen
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.weigh import loads_at
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, Place
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# stages of decreasing output injection before the last, in units of the dominant frequency, or of the last if more
STAGES = (5.0, 2.0, 0.7)
Library = tuple[tuple[Card, ...], tuple[Place, ...]]


def noise_rules(bench: Workbench, places: tuple[Place, ...], last: float) -> Rules:
    """Return how to fit and decide where noise is all that is left, at the `last` bandwidth [rad/s]."""
    frequency = max(bench.frequency, last)
    before = tuple(share * frequency for share in STAGES)
    stages = (*(w for w in before if w > last), last)
    return Rules("noise", stages, stages[min(1, len(stages) - 1)], bench.problem(()).prior_sd, loads_at(places))


def fit_base(bench: Workbench, taken: tuple[Insertion, ...], guess: Mapping[str, float], rules: Rules) -> Base:
    """Fit the model with effects, stage by stage from a guess, as the rules want it."""
    if rules.regime == "forces":
        first = fitted(bench, taken, rules.loads, guess, rules.screening, rules.sd)
        fit, weighed = polished(bench, taken, rules.loads, first, rules.sd)
        return Base(taken, {float(fit.bandwidth[0]): fit}, 0.0, weighed)
    fits: dict[float, Fit] = {}
    point = dict(guess)
    for bandwidth in rules.stages:
        fits[bandwidth] = bench.fit(taken, point, (bandwidth,), rules.sd, patient=not taken)
        point = fits[bandwidth].point
    return Base(taken, fits)


def followed(
    bench: Workbench, taken: tuple[Insertion, ...], guess: Mapping[str, float], rules: Rules, bare: float
) -> Base | None:
    """Return a model with some effects and its fits, as of `fit_base`, or None where it diverges without the others.

    `bare` is the cost of the model without any.
    """
    try:
        return replace(fit_base(bench, taken, guess, rules), bare=bare)
    except SolverError:
        return None


def noise_alone(bench: Workbench, base: Base, rules: Rules) -> Base | None:
    """Return the model without random forces, if it leaves noise alone so: then nothing else moves the rig."""
    if rules.alone is None or not base.taken:
        return None
    after = followed(bench, base.taken, base.fit.point, rules.alone, base.bare)
    return after if after is not None and is_noise_alone(after.fit) else None


def base_of(bench: Workbench, before: Base, taken: tuple[Insertion, ...], winner: Candidate, rules: Rules) -> Base:
    """Return the model with a candidate in it that was fitted to the end, and its fits at the stages before that."""
    assert winner.fit is not None
    together = (*taken, winner.insertion)
    if rules.regime == "disturbances":
        return Base(together, {rules.screening: winner.fit}, before.bare)
    if rules.regime == "forces":
        found = reweighed(bench, together, rules.loads, winner.fit, rules.sd)
        fit, weighed = polished(bench, together, rules.loads, found, rules.sd)
        return Base(together, {float(fit.bandwidth[0]): fit}, before.bare, weighed)
    stages = [w for w in rules.stages if bench.last < w <= rules.screening]
    fits: dict[float, Fit] = {}
    for w in stages:
        with contextlib.suppress(SolverError):  # it is the stage that diverges: one with less injection serves
            fits[w] = bench.fit(together, winner.fit.point, (w,), rules.sd, patient=False)
    return Base(together, {**fits, bench.last: winner.fit}, before.bare)


def place_with_a_future(
    bench: Workbench, base: Base, ranked: list[Candidate], rules: Rules, library: Library
) -> list[Candidate]:
    """Put first, of an effect at places that cannot be told apart yet, that with which another one explains most.

    What is missing besides may hide behind the wrong one of them.
    """
    winner = ranked[0]
    if rules.regime != "noise" or winner.fit is None or not residuals(winner.fit).is_passed:
        return ranked
    tied = [winner, *(c for c in ranked[1:] if c.insertion.card.id == winner.insertion.card.id and is_tied(c, winner))]
    if len(tied) == 1:
        return ranked
    left: list[float] = []
    for candidate in tied:
        after = base_of(bench, base, base.taken, candidate, rules)
        w = max(w for w in after.fits if w <= rules.screening)
        fit, options = after.fits[w], candidates(*library, after.taken)
        screened = screen(bench, after.taken, fit.point, options, w, rules.sd)
        left.append(fit.chi2 - max((c.predicted for c in screened if not c.why_not), default=0.0))
    first = tied[int(np.argmin(left))]
    others = [
        c if c.why_not else replace(c, why_not=f"`{first.insertion.prefix}` leaves more to others") for c in ranked
    ]
    return [replace(first, why_not=""), *(c for c in others if c.insertion.prefix != first.insertion.prefix)]
