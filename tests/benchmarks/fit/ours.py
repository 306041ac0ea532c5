"""Fit a study in this process, and print JSON: times from the study file to the covariance, estimates, memory."""

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

from cartpend_dae.session import identify_study, open_study

PARTS = 3


def main(study):
    """Fit three times; imports are not counted, the first time is that of a fresh process."""
    times = []
    for _ in range(PARTS):
        wall, processor = time.perf_counter(), time.process_time()
        opened = open_study(study)
        read = time.perf_counter() - wall
        fit = identify_study(opened)
        times.append({"wall": time.perf_counter() - wall, "processor": time.process_time() - processor, "read": read})
    return {
        "first": times[0],
        "best": min(times, key=lambda t: t["wall"]),
        "estimates": {e.name: [e.value, e.sd] for e in (*fit.parameters, *fit.starts)},
        "rmse": [float(np.sqrt(np.nanmean(run.residual[:, 0] ** 2))) for run in fit.runs],
        "chi2": fit.chi2,
        "samples": int(sum(run.time.size for run in fit.runs)),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
    print(json.dumps(main(Path(sys.argv[1]))))
