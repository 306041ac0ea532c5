"""Simulation of a model with foreign FMUs in it: one integration of all states, events of both sides located.

At each point outputs of the FMUs and variables of the model are made consistent: where an output answers an input at
once, by Newton's method. One evaluation costs some 0.1 ms, as it passes through Python; a model without FMUs is a
hundred times faster.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.fmi.component import Placed, fmu_inputs, fmu_outputs, fmus_in
from cartpend_dae.fmi.drive import Drive, drive, packed
from cartpend_dae.fmi.instance import READABLE, EventInfo, Instance
from cartpend_dae.fmi.march import EndedByModel, Tolerance, march
from cartpend_dae.fmi.native_side import NativeSide
from cartpend_dae.inputs import Input, checked_inputs
from cartpend_dae.language import Component
from cartpend_dae.quantities import HIDDEN
from cartpend_dae.simulate import Asked, output_grid, prepared_run
from cartpend_dae.system import System, parameters_of_all

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

AGREED = 1e-11
ROUNDS, PLAIN_ROUNDS = 30, 3


def simulate_with_fmus(
    model: Component,
    stop: float | None = None,
    *,
    times: Sequence[float] | np.ndarray | None = None,
    points: int = 501,
    inputs: Mapping[str, Input] | None = None,
    start: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | None = None,
    rtol: float = 1e-8,
    atol: float = 1e-10,
) -> Trajectory:
    """Simulate a model in which components stand for FMUs (see `fmu_component`).

    The code of the FMUs runs in this process: a crash of it ends Python. Try them by `cartpend check-fmu` first.

    Parameters
    ----------
    model
        A component; its parts that `fmu_component` made are run by their FMUs.
    stop, times, points, inputs, start, parameters
        As in `cartpend_dae.simulate`; start values of variables inside an FMU are given to it.
    rtol, atol
        Tolerances; the absolute one of an FMU's states is multiplied by their nominal values.

    Returns
    -------
    Trajectory
        Every variable of the model, and of the FMUs under the path of their component.

    Raises
    ------
    ModelError
        If no part is an FMU, and for what `simulate` refuses.
    SolverError
        If an FMU or the integration fails.
    """
    placed = list(fmus_in(model))
    if not placed:
        raise ModelError(f"{type(model).__name__} has no part that `fmu_component` made: use `simulate`.")
    return run_system(
        assemble(model), placed, output_grid(stop, times, points, None), inputs, start, parameters, rtol, atol
    )


def run_system(
    system: System,
    placed: Sequence[Placed],
    grid: np.ndarray,
    inputs: Mapping[str, Input] | None,
    start: Mapping[str, float] | None,
    parameters: Mapping[str, float] | None,
    rtol: float,
    atol: float,
) -> Trajectory:
    """Run an assembled model with the FMUs that are placed in it."""
    with ExitStack() as stack:
        joint = Joint(system, placed, grid, dict(inputs or {}), dict(start or {}), dict(parameters or {}), stack)
        x = joint.begin(grid)
        scale = np.concatenate([np.ones(joint.native.x.size), *[unit.scale() for unit in joint.units]])
        rows, n_events = march(joint, x, grid, Tolerance(rtol, atol * scale))
    names, unit_names, columns = joint.columns()
    return Trajectory(grid[: len(rows)], names, rows[:, columns], unit_names, {}, n_events)


class Unit:
    """One FMU of the model while it runs."""

    def __init__(self, placed: Placed, stack: ExitStack) -> None:
        fmu = placed.fmu
        folder = stack.enter_context(fmu.opened("me"))
        self.placed = placed
        self.instance = stack.enter_context(Instance(folder, fmu.model_description, "me", placed.path or fmu.path.name))
        table = {v.name: v for v in fmu.model_description.modelVariables}
        self.inputs, self.outputs = fmu_inputs(fmu), fmu_outputs(fmu)
        self.read_outputs = self.instance.reader([table[name] for name in self.outputs])
        shown = [v for v in table.values() if v.type in READABLE and v.causality != "independent"]
        self.read_all = self.instance.reader(shown)
        self.order = [self.read_outputs.names.index(name) for name in self.outputs]
        self.info = EventInfo(np.inf, False)
        self.given = np.zeros(len(self.inputs))
        self.is_direct = _is_direct(fmu.model_description, set(self.inputs))

    def give(self, values: np.ndarray) -> None:
        """Give the inputs."""
        self.given = values
        self.instance.set(dict(zip(self.inputs, values.tolist(), strict=True)))

    def scale(self) -> np.ndarray:
        """Return the nominal values of the states."""
        nominal = self.instance.nominals()
        return np.where((nominal > 0) & np.isfinite(nominal), nominal, 1.0)

    def take(self, info: EventInfo) -> None:
        """Take note of what the FMU said after an event."""
        self.info = info
        if info.terminate:
            raise EndedByModel


def _is_direct(description: "ModelDescription", inputs: set[str]) -> bool:
    """Whether an output answers an input at once, as far as the FMU says."""
    return any(
        output.dependencies is None or any(v.name in inputs for v in output.dependencies)
        for output in description.outputs
    )


class Joint:
    """The model and its FMUs, as `march` wants them."""

    def __init__(
        self,
        system: System,
        placed: Sequence[Placed],
        grid: np.ndarray,
        inputs: dict[str, Input],
        start: dict[str, float],
        parameters: dict[str, float],
        stack: ExitStack,
    ) -> None:
        self.name, self.system = system.name, system
        self.units = [Unit(p, stack) for p in placed]
        hidden = [u.placed.name(name) + HIDDEN for u in self.units for name in u.outputs]
        self.wanted = [u.placed.name(name) for u in self.units for name in u.inputs]
        self.where = np.array([system.inputs.index(name) for name in hidden], dtype=int)
        inner = {p.name(v.name) for p in placed for v in p.fmu.variables if v.causality != "input"}
        self.inner = {name: value for name, value in start.items() if name in inner}
        self.asked = Asked(inputs, {n: v for n, v in start.items() if n not in inner}, parameters)
        self.driven = self._drive(inputs, hidden)
        self.jumps = self.driven.jumps(float(grid[0]), float(grid[-1]))
        self.since, self.y = float(grid[0]), np.zeros(len(hidden))
        self._coupled: tuple[float, bytes] | None = None
        self.native: NativeSide
        self.n_falling = 0

    def _drive(self, inputs: dict[str, Input], hidden: list[str]) -> Drive:
        every = checked_inputs(self.system, {**inputs, **dict.fromkeys(hidden, 0.0)})
        return drive(packed(every))

    def _inputs(self, time: float) -> np.ndarray:
        values = self.driven.at(time, self.since)
        u = np.array([values[name] for name in self.system.inputs], dtype=float)
        u[self.where] = self.y
        return u

    def begin(self, grid: np.ndarray) -> np.ndarray:
        """Find a start that fits both sides, and return all states."""
        time = float(grid[0])
        self._start_native(grid)
        for unit, given in zip(self.units, self._divided(self._ask(time)), strict=True):
            inputs = dict(zip(unit.inputs, given.tolist(), strict=True))
            unit.take(unit.instance.begin(time, float(grid[-1]), self._values(unit), inputs))
        for _ in range(ROUNDS):
            x = np.concatenate([self.native.x, *[unit.instance.states() for unit in self.units]])
            before, _ = self.y.copy(), self._couple(time, x)
            if np.allclose(self.y, before, rtol=AGREED, atol=AGREED):
                return self.event(time, x)
            self._start_native(grid)
        raise SolverError(f"{self.name}: no start fits both the model and its FMUs.")

    def _start_native(self, grid: np.ndarray) -> None:
        hidden = {self.system.inputs[i]: float(value) for i, value in zip(self.where, self.y, strict=True)}
        asked = Asked({**(self.asked.inputs or {}), **hidden}, self.asked.start, self.asked.parameters)
        self.native = NativeSide(prepared_run(self.system, grid, asked, with_times=False).begin, self.wanted)
        self.n_falling, self._coupled = self.native.n_indicators, None

    def _ask(self, time: float) -> np.ndarray:
        return self.native.wanted(time, self.native.x, self._inputs(time))

    def _values(self, unit: Unit) -> dict[str, Any]:
        """Return parameters and start values of an FMU."""
        flat, own = self.system.flat, unit.placed
        values = parameters_of_all(flat, self.native.p)
        named = dict(zip([q.name for q in flat.parameters], values.tolist(), strict=True))
        given = {v.name: named[own.name(v.name)] for v in own.fmu.variables if own.name(v.name) in named}
        return given | {
            v.name: self.inner[own.name(v.name)] for v in own.fmu.variables if own.name(v.name) in self.inner
        }

    def _divided(self, values: np.ndarray) -> list[np.ndarray]:
        ends = np.cumsum([len(unit.inputs) for unit in self.units])
        return np.split(values, ends[:-1])

    def _answer(self, time: float, x: np.ndarray, y: np.ndarray, *, reads: bool = True) -> np.ndarray:
        """Give the FMUs their inputs when the model sees the outputs `y`, and return their outputs."""
        self.y = y
        u = self._inputs(time)
        self.native.algebraics(time, x, u)
        asked = self._divided(self.native.wanted(time, x, u))
        for unit, given in zip(self.units, asked, strict=True):
            unit.give(given)
        return np.concatenate([unit.read_outputs()[unit.order] for unit in self.units]) if reads else y

    def _couple(self, time: float, joint: np.ndarray) -> np.ndarray:
        """Make both sides consistent at a point, and return the inputs of the model."""
        point = (time, joint.tobytes())
        if point == self._coupled:
            return self._inputs(time)
        self._coupled = None
        x = joint[: self.native.x.size]
        at = x.size
        for unit in self.units:
            n = unit.instance.n_x
            unit.instance.move(time, joint[at : at + n])
            at += n
        if not any(unit.is_direct for unit in self.units):
            y = np.concatenate([unit.read_outputs()[unit.order] for unit in self.units])
            self._answer(time, x, y, reads=False)
            self._coupled = point
            return self._inputs(time)
        y = self.y
        for k in range(ROUNDS):
            answer = self._answer(time, x, y)
            error = answer - y
            if np.all(np.abs(error) <= AGREED * (1 + np.abs(y))):
                self._coupled = point
                return self._inputs(time)
            y = answer if k < PLAIN_ROUNDS else y + self._newton(time, x, y, error)
        raise SolverError(
            f"{self.name}: at {time:.6g} s the FMUs and the model find no common values for "
            f"{', '.join(f'`{n}`' for n in self.wanted)}: an output answers an input at once; put some dynamics "
            f"between."
        )

    def _newton(self, time: float, x: np.ndarray, y: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Return Newton's step for what the outputs miss, by differences."""
        slopes = np.zeros((y.size, y.size))
        for i in range(y.size):
            width = 1e-7 * (1 + abs(y[i]))
            moved = y.copy()
            moved[i] += width
            slopes[:, i] = (self._answer(time, x, moved) - moved - error) / width
        return np.linalg.lstsq(slopes, -error, rcond=None)[0]

    def rates(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return the derivatives of all states."""
        u = self._couple(time, x)
        own = self.native.rates(time, x[: self.native.x.size], u)
        return np.concatenate([own, *[unit.instance.rates() for unit in self.units]])

    def indicators(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return the indicators of both sides."""
        u = self._couple(time, x)
        own = self.native.indicators(time, x[: self.native.x.size], u)
        return np.concatenate([own, *[unit.instance.indicators() for unit in self.units]])

    def next_time(self) -> float:
        """Return the next event that time decides [s]."""
        later = self.jumps[self.jumps > self.since]
        times = [self.native.next_tick(), *[unit.info.next_time for unit in self.units], *later[:1].tolist()]
        return min(times)

    def completed(self, time: float, x: np.ndarray) -> bool:
        """Tell the FMUs that a step is done."""
        self._couple(time, x)
        answers = [unit.instance.completed_step() for unit in self.units]
        if any(ends for _, ends in answers):
            raise EndedByModel
        return any(event for event, _ in answers)

    def event(self, time: float, x: np.ndarray) -> np.ndarray:
        """Decide on both sides until nothing changes, and return all states."""
        passed = self.jumps[self.jumps <= time + 1e-12 * max(1.0, abs(time))]
        if passed.size:
            self.since = max(self.since, float(passed[-1]))
        n = self.native.x.size
        for _ in range(ROUNDS):
            u = self._couple(time, x)
            self._coupled = None
            own, changed = self.native.decide(time, x[:n], u)
            for unit in self.units:
                unit.take(unit.instance.event(dict(zip(unit.inputs, unit.given.tolist(), strict=True))))
            new = np.concatenate([own, *[unit.instance.states() for unit in self.units]])
            if not changed and np.array_equal(new, x):
                self._couple(time, new)
                return new
            x = new
        raise SolverError(f"{self.name}: at {time:.6g} s the decisions of the model and its FMUs go round in circles.")

    def observe(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return all variables of the model, then those of the FMUs."""
        u = self._couple(time, x)
        own = self.native.outputs(time, x[: self.native.x.size], u)
        return np.concatenate([own, *[unit.read_all() for unit in self.units]])

    def columns(self) -> tuple[tuple[str, ...], tuple[str, ...], list[int]]:
        """Return names, units and columns of what is shown: all but the hidden names, each once."""
        names = [v.name for v in self.system.variables]
        unit_names = [v.declaration.unit for v in self.system.variables]
        for unit in self.units:
            units = {e: v.unit for v in unit.placed.fmu.variables for e in v.elements}
            names += [unit.placed.name(name) for name in unit.read_all.names]
            unit_names += [units[name] for name in unit.read_all.names]
        first = {name: k for k, name in reversed(list(enumerate(names))) if not name.endswith(HIDDEN)}
        shown = sorted(first.values())
        return tuple(names[k] for k in shown), tuple(unit_names[k] for k in shown), shown
