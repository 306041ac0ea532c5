"""Where a model is linearised: at start values, at a rest, or at a time of a trajectory."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartpend_dae.assemble import check_bounds
from cartpend_dae.dae import parameter_vector
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError
from cartpend_dae.initialize import initialize, unknown_parameters
from cartpend_dae.linear_model import FloatArray
from cartpend_dae.quantities import is_number
from cartpend_dae.singular import check_regular
from cartpend_dae.start_conditions import Steady
from cartpend_dae.system import System

Place = Mapping[str, float] | Literal["steady"] | tuple[Trajectory, float]


@dataclass(frozen=True, slots=True)
class Point:
    """An operating point in SI units: time [s], states, algebraic variables, inputs, parameters, friction forces."""

    time: float
    x: FloatArray
    z: FloatArray
    u: FloatArray
    p: FloatArray
    force: FloatArray

    @property
    def arguments(self) -> tuple[float | FloatArray, ...]:
        """What the functions of `dae` take."""
        return self.time, self.x, self.z, self.u, self.p, self.force


def without_discretes(system: System, at: Place | None) -> tuple[Place | None, dict[str, float]]:
    """Return the place without the discrete variables of a model, and their values there."""
    names = [system.variables[i].name for i in system.hybrid.discretes]
    if isinstance(at, tuple):
        trajectory, time = _moment(at)
        last = max(int(np.searchsorted(trajectory.time, time, side="right")) - 1, 0)
        return at, {name: float(trajectory[name][last]) for name in names if name in trajectory}
    if isinstance(at, Mapping):
        held = {name: value for name, value in at.items() if name in names}
        for name, value in held.items():
            if not is_number(value):
                raise ModelError(f"The value of `{name}` at the operating point must be a number, not {value!r}.")
        return {name: value for name, value in at.items() if name not in held}, held
    return at, {}


def operating_point(
    system: System,
    at: Place | None,
    steady: Steady,
    inputs: dict[str, float],
    parameters: dict[str, float],
    time: float,
) -> Point:
    """Return where a model is to be linearised; see `linearize` for the arguments.

    Raises
    ------
    ModelError
        For a place that is none, an unknown name, or a value that is no number.
    SolverError
        If there is no such start.
    """
    if isinstance(at, tuple):
        if steady:
            raise ModelError(
                "A point of a trajectory is where it is: leave out `steady`, or give start values as `at`."
            )
        return _on_trajectory(system, *_moment(at), inputs, parameters)
    if isinstance(at, str):
        if at != "steady":
            raise ModelError(f"`at` is a dictionary of start values, `steady` or (trajectory, time), not {at!r}.")
        at, steady = {}, True
    start = dict(at or {})
    for name, value in start.items():
        if name in system.inputs:
            raise ModelError(f"`{name}` is an input: give its value as `inputs={{'{name}': {value!r}}}`, not by `at`.")
        if not is_number(value):
            raise ModelError(f"The value of `{name}` at the operating point must be a number, not {value!r}.")
    p = _parameters(system, parameters)
    u = np.array([inputs.get(name, _default(system, name)) for name in system.inputs])
    begin = initialize(system, p, u, start, time, unknown=unknown_parameters(system, parameters, {}), steady=steady)
    return Point(time, begin.x, begin.z, u, begin.p, np.zeros(len(system.frictions.places)))


def _parameters(system: System, changes: dict[str, float]) -> FloatArray:
    p = parameter_vector(system, changes)
    check_bounds(system, p)
    check_regular(system, p)
    return p


def _default(system: System, name: str) -> float:
    return system.variables[system.index_of(name)].declaration.default or 0.0


def _moment(at: tuple[object, ...]) -> tuple[Trajectory, float]:
    trajectory, time = at if len(at) == 2 else (None, None)
    if not isinstance(trajectory, Trajectory) or not is_number(time):
        raise ModelError("`at` is a dictionary of start values, `steady`, or a pair (trajectory, time in seconds).")
    first, last = trajectory.time[0], trajectory.time[-1]
    if not first <= time <= last:
        raise ModelError(f"`at`: the trajectory runs from {first:g} s to {last:g} s; it has no point at {time:g} s.")
    return trajectory, float(time)


def _on_trajectory(
    system: System, trajectory: Trajectory, time: float, inputs: dict[str, float], parameters: dict[str, float]
) -> Point:
    missing = [name for name in (*system.states, *system.inputs) if name not in trajectory]
    if missing:
        raise ModelError(
            f"The trajectory does not hold {', '.join(f'`{name}`' for name in missing)}, which the operating point of "
            f"{system.name} needs: declare a variable for each derivative, and simulate the same model."
        )

    def value(name: str) -> float:
        return float(np.interp(time, trajectory.time, trajectory[name])) if name in trajectory else 0.0

    found = {q.name: value(q.name) for q in system.parameters if q.is_unknown and q.name in trajectory}
    return Point(
        time,
        x=np.array([value(name) for name in system.states]),
        z=np.array([value(name) for name in system.algebraics]),
        u=np.array([inputs.get(name, value(name)) for name in system.inputs]),
        p=_parameters(system, found | parameters),
        force=np.zeros(len(system.frictions.places)),
    )
