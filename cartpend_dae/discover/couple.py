"""Two effects at once: where no effect alone leaves noise, two of them may, of which each hides the other.

To first order each effect changes the residuals along one direction. Of all couples those are fitted that together
promise most; one that leaves nothing but noise is taken whole.
"""

from dataclasses import replace

import numpy as np

from cartpend_dae.discover.attempts import kept
from cartpend_dae.discover.bases import base_of, followed
from cartpend_dae.discover.choice import ALIKE, NEAR, SHAPE, SIMPLER, TOUCH, contains, step_beside, step_of
from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.contradicted import contradicted
from cartpend_dae.discover.disturbed import is_composite
from cartpend_dae.discover.evidence import bic, cancelled, plain_bic
from cartpend_dae.discover.gate import is_clean, is_noise_alone, residuals
from cartpend_dae.discover.nearest import left_early
from cartpend_dae.discover.nested import as_plain, holds, shared
from cartpend_dae.discover.promising import EARLY, Couple, beside, promising
from cartpend_dae.discover.rattle import is_all_that_tells
from cartpend_dae.discover.records import Candidate, Step
from cartpend_dae.discover.screen import UNSEEN
from cartpend_dae.discover.shape import is_far_from_noise, is_left_to_shape, is_shape_error, leaves_little
from cartpend_dae.discover.shortlist import chosen
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.trial import MIN_BIC_GAIN, is_absent
from cartpend_dae.discover.workbench import ROUGH, Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import UNSOLVED, SolverError
from cartpend_dae.identify import Fit

# so many of the best couples are fitted with less injection, in so many steps, and the best to the end
NARROW, LATER, LAST = 4, 12, 2
# where an effect leaves noise alone, couples that leave so many times more than it are not fitted any further: after
# the first steps, with much injection, and then
FIRST_BEHIND, BEHIND = 1.5, 1.1
# a rough fit that leaves more than so many times noise leaves something else, unless it is white
LOOSE = 2.0


def couple(
    bench: Workbench, base: Base, rules: Rules, options: list[Insertion], ranked: list[Candidate], stage: float
) -> tuple[Base, list[Step]] | None:
    """Return the model with two more effects that together leave nothing but noise, and both steps.

    Parameters
    ----------
    bench
        The workbench.
    base
        The model so far, in the regime of noise.
    rules
        How to fit and decide.
    options
        What may be added, from each of its starts.
    ranked
        Candidates of this round, the best first.
    stage
        Bandwidth of the output injection at which they were screened [rad/s].
    """
    best = next((c for c in ranked[:1] if c.fit is not None and not c.why_not), None)
    if best is not None and best.fit is not None:
        is_left = not is_composite(best.insertion) and (
            is_left_to_shape(base.bare, best.fit) or is_all_that_tells(bench, base.bare, best.fit)
        )
        if is_left or is_noise_alone(best.fit):
            few, lower = _instead(bench, base, rules, options, best, ranked, stage)
            return _whole(bench, base, rules, few, ranked, lower, best) if few else None
    made = _whole(bench, base, rules, promising(ranked), ranked, stage)
    if made is not None:
        return made
    few, lower = beside(bench, base, rules, options, ranked, stage)
    return _whole(bench, base, rules, few, ranked, lower)


def _whole(
    bench: Workbench,
    base: Base,
    rules: Rules,
    few: list[Couple],
    ranked: list[Candidate],
    stage: float,
    alone: Candidate | None = None,
) -> tuple[Base, list[Step]] | None:
    """Return the model with the plainest of some couples that leaves nothing but noise; see `couple`.

    Where one effect does so `alone`, couples need no more parameters, and leave hardly more at each stage.
    """
    most = np.inf if alone is None else alone.insertion.complexity
    for pair in few:
        for part in (pair.one, pair.other):
            bench.expect({name: pair.parameters[name] for name in part.insertion.parameter_names})
    few = _fitted(bench, base, rules, few, (stage,), (EARLY, ROUGH))[:NARROW]
    more = [c for c in richer(few, ranked) if c.n_parameters <= most]
    rich = _fitted(bench, base, rules, more, (stage,), (EARLY, ROUGH))
    few = [c for c in (*rich, *few) if c.fit is not None and _may_leave_noise(c.fit)]
    few = _not_behind(bench, base, rules, few, alone, (stage, EARLY, FIRST_BEHIND))
    few += chosen_anew(few)
    least = bench.last or min(w for w in rules.stages if w > 0)
    few = _fitted(bench, base, rules, few, (least,), (LATER, ROUGH))[:LAST]
    few = _not_behind(bench, base, rules, few, alone, (least, LATER, BEHIND))
    close = [c for c in few[:1] if c.fit is not None and c.fit.chi2 < LOOSE * c.fit.n_residuals]
    last = _fitted(bench, base, rules, few, (bench.last,), None)
    few = [c for c in last if c.fit is not None and is_noise_alone(c.fit)]
    # what leaves hardly anything, though far more than noise, may lack the peak of a friction
    close = close or [c for c in last[:1] if c.fit is not None and leaves_little(base.bare, c.fit)]
    if close and not few:
        more = [c for c in next_richer(close[0], ranked) if c.n_parameters <= most]
        rich = _fitted(bench, base, rules, more, (least,), (LATER, ROUGH))[:LAST]
        rich = _fitted(bench, base, rules, rich, (bench.last,), None)
        few = [c for c in rich if c.fit is not None and is_noise_alone(c.fit)]
    few = few or [c for c in last[:1] if c.fit is not None and is_left_to_shape(base.bare, c.fit)]
    few += _with_plainer(bench, base, rules, few, ranked)
    best = next((c for c in ranked[:1] if not c.why_not), None)
    good = [c for c in few if _is_better(c, best)]
    for found in sorted(good, key=lambda c: (c.n_parameters, c.fit.chi2 if c.fit else np.inf)):
        made = _made(bench, base, rules, found, ranked)
        if made is not None:
            return made
    return None


