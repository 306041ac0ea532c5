"""What the runs never showed in one direction is taken from the other one, and said."""

from dataclasses import replace

from cartpend_dae.directions import unreached
from cartpend_dae.identify import Fit

SIDES = {"_pos": "_neg", "_neg": "_pos"}


def mirrored(fit: Fit) -> Fit:
    """Return a fit in which a parameter of one direction that the data leave open has the value of the other direction.

    Parameters
    ----------
    fit
        A fit with parameters named in pairs, as `u_pos` and `u_neg`. Where one does not reach the outputs the runs
        look the same whatever its value, so that neither residuals nor other parameters change. One that is open only
        together with others stays as it was fitted.
    """
    known = {e.name: e for e in fit.parameters if e.status != "unidentifiable"}
    parameters, notes = [], []
    for estimate in fit.parameters:
        other = known.get(estimate.name[:-4] + SIDES.get(estimate.name[-4:], ""))
        if estimate.name in known or other is None or unreached(estimate.name) not in fit.blind:
            parameters.append(estimate)
            continue
        parameters.append(replace(estimate, value=other.value))
        notes.append(f"These runs do not show `{estimate.name}`: it is taken to be as large as `{other.name}`.")
    return fit if not notes else replace(fit, parameters=tuple(parameters), notes=(*fit.notes, *notes))
