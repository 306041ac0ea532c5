"""modelDescription.xml of an FMU, for FMI 2.0 and FMI 3.0, and buildDescription.xml of FMI 3.0."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree as ET

import numpy as np

from cartpend_dae.fmi.structure import Dependencies
from cartpend_dae.fmi.units_xml import unit_definitions
from cartpend_dae.fmi.variables import FmuVariable, VariableTable

Version = Literal["2.0", "3.0"]
Kind = Literal["me", "cs", "both"]
TYPES_3 = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean"}
CATEGORIES = {"logStatusError": "why a call was refused or failed", "logStatusWarning": "what deserves attention"}


@dataclass(frozen=True, slots=True)
class Facts:
    """What a description says besides the variables; `stop` and `tolerance` are those of the default experiment."""

    name: str
    identifier: str
    token: str
    description: str
    tool: str
    version: Version
    kind: Kind
    stop: float
    tolerance: float
    reinit: bool


def model_description(facts: Facts, table: VariableTable, depends: Dependencies) -> bytes:
    """Return modelDescription.xml.

    Parameters
    ----------
    facts, table, depends
        What is said of the model, its variables, and which of them depend on which.
    """
    is_3 = facts.version == "3.0"
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": facts.version,
            "modelName": facts.name,
            "instantiationToken" if is_3 else "guid": facts.token,
            "description": facts.description,
            "generationTool": facts.tool,
            "variableNamingConvention": "structured" if table.is_structured else "flat",
        },
    )
    if not is_3:
        root.set("numberOfEventIndicators", str(len(table.of_role("indicator"))))
    root.extend(_interfaces(facts))
    root.append(unit_definitions(v.declaration.unit for v in table.variables if v.type == "Real"))
    categories = ET.SubElement(root, "LogCategories")
    for name, text in CATEGORIES.items():
        ET.SubElement(categories, "Category", name=name, description=text)
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime=repr(facts.stop), tolerance=repr(facts.tolerance))
    variables = ET.SubElement(root, "ModelVariables")
    variables.extend(_variable(v, table, facts) for v in table.variables)
    root.append((_structure_3 if is_3 else _structure_2)(table, depends))
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True)


def build_description(identifier: str) -> bytes:
    """Return buildDescription.xml of FMI 3.0: one source file, which includes the others."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    ET.SubElement(files, "SourceFile", name="all.c")
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True)


def _interfaces(facts: Facts) -> list[ET.Element]:
    is_3 = facts.version == "3.0"
    state = "FMUState" if is_3 else "FMUstate"
    common = {
        "modelIdentifier": facts.identifier,
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
        "providesDirectionalDerivatives" if is_3 else "providesDirectionalDerivative": "true",
    }
    common |= {"providesAdjointDerivatives": "true"} if is_3 else {"canNotUseMemoryManagementFunctions": "true"}
    found = []
    if facts.kind in ("me", "both"):
        only = {} if is_3 else {"completedIntegratorStepNotNeeded": "true"}
        found.append(ET.Element("ModelExchange", common | only))
    if facts.kind in ("cs", "both"):
        only = {"canHandleVariableCommunicationStepSize": "true"}
        if not is_3:
            only["canInterpolateInputs"] = "true"
        if is_3:
            only |= {
                "hasEventMode": "true",
                "mightReturnEarlyFromDoStep": "true",
                "providesIntermediateUpdate": "true",
                "canReturnEarlyAfterIntermediateUpdate": "true",
            }
        found.append(ET.Element("CoSimulation", common | only))
    if not is_3:
        for element in found:
            ET.SubElement(ET.SubElement(element, "SourceFiles"), "File", name="all.c")
    return found


