"""A foreign FMU for model exchange as a component: its inputs and outputs are signals, its parameters parameters.

CasADi cannot look into an FMU. So the equations of the model see the outputs of the FMU as inputs of the whole system,
under hidden names, and `fmi.joint` integrates the system and the FMU together.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from cartpend_dae import units
from cartpend_dae.declarations import param, signal
from cartpend_dae.errors import ModelError
from cartpend_dae.fmi.foreign import ForeignFmu, load_fmu
from cartpend_dae.language import Component, Param, Statements, parts_of
from cartpend_dae.quantities import HIDDEN

ANY = "any"


class FmuComponent(Component):
    """Base of the components that `fmu_component` makes; `fmu` is what it stands for."""

    fmu: ClassVar[ForeignFmu]


def fmu_component(path: Path | str) -> type[FmuComponent]:
    """Make a component class of an FMU 2.0 or 3.0 for model exchange.

    Its scalar inputs and outputs are signals, its scalar parameters parameters with the FMU's values as default, all
    under the names that they have in the FMU. Units are the FMU's where they are SI units, else they are not checked.
    Such a model is run by `simulate_with_fmus`.

    Parameters
    ----------
    path
        The FMU.

    Raises
    ------
    StudyError
        If the file is no FMU.
    ModelError
        If it does not offer model exchange.
    """
    fmu = load_fmu(path)
    if "me" not in fmu.description.kinds:
        raise ModelError(f"{path}: a component needs an FMU for model exchange; this one offers co-simulation only.")
    fields: dict[str, Any] = {"__doc__": fmu.description.text or f"The FMU {fmu.path.name}."}
    annotations: dict[str, Any] = {}
    for v in fmu.variables:
        if not v.is_numeric or v.elements != (v.name,):
            continue
        unit, start = _unit(v.unit), _number(v.start)
        if v.causality == "input":
            fields[v.name] = signal("in", unit=unit, default=start, doc=v.description)
        elif v.causality == "output":
            fields[v.name] = signal("out", unit=unit, doc=v.description)
            fields[v.name + HIDDEN] = signal("in", unit=unit, doc=f"what the FMU gives for `{v.name}`")
        elif v.causality == "parameter" and start is not None:
            fields[v.name] = param(unit=unit, default=start, doc=v.description)
            annotations[v.name] = Param
    outputs = fmu_outputs(fmu)

    def equations(self: Component) -> Statements:
        for name in outputs:
            yield getattr(self, name) == getattr(self, name + HIDDEN)

    name = "".join(c if c.isalnum() else "_" for c in fmu.description.model) or "Fmu"
    if taken := sorted(set(fields) & {*dir(FmuComponent), "fmu"} - {"__doc__"}):
        raise ModelError(f"{path}: a component cannot have a variable named {', '.join(f'`{n}`' for n in taken)}.")
    fields |= {"equations": equations, "__annotations__": annotations, "fmu": fmu}
    return type(name, (FmuComponent,), fields)


def fmu_outputs(fmu: ForeignFmu) -> list[str]:
    """Return the names of the scalar numeric outputs of an FMU."""
    return [v.name for v in fmu.variables if v.causality == "output" and v.elements == (v.name,)]


def fmu_inputs(fmu: ForeignFmu) -> list[str]:
    """Return the names of the scalar numeric inputs of an FMU."""
    return [v.name for v in fmu.variables if v.causality == "input" and v.elements == (v.name,)]


@dataclass(frozen=True, slots=True)
class Placed:
    """An FMU in a model, under the dotted path of its component."""

    path: str
    fmu: ForeignFmu

    def name(self, own: str) -> str:
        """Return the name in the model of a variable of the FMU."""
        return f"{self.path}.{own}" if self.path else own


def fmus_in(model: Component, path: str = "") -> Iterator[Placed]:
    """Yield the FMUs of a model."""
    if isinstance(model, FmuComponent):
        yield Placed(path, model.fmu)
    for name, part in parts_of(model).items():
        yield from fmus_in(part, f"{path}.{name}" if path else name)


def inner_units(model: Component) -> dict[str, str]:
    """Return the units of the scalar variables inside the FMUs of a model, by their names in it."""
    placed = fmus_in(model)
    return {p.name(v.name): _unit(v.unit) for p in placed for v in p.fmu.variables if v.elements == (v.name,)}


def _unit(text: str) -> str:
    """Return a unit of the FMU where it is a coherent SI unit, else none that is checked."""
    try:
        unit = units.parse(text)
    except ModelError:
        return ANY
    return text if unit.factor == 1.0 and not unit.offset and text != "1" else ANY


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return {"true": 1.0, "false": 0.0}.get(str(text).lower())
