"""The estimation problem as a nonlinear programme: multiple shooting with exact Gauss-Newton derivatives.

Each run is cut into segments with their own start states, joined by equality constraints. Inside a
segment a Runge-Kutta step is folded over the samples together with its sensitivities, so that cost,
gradient and Hessian come from one pass and the build time does not grow with the number of samples.

At each sample the state may be corrected by the innovation with the gains of a critically damped
second-order observer of bandwidth w (output injection). With w = 0 the residual is the error of the
free simulation; with w > 0 it is the error of prediction, in which small disturbances do not pile up.

References
----------
H. G. Bock, K. J. Plitt, "A multiple shooting algorithm for direct solution of optimal control problems",
IFAC Proc. 17 (1984), 1603-1608, doi:10.1016/S1474-6670(17)61205-9.
E. Brookner, "Tracking and Kalman Filtering Made Easy" (1998), section 1.2.6 (critically damped g-h filter).
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from cartpend_dae.data import Experiment
from cartpend_dae.stepping import Step, runge_kutta
from cartpend_dae.system import System
from cartpend_dae.timekeeping import is_rate
from cartpend_dae.unknowns import Free, Tie

SEGMENT = 100


@dataclass(frozen=True, slots=True)
class FreeStart:
    """A variable whose start is free: factor times a state, and a rest that depends on parameters only."""

    state: int
    factor: ca.SX
    rest: ca.SX


@dataclass(frozen=True, slots=True)
class RunStart:
    """How a run starts: state `x` (n_state,) with its inputs `u` (n_u,) at `time` [s], and the variables that are free.

    Where it starts at rest, `steady` lists the states that follow from that.
    """

    x: np.ndarray
    free: tuple[tuple[FreeStart, Free], ...]
    steady: tuple[int, ...] | None
    u: np.ndarray
    time: float


@dataclass(frozen=True, slots=True)
class Slot:
    """A free parameter of the model and the one of `Layout.free` that it is in each run."""

    parameter: str
    owners: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Layout:
    """The structure of an estimation problem: what is free, what is measured, how samples are grouped.

    `free` are the estimated parameters of all runs, of which `slots` says where they stand in the model. `outputs` are
    indices of system variables. Segments (n_segments of `length` samples) of all runs stand one after the other;
    `first` are the segments with which runs begin. With a finite `huber`, residuals beyond so many standard deviations
    count linearly. `floors` are shortest times of the model, each with the least one that the steps can follow [s].
    """

    system: System
    free: tuple[Free, ...]
    slots: tuple[Slot, ...]
    ties: tuple[Tie, ...]
    outputs: tuple[int, ...]
    output_names: tuple[str, ...]
    substeps: int
    length: int
    n_segments: int
    first: tuple[int, ...]
    run_lengths: tuple[int, ...]
    huber: float = np.inf
    floors: tuple[tuple[int, float], ...] = ()

    @property
    def n_state(self) -> int:
        """Number of states and algebraic variables that a step carries on."""
        return self.system.x.numel() + self.system.z.numel()

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameter of each slot."""
        return tuple(slot.parameter for slot in self.slots)

    @property
    def runs(self) -> np.ndarray:
        """The run of each segment, shape (n_segments,)."""
        return np.searchsorted(np.array(self.first), np.arange(self.n_segments), side="right") - 1

    @property
    def sizes(self) -> np.ndarray:
        """The size by which each slot is scaled, SI, shape (n_slots,)."""
        return np.array([self.free[slot.owners[0]].scale for slot in self.slots])

    @property
    def owners(self) -> np.ndarray:
        """Which of `free` each slot is in each run, shape (n_runs, n_slots)."""
        return np.array([slot.owners for slot in self.slots], dtype=int).reshape(len(self.slots), len(self.first)).T


def injection_targets(system: System, outputs: tuple[int, ...]) -> tuple[tuple[int, int, int | None, ca.SX], ...]:
    """Return for each output that shows a state: (output, state, state of its rate, factor).

    Outputs that show none are predicted but do not correct the prediction.
    """
    found = []
    for position, index in enumerate(outputs):
        shown = shown_state(system, system.variables[index].name)
        if shown is None:
            continue
        state, factor = shown
        rate: int | None = None
        for other in range(system.x.numel()):
            if is_rate(system, other, state):
                rate = other
        found.append((position, state, rate, factor))
    return tuple(found)


def shown_state(system: System, name: str) -> tuple[int, ca.SX] | None:
    """Return the state that a variable shows, and its factor: the variable is factor times state, and more.

    It is the state that the variable is, up to a factor; or else the one of the same unit that it differs from, as by
    the deflection of a shaft; or that of the variable it is named after, as ``encoder.s.sensor_delay.y`` is.
    """
    names = {variable.name for variable in system.variables}
    while name:
        relation = system.state_relations.get(name)
        if relation is not None:
            return relation.state, relation.factor
        slope = ca.jacobian(system.outputs[system.index_of(name)], system.x) if name in names else ca.SX(1, 0)
        for state in slope.sparsity().get_triplet()[1]:
            is_fixed = not ca.depends_on(slope[0, state], ca.vertcat(system.x, system.u, system.time))
            if is_fixed and _unit_of_state(system, state) == system.unit_of(name) != "1":
                return state, slope[0, state]
        name = name.rpartition(".")[0]
    return None


def _unit_of_state(system: System, state: int) -> str:
    """Return the unit of a state; one that no variable is stands as ``der(x)``."""
    name = system.states[state]
    inner = name.removeprefix("der(").removesuffix(")")
    return system.unit_of(name) if name in system.positions[0] else f"{system.unit_of(inner)}/s"


