"""The C of FMUs under an importer in C: every call of both standards, with AddressSanitizer and under valgrind."""

import shutil
import subprocess

import pytest
from fmi_bench import VERSIONS, exported
from fmi_host import PLAIN, SANITIZED, VALGRIND, host, library, run, sequences

from cartpend_dae.fmi.build import standard_headers

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
needs_valgrind = pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
pytestmark = [needs_gcc, pytest.mark.slow]
HOST_NAMES = ("mixed", "motor", "swing_up", "cart_pendulum")


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


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", [*HOST_NAMES, "found", "lossy_gear_demo2"])
def test_random_sequences_from_all_phases_are_answered_by_a_status(name, version):
    """`tests/benchmarks/fmu_calls.py` makes 10,000 for more models, and under valgrind; docs/validation.md has them."""
    n_calls, n_refused = sequences(name, version, 300)
    assert n_calls > 3000 and n_refused > 0.1 * n_calls


@needs_valgrind
@pytest.mark.parametrize("version", VERSIONS)
def test_valgrind_finds_nothing(version):
    program = [*VALGRIND, host(version, *PLAIN), library("mixed", version, *PLAIN)]
    assert " 0 failures" in run(program, "mixed", version, "run")
    assert " 0 failures" in run(program, "mixed", version, "random", "10000")
    sequences("mixed", version, 200, valgrind=True)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_model_without_states_compiles_without_a_warning(version):
    """Its matrices have no elements: what is as long as one element, because C wants it, is never read."""
    assert library("swing_up", version, *PLAIN).exists()


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
