"""With small disturbances everywhere: an effect must predict a large part of what the model without it gets wrong.

The errors are those of predictions, with the bandwidth of the output injection with which the most promising effects
together predict best. How sure an effect is, blocks of time tell that are left out one after the other.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cartpend_dae.discover.attempts import each
from cartpend_dae.discover.evidence import bic, robust
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# so many of the best predictions are fitted, in so many steps, and the best of them to the end
WIDE, NARROW, EARLY = 10, 4, 6
# predictions below this share of the best one are not fitted
FAINT = 0.03
# nor those below this share of the cost, a third of what they must explain
HOPELESS = 0.1
# share of the cross-validated cost that one effect must explain. On the measured axis EMPS effects that are there
# explain 42 to 94 % at bandwidths of 30 to 1000 rad/s, imitations of a missing one at most 22 %.
MIN_SHARE = 0.3
# jackknife standard deviations by which a size must differ from zero
MIN_T = 5.0
# percent of the cross-validated cost by which models may differ and explain the data alike
ALIKE = 1.0


def trials(
    bench: Workbench, taken: tuple[Insertion, ...], fit: Fit, options: list[Insertion], sd: np.ndarray
) -> list[Candidate]:
    """Screen all, fit the most promising, and judge; the accepted one, if any, comes first.

    Parameters
    ----------
    bench, taken, fit
        The workbench, and the model so far with its fit of predictions.
    options
        What may be added.
    sd
        Weight of each output, shape (n_y,).
    """
    bandwidth = float(fit.bandwidth[0])
    screened = screen(bench, taken, fit.point, options, bandwidth, sd)
    possible = [c for c in screened if not c.why_not]
    rest = [c for c in screened if c.why_not]
    least = max(FAINT * possible[0].predicted, HOPELESS * fit.chi2) if possible else 0.0
    wide = [c for c in possible[:WIDE] if c.predicted > least]
    rest += [replace(c, why_not="others promise more") for c in possible if c not in wide]
    for candidate in wide:
        bench.expect(candidate.parameters)
    early = each(bench, wide, lambda at, c: _tried(at, taken, fit, c, sd), "first fit")
    rest += [c for c in early if c.why_not]
    ranked = sorted((c for c in early if not c.why_not), key=lambda c: bic(c.fit) if c.fit else np.inf)
    rest += [replace(c, fit=None, why_not="others explain more at the first stage") for c in ranked[NARROW:]]
    judged = each(bench, ranked[:NARROW], lambda at, c: _judged(at, taken, fit, c, sd), "last fit")
    complete = [c for c in judged if c.fit is not None]
    return _ordered(complete) + [c for c in judged if c.fit is None] + rest


def explained(
    bench: Workbench, fewer: tuple[tuple[Insertion, ...], Fit], more: tuple[tuple[Insertion, ...], Fit], sd: np.ndarray
) -> tuple[float, Mapping[str, float]]:
    """Return which share of the cross-validated cost of a model one with more explains, and the jackknife sds there."""
    before = robust(fewer[1], bench.solved(*fewer, sd))
    after = robust(more[1], bench.solved(*more, sd))
    return 1 - after.cost / before.cost, after.sd


def _tried(
    bench: Workbench, taken: tuple[Insertion, ...], base: Fit, candidate: Candidate, sd: np.ndarray
) -> Candidate:
    together, guess = (*taken, candidate.insertion), base.point | candidate.parameters
    fit = bench.fit(together, guess, (float(base.bandwidth[0]),), sd, patient=False, iterations=EARLY)
    if not np.isfinite(fit.chi2):
        raise SolverError("its simulation diverges")
    return replace(candidate, fit=fit, early=fit.chi2)


def _judged(
    bench: Workbench, taken: tuple[Insertion, ...], base: Fit, candidate: Candidate, sd: np.ndarray
) -> Candidate:
    """Fit a candidate to the end and say whether it is worth its parameters."""
    together = (*taken, candidate.insertion)
    assert candidate.fit is not None
    fit = bench.fit(together, candidate.fit.point, (float(base.bandwidth[0]),), sd, patient=False)
    parameters = {name: fit.values[name] for name in candidate.insertion.parameter_names}
    share, sds = explained(bench, (taken, base), (together, fit), sd)
    t = min((value / max(sds.get(name, np.inf), 1e-300) for name, value in parameters.items()), key=abs)
    why = ""
    if share < MIN_SHARE:
        why = f"it explains {100 * share:.1f} % of the cross-validated cost, less than {100 * MIN_SHARE:g} %"
    elif abs(t) < MIN_T:
        why = f"its size differs between parts of the data: {abs(t):.1f} jackknife sds from zero"
    at_bound = [e.status == "at-bound" for e in fit.parameters if e.name in candidate.insertion.size_names]
    if at_bound and all(at_bound):
        why = "its parameter ends on its bound, where it has no effect"
    return replace(candidate, parameters=parameters, gain=100 * share, t=t, fit=fit, why_not=why)


def _ordered(judged: list[Candidate]) -> list[Candidate]:
    """Put the one to take first: of those that explain the data alike, the one with the fewest parameters."""
    judged = sorted(judged, key=lambda c: (bool(c.why_not), -c.gain))
    good = [c for c in judged if not c.why_not]
    if not good:
        return judged
    alike = [c for c in good if good[0].gain - c.gain < ALIKE]
    first = min(alike, key=lambda c: (c.insertion.complexity, -c.gain))
    others = [replace(c, why_not=c.why_not or _second(c, first)) for c in judged if c is not first]
    return [first, *others]


def _second(candidate: Candidate, first: Candidate) -> str:
    explains = "explains as much with fewer parameters" if candidate.gain > first.gain else "explains more"
    return f"`{first.insertion.prefix}` {explains}"
