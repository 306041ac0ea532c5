"""What there is to build from: the components of the library with ports, signals and parameters."""

import inspect
import pkgutil
from dataclasses import dataclass
from importlib import import_module

from cartpend_dae import library
from cartpend_dae.errors import ModelError
from cartpend_dae.explain import nearest
from cartpend_dae.language import Component, parameters_of, ports_of, variables_of
from cartpend_dae.quantities import Signal


@dataclass(frozen=True, slots=True)
class Entry:
    """A component: its name with the module, what it is, and what it declares, in plain data."""

    name: str
    summary: str
    law: str
    ports: dict[str, str]
    signals: dict[str, dict[str, str]]
    parameters: dict[str, dict[str, str | float | None]]


def components() -> tuple[Entry, ...]:
    """Return all components of the library, by module and name."""
    found = []
    for information in pkgutil.iter_modules(library.__path__):
        module = import_module(f"{library.__name__}.{information.name}")
        for name, cls in sorted(vars(module).items()):
            is_own = inspect.isclass(cls) and cls.__module__ == module.__name__
            if is_own and issubclass(cls, Component) and not name.startswith("_"):
                found.append(_entry(f"{information.name}.{name}", cls))
    return tuple(found)


def component(name: str) -> Entry:
    """Return one component, by its name with or without the module.

    Raises
    ------
    ModelError
        If there is none of this name, or several.
    """
    entries = components()
    found = [entry for entry in entries if name in (entry.name, entry.name.split(".")[1])]
    if len(found) == 1:
        return found[0]
    if found:
        listing = ", ".join(f"`{entry.name}`" for entry in found)
        raise ModelError(f"There are several components `{name}`: say which of {listing}.")
    known = [part for entry in entries for part in (entry.name, entry.name.split(".")[1])]
    raise ModelError(f"The library has no component `{name}`{nearest(name, known, '`cartpend components` lists all.')}")


def matching(entries: tuple[Entry, ...], text: str) -> tuple[Entry, ...]:
    """Return the entries that hold all words of a text in name or description, whatever their case."""
    words = text.lower().split()
    return tuple(entry for entry in entries if all(word in f"{entry.name} {entry.law}".lower() for word in words))


def _entry(name: str, cls: type[Component]) -> Entry:
    law = inspect.getdoc(cls) or ""
    signals = {
        key: {
            "direction": signal.direction,
            "unit": signal.declaration.unit,
            "doc": signal.declaration.doc,
        }
        for key, signal in variables_of(cls).items()
        if isinstance(signal, Signal)
    }
    parameters: dict[str, dict[str, str | float | None]] = {
        key: {"unit": q.declaration.unit, "default": _number(q.declaration.default), "doc": q.declaration.doc}
        for key, q in parameters_of(cls).items()
    }
    ports = {key: field.kind.__name__ for key, field in ports_of(cls).items()}
    return Entry(name, law.splitlines()[0] if law else "", law, ports, signals, parameters)


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None
