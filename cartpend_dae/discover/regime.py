"""Which regime the data are in: sensor noise alone, or small disturbances everywhere as well."""

import numpy as np

from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.records import Regime
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError

# bandwidths tried, in units of the sampling rate
LADDER = (1.0, 0.3, 0.1, 0.03, 0.01)


def find_regime(bench: Workbench, everything: tuple[Insertion, ...], sd: np.ndarray) -> tuple[Regime, float]:
    """Fit the model with all effects of the catalogue at once, with less and less output injection.

    If the richest model simulates freely to within white noise, the sensors are the only imperfection. If
    its predictions are best with some injection, something else moves the rig, and the bandwidth of the
    best predictions is that of the steady-state filter for it.

    Parameters
    ----------
    bench
        The workbench.
    everything
        All candidates.
    sd
        Noise used as weight, shape (n_y,).

    Returns
    -------
    tuple
        The regime and the bandwidth [rad/s], 0 for noise alone.

    References
    ----------
    L. Ljung, "System Identification: Theory for the User", 2nd ed. (1999), section 7.2 (prediction errors).
    """
    rate = 1.0 / min(float(np.median(np.diff(experiment.time))) for experiment in bench.setup.train)
    best_bandwidth, best_cost = LADDER[0] * rate, np.inf
    point: dict[str, float] = {}
    for bandwidth in (*(share * rate for share in LADDER), 0.0):
        try:
            fit = bench.fit(everything, point, (bandwidth,), sd)
        except SolverError:
            break
        if bandwidth == 0.0 and not residuals(fit).is_passed:
            return "noise", 0.0
        if not fit.chi2 < 1.05 * best_cost:
            break
        if fit.chi2 < best_cost:
            best_bandwidth, best_cost = bandwidth, fit.chi2
        point = fit.point
    return "disturbances", best_bandwidth or LADDER[-1] * rate
