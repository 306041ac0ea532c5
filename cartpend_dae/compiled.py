"""CasADi functions as machine code: C that CasADi writes, compiled once, and kept on disk by its content.

Nothing depends on it but speed: without a compiler, or where CasADi writes no C (`cvodes`, `idas`, `collocation`,
`newton`), the function comes back as it is. A compiled integrator keeps no statistics (`n_steps`, `n_events`).
"""

import contextlib
import hashlib
import io
import logging
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import casadi as ca

logger = logging.getLogger(__name__)

USED = ".used"
# folders of the cache by the first two digits of their hashes
SHELF = "[0-9a-f][0-9a-f]"
SUFFIX = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
# with its inner functions hidden the library may inline them, and an integrator takes an eighth less time; the macro is
# CasADi's word for a compiler that knows of hiding
LIBRARY = (
    ("-shared",) if sys.platform == "win32" else ("-shared", "-fPIC", "-fvisibility=hidden", "-DGCC_HASCLASSVISIBILITY")
)
# products and sums that are not contracted give what CasADi's own evaluation gives, to the last bit
FLAGS = (*LIBRARY, "-ffp-contract=off")
Level = Literal[0, 1, 2, 3, "g"]
# With more statements of C, from about 1,000 equations with their Jacobian on, gcc takes more than 10 s for -O2.
LARGE = 20_000


def compiled(
    function: ca.Function,
    *,
    optimisation: Level | None = None,
    derivatives: bool = False,
) -> ca.Function:
    """Return the same function as machine code, from the cache on disk if it was compiled before.

    Parameters
    ----------
    function
        Any function that CasADi can write as C: expressions, maps, `mapaccum`, whole integrators of the plugins
        `erk` and `rosenbrock` with their events.
    optimisation
        Level of the C compiler; default 2, and 0 for a source so large that it would take minutes. With "g" it takes
        less than half the time of 2, and what it makes a tenth longer at most.
    derivatives
        True adds the forward derivative, for Jacobians and sensitivities; a compiled function has none otherwise.
        The adjoint of an integrator with adaptive steps is that of the uncompiled function.

    Returns
    -------
    Function
        With the same name, inputs and outputs; `function` itself, and a line in the log that says why, where it
        cannot be compiled.
    """
    command = compiler_command()
    if command is None:
        logger.info("There is no C compiler (`cc`, `gcc`, `clang` or CC): `%s` runs uncompiled.", function.name())
        return function
    try:
        source = _source(function, derivatives)
        return _loaded(function.name(), source, [*command, f"-O{_level(source, optimisation)}", *FLAGS])
    except (RuntimeError, OSError, subprocess.SubprocessError) as error:
        _log_failure(function.name(), error)
        return function


@dataclass(frozen=True, slots=True)
class Use:
    """How much a function was used before by all that share the cache, kept there in a file of its own."""

    path: Path

    def so_far(self) -> int:
        """Return what was noted last; 0 if nothing was."""
        try:
            return int(self.path.read_text(encoding="ascii"))
        except (OSError, ValueError):
            return 0

    def note(self, number: int) -> None:
        """Keep how much it was used in all; of processes that do so at once the last is believed."""
        with contextlib.suppress(OSError):
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile("w", dir=self.path.parent, suffix=USED, delete=False) as file:
                file.write(str(number))
            os.replace(file.name, self.path)


def compiled_before(function: ca.Function, optimisation: Level | None = None) -> tuple[ca.Function | None, Use | None]:
    """Return a function as machine code if it was compiled before, else how much it was used; `compiled` would make it.

    Neither is there without a compiler, or where CasADi writes no C.
    """
    command = compiler_command()
    if command is None:
        return None, None
    try:
        source = _source(function, derivatives=False)
        full = [*command, f"-O{_level(source, optimisation)}", *FLAGS]
        key = _key(source, full)
        is_there = next(_whole(key), None) is not None
        return _loaded(function.name(), source, full) if is_there else None, Use(_shelf(key) / f"{key}{USED}")
    except (RuntimeError, OSError, subprocess.SubprocessError) as error:
        _log_failure(function.name(), error)
        return None, None


def compiled_library(source: Callable[[], str], name: str) -> Path | None:
    """Return the library of a C source, from the cache on disk if it was compiled before.

    Parameters
    ----------
    source
        Writes the source.
    name
        What it is, for the line in the log that says why there is no library: None is returned then.
    """
    command = compiler_command()
    if command is None:
        logger.info("There is no C compiler (`cc`, `gcc`, `clang` or CC): `%s` runs uncompiled.", name)
        return None
    try:
        text = source()
        full = [*command, f"-O{_level(text)}", *FLAGS]
        return next(_whole(_key(text, full)), None) or _made(_key(text, full), text, full)
    except (RuntimeError, OSError, subprocess.SubprocessError) as error:
        _log_failure(name, error)
        return None


