"""One running FMU behind calls that are the same for FMI 2.0 and 3.0; FMPy's ctypes layer stands below it."""

import ctypes
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from cartpend_dae.errors import SolverError

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ModelVariable

T = TypeVar("T")
Kind = Literal["me", "cs"]
READABLE = {"Real", "Integer", "Boolean", "Enumeration", "Float64", "Float32", *[f"Int{n}" for n in (8, 16, 32, 64)]}
READABLE |= {f"UInt{n}" for n in (8, 16, 32, 64)}
MOST_ROUNDS = 1000


@dataclass(frozen=True, slots=True)
class EventInfo:
    """What an FMU says after its event iteration: when it wants the next one [s], and whether it wants to end."""

    next_time: float
    terminate: bool


class Instance:
    """An FMU that was instantiated, for model exchange or co-simulation.

    Every failing call raises `SolverError` with what the FMU said; `log` holds its messages.
    """

    def __init__(self, folder: Path, description: "ModelDescription", kind: Kind, label: str = "") -> None:
        import fmpy.simulation

        self.description, self.kind = description, kind
        self.label = label or description.modelName or "FMU"
        self.is_fmi2 = description.fmiVersion == "2.0"
        self.n_x = description.numberOfContinuousStates if kind == "me" else 0
        self.n_z = description.numberOfEventIndicators if kind == "me" else 0
        self._simulation = fmpy.simulation
        self._fmu: Any = None
        self.log: list[str] = fmi2_callbacks()[1] if self.is_fmi2 else []
        self.log.clear()
        self._called("instantiate", lambda: self._instantiate(str(folder)))
        self._x, self._dx = (ctypes.c_double * self.n_x)(), (ctypes.c_double * self.n_x)()
        self._z = (ctypes.c_double * self.n_z)()
        self._groups: dict[tuple[str, ...], Any] = {}
        self.is_running = False

    def _instantiate(self, folder: str) -> None:
        import fmpy.fmi2

        description, log = self.description, self.log
        if not self.is_fmi2:
            fmi_type = "ModelExchange" if self.kind == "me" else "CoSimulation"
            self._fmu = self._simulation.instantiate_fmu(
                folder, description, fmi_type, logger=lambda environment, status, category, text: note(log, text)
            )
            return
        made = fmpy.fmi2.FMU2Model if self.kind == "me" else fmpy.fmi2.FMU2Slave
        interface: Any = description.modelExchange if self.kind == "me" else description.coSimulation
        fmu = made(guid=description.guid, modelIdentifier=interface.modelIdentifier, unzipDirectory=folder)
        fmu.instantiate(callbacks=fmi2_callbacks()[0])
        self._fmu = fmu

    def _called(self, what: str, call: Callable[[], T]) -> T:
        try:
            return call()
        except SolverError:
            raise
        except Exception as error:  # FMPy raises plain exceptions of many kinds
            said = f"; it says: {' '.join(self.log[-3:])}" if self.log else ""
            reason = " ".join(str(error).split())[:300].rstrip(".")
            raise SolverError(f"{self.label}: the FMU fails to {what}: {reason}{said}.") from error

    def begin(self, time: float, stop: float, values: Mapping[str, Any], inputs: Mapping[str, float]) -> EventInfo:
        """Initialise the FMU.

        Parameters
        ----------
        time, stop
            Start and end of the run [s].
        values
            Start values and parameters by name.
        inputs
            Inputs at the start by name.
        """
        return self._called("initialise", lambda: self._begin(time, stop, dict(values), inputs))

    def _begin(self, time: float, stop: float, values: dict[str, Any], inputs: Mapping[str, float]) -> EventInfo:
        fmu, simulation = self._fmu, self._simulation
        if self.is_fmi2:
            fmu.setupExperiment(startTime=time, stopTime=stop)
        left = simulation.apply_start_values(
            fmu, self.description, values, settable=simulation.settable_in_instantiated
        )
        if self.is_fmi2:
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=time, stopTime=stop)
        left = simulation.apply_start_values(
            fmu, self.description, left, settable=simulation.settable_in_initialization_mode
        )
        if left:
            raise SolverError(
                f"{self.label}: {', '.join(f'`{name}`' for name in sorted(left))} cannot be set before a run: the FMU "
                f"computes it, or it is constant."
            )
        self.set(inputs)
        fmu.exitInitializationMode()
        self.is_running = True
        if self.kind == "cs":
            return EventInfo(math.inf, False)
        return self._iterate()

    def _iterate(self) -> EventInfo:
        fmu = self._fmu
        for _ in range(MOST_ROUNDS):
            update = fmu.newDiscreteStates if self.is_fmi2 else fmu.updateDiscreteStates
            again, terminate, _, _, is_defined, next_time = update()
            if terminate or not again:
                break
        else:
            raise SolverError(f"{self.label}: its event iteration does not end after {MOST_ROUNDS} rounds.")
        if not terminate:
            fmu.enterContinuousTimeMode()
        return EventInfo(float(next_time) if is_defined else math.inf, bool(terminate))

    def event(self, inputs: Mapping[str, float]) -> EventInfo:
        """Carry out an event at the present point, with the inputs after it."""
        return self._called("carry out an event", lambda: self._event(inputs))

    def _event(self, inputs: Mapping[str, float]) -> EventInfo:
        self._fmu.enterEventMode()
        self.set(inputs)
        return self._iterate()

    def states(self) -> np.ndarray:
        """Return the continuous states (n_x,)."""
        if self.n_x:
            self._called("return its states", lambda: self._fmu.getContinuousStates(self._x, self.n_x))
        return np.array(self._x)

    def nominals(self) -> np.ndarray:
        """Return the nominal values of the states (n_x,)."""
        if not self.n_x:
            return np.zeros(0)
        found = (ctypes.c_double * self.n_x)()
        self._called("return nominal values", lambda: self._fmu.getNominalsOfContinuousStates(found, self.n_x))
        return np.abs(np.array(found))

    def move(self, time: float, x: np.ndarray, inputs: Mapping[str, float] | None = None) -> None:
        """Set time [s], states (n_x,) and continuous inputs."""
        self._called("take a time", lambda: self._fmu.setTime(float(time)))
        if self.n_x:
            self._x[:] = x.tolist()
            self._called("take states", lambda: self._fmu.setContinuousStates(self._x, self.n_x))
        if inputs:
            self.set(inputs)

    def rates(self) -> np.ndarray:
        """Return the derivatives of the states (n_x,) [1/s]."""
        if not self.n_x:
            return np.zeros(0)
        get = self._fmu.getDerivatives if self.is_fmi2 else self._fmu.getContinuousStateDerivatives
        self._called("compute its derivatives", lambda: get(self._dx, self.n_x))
        return np.array(self._dx)

    def indicators(self) -> np.ndarray:
        """Return the event indicators (n_z,)."""
        if self.n_z:
            self._called("compute its indicators", lambda: self._fmu.getEventIndicators(self._z, self.n_z))
        return np.array(self._z)

    def completed_step(self) -> tuple[bool, bool]:
        """Tell the FMU that a step is done: whether it wants an event, and whether it wants to end."""
        exchange = self.description.modelExchange
        if exchange is None or not exchange.needsCompletedIntegratorStep:
            return False, False
        event, terminate = self._called("complete a step", self._fmu.completedIntegratorStep)
        return bool(event), bool(terminate)

    def do_step(self, time: float, width: float) -> bool:
        """Let a co-simulation FMU go `width` [s] ahead from `time`; return whether it wants to end."""
        found: Any = self._called(f"step from {time:g} s by {width:g} s", lambda: self._stepped(time, width))
        if self.is_fmi2:
            return bool(found)
        _, terminate, early, reached = found
        if early and reached < time + width * (1 - 1e-9):
            raise SolverError(f"{self.label}: the FMU returned at {reached:g} s from a step to {time + width:g} s.")
        return bool(terminate)

    def _stepped(self, time: float, width: float) -> object:
        import fmpy.fmi1
        import fmpy.fmi2

        try:
            return self._fmu.doStep(currentCommunicationPoint=time, communicationStepSize=width)
        except fmpy.fmi1.FMICallException as error:
            is_discarded = self.is_fmi2 and error.status == fmpy.fmi2.fmi2Discard
            if is_discarded and self._fmu.getBooleanStatus(fmpy.fmi2.fmi2Terminated):
                return True
            raise

    def set(self, values: Mapping[str, Any]) -> None:
        """Set scalar variables by name."""
        if not values:
            return
        groups = self._setters(tuple(values))
        for setter, references, convert, names in groups:
            self._called(
                f"take {', '.join(f'`{name}`' for name in names)}",
                lambda s=setter, r=references, c=convert, n=names: s(r, [c(values[name]) for name in n]),
            )

    def _setters(self, names: tuple[str, ...]) -> list[tuple[Any, list[int], Any, list[str]]]:
        if names not in self._groups:
            groups: dict[str, list[ModelVariable]] = {}
            table = {v.name: v for v in self.description.modelVariables}
            for name in names:
                groups.setdefault(self._type(table[name]), []).append(table[name])
            self._groups[names] = [
                (
                    getattr(self._fmu, f"set{kind}"),
                    [v.valueReference for v in variables],
                    float if kind in ("Real", "Float64", "Float32") else _whole,
                    [v.name for v in variables],
                )
                for kind, variables in groups.items()
            ]
        return self._groups[names]

    def _type(self, variable: "ModelVariable") -> str:
        if variable.type == "Enumeration":
            return "Integer" if self.is_fmi2 else "Int64"
        return str(variable.type)

    def reader(self, variables: "Sequence[ModelVariable]") -> "Reader":
        """Return what reads numeric variables, arrays element by element."""
        return Reader(self, variables)

    def directional(self, unknown: list[int], known: list[int], seed: list[float]) -> np.ndarray:
        """Return the directional derivative of variables in the direction `seed` of others, by value references."""
        found = self._called(
            "give directional derivatives", lambda: self._fmu.getDirectionalDerivative(unknown, known, seed)
        )
        return np.array(found, dtype=float)

    def close(self) -> None:
        """End the run and free the FMU."""
        fmu, self._fmu = self._fmu, None
        if fmu is None:
            return
        try:
            if self.is_running:
                fmu.terminate()
        except Exception as error:  # it has run: what goes wrong now spoils no result
            self.log.append(f"terminate: {error}")
        fmu.freeInstance()

    def __enter__(self) -> "Instance":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _whole(value: float) -> int:
    return round(float(value))


