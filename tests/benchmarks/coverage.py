"""Count how often the 95 % intervals hold the truth, over noise seeds; keep the counts, and write docs/validation.md.

``python tests/benchmarks/coverage.py --jobs 2`` fits what is missing of seeds 0 to 999 and records the fits, so that it
can be stopped and called again; ``--write`` puts the table into docs/validation.md.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(HERE / "fit")]

from benchmarks import coverage_text, page  # noqa: E402
from cases import CASES  # noqa: E402

from cartpend_dae.identify import estimate  # noqa: E402
from cartpend_dae.parallel import in_parallel  # noqa: E402
from cartpend_dae.session import open_study, solve_study  # noqa: E402

SEEDS = 1000
AR = 0.7  # of the coloured noise, from one sample to the next; its standard deviation is that of the white one
KINDS = ("white", "coloured")


def noise(kind, size, sd, seed):
    """Return white or first-order autoregressive noise of one seed."""
    white = np.random.default_rng(seed).standard_normal(size + 100)
    if kind == "white":
        return sd * white[100:]
    return sd * np.sqrt(1 - AR**2) * lfilter([1.0], [1.0, -AR], white)[100:]


def prepared(case, kind):
    """Return a function from the seed to the estimates, in standard deviations from the truth, and in or out."""
    time, clean = case.clean()
    with tempfile.TemporaryDirectory() as folder:
        opened = open_study(case.write(Path(folder), time, clean + noise(kind, time.size, case.noise, 0)))
    problem, first = solve_study(opened)
    (run,) = problem.experiments
    channel = run.outputs[case.measured]

    def fit(seed):
        values = clean + noise(kind, time.size, case.noise, seed)
        made = replace(run, outputs={case.measured: replace(channel, values=values)})
        found = estimate(problem.with_measured((made,)), guess=first.point)
        rows = {}
        for e in found.parameters:
            truth = case.truth[e.name]
            rows[e.name] = [(e.value - truth) / e.sd, int(e.interval[0] <= truth <= e.interval[1]), e.value, e.sd]
        return {"seed": seed, "success": found.success, "estimates": rows}

    return fit


def main():
    """Fit what is missing, and count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--folder", type=Path, required=True, help="where the fits are kept")
    parser.add_argument("--write", action="store_true", help="put the table into docs/validation.md")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    counts = []
    for case in CASES:
        for kind in KINDS:
            file = options.folder / f"{case.name}-{kind}.jsonl"
            lines = file.read_text().splitlines() if file.exists() else []
            done = {entry["seed"]: entry for entry in map(json.loads, lines)}
            missing = [seed for seed in range(options.seeds) if seed not in done]
            if missing:
                with file.open("a") as out:
                    for entry in in_parallel(prepared(case, kind), missing, jobs=options.jobs):
                        out.write(json.dumps(entry) + "\n")
                        out.flush()
                        done[entry["seed"]] = entry
            counts += coverage_text.counted(case.name, kind, [done[seed] for seed in range(options.seeds)])
    if options.write:
        page.record("coverage", {"cells": counts, "ar": AR})
        coverage_text.into(ROOT / "docs" / "validation.md", {"cells": counts, "ar": AR})
    else:
        print("\n".join(coverage_text.section({"cells": counts, "ar": AR})))


if __name__ == "__main__":
    main()
