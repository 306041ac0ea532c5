"""Write docs/validation.md: what was checked against what, with the figures of this run.

``python tests/benchmarks/validation.py`` takes about three minutes; the measured axis needs CARTPEND_DATA.
With ``--references`` only the last section, on the reference examples, is made anew.
"""

import importlib.util
import json
import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from benchmarks import coverage_text  # noqa: E402
from benchmarks.page import recorded  # noqa: E402

from cartpend_dae.discover import discover  # noqa: E402
from cartpend_dae.study_paths import data_folder  # noqa: E402

STUDIES = ROOT / "models" / "studies"


def script(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def command(*arguments):
    code = "from cartpend_dae.cli import main; main()"
    subprocess.run([sys.executable, "-c", code, *arguments], check=True, capture_output=True)


def emps(study):
    with tempfile.TemporaryDirectory() as folder:
        command("discover", str(STUDIES / study), "--out", folder)
        return json.loads((Path(folder) / "result.json").read_text())


def emps_section():
    if not (data_folder() / "emps").is_dir():
        return ["The measured data were not there when this page was made."]
    result = emps("emps.toml")
    lines = [
        "`cartpend discover models/studies/emps.toml`, from mass and viscous friction. Janot, Gautier, Brunot (2019)",
        "published for one Coulomb level, one viscous coefficient and an offset: M = 95.11 kg, F_v = 203.5 N.s/m,",
        "F_c = 20.39 N, offset -3.16 N; they suspect that friction depends on the direction.",
        "",
        "Found: " + ", ".join(f"`{step['effect']}` at `{step['at']}`" for step in result["steps"]) + ".",
        "",
        "| quantity | found | sd |",
        "|---|---|---|",
    ]
    for name, entry in result["final"]["parameters"].items():
        sd = "not determined alone" if entry["sd"] is None else f"{entry['sd']:.2g}"
        lines.append(f"| `{name}` [{entry['unit']}] | {entry['value']:.4g} | {sd} |")
    lines += ["", *(f"{sentence[0].upper()}{sentence[1:]}." for sentence in result["final"]["not_identified"])]
    lines += ["", "| relative force error | before | after | published |", "|---|---|---|---|"]
    for run, published in (("steps", 4.08), ("pulses", 5.98)):
        before, after = (result[k]["scores"]["relative_force_error"][run] for k in ("baseline", "final"))
        lines.append(f"| {run} | {100 * before:.2f} % | {100 * after:.2f} % | {published} % |")
    exchanged = emps("emps_exchanged.toml")
    named = ", ".join(f"`{step['effect']}` at `{step['at']}`" for step in exchanged["steps"])
    lines += [
        "",
        f"With the roles of the two runs exchanged: {named}.",
        f"Verdicts: {result['verdict']}, {exchanged['verdict']}",
    ]
    lines[-1] += "."
    return lines


def pendulum_section():
    tests = script(ROOT / "tests" / "test_discover_pendulum.py")
    sticking, sliding = tests.clean_run(tests.COULOMB), tests.clean_run(0.0)
    found = [discover(tests.noisy_setup(sticking, seed)) for seed in tests.SEEDS]
    none = [discover(tests.noisy_setup(sliding, seed)) for seed in tests.SEEDS]
    right = sum([s.candidate.insertion.prefix for s in d.search.steps] == ["bearing.coulomb_friction"] for d in found)
    levels = [d.search.final.parameters[-1] for d in found]
    inside = sum(abs(e.value - tests.COULOMB) <= 3 * e.sd for e in levels)
    quiet = sum(d.search.verdict == "no-discrepancy" for d in none)
    n = len(tests.SEEDS)
    return [
        "Data from `tests/independent.py`, a simulator that shares no code with the package;",
        "noise 1e-3 rad, one run of 6 s.",
        "",
        "| pendulum | result |",
        "|---|---|",
        f"| Coulomb friction, {n} noise seeds | `coulomb_friction` at `bearing`, nothing else: {right} of {n} |",
        f"| its level within 3 sd of the truth | {inside} of {n} |",
        f"| mean of the estimates, truth | {np.mean([e.value for e in levels]):.6f}, {tests.COULOMB} N.m |",
        f"| scatter over seeds, mean stated sd | {np.std([e.value for e in levels], ddof=1):.2g}, "
        f"{np.mean([e.sd for e in levels]):.2g} N.m |",
        f"| without, {n} noise seeds | verdict `no-discrepancy`: {quiet} of {n} |",
    ]


def published_section():
    published = script(STUDIES / "published_pendulum.py")
    trace = published.rebuild()
    error = published.sums_of_squares(trace) / published.PUBLISHED_SSE - 1
    return [
        "`python models/studies/published_pendulum.py` prints all rows; [the published rig](published_rig.md) says "
        "what was rebuilt.",
        "",
        f"18 published sums of squared errors: {100 * np.sqrt(np.mean(error**2)):.2f} % RMS, "
        f"{100 * np.abs(error).max():.2f} % at worst.",
    ]


def printed(path, **environment):
    """Return what a script prints, as a block."""
    done = subprocess.run(
        [sys.executable, str(path)],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | environment,
    )
    return ["```", *done.stdout.rstrip().splitlines(), "```"]


def reference_section():
    folder = Path(os.environ.get("CARTPEND_MSL") or ROOT.parent / "shared" / "msl")
    if not folder.is_dir():
        return ["The reference results were not there when this page was made."]
    return [
        "`python tests/msl/table.py`: worst use of the tube (0.002 of the signal's range and of the duration) around",
        "the reference results of Dymola for examples of the Modelica Standard Library; 1 is the edge. Events are the",
        "instants at which something was decided anew or an input jumped. Beside them what the spec gives for Dymola's",
        "run: events at known times + located ones. The two tools count differently; differences were not traced one",
        "by one. Seconds are those of assembly and one simulation.",
        "",
        *printed(ROOT / "tests" / "msl" / "table.py", CARTPEND_MSL=str(folder)),
    ]


def main():
    """Write the page, or with ``--references`` only its last section anew."""
    target = ROOT / "docs" / "validation.md"
    kept, title, last = target.read_text().partition("## Reference examples\n")
    behind = last[found:] if (found := last.find("\n## ")) >= 0 else ""  # what other commands have made
    if "--references" in sys.argv[1:]:
        target.write_text("\n".join([f"{kept}{title}", *reference_section(), ""]) + behind)
        keep_coverage(target)
        return
    page = [
        "# Validation",
        "",
        "Made by `python tests/benchmarks/validation.py`; what it says is what that command found.",
        f"(Python {platform.python_version()}, {platform.machine()})",
        "",
        "## The measured servo axis EMPS",
        "",
        *emps_section(),
        "",
        "## A pendulum that sticks, and one that does not",
        "",
        *pendulum_section(),
        "",
        "## The published pendulum",
        "",
        *published_section(),
        "",
        "## The rig, assembled from its parts",
        "",
        "`python models/studies/rig_report.py`",
        "",
        *printed(STUDIES / "rig_report.py"),
        "",
        "## Reference examples",
        "",
        *reference_section(),
        "",
    ]
    target.write_text("\n".join(page) + behind)
    keep_coverage(target)


def keep_coverage(target):
    """Put the recorded coverage of intervals behind the rest of the page."""
    if "coverage" in (found := recorded("coverage")):
        coverage_text.into(target, found["coverage"])


if __name__ == "__main__":
    main()
