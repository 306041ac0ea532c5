"""Reference examples: how their names map to ours, how they are run, and how near they come.

The models stand in `tests/msl`, one a file: a `Component` whose parts carry the names of the reference example, and its
name `SPEC`.
"""

import importlib.util
import re
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae import simulate
from cartpend_dae.collector import Collector, collecting
from cartpend_dae.language import (
    Component,
    Connection,
    Initial,
    Port,
    bindings_of,
    parameters_of,
    parts_of,
    symbols_of,
)

EXAMPLES = sorted(path for path in (Path(__file__).parent / "msl").glob("*.py") if path.stem != "table")

TYPES = {
    "block.LimPID": "controllers.LimPID",
    "block.KinematicPTP": "controllers.KinematicPTP",
    "block.KinematicPTP2": "controllers.KinematicPTP2",
    "block.PI": "controllers.PI",
    "block.SlewRateLimiter": "signals.RateLimiter",
    "clocked.Hold": "sampled.SampleAndHold",
    "clocked.PI": "sampled.PI",
    "clocked.PeriodicRealClock": "sampled.Clock",
    "clocked.Sample": "sampled.SampleAndHold",
    "clocked.SampleClocked": "sampled.SampleAndHold",
    "drive.AveragedInverter": "converters.AveragedInverter",
    "drive.LimitedPI": "controllers.LimitedPI",
    "electrical.CurrentSensor": "electrical_sources.CurrentSensor",
    "electrical.SignalCurrent": "electrical_sources.CurrentSource",
    "electrical.SineVoltage": "electrical_sources.SineVoltage",
    "electrical.SignalVoltage": "electrical.VoltageSource",
    "electrical.StepVoltage": "electrical_sources.StepVoltage",
    "electrical.VoltageSourceWithResistance": "electrical_sources.VoltageSourceWithResistance",
    "machine.DC_PermanentMagnet": "machines.DCPermanentMagnet",
    "multibody.Spring": "planar.Spring",
    "rotational.BearingFriction": "rotational.TableBearing",
    "drive.P_PI_Cascade": "servos.PositionCascade",
    "drive.MotorWithAnalogCurrentControl": "servos.CurrentControlledMotor",
}
"""Types that do not follow the rules of `our_type`."""

PARAMETERS = {
    "TRef": "T_ref",
    "TaRef": "Ta_ref",
    "TorqueDirection": "torque_direction",
    "ForceDirection": "force_direction",
    "friction_PRef": "friction_P",
    "core_PRef": "core_P",
    "strayLoad_PRef": "stray_P",
    "brush_ILinear": "brush_I",
    "I_33": "I",
    "kFF": "k_ff",
    "KFF": "k_ff",
    "Rising": "rising",
    "Falling": "falling",
}
FACTS_WITHOUT_PARAMETER = {
    "*": {"init", "type", "initType", "y_start", "x_start", "xi_start", "useAxisFlange"},
    "block.LimPID": {"withFeedForward"},
    "block.SlewRateLimiter": {"strict"},
    "machine.DC_PermanentMagnet": {"k", "losses", "stator"},
    "multibody.Body": {"I_11", "I_22", "I_21", "I_31", "I_32"},
    "multibody.BodyShape": {"I_11", "I_22", "I_21", "I_31", "I_32"},
    "multibody.Revolute": {"n"},
    "multibody.Spring": {"m"},
    "multibody.World": {"n"},
    "block.Pulse": {"nperiod"},
    "drive.AveragedInverter": {"VMax", "Ti"},
    "drive.LimitedPI": {"limits"},
}
"""What the spec says of a type and a parameter of ours does not: start values, what is nought or given in the plane."""
INSTANTS = (".startForward", ".startBackward")
"""Stages of the reference's friction between stuck and sliding, some microseconds long; ours last no time."""


