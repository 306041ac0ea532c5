"""The C of FMUs under an importer in C: every call of both standards, with AddressSanitizer and under valgrind."""

import os
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
from fmi_bench import ROOT, VERSIONS, description_of, exported

from cartpend_dae.fmi.build import standard_headers

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
pytestmark = [needs_gcc, pytest.mark.slow]
STRICT = ["-std=gnu11", "-Wall", "-Wextra", "-Werror"]
SANITIZED = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"]
HOST_NAMES = ("mixed", "motor", "swing_up", "cart_pendulum")


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
    path = folder / f"{name}{'-'.join(flags)}.so"
    sources = folder / "unpacked" / "sources"
    quiet = ["-Wno-unused-variable", "-Wno-unused-parameter", "-Wno-unused-but-set-variable", "-Wno-unused-function"]
    command = ["gcc", *STRICT, *quiet, *flags, "-shared", "-fPIC", "-fvisibility=hidden", "all.c", "-o", path, "-lm"]
    subprocess.run(command, cwd=sources, check=True)
    return path


def run(program: list, name: str, version: str, *mode: str) -> str:
    """Run a host on an FMU; return what it says."""
    d = description_of(name, version)
    counts = [len(d.modelVariables), len(d.derivatives), d.numberOfEventIndicators]
    command = [*program, d.guid, *map(str, counts), "both", *mode]
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=500)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", HOST_NAMES)
def test_every_call_is_answered(name, version):
    program = [host(version, *SANITIZED), library(name, version, *SANITIZED)]
    assert " 0 failures" in run(program, name, version, "run")


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", HOST_NAMES)
def test_random_calls_are_answered_by_a_status(name, version):
    """10,000 calls in any order: wrong references, no numbers, handles that were freed, states of other instances."""
    program = [host(version, *SANITIZED), library(name, version, *SANITIZED)]
    assert " 0 failures" in run(program, name, version, "random", "10000")


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
@pytest.mark.parametrize("version", VERSIONS)
def test_valgrind_finds_nothing(version):
    valgrind = ["valgrind", "--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=definite", "-q"]
    program = [*valgrind, host(version, "-g", "-O1"), library("mixed", version, "-g", "-O1")]
    assert " 0 failures" in run(program, "mixed", version, "run")
    assert " 0 failures" in run(program, "mixed", version, "random", "10000")


@pytest.mark.parametrize("version", VERSIONS)
def test_only_the_functions_of_the_standard_are_seen(version):
    """All of them, and nothing else, so that two FMUs in one process do not meet."""
    (binary,) = (exported("mixed", version) / "unpacked" / "binaries").rglob("*.so")
    listed = subprocess.run(["nm", "-D", "--defined-only", binary], capture_output=True, text=True, check=True).stdout
    seen = {line.split()[-1] for line in listed.splitlines()}
    header = standard_headers(version)[f"fmi{version[0]}Functions.h"]
    wanted = {
        line.split()[-1].rstrip(";")
        for line in header.splitlines()
        if line.lstrip().startswith(f"FMI{version[0]}_Export ") and line.rstrip().endswith(";")
    }
    assert seen == wanted and len(wanted) > 40
