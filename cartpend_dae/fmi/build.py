"""C sources -> a library for this machine, and everything -> an FMU file."""

import logging
import os
import platform
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from cartpend_dae.compiled import LARGE, SUFFIX, compiler_command
from cartpend_dae.errors import ModelError

logger = logging.getLogger(__name__)

HEADERS = {
    "2.0": ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    "3.0": ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
SYSTEMS = {"linux": "linux", "darwin": "darwin", "win32": "windows"}


def platform_folder(version: str) -> str | None:
    """Return the folder under `binaries` for this machine, None if a version of FMI has no name for it."""
    system, machine = SYSTEMS.get(sys.platform), MACHINES.get(platform.machine().lower())
    if system is None or machine is None:
        return None
    if version == "3.0":
        return f"{machine}-{system}"
    if machine != "x86_64":
        return None
    return {"windows": "win64", "linux": "linux64", "darwin": "darwin64"}[system]


def standard_headers(version: str) -> dict[str, str]:
    """Return the header files of the standard, which FMPy ships (2-clause BSD licence), by name."""
    found = find_spec("fmpy")
    if found is None or found.origin is None:
        raise ModelError("FMPy is not installed: it ships the header files of FMI. `pip install fmpy` brings it.")
    folder = Path(found.origin).parent / "c-code"
    return {name: (folder / name).read_text(encoding="utf-8") for name in HEADERS[version]}


def library(folder: Path, identifier: str, source_size: int) -> Path | None:
    """Compile `all.c` in a folder; None without a compiler, with a line in the log.

    Parameters
    ----------
    folder, identifier
        Where the sources are, and the name of the library without suffix.
    source_size
        Number of statements of the model's functions.

    Raises
    ------
    ModelError
        If the compiler refuses; the last line it wrote.
    """
    command = compiler_command()
    if command is None:
        logger.warning(
            "There is no C compiler (`cc`, `gcc`, `clang` or CC): the FMU holds its sources only, and runs where an "
            "importer compiles them."
        )
        return None
    # -ffp-contract=off: fused products would let a run differ between machines
    level = "-O0" if source_size > LARGE else "-O2"
    flags = [level, "-std=gnu99", "-shared", "-fvisibility=hidden", "-ffp-contract=off"]
    flags += [] if sys.platform == "win32" else ["-fPIC"]
    target = folder / f"{identifier}{SUFFIX}"
    done = subprocess.run(
        [*command, *flags, "all.c", "-o", target.name, "-lm"],
        cwd=folder,
        capture_output=True,
        text=True,
        errors="replace",
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise ModelError(f"The C compiler `{command[0]}` refuses the sources of the FMU: {last}")
    return target


def packed(path: Path, files: Mapping[str, bytes]) -> None:
    """Write an FMU in one step: a file that is there stays whole until the new one is.

    Parameters
    ----------
    path, files
        The FMU, and its files by their path inside.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files.items():
                # the same export gives the same bytes
                entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, data)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
