"""Running one FMU over output times: model exchange by `march`, co-simulation by its own steps."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartpend_dae.fmi.drive import Drive, drive
from cartpend_dae.fmi.instance import READABLE, EventInfo, Instance, Kind, Reader
from cartpend_dae.fmi.march import EndedByModel, Tolerance, march

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be run: output times (n,) [s], packed inputs, start values and parameters, tolerances."""

    kind: Kind
    times: np.ndarray
    inputs: Mapping[str, Any]
    values: Mapping[str, Any]
    rtol: float = 1e-8
    atol: float = 1e-10


@dataclass(frozen=True, slots=True)
class Rows:
    """The result of a run: `values` (n, n_columns) by `names`; what the FMU said; the number of events seen.

    Rows are missing at the end if the FMU asked for the end of the run.
    """

    names: tuple[str, ...]
    values: np.ndarray
    log: tuple[str, ...]
    n_events: int


def run(folder: Path, description: "ModelDescription", task: Task, label: str) -> Rows:
    """Run an FMU that was unpacked into a folder, in this process.

    Raises
    ------
    SolverError
        If a call of the FMU or the integration fails.
    """
    driven = drive(task.inputs)
    with Instance(folder, description, task.kind, label) as instance:
        variables = [v for v in description.modelVariables if v.type in READABLE and v.causality != "independent"]
        reader = instance.reader(variables)
        begin, end = float(task.times[0]), float(task.times[-1])
        info = instance.begin(begin, end, task.values, driven.at(begin))
        if task.kind == "cs":
            values, n_events = _co_simulated(instance, reader, driven, task.times), 0
        else:
            plant = FmuPlant(instance, driven, begin, end, reader)
            plant.take(info)
            x = instance.states()
            nominal = instance.nominals()
            scale = np.where((nominal > 0) & np.isfinite(nominal), nominal, 1.0)
            values, n_events = march(plant, x, task.times, Tolerance(task.rtol, task.atol * scale))
        return Rows(reader.names, values, tuple(instance.log), n_events)


class FmuPlant:
    """An FMU for model exchange with its inputs, as `march` wants it."""

    n_falling = 0

    def __init__(self, instance: Instance, driven: Drive, begin: float, end: float, reader: Reader) -> None:
        self.name, self._instance, self._driven, self._reader = instance.label, instance, driven, reader
        self._jumps, self._since = driven.jumps(begin, end), begin
        self._varies = bool(driven.joined or driven.functions)
        self._info = EventInfo(np.inf, False)

    def take(self, info: EventInfo) -> None:
        """Take note of what the FMU said after an event."""
        self._info = info
        if info.terminate:
            raise EndedByModel

    def _move(self, time: float, x: np.ndarray) -> None:
        self._instance.move(time, x, self._continuous(time))

    def _continuous(self, time: float) -> dict[str, float] | None:
        if not self._varies:
            return None
        values = self._driven.at(time, self._since)
        return {name: values[name] for name in (*self._driven.joined, *self._driven.functions)}

    def rates(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return the derivatives (n_x,)."""
        self._move(time, x)
        return self._instance.rates()

    def indicators(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return the event indicators (n_z,)."""
        if not self._instance.n_z:
            return np.zeros(0)
        self._move(time, x)
        return self._instance.indicators()

    def next_time(self) -> float:
        """Return the next time event of the FMU or jump of an input [s]."""
        later = self._jumps[self._jumps > self._since]
        return min(self._info.next_time, float(later[0]) if later.size else np.inf)

    def completed(self, time: float, x: np.ndarray) -> bool:
        """Tell the FMU that a step is done."""
        self._move(time, x)
        event, terminate = self._instance.completed_step()
        if terminate:
            raise EndedByModel
        return event

    def event(self, time: float, x: np.ndarray) -> np.ndarray:
        """Carry out an event of the FMU, and return its states."""
        self._move(time, x)
        passed = self._jumps[self._jumps <= time + 1e-12 * max(1.0, abs(time))]
        if passed.size:
            self._since = max(self._since, float(passed[-1]))
        inputs = self._driven.at(time, self._since)
        self.take(self._instance.event(inputs))
        return self._instance.states()

    def observe(self, time: float, x: np.ndarray) -> np.ndarray:
        """Return all numeric variables."""
        self._move(time, x)
        return self._reader()


def _co_simulated(instance: Instance, reader: Reader, driven: Drive, times: np.ndarray) -> np.ndarray:
    """Let the FMU go from output time to output time, and to the jumps of inputs where it takes steps of any width."""
    stepping = instance.description.coSimulation
    takes_any = stepping is not None and bool(stepping.canHandleVariableCommunicationStepSize)
    jumps = driven.jumps(float(times[0]), float(times[-1])) if takes_any else np.zeros(0)
    points = np.union1d(times, jumps)
    wanted = set(times.tolist())
    rows = [reader()]
    for begin, end in zip(points[:-1].tolist(), points[1:].tolist(), strict=True):
        instance.set(driven.at(begin))
        if instance.do_step(begin, end - begin):
            break
        if end in wanted:
            rows.append(reader())
    return np.array(rows)