def snake(name: str) -> str:
    """Return startTime as start_time, yMax as y_max."""
    return PARAMETERS.get(name) or re.sub(r"(?<=[a-z])([A-Z])", lambda found: "_" + found[1].lower(), name)


def our_type(kind: str) -> str:
    """Return module and class for a type of the spec; sources and further parts may stand in files of their own."""
    domain, name = kind.split(".")
    module = {"block": "signals", "multibody": "planar"}.get(domain, domain)
    return TYPES.get(kind, f"{module}.{name}")


def type_of(part: Component) -> str:
    module = type(part).__module__.rsplit(".", 1)[-1]
    domain = module if "electrical" in module else re.sub("_(sources|parts|friction)$", "", module)
    return f"{domain}.{type(part).__name__}"


def our_end(end: str, components: dict) -> str:
    """Return one end of a connection of the spec in our names."""
    part, _, name = end.partition(".")
    name = re.sub(r"\[1\]$", "", name)
    kind = components[part]["type"]
    if kind == "electrical.Ground":
        name = "pin"
    elif kind.startswith("electrical."):
        name = {"p": "pin_p", "n": "pin_n", "v": "u"}.get(name, name)
    elif kind == "rotational.IdealRollingWheel":
        name = {"flangeR": "flange_R", "flangeT": "flange_T"}.get(name, name)
    return f"{part}.{snake(name)}"


def our_signal(name: str, components: dict, renamed: dict[str, str]) -> str:
    """Return the name of a reference signal in our model."""
    if name in renamed:
        return renamed[name]
    part, _, rest = name.partition(".")
    kind = components.get(part, {"type": ""})["type"]
    if kind.startswith("electrical.") and rest == "v":
        rest = "u"
    return f"{part}.{'.'.join(snake(segment) for segment in rest.split('.'))}"


def our_parameters(facts: dict) -> dict[str, object]:
    """Return the facts of one component of the spec as our parameters and structural fields."""
    skipped = FACTS_WITHOUT_PARAMETER["*"] | FACTS_WITHOUT_PARAMETER.get(facts["type"], set())
    found: dict[str, object] = {}
    for name, value in facts.items():
        if name in skipped:
            continue
        if isinstance(value, list) and isinstance(value[0], list):
            found[snake(name)] = tuple(tuple(float(number) for number in row) for row in value)
        elif isinstance(value, list) and len(value) == 1:
            found[snake(name)] = value[0]
        elif isinstance(value, list):
            x, y, z = value
            assert z == 0, f"{name} = {value} leaves the plane"
            found |= {"n": (x, y)} if name == "n" else {f"{name}_x": x, f"{name}_y": y}
        else:
            found[snake(name)] = value
    return found


def value_of(part: Component, name: str) -> object:
    """Return what a parameter or structural field of a part was set to, or None where the part has no such thing."""
    if name not in parameters_of(type(part)):
        return getattr(part, name, None)
    bound = ca.SX(bindings_of(part)[name])
    return float(bound) if bound.is_constant() else bound


@dataclass(frozen=True)
class Example:
    """One model of `tests/msl`, and what the reference says of it."""

    module: ModuleType
    model: Component
    spec: dict
    folder: Path

    @property
    def components(self) -> dict:
        return self.spec["components"]

    @property
    def partial(self) -> bool:
        """Whether the spec names some of the parts and connections only, the rest being told in words."""
        return getattr(self.module, "PARTIAL", False)

    @property
    def folders(self) -> tuple[str, ...]:
        """Composites of the reference whose parts are parts of the whole model here."""
        return getattr(self.module, "FOLDERS", ())

    @property
    def renamed(self) -> dict[str, str]:
        return getattr(self.module, "RENAMED", {})


def load(path: Path, folder: Path) -> Example:
    module = load_module(path)
    (cls,) = (
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Component) and value.__module__ == module.__name__
    )
    spec = tomllib.loads((folder / "specs" / f"{module.SPEC}.toml").read_text(encoding="utf-8"))
    folders = getattr(module, "FOLDERS", ())
    spec["components"] = {without(folders, name): facts for name, facts in spec["components"].items()}
    spec["wiring"]["connections"] = [[without(folders, end) for end in ends] for ends in spec["wiring"]["connections"]]
    return Example(module, cls(), spec, folder)


