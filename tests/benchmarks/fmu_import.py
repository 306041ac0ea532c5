"""All FMUs for model exchange without events, imported by CasADi's DaeBuilder, with their derivatives.

``python tests/benchmarks/fmu_import.py --write docs/validation.md`` records what is not recorded yet in
`results/fmu_import.json` and writes the section. ``--again`` forgets what is recorded. The references are found by
CARTPEND_MSL.
"""

import argparse
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import fmpy  # noqa: E402
from benchmarks.fmus import cases  # noqa: E402
from benchmarks.page import put_section, record, recorded  # noqa: E402
from fmi_casadi import has_no_events, imported  # noqa: E402

from cartpend_dae.fmi import export_fmu  # noqa: E402

TITLE = "## FMUs in CasADi's DaeBuilder"
COLUMNS = ("rates", "state slopes", "input slopes", "run")


def measured(system, stop):
    """Return the errors by version."""
    found = {}
    for version in ("2.0", "3.0"):
        with tempfile.TemporaryDirectory() as scratch:
            path = export_fmu(system, Path(scratch) / "model.fmu", version=version, kind="me", stop=stop)
            fmpy.extract(str(path), str(Path(scratch) / "unpacked"))
            found[version] = imported(Path(scratch) / "unpacked", system, stop)
    return {"states": len(system.states), "inputs": len(system.inputs), "errors": found}


INTRODUCTION = """`python tests/benchmarks/fmu_import.py --write docs/validation.md`

All {n} FMUs for model exchange that have no events, which DaeBuilder does not know. The errors are the largest of
both versions of FMI: of the rates, and of the derivatives that the FMU gives, at three random points against CasADi's
own of the model's equations, over the largest element; and of the states over a run by cvodes (1e-10) against the
native one, over their ranges."""


def section(rows):
    """Return the section of the page."""
    lines = [
        TITLE,
        "",
        *INTRODUCTION.format(n=len(rows)).splitlines(),
        "",
        "| model | states | inputs | rates | slopes in states | slopes in inputs | run |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name, row in sorted(rows.items()):
        worst = [max(errors[column] for errors in row["errors"].values()) for column in COLUMNS]
        figures = [f"{value:.1g}" for value in worst]
        if not row["inputs"]:
            figures[2] = "–"
        lines.append(f"| {name} | {row['states']} | {row['inputs']} | {' | '.join(figures)} |")
    return [*lines, ""]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    rows = {} if options.again else recorded("fmu_import").get("fmu_import", {})
    for name, make in cases([]):
        if name in rows:
            continue
        system, stop, _ = make()
        if not has_no_events(system):
            continue
        rows[name] = measured(system, stop)
        record("fmu_import", rows)
        print(name, rows[name]["errors"], flush=True)
    if options.write:
        put_section(options.write, section(rows))


if __name__ == "__main__":
    main()
