"""Stage 1: whether the residual is more than noise."""

import numpy as np

from cartpend_dae.data import von_neumann_z
from cartpend_dae.discover.records import Gate
from cartpend_dae.identify import Fit

# largest value of z seen on 90 noise-only data sets: 2.8; smallest on a real effect: 10.3
LIMIT = 4.0
# of what is noise beyond doubt it is smaller than this
CLEAN = 2.5
# and chi2 over the number of residuals is 1 but for the noise's sd, taken from the raw data: it scatters so that their
# ratio has a standard deviation of SCATTER over the root of that number (simulated: 0.081 for two runs of 801 samples,
# 0.058 for two of 1501); so many of these, and at least so much, may be missing
SCATTER, SDS, LEAST = 3.2, 3.0, 0.12


def z_beyond_rounding(residual: np.ndarray, quantum: float) -> float:
    """Return von Neumann's z of what rounding to a quantum does not explain, in units of the noise of rounding.

    At rest, and wherever a sample moves by less than a quantum, neighbouring errors of rounding are alike, up to half a
    quantum each, and say nothing of the model. What is beyond that half does; it counts as little as it is small.
    """
    beyond = np.sign(residual) * np.maximum(np.abs(residual) - quantum / 2, 0.0)
    before, after = beyond[:-1], beyond[1:]
    both = np.isfinite(before) & np.isfinite(after)
    before, after = before[both], after[both]
    power = max(float(before @ before + after @ after) / 2, len(before) * quantum**2 / 12)
    return float(np.sqrt(len(before)) * (before @ after) / power) if power > 0 else 0.0


def residuals(fit: Fit) -> Gate:
    """Judge the residuals of a fit by their whiteness; of outputs that are counted in steps, beyond their rounding.

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
            series, quantum = run.residual[:, column], fit.quanta[column] if fit.quanta else 0.0
            if np.isfinite(series).sum() > 10:
                z = z_beyond_rounding(series, quantum) if quantum > 0 else von_neumann_z(series)
                found.append((run.name, name, z))
    largest = max((z for _, _, z in found), default=0.0)
    return Gate(tuple(found), float(largest), bool(largest > LIMIT))


def is_clean(fit: Fit) -> bool:
    """Return whether the residuals of a fit are white beyond doubt, whatever their size."""
    return residuals(fit).largest < CLEAN


def is_noise_alone(fit: Fit) -> bool:
    """Return whether a fit leaves nothing but noise, of the size that it is known to have."""
    return is_clean(fit) and fit.chi2 < most_of_noise(fit.n_residuals)


def most_of_noise(n_residuals: int) -> float:
    """Return the largest chi^2 that noise alone leaves in so many residuals, for all that its size is known."""
    return n_residuals * (1 + max(LEAST, SDS * SCATTER / n_residuals**0.5)) if n_residuals else 0.0
