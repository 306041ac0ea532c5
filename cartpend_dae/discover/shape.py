"""Whether what is left of the data is what the laws found may be wrong by: no law is right to the last percent."""

from collections.abc import Mapping

import numpy as np

from cartpend_dae.discover.choice import SHAPE, TOUCH, contains
from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.disturbed import penalty
from cartpend_dae.discover.gate import is_noise_alone, most_of_noise, residuals
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.weigh import weigh
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.identify import Fit

# a law's shape leaves less than the share TOUCH of what it explains, unless so many times noise were left before: where
# another shape was mended, 1.5 to 2.5 times were (tuning seeds of the blind bed); of two effects the first leaves 100
# times and more
FAR = 20.0
# ... unless it explains so many times as much as the best other law of the contact in the place of the one found, where
# at least so many were fitted: by that much the shape of a law may matter
LAWS, OTHERS = 3.0, 2
# an effect that is really there leaves at most this share of what it explains; where small disturbances alone move a
# rig, some effect or other leaves 0.17 of it and more (10 runs of the blind bed's rigs)
MOST = 0.1


def is_shape_error(base: Base, fit: Fit) -> bool:
    """Return whether an addition could be what the laws before it are wrong by."""
    share = (base.fit.chi2 - fit.chi2) / max(base.bare - base.fit.chi2, 1e-300)
    if all(_has_no_shape(insertion) for insertion in base.taken):  # as where there are none
        return False
    if share > SHAPE or is_far_from_noise(base.fit, fit):
        return False
    shapes = np.inf if base.rival is None else max(base.fit.chi2 - base.rival, 0.0)
    if share > TOUCH and base.fit.chi2 - fit.chi2 > LAWS * shapes:
        return False
    return share < TOUCH or residuals(fit).is_passed or fit.chi2 > most_of_noise(fit.n_residuals)


def _has_no_shape(insertion: Insertion) -> bool:
    """Return whether an effect is one number and no law: what a constant leaves is something else."""
    return insertion.card.is_exact or insertion.card.regressors == ("1",)


def best_rival(winner: Candidate, ranked: list[Candidate]) -> float | None:
    """Return what the best other law of a contact leaves that was fitted to the end, None where few were."""
    others = [c.fit.chi2 for c in ranked if c.fit is not None and c is not winner and is_other_law(c, winner)]
    return min(others) if len(others) >= OTHERS else None


def is_left_to_shape(bare: float, fit: Fit) -> bool:
    """Return whether all that a fit leaves is less than its laws may be wrong by: no addition could be told from that.

    `bare` is chi2 of the model without additions.
    """
    return leaves_little(bare, fit) and fit.chi2 < FAR * fit.n_residuals


def leaves_little(bare: float, fit: Fit) -> bool:
    """Return whether a fit leaves less than its laws may be wrong by, be it far more than noise."""
    return fit.chi2 < TOUCH * (bare - fit.chi2)


def is_plainer_left_to_shape(winner: Candidate, tried: Mapping[str, Candidate], bare: float) -> bool:
    """Return whether a law that the one found contains leaves no more than its shape either.

    Where disturbances are left as well, a richer law may have taken up a part of them.

    Parameters
    ----------
    winner
        The law found.
    tried
        The last word on each candidate, by prefix.
    bare
        chi2 of the model without additions.
    """
    others = [c for c in tried.values() if c.insertion.prefix != winner.insertion.prefix]
    plain = [c.fit for c in others if c.fit is not None and contains(winner, c, others)]
    return any(leaves_little(bare, fit) for fit in plain)


def is_far_from_noise(before: Fit, after: Fit) -> bool:
    """Return whether much more than noise was left before, and noise alone is after: no error of a law is mended so."""
    return is_noise_alone(after) and before.chi2 > FAR * before.n_residuals


def is_nearly_all(base: Base) -> bool:
    """Return whether additions leave no more than their laws may be wrong by."""
    return bool(base.taken) and base.fit.chi2 - base.fit.n_residuals < SHAPE * (base.bare - base.fit.chi2)


def is_most(base: Base) -> bool:
    """Return whether additions leave no more than disturbances alone would, moved to where an effect explains most."""
    return bool(base.taken) and base.fit.chi2 - base.fit.n_residuals < MOST * (base.bare - base.fit.chi2)


def supported(bench: Workbench, base: Base, rules: Rules, options: list[Insertion]) -> list[Insertion]:
    """Return the effects that explain more of what is left than small random forces would, from each of their starts.

    What an effect leaves may be the error of its law, or disturbances; a second one must do better than both. It is
    looked for with as much injection as does not hide it.
    """
    shown = [w for w in base.fits if 0 < w <= rules.screening and residuals(base.fits[w]).is_passed]
    bandwidth = max(shown, default=max(w for w in base.fits if w <= rules.screening))
    point = base.fits[bandwidth].point
    weighed = weigh(bench, base.taken, rules.loads, point, bandwidth, rules.sd)
    screened = screen(bench, base.taken, point, options, bandwidth, rules.sd, weighed=weighed)
    cost = penalty(len(options))
    good = {
        c.insertion.prefix for c in screened if not c.why_not and c.predicted > cost * len(c.insertion.parameter_names)
    }
    return [option for option in options if option.prefix in good]
