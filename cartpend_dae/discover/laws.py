"""Which law the friction of a contact follows, where small disturbances move the rig.

Without friction in the model its motion is so far off that slopes tell little of the shape of a law, and many starts
lead nowhere. So other laws are screened beside the one found, along the motion that it makes likeliest: what they
promise there is what is wrong with it, and at which speed, place or direction.
"""

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from cartpend_dae.discover.attempts import each
from cartpend_dae.discover.bases import Library, base_of
from cartpend_dae.discover.choice import step_of
from cartpend_dae.discover.contact import is_dry, is_other_law
from cartpend_dae.discover.contradicted import contradicted
from cartpend_dae.discover.couple import as_fitted
from cartpend_dae.discover.disturbed import ALIKE, fitted, polished, reweighed
from cartpend_dae.discover.evidence import determined, leaves_clearly_less
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.iterated import can_follow
from cartpend_dae.discover.nested import WAYS, as_plain, holds, shared
from cartpend_dae.discover.records import Candidate, Step
from cartpend_dae.discover.regime import sampling_rate
from cartpend_dae.discover.screen import candidates, screen
from cartpend_dae.discover.shortlist import best_of_each, corrected, with_others
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.weigh import Weighed
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import UNSOLVED, SolverError
from cartpend_dae.identify import Fit

# so many other laws are fitted, of those that promise more than this of -2 ln likelihood beside the one found
FEW, LEAST = 4, 10.0
# ... and again beside the one that takes its place, so often at most
ROUNDS = 3
WORSE = "parts of the data left out are predicted worse with it"
# with more injection each sample is corrected by all of its error: with Coulomb friction for a peak at rest, which left
# half as much of a measured motor, 15,400 more of -2 ln likelihood
BLIND = "forces faster than the samples explain everything with it, and tell none of its laws"


def lawful(
    bench: Workbench, base: Base, steps: list[Step], rules: Rules, noise: Rules, library: Library
) -> tuple[Base, list[Step]]:
    """Put the likeliest law of its contact in the place of each dry friction found, unless the runs are too long.

    Parameters
    ----------
    bench
        The workbench.
    base, steps
        The model so far, and its additions.
    rules, noise
        How the regime decides, and how noise alone does, with the forces that may act.
    library
        What may be added, and where.
    """
    for old in list(steps) if can_follow(bench) else []:
        if not is_dry(old.candidate.insertion.card):
            continue
        others = tuple(i for i in base.taken if i.prefix != old.candidate.insertion.prefix)
        told, weighing = replace(old.candidate, fit=base.fit), bench.on("weighed")
        try:
            first, ranked = likeliest_law(weighing, others, told, candidates(*library, others), noise)
            if first is told:
                continue
            after, found = _instead(bench, base, others, told, first, rules)
            if rules.regime != "forces" and leaves_clearly_less(base.fit, after.fit):
                continue  # forces do what friction would, or take up what is wrong with its shape
            base = after
        except (*UNSOLVED, np.linalg.LinAlgError):  # with one of them the model diverges, and the one found stands
            continue
        steps = [step_of(found, residuals(base.fit), ranked) if step is old else step for step in steps]
    return base, steps


def _instead(
    bench: Workbench,
    base: Base,
    others: tuple[Insertion, ...],
    told: Candidate,
    first: Candidate,
    rules: Rules,
) -> tuple[Base, Candidate]:
    """Return the model with another law in the place of one, and that law as the regime judges it."""
    if rules.regime == "forces":
        after = base_of(bench.on(rules.weighing), base, others, first, rules)
        return after, replace(first, gain=told.gain + first.gain)
    assert first.fit is not None
    together, bandwidth = (*others, first.insertion), rules.stages[-1]
    # along what forces make likely another optimum may be nearer than the one where the law found before ended
    before = base.fit.point | first.parameters | shared(first.insertion, told)
    fits: list[Fit] = []
    for guess in (first.fit.point, before):
        with contextlib.suppress(SolverError):
            fits.append(bench.fit(together, guess, rules.descent, rules.sd, patient=False))
    if not fits:
        raise SolverError("The model with another law of friction diverges.")
    fit = min(fits, key=lambda one: one.chi2)
    found = as_fitted(first, fit, base.fit)
    return replace(base, taken=together, fits={bandwidth: fit}), replace(found, gain=told.gain + found.gain)


