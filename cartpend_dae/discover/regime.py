"""Which regime the data are in: sensor noise alone, or small disturbances everywhere as well."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.records import Candidate, Regime
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError

# bandwidths tried, in units of the sampling rate
LADDER = (1.0, 0.3, 0.1, 0.03, 0.01)
# the cost of prediction may rise by this much from one rung to the next before the ladder is left
SLACK = 1.05


def find_regime(
    bench: Workbench, screened: list[Candidate], point: Mapping[str, float], sd: np.ndarray
) -> tuple[Regime, float]:
    """Fit the model with all effects of the catalogue at once, with less and less output injection.

    If the richest model simulates freely to within white noise, the sensors are the only imperfection. If
    its predictions are best with some injection, something else moves the rig, and the bandwidth of the
    best predictions is that of the steady-state filter for it.

    Parameters
    ----------
    bench
        The workbench.
    screened
        All candidates; those that no sensor sees are left out. Their predicted parameters set the scale.
    point
        Fit of the baseline: parameters and free starts by name, SI.
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
    visible = [c for c in screened if any(c.parameters[name] for name in c.insertion.size_names)]
    everything = tuple(candidate.insertion for candidate in visible)
    hints = {name: value for candidate in visible for name, value in candidate.parameters.items()}
    rungs = _rungs(bench)
    # without disturbances the first rungs get better downwards; then the free simulation is tried at once
    first = _descend(bench, everything, point, rungs[:2], sd, hints)
    if first.is_descending:
        try:
            free = bench.fit(everything, first.point, (2.0 * bench.frequency, 0.0), sd, hints)
            if not residuals(free).is_passed:
                return "noise", 0.0
        except SolverError:
            pass
        return "disturbances", _descend(bench, everything, first.point, rungs[1:], sd, hints).bandwidth
    return "disturbances", first.bandwidth


def best_bandwidth(bench: Workbench, sd: np.ndarray) -> float:
    """Return the bandwidth of output injection with which the model as it is predicts best [rad/s].

    Parameters
    ----------
    bench
        The workbench.
    sd
        Noise used as weight, shape (n_y,).
    """
    return _descend(bench, (), {}, _rungs(bench), sd, {}).bandwidth


def _rungs(bench: Workbench) -> tuple[float, ...]:
    rate = 1.0 / min(float(np.median(np.diff(experiment.time))) for experiment in bench.setup.train)
    return tuple(share * rate for share in LADDER)


@dataclass(frozen=True, slots=True)
class _Descent:
    bandwidth: float
    point: Mapping[str, float]
    is_descending: bool


def _descend(
    bench: Workbench,
    insertions: tuple[Insertion, ...],
    point: Mapping[str, float],
    rungs: tuple[float, ...],
    sd: np.ndarray,
    hints: Mapping[str, float],
) -> _Descent:
    """Fit with less and less injection until the predictions get worse."""
    best_bandwidth, best_cost = rungs[0], np.inf
    for bandwidth in rungs:
        try:
            fit = bench.fit(insertions, point, (bandwidth,), sd, hints)
        except SolverError:
            continue
        if fit.chi2 > SLACK * best_cost:
            return _Descent(best_bandwidth, point, False)
        if fit.chi2 < best_cost:
            best_bandwidth, best_cost = bandwidth, fit.chi2
        point = fit.point
    return _Descent(best_bandwidth, point, True)