def without(folders: tuple[str, ...], name: str) -> str:
    """Return the name of a part without the composite that the reference has it in, and ours does not."""
    return next((name.removeprefix(folder) for folder in folders if name.startswith(folder)), name)


def load_module(path: Path) -> ModuleType:
    found = importlib.util.spec_from_file_location(f"msl_{path.stem}", path)
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def statements_of(model: Component) -> list:
    with collecting(Collector(time=ca.SX.sym("time"))):
        return list(model.equations())


def connections_of(model: Component) -> set[frozenset[str]]:
    return {
        frozenset(end_name(model, end) for end in statement.ends)
        for statement in statements_of(model)
        if isinstance(statement, Connection)
    }


def end_name(model: Component, end: Port | ca.SX) -> str:
    for name, part in parts_of(model).items():
        if isinstance(end, Port):
            if end.owner is part:
                return f"{name}.{end.name}"
        else:
            for symbol, value in symbols_of(part).items():
                if value.element_hash() == end.element_hash():
                    return f"{name}.{symbol}"
    raise AssertionError(f"{end} belongs to no part")


def equations_of(model: Component) -> list:
    return [s for s in statements_of(model) if not isinstance(s, Connection | Initial)]


def fixed_starts(example: Example) -> Iterator[tuple[str, float]]:
    for part, facts in example.components.items():
        for name, start in facts.get("init", {}).items():
            if start["fixed"] and not isinstance(start["value"], bool):
                yield our_signal(f"{part}.{name}", example.components, example.renamed), start["value"]


@dataclass(frozen=True)
class Outcome:
    """How near a simulation came to the reference: worst use of the tube by our signal names, seconds and events."""

    use: dict[str, float]
    seconds: float
    start: dict[str, float]
    events: int

    @property
    def worst(self) -> float:
        return max(self.use.values())


def run(example: Example) -> Outcome:
    """Simulate an example at the times of the reference, and compare every listed signal."""
    compare, head, data = reference_of(example)
    begun = time.perf_counter()
    result = simulate(example.model, times=np.unique(data[:, 0]))
    seconds = time.perf_counter() - begun
    use = tube_use(example, (compare, head, data), result.time, result)
    start = {name: float(result[name][0]) for name in result.names}
    return Outcome(use, seconds, start, result.n_events)


def reference_of(example: Example) -> tuple[ModuleType, list[str], np.ndarray]:
    """Return the module that compares, and names and values of the reference; the first column is time."""
    compare = load_module(example.folder / "compare.py")
    return compare, *compare.read_csv(example.folder / "specs" / example.spec["reference"]["file"])


def tube_use(
    example: Example, reference: tuple[ModuleType, list[str], np.ndarray], times: np.ndarray, found: Any
) -> dict[str, float]:
    """Return the worst use of the tube by the listed signals of a result, which gives values by our names."""
    compare, head, data = reference
    begin, tube, use = data[:, 0], example.spec["check"]["tube"], {}
    ignored = example.spec["check"].get("ignore", ())
    for listed in example.spec["signals"]:
        if listed["name"] in ignored:
            continue
        values = data[:, head.index(listed["name"])]
        name = listed["name"] if listed["name"] in example.renamed else without(example.folders, listed["name"])
        ours = our_signal(name, example.components, example.renamed)
        scale = np.ptp(values) or np.max(np.abs(values))
        height, width = max(tube * scale, 1e-10), tube * (begin[-1] - begin[0])
        result = np.zeros_like(times) if listed["name"].endswith(INSTANTS) else found[ours]
        use[ours] = compare.check_signal(begin, values, times, result, width, height)[1]
    return use
