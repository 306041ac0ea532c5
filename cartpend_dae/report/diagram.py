"""The parts of a model and what joins them, as `result.json` holds them and as a graph to be drawn."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from cartpend_dae.system import System

MOST_PARTS = 18
"""Parts beyond which those of an assembly are drawn as one."""


@dataclass(frozen=True, slots=True)
class Part:
    """A box of the drawing: a component, or an assembly drawn as one; its inputs and what is measured of it."""

    path: str
    kind: str
    inputs: tuple[str, ...]
    measured: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Diagram:
    """Parts, and for each connection the ends (part, port) that it joins."""

    parts: tuple[Part, ...]
    joints: tuple[tuple[tuple[int, str], ...], ...]


def diagram_json(system: System, measured: Iterable[str]) -> dict[str, Any]:
    """Return what `result.json` says of the structure of a model."""
    return {
        "components": [{"path": path, "class": kind} for path, kind in system.flat.components if path],
        "connections": [list(ends) for ends in system.flat.connections if len(ends) > 1],
        "inputs": list(system.inputs),
        "measured": list(dict.fromkeys(measured)),
    }


def read_diagram(stored: dict[str, Any]) -> Diagram:
    """Make the graph of a stored structure: the finest one with no more parts than a drawing can show."""
    kinds = {entry["path"]: entry["class"] for entry in stored["components"]}
    deepest = max((path.count(".") for path in kinds), default=0)
    levels = [_shown(kinds, level) for level in range(deepest, -1, -1)]
    shown = next((paths for paths in levels if len(paths) <= MOST_PARTS), levels[-1])
    number = {path: k for k, path in enumerate(shown)}
    parts = tuple(
        Part(path, kinds[path], _of(path, stored["inputs"], shown), _of(path, stored["measured"], shown))
        for path in shown
    )
    joints = []
    for ends in _joined(stored["connections"]):
        seen: dict[int, str] = {}
        for end in ends:
            owner = owner_of(end, shown)
            if owner is not None:
                seen.setdefault(number[owner], end[len(owner) + 1 :])
        if len(seen) > 1:
            joints.append(tuple(sorted(seen.items())))
    return Diagram(parts, tuple(joints))


def _shown(kinds: dict[str, str], level: int) -> tuple[str, ...]:
    """Return the paths down to a level, without the assemblies whose parts are among them."""
    paths = [path for path in kinds if path.count(".") <= level]
    return tuple(path for path in paths if not any(other.startswith(f"{path}.") for other in paths))


def owner_of(name: str, paths: Sequence[str]) -> str | None:
    """Return the path that a dotted name belongs to, None if it is none of them."""
    return next((path for path in paths if name == path or name.startswith(f"{path}.")), None)


def _of(path: str, names: Sequence[str], paths: Sequence[str]) -> tuple[str, ...]:
    return tuple(name[len(path) + 1 :] for name in names if owner_of(name, paths) == path and name != path)


def _joined(connections: Iterable[Sequence[str]]) -> list[tuple[str, ...]]:
    """Join the connections that share a port: one outside an assembly, and one inside it."""
    group: dict[str, int] = {}
    members: dict[int, list[str]] = defaultdict(list)
    for k, ends in enumerate(connections):
        for old in {group[end] for end in ends if end in group} - {k}:
            members[k] += members.pop(old)
        members[k] += ends
        group |= dict.fromkeys(members[k], k)
    return [tuple(dict.fromkeys(ends)) for ends in members.values()]
