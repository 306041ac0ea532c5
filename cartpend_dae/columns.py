"""What every reader of log files hands on: named columns, the units that the file gives, and a bound on memory.

A column goes by its name in the file, or by that name without the unit in brackets: `angle [deg]` is also
`angle`. Errors are clauses that `recording` completes with the file and the experiment.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from cartpend_dae import units as si
from cartpend_dae.errors import ModelError, StudyError

MAX_BYTES = 1_000_000_000
"""Most memory that the columns of one file may take."""

_UNIT_IN_NAME = re.compile(r"(.*?)\s*(?:\[([^][]*)\]|\(([^()]*)\))")
# How loggers write units that Modelica writes in another way.
_SPOKEN = {
    "-": "1", "°": "deg", "degree": "deg", "degrees": "deg", "°/s": "deg/s", "°C": "degC", "sec": "s", "second": "s",
    "seconds": "s", "msec": "ms", "Sec": "s", "Nm": "N.m", "Volt": "V", "volt": "V", "volts": "V", "Volts": "V",
    "Ampere": "A", "ampere": "A", "amps": "A", "radians": "rad", "RPM": "rpm", "U/min": "rpm", "1/min": "rpm",
    "min-1": "rpm", "Ω": "Ohm", "ohm": "Ohm", "µs": "us", "µm": "um", "μs": "us", "μm": "um",
}  # fmt: skip
_POWERS = str.maketrans({"^": None, "²": "2", "³": "3", "·": ".", "*": "."})


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of a file: `columns` those asked for, by the name asked for; `names` all; `units` where given."""

    columns: Mapping[str, NDArray[Any]]
    names: tuple[str, ...]
    units: Mapping[str, str]
    note: str = ""


def readable_unit(text: str) -> str | None:
    """Return a unit that a file gives, as `units` writes it; None if it is none."""
    text = text.strip().strip("[]").strip()
    text = _SPOKEN.get(text, text.translate(_POWERS))
    try:
        si.parse(text)
    except ModelError:
        return None
    return text


def split_unit(name: str) -> tuple[str, str | None]:
    """Split `angle [deg]` into name and unit; what stands in brackets and is no unit belongs to the name."""
    match = _UNIT_IN_NAME.fullmatch(name)
    unit = readable_unit(match[2] or match[3] or "") if match and match[1] else None
    return (match[1], unit) if match and unit else (name, None)


def located(wanted: Iterable[str], names: Iterable[str]) -> dict[str, str]:
    """Find what the study calls each column among the names of the file; what is not found is left out."""
    full = list(names)
    bare = [split_unit(name)[0] for name in full]
    found = {}
    for name in wanted:
        if name in full:
            found[name] = name
        elif bare.count(name) == 1:
            found[name] = full[bare.index(name)]
    return found


def check_size(n_values: float, what: str) -> None:
    """Refuse what would take more memory than `MAX_BYTES`, before it is taken."""
    if n_values * 8 > MAX_BYTES:
        raise StudyError(
            f"{what} would take {n_values * 8 / 1e9:.1f} GB of memory, and at most {MAX_BYTES / 1e9:g} GB are read "
            "from one file; cut the file into runs, or log at a lower rate."
        )
