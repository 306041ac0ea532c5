"""The C of FMUs under the importers in `tests/fmi`, built with sanitizers or run by valgrind."""

import os
import re
import subprocess
from functools import cache
from pathlib import Path

from fmi_bench import ROOT, description_of, exported

from cartpend_dae.fmi.build import standard_headers

STRICT = ["-std=gnu11", "-Wall", "-Wextra", "-Werror"]
SANITIZED = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined")
PLAIN = ("-g", "-O1")
VALGRIND = ("valgrind", "--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=definite", "-q")
# what a model can have: dry friction, clock and algebraic loop; a parameter that the start finds; nothing of all that;
# no states; friction and an input; a sampled controller; diodes; many algebraic variables; two frictions on one shaft
KINDS_OF_MODELS = {
    "mixed": "dry friction, a clock, an algebraic loop",
    "found": "a parameter that the start finds",
    "cart_pendulum": "smooth",
    "swing_up": "clocks and discrete variables, no states",
    "motor": "dry friction, an input",
    "closed_loop": "a sampled controller, encoders that count",
    "rectifier": "nine conditions of diodes",
    "dcpm_with_losses": "an algebraic equation with conditions",
    "lossy_gear_demo2": "two dry frictions on one shaft",
}


@cache
def host(version: str, *flags: str) -> Path:
    """Return the host program for a version, built with flags."""
    folder = exported("mixed", version)
    for name, text in standard_headers(version).items():
        (folder / name).write_text(text)
    path = folder / f"host{'-'.join(flags)}".replace("/", "_")
    source = ROOT / "tests" / "fmi" / f"host{version[0]}.c"
    subprocess.run(["gcc", *STRICT, *flags, f"-I{folder}", source, "-o", path, "-ldl", "-lm"], check=True)
    return path


@cache
def library(name: str, version: str, *flags: str) -> Path:
    """Return the library of an FMU, built from its sources with flags."""
    folder = exported(name, version)
    path = folder / f"{name.replace('/', '-')}{'-'.join(flags)}.so"
    sources = folder / "unpacked" / "sources"
    quiet = ["-Wno-unused-variable", "-Wno-unused-parameter", "-Wno-unused-but-set-variable", "-Wno-unused-function"]
    command = ["gcc", *STRICT, *quiet, *flags, "-shared", "-fPIC", "-fvisibility=hidden", "all.c", "-o", path, "-lm"]
    subprocess.run(command, cwd=sources, check=True)
    return path


def run(program: list, name: str, version: str, *mode: str, kinds: str = "both", limit: float = 500) -> str:
    """Run a host on an FMU; return what it says."""
    d = description_of(name, version)
    counts = [len(d.modelVariables), len(d.derivatives), d.numberOfEventIndicators]
    command = [*program, d.guid, *map(str, counts), kinds, *mode]
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=limit)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def sequences(name: str, version: str, n: int, *, valgrind: bool = False, limit: float = 500) -> tuple[int, int]:
    """Make n sequences of random calls; return how many calls these were, and how many were refused."""
    program: list = [host(version, *SANITIZED), library(name, version, *SANITIZED)]
    if valgrind:
        program = [*VALGRIND, host(version, *PLAIN), library(name, version, *PLAIN)]
    said = run(program, name, version, "sequences", str(n), limit=limit)
    found = re.search(r"(\d+) calls, (\d+) refusals, 0 failures", said)
    assert found, said
    return int(found[1]), int(found[2])
