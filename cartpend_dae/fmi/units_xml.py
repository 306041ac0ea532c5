"""Unit definitions of an FMU, with exponents over the base units."""

from collections.abc import Iterable
from xml.etree import ElementTree as ET

from cartpend_dae.units import BASE_UNITS, parse

# shown instead of SI where the importer likes that: name and value in it of one SI unit
DISPLAY = {"rad": ("deg", 57.29577951308232), "rad/s": ("deg/s", 57.29577951308232), "m": ("mm", 1000.0)}


def unit_definitions(names: Iterable[str]) -> ET.Element:
    """Return the element `UnitDefinitions` for some unit names, sorted."""
    element = ET.Element("UnitDefinitions")
    for name in sorted(set(names) - {""}):
        unit = ET.SubElement(element, "Unit", name=name)
        known = parse(name)
        if all(x == int(x) for x in known.dimension):  # FMI has no fractional exponents
            powers = {base: str(int(x)) for base, x in zip(BASE_UNITS, known.dimension, strict=True) if x}
            ET.SubElement(unit, "BaseUnit", powers)
        if name in DISPLAY:
            other, factor = DISPLAY[name]
            ET.SubElement(unit, "DisplayUnit", name=other, factor=repr(factor))
    return element