def _variable(v: FmuVariable, table: VariableTable, facts: Facts) -> ET.Element:
    is_3, d = facts.version == "3.0", v.declaration
    common = {"name": v.name, "valueReference": str(v.reference)}
    if d.doc:
        common["description"] = " ".join(d.doc.split())
    common |= {"causality": v.causality, "variability": v.variability}
    if v.causality not in ("input", "independent", "parameter"):
        common["initial"] = v.initial
    typed: dict[str, str] = {}
    if v.start is not None:
        typed["start"] = _number(v.start, v.type)
    for name, value in (("min", d.min), ("max", d.max)):
        if value is not None and np.isfinite(value) and v.type != "Boolean":
            typed[name] = _number(value, v.type)
    if v.type == "Real":
        if d.unit:
            typed["unit"] = d.unit
        if d.nominal is not None and d.nominal > 0:
            typed["nominal"] = repr(float(d.nominal))
        if v.state >= 0:
            state = _state_variables(table)[v.state]
            typed["derivative"] = str(state.reference if is_3 else state.reference + 1)
        if facts.reinit and v in _state_variables(table):
            typed["reinit"] = "true"
    if is_3:
        return ET.Element(TYPES_3[v.type], common | typed)
    element = ET.Element("ScalarVariable", common)
    ET.SubElement(element, v.type, typed)
    return element


def _number(value: float, kind: str) -> str:
    if kind == "Real":
        return repr(float(value))
    return ("true" if value else "false") if kind == "Boolean" else str(round(value))


def _state_variables(table: VariableTable) -> list[FmuVariable]:
    values = table.of_role("value")
    where = {state: k for k, state in enumerate(table.state_of) if state >= 0}
    return [values[where[k]] for k in sorted(where)]


@dataclass(frozen=True, slots=True)
class _Unknown:
    """An unknown of ModelStructure, and what it depends on."""

    variable: FmuVariable
    depends: tuple[FmuVariable, ...]


def _lists(table: VariableTable, depends: Dependencies) -> dict[str, list[_Unknown]]:
    """Return the unknowns of each list of ModelStructure."""
    values, states = table.of_role("value"), _state_variables(table)
    where = {k: value for k, value in zip(table.input_of, values, strict=False) if k >= 0}
    knowns = [*table.of_role("time"), *states, *(where[k] for k in sorted(where)), *table.of_role("parameter")]
    rows = {"value": depends.values, "rate": depends.rates, "indicator": depends.indicators}

    def unknowns(variables: Iterable[FmuVariable], at_start: bool = False) -> list[_Unknown]:
        found = []
        for v in variables:
            # an unknown parameter follows from the start, which says on what it depends
            row = rows[v.role][v.index] if v.role in rows else np.array([known == v for known in knowns])
            row = row @ depends.start if at_start else row
            kinds = ("exact", "") if at_start else ("exact", "approx", "calculated", "")
            chosen = [k for k, one in zip(knowns, row, strict=True) if one and k.initial in kinds]
            chosen = [k for k in chosen if k.variability != "constant" and (at_start or k.role != "parameter")]
            found.append(_Unknown(v, tuple(chosen)))
        return found

    initial = [
        v
        for v in table.variables
        if (v.causality == "output" and v.initial in ("approx", "calculated"))
        or v.causality == "calculatedParameter"
        or v.role == "rate"
        or (v in states and v.initial in ("approx", "calculated"))
    ]
    return {
        "outputs": unknowns(v for v in values if v.causality == "output"),
        "derivatives": unknowns(table.of_role("rate")),
        "initial": unknowns(initial, at_start=True),
        "indicators": unknowns(table.of_role("indicator")),
    }


def _structure_2(table: VariableTable, depends: Dependencies) -> ET.Element:
    root, lists = ET.Element("ModelStructure"), _lists(table, depends)
    for tag, name in (("Outputs", "outputs"), ("Derivatives", "derivatives"), ("InitialUnknowns", "initial")):
        if lists[name]:
            group = ET.SubElement(root, tag)
            for u in lists[name]:
                listing = " ".join(str(v.reference + 1) for v in u.depends)
                ET.SubElement(group, "Unknown", index=str(u.variable.reference + 1), dependencies=listing)
    return root


def _structure_3(table: VariableTable, depends: Dependencies) -> ET.Element:
    root, lists = ET.Element("ModelStructure"), _lists(table, depends)
    tags = {
        "Output": "outputs",
        "ContinuousStateDerivative": "derivatives",
        "InitialUnknown": "initial",
        "EventIndicator": "indicators",
    }
    for tag, name in tags.items():
        for u in lists[name]:
            listing = " ".join(str(v.reference) for v in u.depends)
            ET.SubElement(root, tag, valueReference=str(u.variable.reference), dependencies=listing)
    return root
