"""What a result rests on: the files that were read, by their contents, and the versions that computed it."""

import platform
import shlex
from collections.abc import Iterable
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from cartpend_dae.session import Opened

PACKAGES = ("cartpend-dae", "casadi", "numpy", "scipy")


def ledger(opened: Opened) -> dict[str, Any]:
    """Return the files of a study with their digests, and the versions of what computed the result."""
    study = opened.study
    named = [("study", study.path), ("model", study.model.path)]
    named += [("effects", path) for path in study.discover.cards]
    named += [(f"{run.role} run {run.name}", run.file) for run in study.experiments]
    files = [_entry(what, path) for what, path in named if path.is_file()]
    return {"files": files, "versions": {"Python": platform.python_version()} | dict(_versions())}


def package_version(package: str = "cartpend-dae") -> str:
    """Return the version of an installed package."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def _versions() -> Iterable[tuple[str, str]]:
    return ((name, package_version(name)) for name in PACKAGES)


def _entry(what: str, path: Path) -> dict[str, Any]:
    digest = sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return {"what": what, "name": path.name, "bytes": path.stat().st_size, "sha256": digest.hexdigest()}


def command_line(command: str, opened: Opened, *options: str) -> str:
    """Return the shell command that makes a result again."""
    return shlex.join(["cartpend", command, str(opened.study.path), *options])