def _not_behind(
    bench: Workbench,
    base: Base,
    rules: Rules,
    couples: list[Couple],
    alone: Candidate | None,
    at: tuple[float, int, float],
) -> list[Couple]:
    """Leave out couples that leave so many times more, after as many steps at a stage, than an effect does alone."""
    if alone is None or not couples:
        return couples
    stage, iterations, times = at
    taken, guess = (*base.taken, alone.insertion), base.fits.get(stage, base.fit).point | alone.parameters
    try:
        fit = bench.fit(taken, guess, (stage,), rules.sd, patient=False, iterations=iterations, stride=ROUGH)
    except SolverError:  # on such steps it diverges, and nothing can be compared with it
        return couples
    return [c for c in couples if c.fit is not None and c.fit.chi2 < times * fit.chi2]


def _may_leave_noise(fit: Fit) -> bool:
    """Return whether a rough fit leaves little or, as strong injection makes the noise itself large, what is white."""
    return fit.chi2 < LOOSE * fit.n_residuals or not residuals(fit).is_passed


def richer(couples: list[Couple], ranked: list[Candidate]) -> list[Couple]:
    """Return couples with the law in the place of a plainer one that alone explained more, as roughly as they are."""
    found: list[Couple] = []
    for pair in couples:
        assert pair.fit is not None
        n = pair.fit.n_residuals
        for part, other in ((pair.one, pair.other), (pair.other, pair.one)):
            able = [c for c in ranked if c.early is not None and c.begun and _is_case(part, c, ranked)]
            rich = min(able, key=lambda c: _roughly(c, n), default=None)
            if rich is not None and _roughly(rich, n) < _roughly(part, n) - MIN_BIC_GAIN:
                values = {name: rich.begun[name] for name in rich.insertion.parameter_names}
                found.append(Couple(rich, other, pair.predicted, {**pair.fit.point, **values}))
    return found


def next_richer(pair: Couple, ranked: list[Candidate]) -> list[Couple]:
    """Return couples with each next richer law of a contact in the place of one, from where the couple was fitted."""
    found: list[Couple] = []
    for part, other in ((pair.one, pair.other), (pair.other, pair.one)):
        plain = replace(part, fit=pair.fit)
        laws = {c.insertion.prefix: c for c in ranked if holds(c, plain) and is_other_law(c, plain)}
        for law in laws.values():
            values = as_plain(law.insertion, plain)
            point = {} if pair.fit is None else pair.fit.point
            found.append(Couple(law, other, pair.predicted, {**point, **values}))
    return found


def _roughly(candidate: Candidate, n: int) -> float:
    """Return BIC of a candidate's first fit to `n` residuals, without what all have; infinite without one."""
    left = left_early(candidate)
    return n * np.log(left / n) + len(candidate.insertion.parameter_names) * np.log(n) if left > 0 else np.inf


def chosen_anew(couples: list[Couple]) -> list[Couple]:
    """Return couples in which an effect has others of its choices."""
    found: list[Couple] = []
    for pair in couples:
        found += [replace(pair, one=c) for c in pair.one.others if chosen(c) != chosen(pair.one)]
        found += [replace(pair, other=c) for c in pair.other.others if chosen(c) != chosen(pair.other)]
    return found


