"""FMUs that others made: what they say of themselves, and their simulation to a Trajectory."""

import logging
import math
import platform
import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError, StudyError
from cartpend_dae.fmi.archive import DESCRIPTION, unpacked
from cartpend_dae.fmi.contained import contained
from cartpend_dae.fmi.drive import check_names, packed
from cartpend_dae.fmi.instance import READABLE, Kind, element_names
from cartpend_dae.fmi.runs import Rows, Task, run
from cartpend_dae.inputs import Input
from cartpend_dae.quantities import is_number
from cartpend_dae.simulate import output_grid

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ModelVariable

logger = logging.getLogger(__name__)

LIMIT = 60.0
WARNING = "Running an FMU runs its code, with all your rights: open those that you trust."


@dataclass(frozen=True, slots=True)
class ForeignVariable:
    """A variable as the FMU declares it; numbers are in `unit`, as the FMU calls it."""

    name: str
    type: str
    causality: str
    variability: str
    unit: str
    start: str | None
    description: str
    elements: tuple[str, ...]
    is_numeric: bool


@dataclass(frozen=True, slots=True)
class Description:
    """What an FMU says of itself."""

    model: str
    version: str
    kinds: tuple[Kind, ...]
    tool: str
    text: str
    n_states: int
    n_indicators: int
    start: float
    stop: float | None
    tolerance: float | None
    platforms: tuple[str, ...]
    gives_directional: bool


@dataclass(frozen=True, slots=True)
class ForeignFmu:
    """An FMU that was read but not yet run."""

    path: Path
    description: Description
    variables: tuple[ForeignVariable, ...]
    model_description: "ModelDescription" = field(repr=False, compare=False)

    def names(self, causality: str) -> list[str]:
        """Return the names of the numeric variables with a causality, such as ``"input"``."""
        return [v.name for v in self.variables if v.causality == causality and v.is_numeric]

    def simulate(
        self,
        stop: float | None = None,
        *,
        times: Sequence[float] | np.ndarray | None = None,
        points: int = 501,
        inputs: Mapping[str, Input] | None = None,
        start: Mapping[str, Any] | None = None,
        parameters: Mapping[str, Any] | None = None,
        kind: Kind | None = None,
        rtol: float = 1e-8,
        atol: float = 1e-10,
        limit: float = LIMIT,
        contain: bool = True,
    ) -> Trajectory:
        """Run the FMU.

        Parameters
        ----------
        stop, times, points
            End [s] or output times, as in `cartpend_dae.simulate`; without both, the FMU's own experiment.
        inputs
            Inputs by name, as in `cartpend_dae.simulate`; one that is left out keeps the start value of the FMU.
        start, parameters
            Start values and parameters by name, in the units of the FMU.
        kind
            ``"me"`` (model exchange, integrated here) or ``"cs"`` (co-simulation, the FMU steps from output time to
            output time); by default model exchange where the FMU offers it.
        rtol, atol
            Tolerances for model exchange; the absolute one is multiplied by the nominal values of the FMU.
        limit
            Seconds after which a contained run is ended.
        contain
            Run the code of the FMU in a process of its own (2 s), so that a crash of it is reported.

        Returns
        -------
        Trajectory
            All numeric variables; arrays element by element; units as the FMU calls them. It ends early if the FMU
            asks for the end.

        Raises
        ------
        ModelError
            For unknown names, inputs that are none, or a kind that the FMU does not offer.
        StudyError
            If the FMU cannot run on this machine.
        SolverError
            If the FMU or the integration fails.
        """
        chosen = self._kind(kind)
        values = {**(start or {}), **(parameters or {})}
        label = self.path.name
        check_names(label, inputs or {}, self.names("input"), "input")
        check_names(label, values, [v.name for v in self.variables], "variable")
        wrong = [name for name, value in values.items() if not is_number(value)]
        if wrong:
            raise ModelError(f"{label}: the start values of {', '.join(f'`{n}`' for n in wrong)} must be numbers.")
        grid = self._grid(stop, times, points)
        asked = {"kind": chosen, "inputs": packed(inputs or {}), "values": values, "rtol": rtol, "atol": atol}
        with self.opened(chosen) as folder:
            if contain:
                rows = _contained_run(folder, label, grid, asked, limit)
            else:
                rows = run(folder, self.model_description, Task(times=grid, **asked), label)
        if (n := rows.values.shape[0]) < grid.size:
            logger.warning("%s: the FMU ended the run after %g s.", label, grid[max(n - 1, 0)])
        units = {name: v.unit for v in self.variables for name in v.elements}
        return Trajectory(
            grid[:n], rows.names, rows.values, tuple(units[name] for name in rows.names), {}, rows.n_events
        )

    def _grid(self, stop: float | None, times: Sequence[float] | np.ndarray | None, points: int) -> np.ndarray:
        own = self.description
        if stop is None and times is None:
            begin = own.start
            end = own.stop if own.stop is not None and own.stop > begin else begin + 10.0
            times = np.linspace(begin, end, points)
        return output_grid(stop, times, points, None)

    def _kind(self, kind: Kind | None) -> Kind:
        kinds = self.description.kinds
        if kind is not None and kind not in kinds:
            raise ModelError(f"{self.path.name} offers {' and '.join(k.upper() for k in kinds)}, not {kind!r}.")
        if not kinds:
            raise ModelError(f"{self.path.name} offers neither model exchange nor co-simulation.")
        return kind or ("me" if "me" in kinds else kinds[0])

    @contextmanager
    def opened(self, kind: Kind) -> Iterator[Path]:
        """Yield the unpacked FMU, whose library fits this machine.

        Raises
        ------
        StudyError
            If it has no library for this machine.
        """
        with unpacked(self.path) as folder:
            if problem := library_problem(self, folder, kind):
                raise StudyError(f"{self.path}: {problem}")
            yield folder


