"""Every model and reference example as FMU under the importer in C, with AddressSanitizer.

``python tests/benchmarks/fmu_host.py --write docs/validation.md`` runs what is not recorded yet, records it in
`results/fmu_host.json`, and writes the section. ``--again`` forgets what is recorded, ``-n`` is another number of
random sequences; names, such as `models/emps`, restrict the run to these.
"""

import argparse
import re
import shutil
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from benchmarks.fmus import AMPLITUDES, MODELS, TUBE  # noqa: E402
from benchmarks.page import put_section, record, recorded  # noqa: E402
from fmi_bench import VERSIONS, description_of, exported, system_of  # noqa: E402
from fmi_host import SANITIZED, host, library, run, sequences  # noqa: E402
from msl_bench import EXAMPLES  # noqa: E402

from cartpend_dae import simulate  # noqa: E402

TITLE = "## FMUs under an importer in C"
LIMIT = 1800.0
# a value at an event is that of one side or the other
SIDES = (-1e-6, 0.0, 1e-6)
NAMES = [f"models/{path.stem}" for path in MODELS] + [f"examples/{path.stem}" for path in EXAMPLES]


def measured(name, n):
    """Return what the importer made of the FMUs of a model, by version."""
    system, row = system_of(name), {}
    for version in VERSIONS:
        begun = time.perf_counter()
        program = [host(version, *SANITIZED), library(name, version, *SANITIZED)]
        said = run(program, name, version, "run", *driven(system, name, version), limit=LIMIT)
        assert " 0 failures" in said, said
        calls, _ = sequences(name, version, n, limit=LIMIT)
        use, worst = worst_use(system, description_of(name, version), said)
        row[version] = {
            "variables": len(description_of(name, version).modelVariables),
            "written": max(map(int, re.findall(r"(\d+) written", said))),
            "runs": 1 + len(ends(said)),
            "calls": calls,
            "use": use,
            "variable": worst,
            "seconds": time.perf_counter() - begun,
        }
        shutil.rmtree(exported(name, version), ignore_errors=True)
    return row


def driven(system, name, version):
    """Return a constant value for each input, as the importer takes them."""
    numbers = {v.name: v.valueReference for v in description_of(name, version).modelVariables}
    return [f"{numbers[each]}:{AMPLITUDES.get(each, 0.1)}" for each in system.inputs]


def ends(said):
    """Return the values of all variables by number at the end of each co-simulation; number 0 is the time."""
    found = []
    for number, value in re.findall(r"value (\d+) (\S+)", said):
        if number == "0":
            found.append({})
        found[-1][int(number)] = float(value)
    return found


def worst_use(system, description, said):
    """Return the worst use of the tube around the native run at the ends of all co-simulations, and by which variable.

    The tube is 0.002 of the range up to there high, as for the runs by FMPy.
    """
    numbers = {v.name: v.valueReference for v in description.modelVariables}
    worst = 0.0, ""
    for values in ends(said):
        end = values[0]
        times = np.concatenate([np.linspace(0, end, 201)[:-1], [end + side for side in SIDES]])
        inputs = {name: values[numbers[name]] for name in system.inputs}
        native = simulate(system, times=np.unique(times), inputs=inputs, rtol=1e-10, atol=1e-12)
        for name in (v.name for v in system.variables if numbers[v.name] in values):
            series, value = native[name], values[numbers[name]]
            scale = float(np.ptp(series)) or float(np.max(np.abs(series)))
            low, high = np.min(series[-len(SIDES) :]), np.max(series[-len(SIDES) :])
            use = max(low - value, value - high, 0.0) / max(TUBE * scale, 1e-9)
            worst = max(worst, (float(use), name))
    return worst


INTRODUCTION = """`python tests/benchmarks/fmu_host.py --write docs/validation.md`

A second importer, in C (`tests/fmi`), built with AddressSanitizer and the sanitizer of undefined behaviour as the FMU
is, makes every call of both standards on {models} models and examples: it runs them as model exchange and as
co-simulation (version 3.0 with and without event mode and early return), reads every variable and writes every one
that takes a value, saves, serialises and restores, and then makes {n:,} random sequences of calls. In {runs} runs and
{calls:,} random calls nothing was found. {inside} of {models} models end inside the tube around the native run in all
co-simulations; the last columns are the worst use of the tube (1 is its edge) by any variable. The importer asks for a
tolerance of 1e-6 only, and a variable that rests in the native run has no range: its tube is 1e-9 high."""


def section(rows, n):
    """Return the section of the page."""
    counted = [row[version] for row in rows.values() for version in VERSIONS]
    inside = sum(max(row[version]["use"] for version in VERSIONS) <= 1 for row in rows.values())
    runs, calls = (sum(row[name] for row in counted) for name in ("runs", "calls"))
    text = INTRODUCTION.format(models=len(rows), n=n, runs=runs, calls=calls, inside=inside)
    lines = [TITLE, "", *text.splitlines(), ""]
    lines += ["| model | variables | written | random calls | 2.0 | 3.0 |", "|---|--:|--:|--:|--:|--:|"]
    for name, row in sorted(rows.items()):
        old, new = (row[version] for version in VERSIONS)
        counts = f"{old['variables']} | {old['written']} | {old['calls'] + new['calls']:,}"
        lines.append(f"| {name} | {counts} | {old['use']:.2g} | {new['use']:.2g} |")
    outside = [
        f"- Outside: `{row[version]['variable']}` of {name}, version {version}."
        for name, row in sorted(rows.items())
        for version in VERSIONS
        if row[version]["use"] > 1
    ]
    return [*lines, "", *outside, ""] if outside else [*lines, ""]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("-n", type=int, default=500)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    rows = {} if options.again else recorded("fmu_host").get("fmu_host", {})
    for name in options.names or NAMES:
        if name in rows and not options.names:
            continue
        rows[name] = measured(name, options.n)
        record("fmu_host", rows)
        for version, row in rows[name].items():
            print(f"{name:<36} {version}", *row.values(), flush=True)
    if options.write:
        put_section(options.write, section(rows, options.n))


if __name__ == "__main__":
    main()
