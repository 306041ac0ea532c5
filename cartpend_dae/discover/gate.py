"""Stage 1: whether the residual is more than noise."""

import numpy as np

from cartpend_dae.data import von_neumann_z
from cartpend_dae.discover.records import Gate
from cartpend_dae.identify import Fit

# largest value of z seen on 90 noise-only data sets: 2.8; smallest on a real effect: 10.3
LIMIT = 4.0


def residuals(fit: Fit) -> Gate:
    """Judge the residuals of a fit by their whiteness.

    Parameters
    ----------
    fit
        A fit of the free simulation, or of innovations.

    References
    ----------
    J. von Neumann, Ann. Math. Statist. 12 (1941), 367-395, doi:10.1214/aoms/1177731677.
    """
    found = []
    for run in fit.runs:
        for column, name in enumerate(fit.outputs):
            series = run.residual[:, column]
            if np.isfinite(series).sum() > 10:
                found.append((run.name, name, von_neumann_z(series)))
    largest = max((z for _, _, z in found), default=0.0)
    return Gate(tuple(found), float(largest), bool(largest > LIMIT))
