"""The model with chosen effects, fitted: what a search would hand on if it had chosen them."""

from collections.abc import Mapping

from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.records import Candidate, Search, Step
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion

# bandwidths of the output injection of a fit, one after the other, in units of the dominant frequency
STAGES = (5.0, 2.0, 0.7, 0.0)


def refit(bench: Workbench, insertions: tuple[Insertion, ...], *, guess: Mapping[str, float] | None = None) -> Search:
    """Fit the model without and with effects, so that `prove` can compare them on all runs.

    Parameters
    ----------
    bench
        The workbench with the runs.
    insertions
        The effects, as `effects.insertion_at` makes them; none calibrates the model as it is.
    guess
        Where to begin, parameters by name, SI; what is missing keeps its guess.

    Raises
    ------
    SolverError
        If a fit ends without a usable point.
    TypeError
        If one of `insertions` is no effect at a place.
    """
    if isinstance(insertions, Insertion):
        raise TypeError("`refit` takes a tuple of effects; put a comma behind it: `(insertion_at(...),)`.")
    for given in insertions:
        if not isinstance(given, Insertion):
            shown = given.id if isinstance(given, Card) else given
            raise TypeError(
                f"`refit` takes effects at their places, and {shown!r} is none; write "
                f"`(insertion_at(setup.model, {shown!r}, place),)`."
            )
    sd = bench.problem(()).prior_sd
    stages = tuple(share * bench.frequency for share in STAGES)
    before = bench.fit((), {}, stages, sd)
    after = bench.fit(insertions, guess or {}, stages, sd) if insertions else before
    gate, left = residuals(before), residuals(after)
    steps = []
    for insertion in insertions:
        own = {name: after.values[name] for name in insertion.parameter_names}
        gain = before.chi2 - after.chi2
        steps.append(Step(Candidate(insertion, own, 0.0, gain, 0.0, after, ""), left, ()))
    verdict = "no-discrepancy" if not gate.is_passed else "unexplained"
    if steps:
        verdict = "improved" if left.is_passed else "explained"
    return Search("noise", "noise", 0.0, before, gate, after, left, tuple(steps), (), verdict, False)
