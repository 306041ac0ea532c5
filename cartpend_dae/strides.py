"""In how many equal parts a step between samples is taken, so that errors of integration do not show."""

import casadi as ca
import numpy as np

from cartpend_dae.prepared import once
from cartpend_dae.stepping import LONGEST, shortest_times
from cartpend_dae.system import System
from cartpend_dae.transcribe import RunStart

# what a shortest time is taken for [s] where the fastest motion is looked for
SLOW = 1.0
# more parts than so many are not taken
MOST = 100


def substeps(system: System, start: RunStart, p: np.ndarray, width: float, stride: float | None) -> int:
    """Return into how many parts samples are divided so that each is short against the fastest motion of a model.

    The product of step and fastest eigenvalue stays below 0.25 (error of RK4 per step below 1e-5); with
    dry friction below 0.03, because reversals are resolved to second order only. What has a shortest time in which it
    changes is not what is fastest, as it counts as half a step where it is less: without a stride, the step is no
    longer than can follow it.

    Parameters
    ----------
    system
        The system.
    start
        Where a run starts, at which the motion is looked at.
    p
        Parameters, shape (n_p,).
    width
        Distance of samples [s].
    stride
        The largest product of step and fastest eigenvalue; that of the method if None.
    """
    slow = p.copy()
    shortest = min((p[i] for i in shortest_times(system) if p[i] > 0), default=np.inf)
    slow[list(shortest_times(system))] = SLOW
    x, z = np.split(start.x, [system.x.numel()])
    jacobian = once(system, "jacobian", None, lambda: _jacobian(system))
    value = np.asarray(jacobian(start.time, x, z, start.u, slow, np.zeros(system.frictions.force.numel())))
    fastest = float(np.abs(np.linalg.eigvals(value)).max(initial=0.0)) if value.size else 0.0
    count = width * fastest / (stride or usual_stride(system))
    if stride is None:
        count = max(count, width / (LONGEST * shortest))
    return int(np.clip(np.ceil(count - 1e-9), 1, MOST))


def usual_stride(system: System) -> float:
    """Return the largest product of step and fastest eigenvalue at which errors of integration do not show."""
    return 0.03 if system.frictions.places else 0.25


def _jacobian(system: System) -> ca.Function:
    """Return the Jacobian of the rates of the states, as a function of all that the equations depend on."""
    slope = ca.jacobian(system.ode, system.x)
    if system.algebraics:
        slope -= ca.jacobian(system.ode, system.z) @ ca.solve(
            ca.jacobian(system.alg, system.z), ca.densify(ca.jacobian(system.alg, system.x))
        )
    arguments = [system.time, system.x, system.z, system.u, system.p, system.frictions.force]
    return ca.Function("jacobian", arguments, [slope])
