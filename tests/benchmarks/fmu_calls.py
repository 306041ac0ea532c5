"""Random sequences of calls of FMUs of each kind of model, with AddressSanitizer and under valgrind.

``python tests/benchmarks/fmu_calls.py --write docs/validation.md`` makes 10,000 sequences for each kind, in both
versions of FMI, records what is not recorded yet in `results/fmu_calls.json`, and writes the section. ``--again``
forgets what is recorded, ``-n`` is another number of sequences.
"""

import argparse
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from benchmarks.page import put_section, record, recorded  # noqa: E402
from fmi_bench import VERSIONS  # noqa: E402
from fmi_host import KINDS_OF_MODELS, sequences  # noqa: E402

TITLE = "## Random calls of FMUs"
TOOLS = {"AddressSanitizer": False, "valgrind": True}
LIMIT = 3600.0


INTRODUCTION = """`python tests/benchmarks/fmu_calls.py --write docs/validation.md`

An importer in C (`tests/fmi`) makes sequences of up to 60 calls, from nothing or from an instance at an event, between
events or before a step, as model exchange and as co-simulation: in any order, with wrong references and lengths, values
that are no numbers, handles that were freed, saved states that were changed or cut. Each must be answered by a status;
the library and the importer are built with AddressSanitizer and the sanitizer of undefined behaviour, or run under
valgrind, which also look for leaks. In all runs below, of {sequences:,} sequences and {calls:,} calls, nothing was
found."""


def section(rows):
    """Return the section of the page."""
    whole = {name: sum(row[name] for row in rows.values()) for name in ("sequences", "calls")}
    lines = [
        TITLE,
        "",
        *INTRODUCTION.format(**whole).splitlines(),
        "",
        "| model | what it has | FMI | tool | sequences | calls | refused | seconds |",
        "|---|---|---|---|--:|--:|--:|--:|",
    ]
    for key, row in rows.items():
        name, version, tool = key.split()
        what = KINDS_OF_MODELS[name]
        counts = f"{row['sequences']:,} | {row['calls']:,} | {row['refused']:,} | {row['seconds']:.0f}"
        lines.append(f"| {name} | {what} | {version} | {tool} | {counts} |")
    return [*lines, ""]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=10_000)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    rows = {} if options.again else recorded("fmu_calls").get("fmu_calls", {})
    for name, version, tool in ((n, v, t) for t in TOOLS for n in KINDS_OF_MODELS for v in VERSIONS):
        key = f"{name} {version} {tool}"
        if key in rows:
            continue
        begun = time.perf_counter()
        calls, refused = sequences(name, version, options.n, valgrind=TOOLS[tool], limit=LIMIT)
        seconds = time.perf_counter() - begun
        rows[key] = {"sequences": options.n, "calls": calls, "refused": refused, "seconds": seconds}
        record("fmu_calls", rows)
        print(f"{key:<45} {calls:>9,} calls, {refused:>9,} refused, {seconds:6.1f} s", flush=True)
    if options.write:
        put_section(options.write, section(rows))


if __name__ == "__main__":
    main()
