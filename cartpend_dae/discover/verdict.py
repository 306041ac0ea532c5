"""What a search has come to: whether its effects explain the runs, or something is left beside them."""

import contextlib
from dataclasses import replace

from cartpend_dae.discover.records import Verdict
from cartpend_dae.discover.state import Base, Rules, push_left
from cartpend_dae.discover.trial import is_absent
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# share of the random forces of the model before, or of its error, that is not small
MUCH = 0.5


def verdict(has_steps: bool, is_left: bool) -> Verdict:
    """Return the verdict of a search that has added effects, or not, beside which something is left, or not."""
    if not has_steps:
        return "unexplained"
    return "improved" if is_left else "explained"


def pushes_remain(before: Base, after: Base) -> bool:
    """Return whether the random forces found are still at least half of those without any additions.

    Innovations are white where a random force stands for what is missing; its size tells.
    """
    return before.weighed is not None and push_left(before, after) > MUCH


def is_told_freely(bench: Workbench, before: Base, after: Base) -> bool:
    """Return whether effects found against random forces take most of the error of the free simulation as well.

    Forces follow whatever moves the rig, so that what they leave is white with a wrong effect, too.
    """
    free = after.fits.get(bench.last)
    return free is not None and free.chi2 < MUCH**2 * before.fit.chi2


def compared(bench: Workbench, bare: Base, start: Base, base: Base, rules: Rules) -> tuple[Base, Base]:
    """Return the models before and after with fits that can be compared: of the free simulation, where that is better.

    Effects that it leaves at nothing are out of the model then. Where it is not better, both have the output injection
    that suits the last.
    """
    if base.taken:
        with contextlib.suppress(SolverError):
            free, taken = _freely(bench, base, base.taken, rules), base.taken
            felt = tuple(insertion for insertion in taken if not is_absent(free, insertion))
            if felt and felt != taken:
                free, taken = _freely(bench, base, felt, rules), felt
            if felt and free.chi2 < bare.fit.chi2:
                return bare, replace(base, taken=taken, fits={**base.fits, bench.last: free})
    bandwidth = float(base.fit.bandwidth[0])
    return Base((), {bandwidth: bench.fit((), start.fit.point, (bandwidth,), rules.sd)}), base


def _freely(bench: Workbench, base: Base, taken: tuple[Insertion, ...], rules: Rules) -> Fit:
    return bench.fit(taken, base.fit.point, (bench.last,), rules.sd, patient=False)