def likeliest_law(
    bench: Workbench, others: tuple[Insertion, ...], told: Candidate, options: list[Insertion], rules: Rules
) -> tuple[Candidate, list[Candidate]]:
    """Return the law that explains most against random forces, of those of a contact, and all that were fitted.

    Laws that explain the data alike, with -2 ln likelihood within `ALIKE`, are told apart by their parameters: the one
    with the fewest is taken.

    Parameters
    ----------
    bench
        The workbench, with the steps on which models are weighed.
    others
        Other effects in the model.
    told
        The law found, with a fit to begin at.
    options
        What may be in its place.
    rules
        Random forces that may act, and weights; the stage of screening is where fits begin.

    Returns
    -------
    Candidate
        With the fit against random forces, and the gain against the one told; or `told` as it is, if no other one is
        better.

    Raises
    ------
    SolverError
        If the model with the law found diverges where it is weighed.
    """
    laws = [option for option in options if is_other_law(replace(told, insertion=option), told)]
    laws = [law for law in laws if law.place.at == told.insertion.place.at]
    if not any(law.prefix != told.insertion.prefix for law in laws):
        return told, []
    assert told.fit is not None
    start = fitted(bench, (*others, told.insertion), rules.loads, told.fit.point, rules.screening, rules.sd)
    first, pool, zero = told, list[Candidate](), None
    for _ in range(ROUNDS):
        fit, weighed = polished(bench, (*others, first.insertion), rules.loads, start, rules.sd)
        zero = weighed.criterion if zero is None else zero
        first = replace(first, fit=fit, gain=zero - weighed.criterion, why_not="")
        new = [law for law in laws if law.prefix != first.insertion.prefix]
        promising = beside(bench, others, first, (fit, weighed), new, rules)
        starts = [*promising, *_plainer(first, new), *_richer(first, new, promising)]
        starts = [replace(law, gain=first.gain) for law in starts]  # results are kept by what they follow from

        work = partial(_judged, others=others, near=(fit, weighed), rules=rules, zero=zero)
        judged = each(bench, starts, work, "law of a contact")
        pool = best_of_each([first, *pool, *judged], lambda c: -c.gain)
        best = _plainest([c for c in pool if c.fit is not None and not c.why_not])
        if best.insertion.prefix == first.insertion.prefix or best.fit is None:
            break
        first, near = best, weighed.forces
        start = reweighed(bench, (*others, first.insertion), rules.loads, best.fit, rules.sd, near=near)
    return (told if first.insertion.prefix == told.insertion.prefix else first), pool


def _judged(
    bench: Workbench,
    law: Candidate,
    *,
    others: tuple[Insertion, ...],
    near: tuple[Fit, Weighed],
    rules: Rules,
    zero: float,
) -> Candidate:
    """Fit a law against random forces from where another one ended; `zero` is -2 ln likelihood where its gain is 0."""
    before, weighed = near
    together, guess = (*others, law.insertion), before.point | law.parameters
    bandwidth = float(before.bandwidth[0])
    fit, after = fitted(bench, together, rules.loads, guess, bandwidth, rules.sd, near=weighed.forces)
    values = {name: fit.values[name] for name in law.insertion.parameter_names}
    is_overfitted = after.criterion < weighed.criterion and after.validated > weighed.validated
    why = WORSE if is_overfitted else contradicted(bench.setup.train, law.insertion, fit)
    why = BLIND if float(fit.bandwidth[0]) > sampling_rate(bench) else why
    return replace(law, parameters=values, gain=zero - after.criterion, fit=fit, why_not=why)


def _plainest(good: list[Candidate]) -> Candidate:
    """Return the law with the fewest parameters of those that explain the data as the best one does."""
    most = max(c.gain for c in good)
    return min((c for c in good if most - c.gain < ALIKE), key=lambda c: (determined(c.fit), -c.gain))


def beside(
    bench: Workbench,
    others: tuple[Insertion, ...],
    told: Candidate,
    found: tuple[Fit, Weighed],
    laws: list[Insertion],
    rules: Rules,
) -> list[Candidate]:
    """Return the most promising other laws of a contact, from where they do, beside the law found and its fit."""
    fit, weighed = found
    together, bandwidth = (*others, told.insertion), float(fit.bandwidth[0])
    screened = screen(bench, together, fit.point, laws, bandwidth, rules.sd, weighed=weighed)
    promising = [c for c in screened if not c.why_not and c.predicted > LEAST][:FEW]
    return [replace(c, parameters=joined(c, told, fit.values)) for c in with_others(promising)]


def joined(law: Candidate, told: Candidate, values: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of a law that does what it would beside another one, and what that does."""
    known = {name.rpartition(".")[2]: values[name] for name in told.insertion.parameter_names}
    kind, peaks = law.insertion.place.kind, law.insertion.card.peaks
    found: dict[str, float] = {}
    for item in law.insertion.parameters:
        short = item.names[kind]
        name = f"{law.insertion.prefix}.{short}"
        stems = (short, *(short.removesuffix(way) for way in WAYS), peaks.get(short, short))
        before = next((known[stem] for stem in stems if stem in known), 0.0) if item.role == "size" else 0.0
        low, high = item.bounds_at(kind)
        found[name] = float(np.clip(before + law.parameters[name], low, high))
    return found


def _plainer(told: Candidate, laws: list[Insertion]) -> list[Candidate]:
    """Return the laws that one contains, from its own fit."""
    plain = [Candidate(law, law.starts, 0.0, 0.0, 0.0, None, "") for law in laws]
    return [replace(c, parameters=c.parameters | shared(c.insertion, told)) for c in plain if holds(told, c)]


def _richer(told: Candidate, laws: list[Insertion], promising: list[Candidate]) -> list[Candidate]:
    """Return the laws that contain one and promise nothing beside it, from its own fit and each of their starts.

    Where the motion with the one found is still far off, nothing promises anything; waves are not told by few starts.
    """
    known = {c.insertion.prefix for c in promising}
    rich = [Candidate(law, law.starts, 0.0, 0.0, 0.0, None, "") for law in laws if law.prefix not in known]
    rich = [c for c in rich if holds(c, told) and not any(item.role == "wave" for item in c.insertion.card.parameters)]
    rich = [replace(c, parameters=as_plain(c.insertion, told)) for c in rich]
    return [one for c in rich for one in (c, *corrected(c))]
