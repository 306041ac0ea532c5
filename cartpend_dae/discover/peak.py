"""The peak at rest of a dry friction that leaves nothing but noise without it."""

from dataclasses import replace

from cartpend_dae.discover.bases import Library
from cartpend_dae.discover.choice import step_of
from cartpend_dae.discover.contact import is_dry
from cartpend_dae.discover.contradicted import contradicted
from cartpend_dae.discover.couple import as_fitted
from cartpend_dae.discover.evidence import bic, coloured_bic
from cartpend_dae.discover.gate import is_noise_alone, residuals
from cartpend_dae.discover.laws import joined
from cartpend_dae.discover.records import Candidate, Step
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.trial import MIN_BIC_GAIN
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, fits
from cartpend_dae.errors import SolverError

_Model = tuple[Base, list[Step]]


def with_peak_at_rest(bench: Workbench, base: Base, steps: list[Step], rules: Rules, library: Library) -> _Model:
    """Put a law with a peak at rest in the place of each dry friction without one, where the data tell the peak.

    Richer laws are not fitted where one leaves noise alone, whose size is known to some percent: so much of a peak may
    be left in it, and stick-slip in other runs is wrong. What it would explain to first order says whether to fit it
    (a score test), and then BIC must fall as for any addition.

    Parameters
    ----------
    bench
        The workbench.
    base, steps
        The model found, and its additions.
    rules
        How noise alone decides.
    library
        What may be added, and where.

    References
    ----------
    C. R. Rao, Math. Proc. Camb. Phil. Soc. 44 (1948), 50-57, doi:10.1017/S0305004100023987 (the score test).
    """
    if not is_noise_alone(base.fit):
        return base, steps
    for old in steps:
        card, place = old.candidate.insertion.card, old.candidate.insertion.place
        if card.peaks or not is_dry(card):
            continue
        laws = [other for other in library[0] if is_dry(other) and other.id != card.id and fits(other, place)]
        found = _peaked(bench, base, old, laws, rules)
        if found is not None:
            base, law = found
            steps = [step_of(law, residuals(base.fit), [law, old.candidate]) if step is old else step for step in steps]
    return base, steps


def _peaked(bench: Workbench, base: Base, old: Step, cards: list[Card], rules: Rules) -> tuple[Base, Candidate] | None:
    """Return the model with the best of some laws in the place of one, and that law; None if no peak is told."""
    good = _better(bench, base, old, [card for card in cards if card.peaks], rules)
    if good:
        good += _better(bench, base, old, [card for card in cards if not card.peaks], rules)
    return max(good, key=lambda model: model[1].gain, default=None)


def _better(bench: Workbench, base: Base, old: Step, cards: list[Card], rules: Rules) -> list[tuple[Base, Candidate]]:
    """Return the models with one of some laws in the place of one whose BIC is clearly less, and those laws."""
    told = old.candidate
    place = told.insertion.place
    laws = [Insertion(card, place, start) for card in cards for start in card.starts(place.kind)]
    others = tuple(i for i in base.taken if i.prefix != told.insertion.prefix)
    good: list[tuple[Base, Candidate]] = []
    for law in _promising(bench, base, laws, rules):
        point = base.fit.point | joined(law, told, base.fit.values)
        try:
            fit = bench.fit((*others, law.insertion), point, rules.descent, rules.sd, patient=False)
        except SolverError:
            continue
        gains = bic(base.fit) - bic(fit), coloured_bic(base.fit) - coloured_bic(fit)
        if min(gains) > MIN_BIC_GAIN and not contradicted(bench.setup.train, law.insertion, fit):
            after = Base((*others, law.insertion), {bench.last: fit}, base.bare)
            found = as_fitted(law, fit, base.fit)
            good.append((after, replace(found, gain=told.gain + found.gain)))
    return good


def _promising(bench: Workbench, base: Base, laws: list[Insertion], rules: Rules) -> list[Candidate]:
    """Return the laws that explain to first order what an addition must, beside the one that the model has."""
    if not laws:
        return []
    screened = screen(bench, base.taken, base.fit.point, laws, bench.last, rules.sd)
    return [c for c in screened if not c.why_not and c.predicted > MIN_BIC_GAIN]
