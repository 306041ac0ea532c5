"""Where no free simulation tells: gaps that rattle pass their impacts in another order after the smallest change.

Then a model may explain all that is predicted over a short time, and no free run, whatever its parameters are. What
tells the two apart from an effect that is still missing is how far free runs lie apart that start from nearly the same
parameters.

References
----------
S. W. Shaw, P. J. Holmes, "A periodically forced piecewise linear oscillator", J. Sound Vib. 90 (1983), 129-155,
doi:10.1016/0022-460X(83)90407-8: oscillators with stops are chaotic.
"""

import numpy as np

from cartpend_dae.discover.choice import SHAPE
from cartpend_dae.discover.disturbed import is_composite
from cartpend_dae.discover.nearest import left_early
from cartpend_dae.discover.nested import with_gaps
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.shape import FAR
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.workbench import ROUGH, Workbench
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# predictions are explained where so many times noise is left, and this share of what there was without the effect
LOOSE, LEFT = 2.0, 0.1
# parameters are moved by this share of their standard deviations: in a regular motion that changes next to nothing
NUDGE = 0.1


class RattlingError(Exception):
    """Free simulations tell nothing; `least` is the bandwidth of the injection with which predictions do [rad/s]."""

    def __init__(self, least: float) -> None:
        super().__init__(f"No free simulation tells; predictions do at {least:.3g} rad/s.")
        self.least = least


def least_that_tells(bench: Workbench, base: Base, rules: Rules, ranked: list[Candidate]) -> float | None:
    """Return the least injection at which an effect explains the runs, if no free simulation can; None otherwise.

    Parameters
    ----------
    bench
        The workbench.
    base, rules
        The model without any addition, and the regime of noise.
    ranked
        Candidates, fitted at the stage of screening and, the better ones, without injection.

    Returns
    -------
    float or None
        Bandwidth of the output injection [rad/s].
    """
    n = base.fit.n_residuals
    able = [c for c in ranked if c.early is not None and c.begun and not is_composite(c.insertion)]
    injected = [w for w in base.fits if 0 < w <= rules.screening]
    if bench.last or base.taken or not able or not injected:
        return None
    if any(c.fit is not None and not float(c.fit.bandwidth[0]) and c.fit.chi2 < FAR * n for c in ranked):
        return None
    least, best = min(injected), min(able, key=left_early)
    taken = (best.insertion,)
    enough = min(LOOSE * n, n + LEFT * (base.fits[least].chi2 - n))
    try:
        for point in with_gaps(best.insertion, best.begun):
            fit = bench.fit(taken, point, (rules.screening, least), rules.sd, patient=False, stride=ROUGH)
            if fit.chi2 <= enough:
                break
        else:
            return None
        free = {"patient": False, "iterations": 0, "stride": ROUGH}
        one, other = (bench.fit(taken, _moved(fit, side), (0.0,), rules.sd, **free) for side in (1.0, -1.0))
    except SolverError:
        return None
    return least if _apart(one, other, rules.sd) > FAR * n else None


def is_all_that_tells(bench: Workbench, bare: float, fit: Fit) -> bool:
    """Return whether predictions decide, and a fit leaves no more than laws may be wrong by; `bare` is without any."""
    return bench.least > 0 and fit.chi2 - fit.n_residuals < SHAPE * (bare - fit.chi2)


def _moved(fit: Fit, side: float) -> dict[str, float]:
    """Return the point of a fit, its parameters moved by a small share of their standard deviations."""
    step = {e.name: side * NUDGE * e.sd for e in fit.parameters if np.isfinite(e.sd)}
    return {name: value + step.get(name, 0.0) for name, value in fit.point.items()}


def _apart(one: Fit, other: Fit, sd: np.ndarray) -> float:
    """Return the squared distance of two simulations of the same runs, in noise sds."""
    pairs = zip(one.runs, other.runs, strict=True)
    return float(sum(np.nansum(((a.residual - b.residual) / sd) ** 2) for a, b in pairs))