def note(log: list[str], text: bytes | None) -> None:
    """Keep a message of an FMU, the newest hundred."""
    if text:
        log.append(text.decode(errors="replace").strip()[:500])
        del log[:-100]


@functools.cache
def fmi2_callbacks() -> tuple[Any, list[str]]:
    """Return the callbacks of all FMUs 2.0 in this process, and what they say.

    FMPy formats messages in C and hands them to the logger that was registered last, also those of other FMUs: one
    that is freed with its FMU would be called all the same, and the process would crash.
    """
    import fmpy
    import fmpy.fmi2
    from fmpy.logging import addLoggerProxy

    log: list[str] = []
    callbacks = fmpy.fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(
        lambda environment, name, status, category, text: note(log, text)
    )
    callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
    callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
    addLoggerProxy(ctypes.byref(callbacks))
    return callbacks, log


class Reader:
    """Reads numeric variables of an instance as one row of numbers; `names` has one for each element."""

    def __init__(self, instance: Instance, variables: "Sequence[ModelVariable]") -> None:
        groups: dict[str, list[ModelVariable]] = {}
        for variable in variables:
            groups.setdefault(instance._type(variable), []).append(variable)
        self._calls: list[tuple[Any, dict[str, Any]]] = []
        names: list[str] = []
        for kind, members in groups.items():
            arguments: dict[str, Any] = {"vr": [v.valueReference for v in members]}
            if not instance.is_fmi2:
                arguments["nValues"] = int(sum(np.prod(v.shape or (1,)) for v in members))
            self._calls.append((getattr(instance._fmu, f"get{kind}"), arguments))
            names += [name for v in members for name in element_names(v)]
        self.names, self._instance = tuple(names), instance

    def __call__(self) -> np.ndarray:
        """Return the values (n,)."""
        rows = [
            self._instance._called("return its variables", lambda g=get, a=arguments: g(**a))
            for get, arguments in self._calls
        ]
        return np.array([value for row in rows for value in row], dtype=float)


def element_names(variable: "ModelVariable") -> list[str]:
    """Return the name of each element of a variable, counted from 1; a scalar has its own."""
    if not variable.shape:
        return [variable.name]
    return [f"{variable.name}[{','.join(str(i + 1) for i in index)}]" for index in np.ndindex(*variable.shape)]
