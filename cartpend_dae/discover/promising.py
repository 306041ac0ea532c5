"""Which two effects may explain together what none does alone.

To first order each effect changes the residuals along one direction: of all couples those promise most that together
explain most. Of effects that are far from small, one is taken as it was fitted, and what promises most beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cartpend_dae.discover.choice import are_parallel, contains
from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.disturbed import is_composite
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.nearest import left_early
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.shortlist import each_wave
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.workbench import ROUGH, Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import UNSOLVED
from cartpend_dae.identify import Fit

# so many couples are fitted, of which one is fitted in so many steps to see what shows beside it
WIDE, EARLY = 10, 8
# beside so many effects, as fitted, so many others are tried each
FIRST, SECOND = 3, 4
# a plainer law that promises this share of a richer one stands for it
PLAIN = 0.5
# of parallel effects, whose sum is open, there is no couple; and those that are the same here are tried once
ALIGNED, SAME = 0.999, 1 - 1e-6
# what leaves so many times noise with injection is not hidden by it
HELD = 3.0


@dataclass(frozen=True, slots=True)
class Couple:
    """Two candidates, by how much the cost would fall with both, and their fit."""

    one: Candidate
    other: Candidate
    predicted: float
    parameters: Mapping[str, float]
    fit: Fit | None = None

    @property
    def n_parameters(self) -> int:
        """Number of parameters of both effects."""
        return self.one.insertion.complexity + self.other.insertion.complexity


def may_be_two(base: Base, rules: Rules, stage: float, last: float) -> bool:
    """Return whether two effects may explain what is left, screened at `stage`: with injection some effect shows, too.

    Where none does, though far more than noise is left with it, what moves the rig is in no effect. Only the free
    simulation at the `last` stage seems to tell then, in which a small push is felt ever after.
    """
    held = [fit for bandwidth, fit in base.fits.items() if last < bandwidth <= rules.screening]
    return stage > last or not held or any(fit.chi2 < HELD * fit.n_residuals for fit in held)


def promising(ranked: list[Candidate]) -> list[Couple]:
    """Return the couples that promise most, each parameter at its price of BIC; a plain law stands for richer ones."""
    able = [c for c in ranked if c.response is not None and c.predicted > 0 and not is_composite(c.insertion)]
    able = [c for c in each_wave(_plain(able)) if c.response is not None]
    able.sort(key=lambda c: (c.insertion.complexity, -c.predicted))
    able = [c for k, c in enumerate(able) if not any(_is_twin(c, d) for d in able[:k])]
    if len(able) < 2:
        return []
    directions = np.column_stack([c.response for c in able if c.response is not None])
    products, alone = directions.T @ directions, np.sqrt([c.predicted for c in able])
    price = np.log(len(directions))
    found: list[tuple[float, Couple]] = []
    for i, j in combinations(range(len(able)), 2):
        one, other, cosine = able[i], able[j], products[i, j]
        if is_other_law(one, other) or are_parallel(one, other, ALIGNED):  # as two starts of one are
            continue
        sizes = np.linalg.solve([[1.0, cosine], [cosine, 1.0]], alone[[i, j]])
        if not np.all(sizes > 0):  # one of them would go the wrong way
            continue
        shares = sizes / alone[[i, j]]
        both = Couple(one, other, float(sizes @ alone[[i, j]]), _scaled(one, shares[0]) | _scaled(other, shares[1]))
        found.append((both.predicted - price * both.n_parameters, both))
    return [both for _, both in sorted(found, key=lambda pair: -pair[0])[:WIDE]]


def _is_twin(one: Candidate, other: Candidate) -> bool:
    """Return whether another effect moves the data in the same direction; one's own from another start is none."""
    return one.insertion.prefix != other.insertion.prefix and are_parallel(one, other, SAME)


def beside(
    bench: Workbench, base: Base, rules: Rules, options: list[Insertion], ranked: list[Candidate], stage: float
) -> tuple[list[Couple], float]:
    """Return couples of an effect as it was fitted and of those that promise most of what it leaves.

    Of effects that are far from small the first order does not tell what others explain beside them. With them is the
    bandwidth at which they show: that of the stage, or less where its injection hides all that such an effect leaves.
    Arguments are those of `couple`.
    """
    found: list[Couple] = []
    lower = stage
    for one in _strong(base, ranked, stage):
        taken = (*base.taken, one.insertion)
        rest = [option for option in options if option.prefix != one.insertion.prefix and not is_composite(option)]
        try:
            at, fit = _shown(bench, base, rules, one, stage)
            screened = screen(bench, taken, fit.point, rest, at, rules.sd)
        except UNSOLVED:
            continue
        able = [c for c in screened if not c.why_not and not is_other_law(c, one)]
        others = _plain(able)[:SECOND]
        less = base.fits[at].chi2 - fit.chi2
        found += [Couple(one, c, less + c.predicted, {**fit.point, **c.parameters}) for c in others]
        lower = min(lower, at)
    return found, lower


def _strong(base: Base, ranked: list[Candidate], stage: float) -> list[Candidate]:
    """Return the effects that explain most as they were fitted, of each contact the plainest law that does."""
    able = sorted((c for c in ranked if c.early is not None and not is_composite(c.insertion)), key=left_early)
    strong: list[Candidate] = []
    for c in able:
        cases = [
            d for d in able if contains(c, d, ranked) and _explains(d, base, stage) > PLAIN * _explains(c, base, stage)
        ]
        first = min(cases, key=lambda d: (d.insertion.complexity, d.early), default=c)
        if not any(first is d or is_other_law(first, d) for d in strong):
            strong.append(first)
    most = max((_explains(c, base, stage) for c in strong), default=0.0)
    return [c for c in strong if _explains(c, base, stage) > PLAIN * most][:FIRST]


def _shown(bench: Workbench, base: Base, rules: Rules, one: Candidate, stage: float) -> tuple[float, Fit]:
    """Return a rough fit with an effect at the first of the lower stages at which it leaves more than noise, and that.

    It is that of the last one where nothing shows.
    """
    lower = sorted((w for w in base.fits if 0 < w < stage), reverse=True)
    at, guess = stage, base.fits[stage].point | one.parameters
    while True:
        taken = (*base.taken, one.insertion)
        fit = bench.fit(taken, guess, (at,), rules.sd, patient=False, iterations=EARLY, stride=ROUGH)
        if residuals(fit).is_passed or not lower:
            return at, fit
        at, guess = lower.pop(0), fit.point


def _plain(able: list[Candidate]) -> list[Candidate]:
    """Leave out laws that promise little more than a plainer one of the same place, which they contain."""
    return [
        c
        for c in able
        if not any(d is not c and contains(c, d, able) and d.predicted > PLAIN * c.predicted for d in able)
    ]


def _explains(candidate: Candidate, base: Base, stage: float) -> float:
    return base.fits[stage].chi2 - left_early(candidate)


def _scaled(candidate: Candidate, share: float) -> dict[str, float]:
    """Return parameters of an effect whose sizes are a share of those promised."""
    sizes = candidate.insertion.size_names
    return {name: value * share if name in sizes else value for name, value in candidate.parameters.items()}