def _with_plainer(
    bench: Workbench, base: Base, rules: Rules, couples: list[Couple], ranked: list[Candidate]
) -> list[Couple]:
    """Return couples in which a plainer law does as well in the place of one that contains it.

    Beside the other effect it may, though alone it promised nothing. Where both leave more than noise, it need not do
    better than laws may be wrong by.
    """
    found: list[Couple] = []
    for pair in couples[:1]:
        assert pair.fit is not None
        able: list[Couple] = []
        for part, other in ((pair.one, pair.other), (pair.other, pair.one)):
            rich = replace(part, fit=pair.fit)
            told = [(c, shared(c.insertion, rich)) for c in ranked if _is_case(c, rich, ranked)]
            able += [Couple(c, other, pair.predicted, {**pair.fit.point, **values}) for c, values in told]
        able = [c for c in able if c.n_parameters < pair.n_parameters]
        # the richer law may have taken up what the model has besides, such as its viscous friction: they begin far off
        fitted = _fitted(bench, base, rules, able, rules.descent, None) if able else []
        if is_noise_alone(pair.fit):
            found += [c for c in fitted if c.fit and bic(c.fit) < bic(pair.fit) + NEAR and is_clean(c.fit)]
        else:
            found += [c for c in fitted if _is_shapeless(bench, base, rules, c, pair)]
    return found


def _is_shapeless(bench: Workbench, base: Base, rules: Rules, plain: Couple, rich: Couple) -> bool:
    """Return whether a couple with a plainer law leaves no more than laws may be wrong by, beside a richer one."""
    assert plain.fit is not None and rich.fit is not None
    noise, more = rich.fit.n_residuals, plain.fit.chi2 - rich.fit.chi2
    if plain.fit.chi2 - noise > SIMPLER * (rich.fit.chi2 - noise):
        return False
    without = followed(bench, (*base.taken, plain.other.insertion), plain.fit.point, rules, base.bare)
    return without is not None and more < SHAPE * (without.fit.chi2 - rich.fit.chi2)


def _instead(
    bench: Workbench,
    base: Base,
    rules: Rules,
    options: list[Insertion],
    best: Candidate,
    ranked: list[Candidate],
    stage: float,
) -> tuple[list[Couple], float]:
    """Return couples that may explain with no more parameters what the best effect does alone, and a bandwidth.

    Either it does several things at once, or it is a rich law, and one of the couple is a case of it. The rest is as of
    `beside`.
    """
    few, lower = promising(ranked), stage
    if not is_composite(best.insertion):
        cases = [c for c in ranked if c.early is not None and _is_case(c, best, ranked)]
        few, lower = beside(bench, base, rules, options, cases, stage)
    return [pair for pair in few if pair.n_parameters <= best.insertion.complexity], lower


def _is_case(part: Candidate, rich: Candidate, ranked: list[Candidate]) -> bool:
    return contains(rich, part, ranked) and part.insertion.prefix != rich.insertion.prefix


def _is_better(both: Couple, best: Candidate | None) -> bool:
    """Return whether two effects explain more than the best one alone, or as much more plainly."""
    if best is None or best.fit is None:
        return True
    assert both.fit is not None
    gain = bic(best.fit) - bic(both.fit)
    if both.n_parameters < best.insertion.complexity and (is_composite(best.insertion) or gain > ALIKE):
        return True
    return gain > MIN_BIC_GAIN


def simpler(
    bench: Workbench, base: Base, rules: Rules, steps: list[Step], ranked: list[Candidate], tried: list[Candidate]
) -> tuple[Base, list[Step]] | None:
    """Return the model with a plainer law in the place of an earlier one and an effect that was refused beside that.

    A rich law takes up what another effect does, which beside it seems to be no more than its shape. Both together
    leave nothing but noise then, with no more parameters. Arguments are those of `couple`; `tried` are all candidates.
    """
    refused = [c for c in ranked if c.fit is not None and c.why_not and is_noise_alone(c.fit)]
    for step in steps:
        rich, others = step.candidate, [s for s in steps if s is not step]
        taken = tuple(s.candidate.insertion for s in others)
        there = {insertion.prefix for insertion in taken}
        plain = [c for c in plainer(step, tried) if c.insertion.prefix not in there]
        couples = [
            Couple(one, other, 0.0, {**other.fit.point, **as_plain(one.insertion, rich)})
            for other in refused
            for one in plain
            if other.fit is not None
        ]
        few = [pair for pair in couples if pair.n_parameters <= rich.insertion.complexity]
        if not few:
            continue
        without = followed(bench, taken, base.fit.point, rules, base.bare)
        if without is None:
            continue
        few = _fitted(bench, without, rules, few, (max(rules.stages),), (LATER, ROUGH))[:LAST]
        few = _fitted(bench, without, rules, few, rules.stages, None)
        for found in few:
            made = found.fit is not None and is_noise_alone(found.fit) and _made(bench, without, rules, found, [rich])
            if made:
                return made[0], [*others, *made[1]]
    return None