def cache_folder() -> Path:
    """Return where compiled functions are kept: CARTPEND_CACHE, else the cache of the user."""
    if chosen := os.environ.get("CARTPEND_CACHE"):
        return Path(chosen).expanduser().absolute()
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "cartpend_dae"


def cached_libraries() -> tuple[Path, ...]:
    """Return the compiled functions in the cache, sorted by name."""
    return tuple(sorted(cache_folder().glob(f"{SHELF}/{'?' * 64}-{'?' * 64}{SUFFIX}")))


def clear_cache() -> int:
    """Delete the compiled functions in the cache, with all that is there besides; return their number."""
    found = cached_libraries()
    for path in found:
        path.unlink(missing_ok=True)
    for path in cache_folder().glob(f"{SHELF}/*{USED}"):
        path.unlink(missing_ok=True)
    for path in cache_folder().glob("making-*"):
        shutil.rmtree(path, ignore_errors=True)
    for path in cache_folder().glob(SHELF):
        with contextlib.suppress(OSError):  # what is not of the cache stays
            path.rmdir()
    return len(found)


def _shelf(key: str) -> Path:
    """Return the folder of a key, one of 256, as looking for a file takes as long as its folder has others."""
    return cache_folder() / key[:2]


def _level(source: str, chosen: Level | None = None) -> Level:
    if isinstance(chosen, int):
        return chosen
    return 0 if source.count(";") > LARGE else chosen or 2


def _log_failure(name: str, error: Exception) -> None:
    reason = str(error).strip().splitlines() or [type(error).__name__]
    logger.info("`%s` runs uncompiled: %s", name, reason[-1][:300])


def compiler_command() -> list[str] | None:
    """Return the command of the C compiler with its full path, None if there is none."""
    command = shlex.split(os.environ.get("CC", ""))
    for name in command[:1] or ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return [found, *command[1:]]
    return None


def _source(function: ca.Function, derivatives: bool) -> str:
    """Return C of a function.

    Raises
    ------
    RuntimeError
        If CasADi cannot write it.
    """
    generator = ca.CodeGenerator("function.c")
    # what it cannot write, CasADi tells the error stream, and puts into C that does not compile
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        generator.add(function)
        if derivatives:
            generator.add(function.forward(1))
        source = generator.dump()
    refusals = [line.strip() for line in source.splitlines() if line.lstrip().startswith("#error")]
    if refusals:
        raise RuntimeError(f"CasADi writes no C of it ({refusals[0].removeprefix('#error ')}).")
    return source


def _loaded(name: str, source: str, command: list[str]) -> ca.Function:
    """Load a function from the cache, or compile it.

    The name of a library is the hash of what it was made of and the hash of its own bytes, so that one that was cut
    short or exchanged is found out before it is loaded: loading it could end the process.
    """
    key = _key(source, command)
    for path in _whole(key):
        try:
            return ca.external(name, str(path))
        except (RuntimeError, OSError):
            logger.info("The compiled `%s` in %s cannot be loaded and is made again.", name, path)
            path.unlink(missing_ok=True)
    return ca.external(name, str(_made(key, source, command)))


def _whole(key: str) -> Iterator[Path]:
    """Yield the libraries of a key that are whole; what is not is deleted."""
    for path in _shelf(key).glob(f"{key}-*{SUFFIX}"):
        if path.stem.endswith(_digest(path.read_bytes())):
            yield path
        else:
            path.unlink(missing_ok=True)


def _key(source: str, command: list[str]) -> str:
    """Return the hash of all that decides what the compiler makes; its program stands for its version."""
    program = Path(command[0]).resolve()
    state = program.stat()
    versions = [ca.CasadiMeta.version(), platform.platform(), platform.machine()]
    parts = [source, *command, str(program), str(state.st_size), str(state.st_mtime_ns), *versions]
    return _digest("\0".join(parts).encode())


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _made(key: str, source: str, command: list[str]) -> Path:
    """Compile in a folder of its own, and move the library to its place in one step.

    Raises
    ------
    RuntimeError
        If the compiler refuses; the last line it wrote.
    OSError
        If the cache cannot be written.
    """
    cache = cache_folder()
    cache.mkdir(mode=0o700, parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="making-", dir=cache) as folder:
        (Path(folder) / "function.c").write_text(source, encoding="utf-8")
        made = Path(folder) / f"function{SUFFIX}"
        done = subprocess.run(
            [*command, "function.c", "-o", made.name, "-lm"],
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
        )
        if done.returncode:
            raise RuntimeError(f"the compiler failed: {done.stderr.strip() or f'exit code {done.returncode}'}")
        path = _shelf(key) / f"{key}-{_digest(made.read_bytes())}{SUFFIX}"
        path.parent.mkdir(mode=0o700, exist_ok=True)
        os.replace(made, path)
    return path
