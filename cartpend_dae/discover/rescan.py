"""The wave of a law is looked for again along the fit of a plainer law: where nothing rubs yet, stops hide the wave."""

from dataclasses import replace

import numpy as np

from cartpend_dae.discover.nested import as_plain, holds
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError


def rescanned(bench: Workbench, base: Base, rules: Rules, stage: float, fitted: list[Candidate]) -> list[Candidate]:
    """Return laws with a wave from where the best plainer law ended, with the waves that promise most beside that.

    Parameters
    ----------
    bench
        The workbench.
    base, rules
        The model without any of them, and the regime.
    stage
        Bandwidth of the output injection at which they were fitted [rad/s].
    fitted
        Candidates that were fitted, or failed.

    Returns
    -------
    list
        Candidates whose `parameters` are the point of the plainer fit and their own, to start from.
    """
    found: list[Candidate] = []
    for rich in fitted:
        plain = [c for c in fitted if c.fit is not None and holds(rich, c)]
        best = min(plain, key=lambda c: c.fit.chi2 if c.fit else np.inf, default=None)
        option = _at_first_wave(rich.insertion)
        if option is None or rich.why_not or best is None or best.fit is None:
            continue
        try:
            (again,) = screen(bench, (*base.taken, best.insertion), best.fit.point, [option], stage, rules.sd)
        except SolverError:
            continue
        same = {name.rpartition(".")[2] for name in best.insertion.parameter_names}
        plainly = as_plain(rich.insertion, best)
        kept = {name: value for name, value in plainly.items() if name.rpartition(".")[2] in same}
        for one in (again, *again.others):
            if not one.why_not:
                found.append(replace(one, parameters={**best.fit.point, **one.parameters, **kept}, others=()))
    return found


def _at_first_wave(insertion: Insertion) -> Insertion | None:
    """Return a law of dry friction with the first start of its wave, from which all are tried; None if it has none."""
    kind = insertion.place.kind
    waves = [item for item in insertion.card.parameters if item.role == "wave"]
    if not waves or "sign v" not in insertion.card.regressors:
        return None
    firsts = {item.names[kind]: item.starts_at(kind)[0] for item in waves}
    return replace(insertion, values={**insertion.values, **firsts})
