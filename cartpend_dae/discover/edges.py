"""Away from an edge: where data bound a parameter from one side only, a fit may end on that side, and hide the rest.

A motor that did not start at one level of voltage and did at the next tells of its break-away level only that it lies
between them. Close to either, when the motor starts depends on everything, so that no other effect seems to explain
what is left. A little off the edge the data no longer see the parameter, and the others can be told.
"""

from dataclasses import replace

from cartpend_dae.discover.shape import FAR
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit

# a parameter is moved by these factors, one after the other, if what is left grows by less than this share
FACTORS, LITTLE = (0.8, 1.25), 0.1


def off_edges(bench: Workbench, base: Base, rules: Rules) -> Base:
    """Return the model so far with the fits before the last one, from which others begin, off such edges.

    The last fit, by which others are judged, stays. Where little more than noise is left, all do.

    Parameters
    ----------
    bench
        The workbench.
    base
        The model so far, in the regime of noise.
    rules
        How to fit and decide.
    """
    fit, before = base.fit, [w for w in base.fits if w != bench.last]
    if not before or not fit.chi2 > FAR * fit.n_residuals:
        return base
    moved: dict[str, float] = {}
    for name in (name for insertion in base.taken for name in insertion.size_names):
        for factor in FACTORS:
            trial = moved | {name: factor * fit.values[name]}
            there = _there(bench, base, rules, bench.last, trial)
            if there is not None and there.chi2 < (1 + LITTLE) * fit.chi2 and _is_unseen(there, name):
                moved = trial
                break
    if not moved:
        return base
    fits = {w: _there(bench, base, rules, w, moved) or base.fits[w] for w in before}
    return replace(base, fits=base.fits | fits)


def _there(bench: Workbench, base: Base, rules: Rules, bandwidth: float, values: dict[str, float]) -> Fit | None:
    """Return the model as it is with some values, not fitted; None where it diverges."""
    point = base.fits[bandwidth].point | values
    try:
        return bench.fit(base.taken, point, (bandwidth,), rules.sd, patient=False, iterations=0)
    except SolverError:
        return None


def _is_unseen(fit: Fit, name: str) -> bool:
    """Return whether the data do not tell a parameter from nothing."""
    return any(e.name == name and not e.sd < abs(e.value) for e in fit.parameters)
