"""All effects in one simulation, as output injection leads it or along the likeliest course of the rig.

Where none of them is felt, the states of the model may follow any course, and those inside the effects follow them.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cartpend_dae.discover.recursion import carried_along
from cartpend_dae.discover.slopes import Local
from cartpend_dae.effects import Insertion
from cartpend_dae.problem import Problem
from cartpend_dae.shooting import carried_on, run_through, scaled_values, start_states
from cartpend_dae.system import System
from cartpend_dae.transcribe import shown_state, stack_data


@dataclass(frozen=True, slots=True)
class Trail:
    """States by their names, shape (n_states, n), and the forces of `loads` (n_d, n), at all samples [SI]."""

    names: tuple[str, ...]
    states: np.ndarray
    loads: tuple[Insertion, ...]
    forces: np.ndarray

    @property
    def content(self) -> tuple[object, ...]:
        """What a result that depends on it depends on."""
        return self.names, self.states, tuple(load.content for load in self.loads), self.forces

    @property
    def sizes(self) -> tuple[str, ...]:
        """Names of the forces."""
        return tuple(name for load in self.loads for name in load.size_names)

    def in_states_of(self, system: System) -> dict[int, np.ndarray] | None:
        """Return the states (n,) of another system that move so, by their place; None if it has not all of them."""
        found: dict[int, np.ndarray] = {}
        for name, values in zip(self.names, self.states, strict=True):
            if name in system.states:
                found[system.states.index(name)] = values
                continue
            shown = shown_state(system, name)
            if shown is None or not shown[1].is_constant():
                return None
            found[shown[0]] = values / float(shown[1])
        return found if len(found) == len(self.names) else None


@dataclass(frozen=True, slots=True)
class Followed:
    """What a model does from each sample of a trail: residuals (n_y, n), states there and one step on, (n_state, n)."""

    residual: np.ndarray
    states: np.ndarray
    ends: np.ndarray


def follow(
    problem: Problem, places: dict[int, np.ndarray], values: np.ndarray, carried: np.ndarray, data: np.ndarray
) -> Followed:
    """Step from each sample to the next, from the states at `places` as they are there, others as they come.

    Parameters
    ----------
    problem
        The problem.
    places
        States that follow the trail, by their place, shape (n,) each.
    values
        Scaled variables (n_all,).
    carried
        Parameters and bandwidths at each sample, shape (n_slots + n_y, n).
    data
        The samples, see `stack_data`.
    """
    alone, n = problem.by_sample(), data.shape[1]
    begin = dict(zip(alone.layout.first, start_states(problem, values), strict=True))
    own, course = list(places), np.array(list(places.values()))
    n_c = len(carried)
    residual = np.empty((len(problem.outputs), n))
    states, ends = np.empty((2, problem.layout.n_state, n))
    x = np.zeros(problem.layout.n_state)
    for k in range(n):
        x = begin.get(k, x).copy()
        x[own] = course[:, k]
        packed = np.concatenate([carried[:, k], x])[:, None]
        after, error, _ = alone.functions.evaluated("series", packed, data[:, k : k + 1])
        states[:, k], residual[:, k] = x, error[:, 0]
        x = after[n_c:, -1]
        ends[:, k] = x
    return Followed(residual, states, ends)


def nominal(
    problem: Problem,
    local: Local,
    found: Followed,
    values: np.ndarray,
    kept: list[int],
    pushed: np.ndarray,
) -> np.ndarray:
    """Return the residuals (n_y, n) to first order of the motion that starts at the starts and that no force moves.

    Parameters
    ----------
    problem, local, found, values
        The problem, what it does from sample to sample, and its scaled variables.
    kept
        Places of the states that `local` has, in its order.
    pushed
        What the forces of the trail add in a step, shape (n, n_kept).
    """
    length = problem.layout.length
    states, ends = found.states[kept].T, found.ends[kept].T
    starts = zip(problem.layout.first, start_states(problem, values), strict=True)
    begin = {k * length: (start[kept] - states[k * length])[:, None] for k, start in starts}
    jumps = np.vstack([ends[:-1] - states[1:], np.zeros((1, len(kept)))]) - pushed
    offsets = carried_along(local.transition, jumps[:, :, None], begin)
    return found.residual + (local.error @ offsets)[:, :, 0].T


@dataclass(frozen=True, slots=True)
class Run:
    """All effects in one simulation: scaled variables, samples, what each carries, residuals (n_y, n) and states.

    `followed` is how a trail was followed, if one was.
    """

    problem: Problem
    values: np.ndarray
    data: np.ndarray
    carried: np.ndarray
    residual: np.ndarray
    states: np.ndarray
    followed: Followed | None

    def own(self, inside: list[int]) -> list[int]:
        """Return the places of the states that are not `inside` effects."""
        return [i for i in range(self.states.shape[0]) if i not in inside]

    def leaves_no_more_than(self, alone: np.ndarray | None) -> bool:
        """Return whether the residuals are those of the model `alone` (n_y, n), if they are given."""
        if alone is None:
            return True
        return bool(np.linalg.norm(self.residual - alone) <= np.linalg.norm(alone) + np.sqrt(alone.size))

    def pushed(self, local: Local, trail: Trail) -> np.ndarray:
        """Return what the forces of a trail add to the states in a step, shape (n, n_own)."""
        slots = _slots(self.problem, trail)
        return np.einsum("kij,jk->ki", local.theta[:, :, slots], self.carried[slots])


def _slots(problem: Problem, trail: Trail) -> list[int]:
    parameters = problem.layout.parameters
    return [parameters.index(name) for name in trail.sizes]


def run_along(
    problem: Problem,
    point: Mapping[str, float],
    bandwidth: float,
    sd: np.ndarray,
    trail: Trail | None,
    places: dict[int, np.ndarray] | None,
) -> Run:
    """Simulate a problem as the output injection leads it, or along a trail whose states are at `places`.

    Other arguments are those of `sweep`.
    """
    values = scaled_values(problem, point)
    w = np.full(len(problem.outputs), float(bandwidth))
    data = stack_data(problem.layout, problem.experiments, 1.0 / sd)
    carried = np.repeat(carried_on(problem, values, w), problem.layout.length, axis=1)
    if trail is None or places is None:
        return Run(problem, values, data, carried, *run_through(problem, values, w, data), None)
    slots = _slots(problem, trail)
    carried[slots] = trail.forces / problem.layout.sizes[slots, None]
    found = follow(problem, places, values, carried, data)
    return Run(problem, values, data, carried, found.residual, found.states, found)