def plainer(step: Step, tried: list[Candidate]) -> list[Candidate]:
    """Return those of some candidates that the law of a step contains, and that the model has not anyway."""
    rich = step.candidate
    return [c for c in tried if _is_case(c, rich, tried) and c.why_not != UNSEEN]


def _fitted(
    bench: Workbench,
    base: Base,
    rules: Rules,
    couples: list[Couple],
    stages: tuple[float, ...],
    rough: tuple[int, float] | None,
) -> list[Couple]:
    """Return couples with their fits along stages, those that leave least first; those that fail are left out."""
    iterations, stride = rough or (None, None)

    def attempt(pair: Couple) -> Fit | None:
        together = (*base.taken, pair.one.insertion, pair.other.insertion)
        before = base.fits.get(stages[0], base.fit)
        guess = before.point | dict(pair.parameters) if pair.fit is None else pair.fit.point
        try:
            return bench.fit(together, guess, stages, rules.sd, patient=False, iterations=iterations, stride=stride)
        except UNSOLVED:
            return None

    bench.begin("couples", len(couples))
    depends = [
        (
            "couple",
            [i.prefix for i in base.taken],
            [c.insertion.content for c in (pair.one, pair.other)],
            dict(pair.parameters),
            None if pair.fit is None else pair.fit.point,
            base.fit.point,
            stages,
            iterations,
        )
        for pair in couples
    ]
    fits = kept(bench, "couple", depends, attempt, couples)
    found = [replace(pair, fit=fit) for pair, fit in zip(couples, fits, strict=True) if fit is not None]
    found = [pair for pair in found if pair.fit is not None and np.isfinite(pair.fit.chi2)]
    return sorted(found, key=lambda pair: plain_bic(pair.fit, pair.one.insertion, pair.other.insertion))


def _made(
    bench: Workbench, base: Base, rules: Rules, both: Couple, ranked: list[Candidate]
) -> tuple[Base, list[Step]] | None:
    """Return the model with a couple in it, if neither effect can be left out, nor is the shape of one law.

    Neither may end on its bounds. What is left without one of them must be more than laws may be wrong by, or both
    together have no more parameters than the law that explains most alone. Where one does it alone from here, which it
    did not from its own starts, it is taken.
    """
    fit, parts = both.fit, (both.one, both.other)
    assert fit is not None
    if any(contradicted(bench.setup.train, part.insertion, fit) or is_absent(fit, part.insertion) for part in parts):
        return None
    if cancelled(fit, parts[0].insertion, (*base.taken, parts[1].insertion)):
        return None
    lone = [c for c in ranked if c.fit is not None and not c.why_not]
    is_plain = bool(lone) and both.n_parameters <= lone[0].insertion.complexity
    done: list[Candidate] = []
    alone: list[Candidate] = []
    for part, rest in (parts, parts[::-1]):
        other = followed(bench, (*base.taken, rest.insertion), fit.point, rules, base.bare)
        if other is None:  # whether it matters cannot be told
            return None
        without = other.fit
        gain, share = bic(without) - bic(fit), (without.chi2 - fit.chi2) / max(base.bare - fit.chi2, 1e-300)
        is_shape = share < TOUCH and not is_plain and not is_far_from_noise(without, fit)
        if not is_noise_alone(fit):
            is_shape = share < SHAPE or fit.chi2 - fit.n_residuals > SHAPE * (without.chi2 - fit.chi2)
        if gain < MIN_BIC_GAIN and is_noise_alone(without):
            alone.append(as_fitted(rest, without, base.fit))
        elif gain < MIN_BIC_GAIN or is_shape:
            return None
        done.append(replace(as_fitted(part, fit, base.fit), gain=gain))
    if alone:
        best = max(alone, key=lambda c: c.gain)
        if best.fit is not None and is_shape_error(base, best.fit):
            return None
        after = base_of(bench, base, base.taken, best, rules)
        others = [c for c in ranked if c.insertion.prefix != best.insertion.prefix]
        return after, [step_of(best, residuals(after.fit), [best, *others])]
    done.sort(key=lambda c: -c.gain)
    after = base_of(bench, base, (*base.taken, done[0].insertion), done[1], rules)
    gate = residuals(after.fit)
    taken = {insertion.prefix for insertion in after.taken}
    others = [c for c in ranked if c.insertion.prefix not in taken]
    return after, [step_beside(part, gate, others) for part in done]


def as_fitted(part: Candidate, fit: Fit, before: Fit) -> Candidate:
    """Return a candidate with a fit of the model that has it, and what that gained on the one before."""
    values = {name: fit.values[name] for name in part.insertion.parameter_names}
    return replace(part, parameters=values, gain=bic(before) - bic(fit), fit=fit, why_not="")