def _contained_run(folder: Path, label: str, grid: np.ndarray, asked: dict[str, Any], limit: float) -> Rows:
    answer = contained(
        "simulate", {"unpacked": str(folder), "label": label, "times": grid, **asked}, limit=limit, label=label
    )
    return Rows(tuple(answer["names"]), answer["arrays"]["values"], tuple(answer["log"]), answer["n_events"])


def load_fmu(path: Path | str) -> ForeignFmu:
    """Read an FMU 2.0 or 3.0; nothing of its code is run.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    StudyError
        If it is no FMU, breaks the bounds of `fmi.archive`, or its description is wrong.
    """
    import fmpy

    path = Path(path)
    with unpacked(path) as folder:
        try:
            read = fmpy.read_model_description(str(folder), validate=False)
            platforms = tuple(fmpy.supported_platforms(str(folder)))
            variables = tuple(_variable(v) for v in read.modelVariables)
            described = _described(read, platforms, _gives_directional(folder))
        except Exception as error:  # FMPy raises what its parsing code happens to meet
            reason = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}".rstrip(".")
            raise StudyError(f"{path}: its modelDescription.xml does not follow the standard ({reason}).") from None
    names = [v.name for v in variables]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})[:5] if len(names) < 10_000 else ["a name"]
        raise StudyError(f"{path}: {', '.join(f'`{name}`' for name in twice)} is declared twice.")
    return ForeignFmu(path, described, variables, read)


def _variable(variable: "ModelVariable") -> ForeignVariable:
    if not isinstance(variable.name, str) or variable.valueReference is None:
        raise ValueError("a variable without name or value reference")
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None) or "1"
    return ForeignVariable(
        variable.name,
        str(variable.type),
        variable.causality or "local",
        variable.variability or "continuous",
        unit,
        variable.start,
        variable.description or "",
        tuple(element_names(variable)) if variable.type in READABLE else (),
        variable.type in READABLE,
    )


def _gives_directional(folder: Path) -> bool:
    """Whether the model exchange of an FMU gives directional derivatives; FMPy reads this of FMI 2.0 only."""
    found = ElementTree.parse(folder / DESCRIPTION).find("ModelExchange")
    names = ("providesDirectionalDerivative", "providesDirectionalDerivatives")
    return found is not None and any(found.get(name) in ("true", "1") for name in names)


def _described(read: "ModelDescription", platforms: tuple[str, ...], gives_directional: bool) -> Description:
    kinds: list[Kind] = []
    if read.modelExchange is not None:
        kinds.append("me")
    if read.coSimulation is not None:
        kinds.append("cs")
    experiment = read.defaultExperiment

    def number(name: str) -> float | None:
        text = getattr(experiment, name, None)
        value = None if text is None else float(text)
        return value if value is not None and math.isfinite(value) else None

    return Description(
        read.modelName or "",
        read.fmiVersion or "",
        tuple(kinds),
        read.generationTool or "",
        read.description or "",
        int(read.numberOfContinuousStates),
        int(read.numberOfEventIndicators),
        number("startTime") or 0.0,
        number("stopTime"),
        number("tolerance"),
        platforms,
        gives_directional,
    )


def library_problem(fmu: ForeignFmu, folder: Path, kind: Kind) -> str:
    """Return why the library of an FMU cannot be loaded on this machine, empty if nothing speaks against it."""
    import fmpy

    interface = fmu.model_description.modelExchange if kind == "me" else fmu.model_description.coSimulation
    identifier = interface.modelIdentifier if interface is not None else None
    if not identifier or not identifier.isidentifier():
        return f"the model identifier {identifier!r} is no name of a library."
    places = [f"binaries/{fmpy.platform}", f"binaries/{fmpy.platform_tuple}"]
    place = places[0] if fmu.description.version == "2.0" else places[1]
    library = folder / place / f"{identifier}{fmpy.sharedLibraryExtension}"
    if not library.is_file():
        there = ", ".join(p for p in fmu.description.platforms if p != "c-code") or "no machine"
        sources = (
            " Its C sources are inside: build them for this machine first." if (folder / "sources").is_dir() else ""
        )
        return (
            f"it holds no `{place}/{library.name}`, the library for this machine ({fmpy.platform}); it has libraries "
            f"for {there}.{sources}"
        )
    return _wrong_library(library)


def _wrong_library(library: Path) -> str:
    """Return why a file is no library of this machine; only ELF files are looked into."""
    if not sys.platform.startswith("linux"):
        return ""
    head = library.read_bytes()[:20]
    if len(head) < 20 or head[:4] != b"\x7fELF":
        return f"`{library.name}` in it is no library for Linux: it does not begin as ELF files do."
    machine = struct.unpack("<H", head[18:20])[0]
    if platform.machine() == "x86_64" and (head[4] != 2 or machine != 62):
        return f"`{library.name}` in it is a library for another processor (ELF machine {machine})."
    return ""
