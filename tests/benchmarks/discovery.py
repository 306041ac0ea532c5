"""Run `cartpend discover` on the measured studies and on the rig in closed loop; record what it finds.

``python tests/benchmarks/discovery.py [STUDY ...] [--write docs/validation.md] [--jobs N]`` runs the named studies, or
all. What was recorded of the others stays, so that an interrupted run goes on study by study; with ``--write`` the
table is put into the page. The measured data need CARTPEND_DATA.
"""

import argparse
import json
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from benchmarks import discovery_text  # noqa: E402
from benchmarks.page import commit, record, recorded  # noqa: E402

STUDIES = ROOT / "models" / "studies"
COMMAND = "from cartpend_dae.cli import main; main()"


def discovered(name, jobs):
    """Return what the command writes for a study, with the seconds that it took."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--out", folder, "--jobs", str(jobs)]
        begin = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", COMMAND, "discover", str(STUDIES / f"{name}.toml"), *options],
            capture_output=True,
            text=True,
        )
        seconds = time.perf_counter() - begin
        if done.returncode:
            raise SystemExit(f"{name}: {done.stderr.strip()}")
        return kept(json.loads((Path(folder) / "result.json").read_text()), seconds)


def kept(result, seconds):
    """Return the part of a result that the table is made of."""

    def errors(state):
        return [
            {"run": run, "role": head["role"], "output": name, "rmse": error["rmse"], "unit": error["unit"]}
            for run, head in state["experiments"].items()
            for name, error in head["outputs"].items()
        ]

    both = zip(errors(result["baseline"]), errors(result["final"]), strict=True)
    return {
        "verdict": result["verdict"],
        "regime": result["regime"],
        "steps": [{"effect": s["effect"], "at": s["at"], "aliases": s["aliases"]} for s in result["steps"]],
        "parameters": {n: [p["value"], p["sd"], p["unit"]] for n, p in result["final"]["parameters"].items()},
        "errors": [old | {"after": new["rmse"]} for old, new in both],
        "scores": {"before": result["baseline"]["scores"], "after": result["final"]["scores"]},
        "left": (result["open_set"] or {}).get("message", ""),
        "seconds": round(seconds),
    }


def main():
    """Run, record, and write the table if a page is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help=", ".join(discovery_text.STUDIES))
    parser.add_argument("--write", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--recorded", action="store_true", help="measure nothing, write what was recorded")
    options = parser.parse_args()
    names = [] if options.recorded else options.studies or list(discovery_text.STUDIES)
    results = recorded("discovery").get("discovery", {})
    sources = commit()
    for name in names:
        results[name] = discovered(name, options.jobs) | {"commit": sources, "python": platform.python_version()}
        record("discovery", results)
    if options.write:
        discovery_text.into(options.write, results)
    print("\n".join(discovery_text.section(results)))


if __name__ == "__main__":
    main()
