"""Measure how time and memory grow with the size of a model, here and in peers; write docs/benchmarks.md.

``python tests/benchmarks/scale.py --write docs/benchmarks.md`` takes about ten minutes with all peers, one without.
Peers live in this interpreter (``pip install -e .[bench]``) or in others (``--python rumoca=PATH``). With ``--tools``
only some are measured anew; the others keep what was recorded on the same machine.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.sparse import block_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import expm_multiply

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(HERE / "chain")]

from benchmarks import page  # noqa: E402
from benchmarks.scale_text import total  # noqa: E402
from child import DAMPING, DISPLACEMENT, MASS, MEMORY_LIMIT, SPRING, STOP  # noqa: E402

SCRIPTS = {
    "cartpend_dae": "with_cartpend.py",
    "rumoca": "with_rumoca.py",
    "pymoca": "with_pymoca.py",
    "jaxonomy": "with_jaxonomy.py",
}
SIZES = (10, 100, 1000, 10_000)
REPEATS, LONG = 3, 10.0  # a run that takes longer than this [s] is not repeated


def reference(n):
    """Return the positions [m] at the end, by the matrix exponential of the chain's equations of motion."""
    diagonal = np.full(n, 2.0)
    diagonal[-1] = 1.0
    coupling = csr_array(diags_array([-np.ones(n - 1), diagonal, -np.ones(n - 1)], offsets=[-1, 0, 1]))
    rates = block_array([[None, eye_array(n)], [-SPRING / MASS * coupling, -DAMPING / MASS * coupling]])
    start = np.zeros(2 * n)
    start[0] = DISPLACEMENT
    return expm_multiply(csr_array(rates) * STOP, start)[:n]


def machine():
    """Describe the computer."""
    cpu = platform.processor()
    if (info := Path("/proc/cpuinfo")).exists():
        names = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if "model name" in line]
        cpu = names[0] if names else cpu
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1024**3
    return f"{cpu}, {os.cpu_count()} cores, {memory:.0f} GB, {platform.system()} {platform.machine()}"


def version(tool, python):
    """Return the version of a tool in an interpreter; None if it is not there."""
    if tool == "cartpend_dae":
        return f"commit {page.commit()}"
    code = f"from importlib.metadata import version; print(version({tool!r}))"
    done = subprocess.run([python, "-c", code], capture_output=True, text=True)
    return done.stdout.strip() if done.returncode == 0 else None


def run_once(tool, n, python, limit):
    """Run one chain in a fresh process; return what it reported, with its `status`."""
    environment = os.environ | ({"PYTHONPATH": str(ROOT)} if tool == "cartpend_dae" else {})
    command = [python, str(HERE / "chain" / SCRIPTS[tool]), str(n)]
    with tempfile.TemporaryDirectory() as folder:
        try:
            done = subprocess.run(
                command, env=environment, cwd=folder, capture_output=True, text=True, errors="replace", timeout=limit
            )
        except subprocess.TimeoutExpired as cut:
            return last_report((cut.stdout or b"").decode(errors="replace")) | {"status": "time"}
    found = last_report(done.stdout)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        return found | {"status": "failed", "message": lines[-1][:300]}
    return with_verdict(found | {"status": "right"}, n)


def last_report(output):
    """Return the last line of JSON that a child printed."""
    lines = [line for line in output.splitlines() if line.startswith('{"seconds"')]
    return json.loads(lines[-1]) if lines else {"seconds": {}, "processor": {}}


def with_verdict(found, n):
    """Replace the positions by their error, relative to the displacement; `wrong` if it is too large."""
    if "positions" in found:
        error = np.abs(np.array(found.pop("positions")) - reference(n)).max() / DISPLACEMENT
        # a thousand times the relative tolerance that every simulation was given
        return found | {"error": float(error)} | ({} if error <= 1e-5 else {"status": "wrong"})
    # a residual of terms of the size of SPRING, computed in double precision
    return found | ({} if found["residual"] <= 1e-9 * SPRING else {"status": "wrong"})


def measure(tool, python, sizes, limit):
    """Measure one tool at all sizes, up to the first that is cut short."""
    entry = {"version": version(tool, python), "python": platform.python_version(), "date": time.strftime("%Y-%m-%d")}
    entry |= {"limit": limit, "memory_limit": MEMORY_LIMIT, "load": os.getloadavg()[0], "runs": []}
    if entry["version"] is None:
        return entry
    for n in sizes:
        runs = []
        while len(runs) < REPEATS and (not runs or (runs[-1]["status"] == "right" and total(runs[-1]) < LONG)):
            runs.append(run_once(tool, n, python, limit))
            print(f"{tool} {n}: {runs[-1]['status']}, {total(runs[-1]):.3g} s", file=sys.stderr)
        best = min((run for run in runs if run["status"] == runs[-1]["status"]), key=total)
        entry["runs"].append({"n": n, "repeats": len(runs)} | best)
        if best["status"] in ("time", "failed"):
            break
    return entry


def arguments():
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tools", nargs="*", choices=SCRIPTS, default=list(SCRIPTS), help="what to measure")
    parser.add_argument("--sizes", nargs="*", type=int, default=SIZES, help="numbers of masses")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds for one run, after which it is stopped")
    parser.add_argument("--peers-python", default=sys.executable, help="interpreter of all peers")
    parser.add_argument("--python", action="append", default=[], metavar="TOOL=PATH", help="interpreter of one tool")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="record the figures and write the page")
    return parser.parse_args()


def main():
    """Measure, and print or write the page."""
    options = arguments()
    pythons = dict.fromkeys(SCRIPTS, options.peers_python) | {"cartpend_dae": sys.executable}
    pythons |= dict(pair.split("=", 1) for pair in options.python)
    tools = {tool: measure(tool, pythons[tool], options.sizes, options.limit) for tool in options.tools}
    recorded, here = page.recorded().get("scale", {}), machine()
    kept = recorded["tools"] if recorded.get("machine") == here else {}
    results = {"machine": here, "tools": {tool: (kept | tools)[tool] for tool in SCRIPTS if tool in kept | tools}}
    if options.write:
        page.record("scale", results)
        options.write.write_text(page.text(page.recorded()))
    else:
        print(page.text({"scale": results}))


if __name__ == "__main__":
    main()
