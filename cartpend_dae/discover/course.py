"""The course that a rig took under random forces: its model linearised along one, and the likeliest one near it.

References
----------
J. Durbin, S. J. Koopman, "Time Series Analysis by State Space Methods", 2nd ed. (2012), section 4.4 (the smoother).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cartpend_dae.continuous import without_events
from cartpend_dae.cuts import owners_of
from cartpend_dae.discover.recursion import carried_along, filters
from cartpend_dae.discover.sweep import strides
from cartpend_dae.discover.unknown_input import Chain, side_by_side
from cartpend_dae.discover.workbench import Workbench, assembled
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError
from cartpend_dae.problem import Problem
from cartpend_dae.shooting import carried_on, run_through, scaled_values, start_slopes, start_states
from cartpend_dae.transcribe import stack_data


@dataclass(frozen=True, slots=True)
class Course:
    """What a rig is taken to have done: scaled variables (n_all,), states (n_state, n) and forces (n_d, n) [SI]."""

    values: np.ndarray
    states: np.ndarray
    forces: np.ndarray

    def towards(self, other: "Course", share: float) -> "Course":
        """Return the course at a share of the way to another one."""
        pairs = ((self.values, other.values), (self.states, other.states), (self.forces, other.forces))
        return Course(*(one + share * (two - one) for one, two in pairs))


@dataclass(frozen=True, slots=True)
class Linear:
    """A model to first order along a course.

    Parameters
    ----------
    chain
        How states and residuals follow from sample to sample, random forces included.
    rows
        Residuals of the nominal motion, which no force moves, and their derivatives, shape (n, n_y, 1 + n_all).
    offset, slopes
        The nominal motion less the course, shape (n, n_state), and its derivatives, (n, n_state, n_all).
    """

    chain: Chain
    rows: np.ndarray
    offset: np.ndarray
    slopes: np.ndarray


@dataclass(frozen=True)
class Forced:
    """A model of which some parameters, `names`, are forces that stay as they are between two samples.

    Each segment of the problem is a single sample; `samples` are stacked as by `stack_data`.
    """

    problem: Problem
    names: tuple[str, ...]
    samples: np.ndarray

    @cached_property
    def _slots(self) -> list[int]:
        """Where the forces stand among the parameters of a run."""
        return [self.problem.layout.parameters.index(name) for name in self.names]

    @cached_property
    def fitted(self) -> list[int]:
        """Which of the variables are fitted: all but the forces."""
        return [i for i, item in enumerate(self.problem.variables) if item.name not in self.names]

    @np.errstate(over="ignore", invalid="ignore")
    def along(self, course: Course) -> Linear:
        """Linearise along a course.

        Raises
        ------
        SolverError
            If the model diverges.
        """
        problem, layout, n_all = self.problem, self.problem.layout, course.values.size
        n_x, n_p, n_y, n = layout.n_state, len(layout.slots), len(layout.outputs), self.samples.shape[1]
        scales = layout.sizes[self._slots]
        carried = carried_on(problem, course.values, np.zeros(n_y))
        carried[self._slots] = course.forces / scales[:, None]
        seeds = np.hstack([np.eye(n_x), np.zeros((n_x, n_p))]).ravel(order="F")
        packed = np.vstack([carried, course.states, np.tile(seeds[:, None], n)])
        after, found = problem.functions.evaluated("rows", packed, self.samples)
        after = after[len(carried) :].T
        moved = after[:, n_x:].reshape(n, n_x + n_p, n_x).transpose(0, 2, 1)
        shown = found[n_y:].T.reshape(n, n_x + n_p, n_y).transpose(0, 2, 1)
        by_force = moved[:, :, n_x:][:, :, self._slots] / scales
        defects = np.vstack([after[:-1, :n_x] - course.states[:, 1:].T, np.zeros((1, n_x))])
        defects = defects - np.einsum("kij,jk->ki", by_force, course.forces)
        starts = zip(start_states(problem, course.values), start_slopes(problem, course.values), strict=True)
        begin = {
            k: np.column_stack([state - course.states[:, k], slope])
            for k, (state, slope) in zip(layout.first, starts, strict=True)
        }
        sample, theta = np.arange(n)[:, None, None], 1 + layout.owners[layout.runs][:, None]
        pushes = np.zeros((n, n_x, 1 + n_all))
        pushes[:, :, 0] = defects
        pushes[sample, np.arange(n_x)[:, None], theta] += moved[:, :, n_x:]
        motion = carried_along(moved[:, :, :n_x], pushes, begin)
        rows = shown[:, :, :n_x] @ motion
        rows[:, :, 0] += found[:n_y].T
        rows[sample, np.arange(n_y)[:, None], theta] += shown[:, :, n_x:]
        if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(motion[:, :, 0]))):
            raise SolverError(f"{problem.system.name} diverges along the motion that random forces make likely.")
        still, measured = np.zeros((n, n_x, n_y)), self.samples[-n_y:].T > 0
        width, seen, owners = self.samples[1], shown[:, :, :n_x], owners_of(problem.experiments)
        pushed = (moved[:, :, :n_x], still, by_force, seen, measured)
        chain = Chain(self.names, *pushed, layout.first, width, owners)
        kept = [0, *(1 + i for i in self.fitted)]
        return Linear(chain, rows[:, :, kept], motion[:, :, 0], motion[:, :, kept[1:]])


def led(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    loads: tuple[Insertion, ...],
    point: Mapping[str, float],
    bandwidth: float,
    sd: np.ndarray,
) -> tuple[Forced, Course]:
    """Return a model whose loads are forces, and the course on which the output injection leads it, without forces.

    Parameters
    ----------
    bench
        The workbench.
    taken
        Effects in the model.
    loads
        Where forces may act.
    point
        Parameters and free starts by name, SI.
    bandwidth
        Bandwidth of the output injection [rad/s].
    sd
        Noise used as weight, shape (n_y,).
    """
    whole = (*taken, *loads)
    system = without_events(assembled(bench.setup.model, whole, bench.setup.train), "An estimation")
    names = tuple(name for load in loads for name in load.size_names)
    usual = bench.problem_of(system, whole, whole)
    values = scaled_values(usual, {**point, **dict.fromkeys(names, 0.0)})
    samples = stack_data(usual.layout, usual.experiments, 1.0 / sd)
    for step, stride in strides(bench.setup, bench.weighing is not None):
        problem = replace(usual, step=step, stride=stride)
        _, states = run_through(problem, values, np.full(len(problem.outputs), float(bandwidth)), samples)
        if np.all(np.isfinite(states)):
            break
    else:
        raise SolverError(f"{usual.system.name} diverges however the output injection leads it.")
    forces = np.zeros((len(names), samples.shape[1]))
    return Forced(problem.by_sample(), names, samples), Course(values, states, forces)


@np.errstate(over="ignore", invalid="ignore")
def smoothed(
    chain: Chain, rows: np.ndarray, sizes: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Filter rows under random forces, and return them white, and the likeliest motion behind each of them.

    Parameters
    ----------
    chain
        The chain, whose residuals change by `error` with the states.
    rows
        Residuals and derivatives at the samples, shape (n, n_y, m), with noise of size 1.
    sizes, times
        Standard deviation and correlation time [s] of each force in each run, shape (n_runs, n_d).

    Returns
    -------
    tuple
        Innovations over the root of their variance (n, n_y, m), and deviations of states (n, n_x, m) and of forces
        (n, n_d, m).

    Raises
    ------
    SolverError
        If what is linear grows so fast that a covariance is none any more.
    """
    n, _, m = rows.shape
    n_x, n_d = chain.transition.shape[1], sizes.shape[1]
    samples, is_on = side_by_side(chain)
    keep = np.exp(-chain.width[samples][:, :, None] / times)[:, None]
    seen = np.where(chain.measured[:, :, None], chain.error, 0.0)
    known = filters(chain.transition[samples], chain.pushes[samples], seen[samples], keep, sizes[None])
    steps, pushes, root, cov = (part[:, 0] for part in (known.step, known.push, known.root, known.covariance))
    if not np.all(np.isfinite(root[is_on])):
        raise SolverError("What is linear along the course grows beyond all numbers.")
    side, c = np.where(chain.measured[:, :, None], rows, 0.0)[samples], seen[samples]
    means, now = np.empty((*samples.shape, n_x + n_d, m)), np.zeros((samples.shape[1], n_x + n_d, m))
    for k, (step, push) in enumerate(zip(steps, pushes, strict=True)):
        means[k] = now
        now = step @ now + push @ side[k]
    white = root @ (side - c @ means[:, :, :n_x])
    pulls = np.zeros(means.shape)
    pulls[:, :, :n_x] = c.swapaxes(2, 3) @ (root.swapaxes(2, 3) @ white)
    backs, back = np.empty_like(means), np.zeros(means.shape[1:])
    for k in reversed(range(len(samples))):
        back = np.where(is_on[k][:, None, None], steps[k].swapaxes(1, 2) @ back + pulls[k], 0.0)
        backs[k] = back
    likeliest, found, whites = means + cov @ backs, np.empty((n, n_x + n_d, m)), np.empty(rows.shape)
    found[samples[is_on]], whites[samples[is_on]] = likeliest[is_on], white[is_on]
    return whites, found[:, :n_x], found[:, n_x:]