def weighed(error: ca.SX, huber: float) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return half the sum of squares, its gradient and curvature; beyond `huber` the square goes on as a line.

    References
    ----------
    P. J. Huber, Ann. Math. Statist. 35 (1964), 73-101, doi:10.1214/aoms/1177703732.
    """
    if not np.isfinite(huber):
        return ca.sumsqr(error) / 2, error, ca.SX.ones(error.numel())
    size = ca.fabs(error)
    is_small = size <= huber
    loss = ca.if_else(is_small, error**2 / 2, huber * (size - huber / 2))
    weight = ca.if_else(is_small, 1, huber / ca.fmax(size, huber))
    return ca.sum1(loss), weight * error, weight


def parameter_function(layout: Layout) -> ca.Function:
    """Return theta -> all parameters of the system, ties included."""
    theta = ca.SX.sym("theta", len(layout.slots))
    p = sized_parameters(layout, theta, ca.SX(layout.sizes))
    return ca.Function("parameters", [theta], [p], ["theta"], ["p"])


def sized_parameters(layout: Layout, theta: ca.SX, sizes: ca.SX) -> ca.SX:
    """Return all parameters of the system, ties included, from those of each slot, scaled, and their sizes."""
    system = layout.system
    p = ca.SX(ca.DM(system.parameter_values))
    for position, slot in enumerate(layout.slots):
        plain = replace(layout.free[slot.owners[0]], scale=1.0)
        p[system.parameter_index(slot.parameter)] = plain.value(theta[position]) * sizes[position]
    if layout.ties:
        tied = ca.substitute([tie.value for tie in layout.ties], [system.p], [p])
        for tie, value in zip(layout.ties, tied, strict=True):
            p[tie.index] = value
    for i, least in layout.floors:
        p[i] = ca.fmax(p[i], least)
    return p


def sample_step(layout: Layout, theta: ca.SX, w: ca.SX, x: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the state at the next sample and the weighted residual of this one, whose data is a column."""
    step = runge_kutta(layout.system, substeps=layout.substeps)
    p = parameter_function(layout)(theta)
    now, error = seen(layout, step, p, w, x, data)
    n_u = layout.system.u.numel()
    time, width, u_a, u_b, _ = ca.vertsplit(data, [0, 1, 2, 2 + n_u, 2 + 2 * n_u, data.numel()])
    return step.function(time, width, now, u_a, u_b, p), error


def seen(layout: Layout, step: Step, p: ca.SX, w: ca.SX, x: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the state as the sample corrects it, and the weighted residual there."""
    n_u, n_y = layout.system.u.numel(), len(layout.outputs)
    time, width, u_a, _, measured, weight = ca.vertsplit(
        data, [0, 1, 2, 2 + n_u, 2 + 2 * n_u, 2 + 2 * n_u + n_y, 2 + 2 * n_u + 2 * n_y]
    )
    error = measured - step.measure(time, width, x, u_a, p)[list(layout.outputs)]
    return corrected(layout, p, w, x, error, (width, weight)), weight * error


def corrected(layout: Layout, p: ca.SX, w: ca.SX, x: ca.SX, error: ca.SX, sample: tuple[ca.SX, ca.SX]) -> ca.SX:
    """Return a state as the innovation at a sample, of which width and weights are given, corrects it."""
    (width, weight), now = sample, ca.SX(x)
    # width is 0 at the last sample of a run and at padding: nothing is corrected or stepped there
    for position, state, rate, factor in injection_targets(layout.system, layout.outputs):
        factor = ca.substitute(factor, layout.system.p, p) if layout.system.p.numel() else factor
        rho = ca.exp(-w[position] * width)
        seen = (weight[position] > 0) * error[position] / factor
        if rate is None:
            now[state] += (1 - rho) * seen
        else:
            now[state] += (1 - rho**2) * seen
            now[rate] += (1 - rho) ** 2 * seen / ca.fmax(width, 1e-30)
    return now


def stack_data(layout: Layout, experiments: tuple[Experiment, ...], weights: np.ndarray) -> np.ndarray:
    """Return the samples of all runs in segments, shape (n_rows, n_segments * length).

    Rows are time, width of the interval, inputs at its ends, measured outputs, weights (1/sd, 0 where missing).

    Parameters
    ----------
    layout
        The layout of the same experiments.
    experiments
        The runs.
    weights
        1/sd of each output, shape (n_y,).
    """
    n_u, n_y = layout.system.u.numel(), len(layout.outputs)
    columns = np.zeros((2 + 2 * n_u + 2 * n_y, layout.n_segments * layout.length))
    for run, (experiment, first) in enumerate(zip(experiments, layout.first, strict=True)):
        n = layout.run_lengths[run]
        block = columns[:, first * layout.length :][:, :n]
        block[0] = experiment.time
        block[1, :-1] = np.diff(experiment.time)
        for row, name in enumerate(layout.system.inputs):
            left, right = interval_inputs(experiment, layout.system, name)
            block[2 + row], block[2 + n_u + row] = left, right
        for row, name in enumerate(layout.output_names):
            if name not in experiment.outputs:
                continue
            values = experiment.outputs[name].values
            known = np.isfinite(values)
            block[2 + 2 * n_u + row] = np.where(known, values, 0.0)
            block[2 + 2 * n_u + n_y + row] = np.where(known, weights[row], 0.0)
    return columns


def interval_inputs(experiment: Experiment, system: System, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return an input at both ends of the interval after each sample, shapes (n,)."""
    if name not in experiment.inputs:
        value = system.variables[system.index_of(name)].declaration.default or 0.0
        constant = np.full(experiment.time.size, value)
        return constant, constant
    channel = experiment.inputs[name]
    if channel.hold == "zoh":
        return channel.values, channel.values
    return channel.values, np.append(channel.values[1:], channel.values[-1])
