"""FMUs for tests: a model with all that an FMU may have, exports made once, and FMUs opened by FMPy."""

import atexit
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.model_description import ModelDescription

from cartpend_dae import (
    Component,
    Param,
    Statements,
    assemble,
    assign,
    connect,
    der,
    discrete,
    dry_friction,
    initial,
    param,
    sample,
    signal,
    unknown,
    var,
    when,
)
from cartpend_dae.fmi import export_fmu
from cartpend_dae.study import load_model, model_reference
from cartpend_dae.system import System

ROOT = Path(__file__).resolve().parent.parent
VERSIONS = ("2.0", "3.0")
CLASSES = {("2.0", "me"): FMU2Model, ("2.0", "cs"): FMU2Slave, ("3.0", "me"): FMU3Model, ("3.0", "cs"): FMU3Slave}


class Part(Component):
    """A gain that follows from that of its owner."""

    k: Param = param(unit="N/m", doc="stiffness")
    x = signal("in", unit="m", doc="length")
    f = signal("out", unit="N", doc="force")

    def equations(self) -> Statements:
        yield self.f == self.k * self.x


class Mixed(Component):
    """A block that a spring and a force pull over a dry floor: it sticks, is sampled, and has an algebraic loop.

    The air behind it takes the force h + h^3 at the speed v = h + h^3/10, so that h is found by Newton's method.
    """

    m: Param = param(unit="kg", min=0, default=0.5, doc="mass")
    c: Param = param(unit="N/m", min=0, max=1e4, default=40.0, doc="stiffness", nominal=10.0)
    f_c: Param = param(unit="N", min=0, default=1.0, doc="level of the dry friction")
    s_0: Param = param(unit="m", default=0.2, doc="where it starts")
    period: Param = param(unit="s", min=1e-3, default=0.05, doc="of the sampling")
    f: Param = param(unit="N", default=0.0, doc="constant force")
    u = signal("in", unit="N", doc="force")
    y = signal("out", unit="m", doc="where it was at the last sample")
    place = signal("out", unit="m", doc="position, for the spring")
    s = var(unit="m", doc="position")
    v = var(unit="m/s", doc="speed")
    h = var(unit="1", doc="state of the air", start=0.0)
    seen = discrete(unit="m", doc="last sample")

    def __post_init__(self) -> None:
        self.spring = Part(k=2 * self.c)

    def equations(self) -> Statements:
        yield self.place == self.s
        yield connect(self.place, self.spring.x)
        yield der(self.s) == self.v
        yield self.v == self.h + self.h**3 / 10
        air = 0.3 * (self.h + self.h**3)
        yield self.m * der(self.v) == self.u + self.f - self.spring.f - air - dry_friction(self.v, self.f_c)
        yield when(sample(self.period), assign(self.seen, self.s))
        yield self.y == self.seen
        yield initial(self.s == self.s_0)
        yield initial(self.v == 0)


class Found(Component):
    """A spring whose stiffness the start finds: it rests under a load."""

    m: Param = param(unit="kg", min=0, default=2.0, doc="mass")
    d: Param = param(unit="N.s/m", min=0, default=3.0, doc="damping")
    c: Param = param(unit="N/m", min=0, doc="stiffness")
    load: Param = param(unit="N", default=20.0, doc="load")
    s = var(unit="m", doc="length")
    v = var(unit="m/s", doc="speed")

    def equations(self) -> Statements:
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.load - self.c * self.s - self.d * self.v
        yield initial(self.s == 0.1)
        yield initial(self.v == 0)
        yield initial(der(self.v) == 0)


MODELS: dict[str, Any] = {"mixed": Mixed, "found": lambda: Found(c=unknown(100.0))}


def system_of(name: str) -> System:
    """Return a model of this file, of `models/` or of the reference examples, assembled.

    Where a model and an example share a name, `models/NAME` and `examples/NAME` tell them apart.
    """
    if name in MODELS:
        return assemble(MODELS[name]())
    kind, _, stem = name.rpartition("/")
    is_model = kind != "examples" and (ROOT / "models" / f"{stem}.py").exists()
    folder = ROOT / "models" if is_model else ROOT / "tests" / "msl"
    return assemble(load_model(model_reference(str(folder / f"{stem}.py"))))


@cache
def exported(name: str, version: str, kind: str = "both") -> Path:
    """Return the folder of an FMU, unpacked; made once."""
    folder = Path(tempfile.mkdtemp(prefix=f"cartpend-{name.replace('/', '-')}-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = export_fmu(system_of(name), folder / "model.fmu", version=version, kind=kind, stop=5.0)  # pyright: ignore
    fmpy.extract(str(path), str(folder / "unpacked"))
    return folder


def description_of(name: str, version: str) -> ModelDescription:
    return fmpy.read_model_description(str(exported(name, version) / "model.fmu"))


class Opened:
    """An instance in FMPy, with variables by name, and calls that the two versions name differently."""

    def __init__(self, fmu: Any, description: ModelDescription, version: str) -> None:
        self.fmu, self.version = fmu, version
        self.number = {v.name: v.valueReference for v in description.modelVariables}
        self.names = [v.name for v in description.modelVariables if v.type in ("Real", "Float64")]

    def get(self, *names: str) -> list[float]:
        numbers = [self.number[name] for name in names]
        return self.fmu.getReal(numbers) if self.version == "2.0" else self.fmu.getFloat64(numbers)

    def set(self, name: str, value: float) -> None:
        (self.fmu.setReal if self.version == "2.0" else self.fmu.setFloat64)([self.number[name]], [value])

    def begin(self, start: float = 0.0) -> None:
        if self.version == "2.0":
            self.fmu.setupExperiment(startTime=start)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start)

    def initialise(self, start: float = 0.0, **values: float) -> None:
        self.begin(start)
        for name, value in values.items():
            self.set(name, value)
        self.fmu.exitInitializationMode()

    def update(self) -> tuple:
        """Decide at an event: whether states jumped, and the next event time or None."""
        found = self.fmu.newDiscreteStates() if self.version == "2.0" else self.fmu.updateDiscreteStates()
        return bool(found[3]), found[5] if found[4] else None

    def rates(self, n: int) -> list[float]:
        values = (fmpy.fmi2.fmi2Real * n)()
        (self.fmu.getDerivatives if self.version == "2.0" else self.fmu.getContinuousStateDerivatives)(values, n)
        return list(values)

    def forward(self, unknowns: list[str], knowns: list[str], seed: list[float]) -> list[float]:
        numbers = [self.number[name] for name in unknowns], [self.number[name] for name in knowns]
        return list(self.fmu.getDirectionalDerivative(*numbers, seed))


@contextmanager
def opened(name: str, version: str, kind: str = "me") -> Iterator[Opened]:
    """Open an FMU in FMPy."""
    description = description_of(name, version)
    part = description.modelExchange if kind == "me" else description.coSimulation
    fmu = CLASSES[version, kind](
        guid=description.guid,
        unzipDirectory=str(exported(name, version) / "unpacked"),
        modelIdentifier=part.modelIdentifier,
        instanceName="test",
    )
    fmu.instantiate()
    try:
        yield Opened(fmu, description, version)
    finally:
        fmu.freeInstance()
