"""With which bandwidth a model predicts best, where small disturbances move the rig besides the sensors' noise."""

from collections.abc import Mapping

import numpy as np

from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.errors import SolverError

# bandwidths tried, in units of the sampling rate
LADDER = (1.0, 0.3, 0.1, 0.03, 0.01)
# the cost of prediction may rise by this much from one rung to the next before the ladder is left
SLACK = 1.05


def best_bandwidth(bench: Workbench, rich: list[Candidate], point: Mapping[str, float], sd: np.ndarray) -> float:
    """Return the bandwidth of output injection with which a model predicts best [rad/s].

    Where something unknown moves the rig, predictions are best with some injection, and the bandwidth of the best
    ones is that of the steady-state filter for it. What the model lacks must not pass for unknown: so the promising
    effects are all in it.

    Parameters
    ----------
    bench
        The workbench.
    rich
        Effects that are put into the model; their predicted parameters set the scale.
    point
        Fit without them: parameters and free starts by name, SI.
    sd
        Noise used as weight, shape (n_y,).

    References
    ----------
    L. Ljung, "System Identification: Theory for the User", 2nd ed. (1999), section 7.2 (prediction errors).
    """
    bench.expect({name: value for candidate in rich for name, value in candidate.parameters.items()})
    for count in sorted({len(rich), min(1, len(rich))}, reverse=True):  # all together may be too much to simulate
        found = _descend(bench, tuple(rich[:count]), point, _rungs(bench), sd)
        if found is not None:
            return found
    return _rungs(bench)[0]


def _rungs(bench: Workbench) -> tuple[float, ...]:
    return tuple(share * sampling_rate(bench) for share in LADDER)


def sampling_rate(bench: Workbench) -> float:
    """Return the rate of the training run that is sampled fastest [1/s]."""
    return 1.0 / min(float(np.median(np.diff(experiment.time))) for experiment in bench.setup.train)


def _descend(
    bench: Workbench,
    rich: tuple[Candidate, ...],
    start: Mapping[str, float],
    rungs: tuple[float, ...],
    sd: np.ndarray,
) -> float | None:
    """Fit with less and less injection until the predictions get worse; None if the first fit fails."""
    insertions = tuple(candidate.insertion for candidate in rich)
    point = dict(start) | {name: value for candidate in rich for name, value in candidate.parameters.items()}
    best, best_cost = None, np.inf
    for bandwidth in rungs:
        try:
            fit = bench.fit(insertions, point, (bandwidth,), sd, patient=False)
        except SolverError:
            if best is None:
                return None
            continue
        if fit.chi2 > SLACK * best_cost:
            return best
        if fit.chi2 < best_cost:
            best, best_cost = bandwidth, fit.chi2
        point = fit.point
    return best
