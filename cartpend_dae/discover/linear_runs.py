"""Runs as linear systems about the filtered motion, driven by unknown inputs at places of the model.

The trajectory x follows the data by output injection. With F the slope of the model's own step, without injection,

    dx' = F dx - g + B d + E dtheta,    r = r_0 + C dx + D d + H dtheta,

g being what the injection added at a sample. So the unknown inputs d, and the deviations dtheta of what was fitted and
of the start states, have a likelihood of their own, and the residual of the injection does not enter it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError
from cartpend_dae.problem import Problem, dominant_frequency
from cartpend_dae.shooting import carried_on, run_through, scaled_values, start_slopes
from cartpend_dae.transcribe import sample_step, stack_data

# an unknown input is constant over a part of the period of the strongest line, within these times [s]
PART, SHORTEST, LONGEST = 24, 0.01, 0.05
# blocks of all runs together, above which the inputs are constant for longer
MOST = 3000


@dataclass(frozen=True, slots=True)
class Block:
    """Some samples of a run as one step of the whole state (dx, dtheta, d): it becomes `step` times it, and `rest`.

    The sum of squared residuals is |`offset` + `root`' state|^2 + `constant`; `width` is in seconds.
    """

    step: np.ndarray
    rest: np.ndarray
    root: np.ndarray
    offset: np.ndarray
    constant: float
    width: float


@dataclass(frozen=True, slots=True)
class LinearRun:
    """A run in blocks; `start` (n_x, n_theta) is how its start state depends on dtheta, `first` the sample of each."""

    name: str
    time: np.ndarray
    first: np.ndarray
    start: np.ndarray
    blocks: tuple[Block, ...]
    local: "Local"


@dataclass(frozen=True, slots=True)
class Local:
    """Slopes at each sample, (n, ...): F, E and B, g, C, H and D, the residual, and the states (n, n_x)."""

    transition: np.ndarray
    theta: np.ndarray
    unknown: np.ndarray
    jump: np.ndarray
    seen: np.ndarray
    seen_theta: np.ndarray
    seen_unknown: np.ndarray
    residual: np.ndarray
    states: np.ndarray


@dataclass(frozen=True, slots=True)
class LinearRuns:
    """All runs, with the names of the unknown inputs; `problem` and `values` are what was linearised, and where.

    `n` is the number of measured values, `noise` the factor on the sensors' noise with which residuals are weighed.
    """

    unknown: tuple[str, ...]
    n_x: int
    n_theta: int
    runs: tuple[LinearRun, ...]
    problem: Problem
    values: np.ndarray
    n: int = 0
    noise: float = 1.0

    def with_noise(self, factor: float) -> "LinearRuns":
        """Return the same with the noise of all sensors larger by a factor."""
        runs = tuple(replace(run, blocks=tuple(_noisier(block, factor) for block in run.blocks)) for run in self.runs)
        return replace(self, runs=runs, noise=self.noise * factor)


def _noisier(block: Block, factor: float) -> Block:
    return replace(block, root=block.root / factor, offset=block.offset / factor, constant=block.constant / factor**2)


def linear_runs(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    unknown: tuple[Insertion, ...],
    point: Mapping[str, float],
    bandwidth: float,
    sd: np.ndarray,
    *,
    fineness: int = 1,
) -> LinearRuns:
    """Linearise the training runs at a fit, with inputs that nobody knows.

    Parameters
    ----------
    bench
        The workbench.
    taken
        Effects in the model already.
    unknown
        Effects with one size each, the unknown input.
    point
        The fit: parameters and free starts by name, SI.
    bandwidth
        Bandwidth of the output injection that keeps the trajectory at the data [rad/s].
    sd
        Noise used as weight, shape (n_y,).
    fineness
        Into how many parts the times are divided over which inputs are constant.

    Raises
    ------
    SolverError
        If the simulation diverges.
    """
    problem = bench.build((*taken, *unknown), bench.setup.train)
    values = scaled_values(problem, point)
    names = tuple(insertion.size_names[0] for insertion in unknown)
    data = stack_data(problem.layout, problem.experiments, 1.0 / sd)
    states = run_through(problem, values, np.full(len(problem.outputs), float(bandwidth)), data)[1]
    if not np.all(np.isfinite(states)):
        raise SolverError(f"{problem.system.name} cannot be followed along its data: it diverges.")
    local = _slopes(problem, values, data, states, names)
    frequency = dominant_frequency(bench.setup.train)
    whole = sum(float(np.ptp(run.time)) for run in problem.experiments)
    longest = float(np.clip(2 * np.pi / max(frequency, 1e-12) / PART, SHORTEST, LONGEST))
    longest = max(longest / fineness, whole / MOST)
    layout, slopes = problem.layout, start_slopes(problem, values)
    own = _own(problem, names)
    runs = []
    for k, (run, first, n) in enumerate(zip(problem.experiments, layout.first, layout.run_lengths, strict=True)):
        part = slice(first * layout.length, first * layout.length + n)
        runs.append(_run(run.name, data[:2, part], _cut(local, part), slopes[k][:, own], longest))
    n = int(np.count_nonzero(data[-len(problem.outputs) :]))
    return LinearRuns(names, layout.n_state, len(own), tuple(runs), problem, values, n)


def _own(problem: Problem, names: tuple[str, ...]) -> list[int]:
    """Return the variables that are no unknown inputs."""
    return [i for i, item in enumerate(problem.variables) if item.name not in names]


def _slopes(
    problem: Problem, values: np.ndarray, data: np.ndarray, states: np.ndarray, names: tuple[str, ...]
) -> Local:
    """Differentiate the step between samples without injection, at all samples."""
    layout = problem.layout
    n_x, n_y, n_p, n = layout.n_state, len(layout.outputs), len(layout.slots), data.shape[1]
    theta, gain, x = ca.SX.sym("theta", n_p), ca.SX.sym("w", n_y), ca.SX.sym("x", n_x)
    column = ca.SX.sym("data", data.shape[0])
    after = ca.vertcat(*sample_step(layout, theta, gain, x, column))
    found = ca.densify(ca.horzcat(after, ca.jacobian(after, ca.vertcat(x, theta))))
    function = ca.Function("local", [ca.vertcat(theta, gain), x, column], [found], {"cse": True})
    carried = np.repeat(carried_on(problem, values, np.zeros(n_y)), layout.length, axis=1)
    table = np.asarray(function.map(n)(carried, states, data)).reshape(n_x + n_y, n, 1 + n_x + n_p).transpose(1, 0, 2)
    value, by_x, by_slot = table[:, :, 0], table[:, :, 1 : 1 + n_x], table[:, :, 1 + n_x :]
    owners = np.repeat(layout.owners[layout.runs], layout.length, axis=0)
    by_all = np.zeros((n, n_x + n_y, values.size))
    for slot in range(n_p):
        by_all[np.arange(n), :, owners[:, slot]] += by_slot[:, :, slot]
    known, order = _own(problem, names), {item.name: i for i, item in enumerate(problem.variables)}
    inputs = [order[name] for name in names]
    scales = np.array([problem.variables[i].scale for i in inputs])
    mine, foreign = by_all[:, :, known], by_all[:, :, inputs] / scales
    jump = np.zeros((n, n_x))
    jump[:-1] = states.T[1:] - value[:-1, :n_x]
    parts = (mine, foreign)
    return Local(
        by_x[:, :n_x],
        parts[0][:, :n_x],
        parts[1][:, :n_x],
        jump,
        by_x[:, n_x:],
        parts[0][:, n_x:],
        parts[1][:, n_x:],
        value[:, n_x:],
        states.T,
    )


def _cut(local: Local, part: slice) -> Local:
    return Local(*(getattr(local, name)[part] for name in Local.__dataclass_fields__))


def _run(name: str, clock: np.ndarray, local: Local, start: np.ndarray, longest: float) -> LinearRun:
    time, widths = clock
    each = max(1, round(longest / max(float(np.median(widths[:-1])), 1e-12)))
    first = np.arange(0, time.size, each)
    blocks = tuple(
        _block(local, slice(k, min(k + each, time.size)), float(widths[k : k + each].sum()), k + each >= time.size)
        for k in first
    )
    return LinearRun(name, time, first, start, blocks, local)


def _block(local: Local, part: slice, width: float, is_last: bool) -> Block:
    """Join the samples of a block, over which the unknown inputs are constant."""
    n_x, n_theta, n_d = local.transition.shape[1], local.theta.shape[2], local.unknown.shape[2]
    size = n_x + n_theta + n_d
    whole, rest = np.eye(size), np.zeros(size)
    slopes, errors = [], []
    for k in range(part.start, part.stop):
        seen = np.hstack([local.seen[k], local.seen_theta[k], local.seen_unknown[k]])
        slopes.append(seen @ whole)
        errors.append(local.residual[k] + seen @ rest)
        if k + 1 == part.stop and is_last:
            break
        moved = np.hstack([local.transition[k], local.theta[k], local.unknown[k]])
        rest = np.concatenate([moved @ rest - local.jump[k], rest[n_x:]])
        whole = np.vstack([moved @ whole, whole[n_x:]])
    slope, error = np.vstack(slopes), np.concatenate(errors)
    constant = 0.0
    if len(slope) > size:  # as few rows as say the same
        turn, short = np.linalg.qr(slope)
        constant = float(error @ error)
        slope, error = short, turn.T @ error
        constant -= float(error @ error)
    return Block(whole, rest, slope.T, error, constant, width)
