"""Of candidates that were fitted roughly with the least injection, those that are fitted to the end."""

import numpy as np

from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.evidence import bic
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.shortlist import is_simple

# so many of the best are fitted to the end, and so many of those that explained most at the first stage, where the rest
# of all of these is alike to this share of what lies beyond noise
NARROW, TELLING, ALIKE = 4, 3, 0.01
# those that leave so many times more than the best one are not; what the best one leaves beyond noise counts as this
# share of noise at least
BEHIND, LITTLE = 10.0, 0.1


def left_by(candidate: Candidate) -> float:
    """Return what the fit of a candidate leaves; infinity without one."""
    return candidate.fit.chi2 if candidate.fit else np.inf


def left_early(candidate: Candidate) -> float:
    """Return what a candidate left at its first fit; infinity if it had none."""
    return np.inf if candidate.early is None else candidate.early


def nearest(few: list[Candidate], n_residuals: int, places: int = NARROW) -> list[Candidate]:
    """Return those to fit to the end.

    Rough steps without injection may leave the same of all laws, and the number of parameters alone would tell them
    apart; then those that explained most before are fitted, too.

    Parameters
    ----------
    few
        Candidates with their rough fits.
    n_residuals
        Number of residuals of a whole fit.
    places
        How many of the best there are, and none of those that were refused.
    """
    left = [_beyond(c) for c in few]
    least = max(min(left), LITTLE * n_residuals) if left else 0.0
    few = sorted(few, key=lambda c: bic(c.fit) if c.fit else np.inf)
    early = sorted(few, key=left_early)
    near = few[:places]
    told = early[: TELLING if are_alike(near) else 1]
    near += [c for c in few[places:] if is_simple(c) or c in told]
    near = [c for c in near if c.fit and _beyond(c) <= BEHIND * least]
    return near + [
        c for c in few if is_simple(c) and c not in near and any(_may_be_rounded(c, other) for other in near)
    ]


def are_alike(near: list[Candidate]) -> bool:
    """Return whether all of some candidates leave more than noise, and the same of it."""
    if not all(c.fit is not None and residuals(c.fit).is_passed for c in near):
        return False
    left = [_beyond(c) for c in near]
    return len(left) > 1 and min(left) > 0 and max(left) < (1 + ALIKE) * min(left)


def _beyond(candidate: Candidate) -> float:
    """Return what the fit of a candidate leaves beyond noise; infinity without one."""
    return candidate.fit.chi2 - candidate.fit.n_residuals if candidate.fit else np.inf


def _may_be_rounded(plain: Candidate, best: Candidate) -> bool:
    """Return whether a law of dry friction is the plain one of another, which as fitted is weaker at rest."""
    return best.fit is not None and bool(best.insertion.contradiction(best.fit.values)) and is_other_law(plain, best)
