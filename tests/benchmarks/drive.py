"""How long a discovery takes on an electromechanical drive: three runs of 15 s, the whole catalogue, two processes.

``python tests/benchmarks/drive.py [EFFECT@PLACE ...] [--seed 10] [--jobs 2] [--write docs/validation.md]`` hides one
effect after the other in the driven cart of the blind bed, gives each data set to `cartpend discover` twice, the first
time without any compiled functions of the rig, and records how long that takes, with imports, closures and report.
What was recorded of other effects stays.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from benchmarks.discovery import COMMAND  # noqa: E402
from benchmarks.page import commit, put_section, record, recorded  # noqa: E402
from blind.generate import DataSet, generate  # noqa: E402
from blind.keys import Key  # noqa: E402
from blind.run import known_effects  # noqa: E402
from blind.writer import write  # noqa: E402

EFFECTS = (
    "coulomb_friction@rail",
    "quadratic_drag@bearing",
    "saturation@input",
    "cogging@motor",
    "compliance@chain",
    "input_delay@input",
)


def discovered(hidden, seed, jobs):
    """Return the seconds that the command takes on a data set with a hidden effect, and again, and what it finds."""
    effect, _, place = hidden.partition("@")
    (data,) = generate([Key("driven_cart", "noise", ((effect, place),), seed)])
    if not isinstance(data, DataSet):
        raise SystemExit(f"{hidden}: {data}")
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        study = write(data, home / "data", home / "truth", known_effects())
        command = [sys.executable, "-c", COMMAND, "discover", str(study), "--out", str(home / "out")]
        without = os.environ | {"CARTPEND_CACHE": str(home / "cache")}
        seconds = list[int]()
        for _ in range(2):
            begin = time.perf_counter()
            done = subprocess.run([*command, "--jobs", str(jobs)], capture_output=True, text=True, env=without)
            seconds.append(round(time.perf_counter() - begin))
            if done.returncode:
                raise SystemExit(f"{hidden}: {done.stderr.strip()}")
        result = json.loads((home / "out" / "result.json").read_text())
    steps = [f"`{step['effect']}` at `{step['at']}`" for step in result["steps"]]
    first, again = seconds
    found = {"steps": steps, "verdict": result["verdict"]}
    return {"seconds": first, "again": again, "jobs": jobs, "seed": seed, **found}


def section(results):
    """Return the table."""
    lines = [
        "## How long a discovery takes",
        "",
        "`python tests/benchmarks/drive.py --write docs/validation.md` hides an effect in the driven cart of the blind",
        "bed (three runs of 15 s, two encoders, noise) and gives it to `cartpend discover`, with the whole catalogue.",
        "Seconds are wall time on a machine of two cores, imports, closures and report included; the target is 60 s.",
        "At first nothing of the rig has been compiled; later, what was used much is found compiled.",
        "",
        "| hidden | seed | processes | seconds at first | seconds again | found | verdict | commit |",
        "|---|--:|--:|--:|--:|---|---|---|",
    ]
    for hidden, r in results.items():
        found = ", ".join(r["steps"]) or "nothing"
        lines.append(
            f"| `{hidden}` | {r['seed']} | {r['jobs']} | {r['seconds']} | {r.get('again', '')} | {found} | "
            f"{r['verdict']} | {r['commit']} |"
        )
    return lines


def main():
    """Measure, record, and write the table if a page is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("effects", nargs="*", metavar="EFFECT@PLACE", help="of the driven cart of the blind bed")
    parser.add_argument("--seed", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--recorded", action="store_true", help="measure nothing, write what was recorded")
    options = parser.parse_args()
    results, sources = recorded("drive").get("drive", {}), commit()
    for hidden in () if options.recorded else options.effects or EFFECTS:
        results[hidden] = discovered(hidden, options.seed, options.jobs) | {"commit": sources}
        record("drive", results)
    lines = section(results)
    if options.write:
        put_section(options.write, lines)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
