"""Measure the identification of two rigs that stick, and of a larger one, beside peers; write docs/benchmarks.md.

``python tests/benchmarks/identify.py --peers PYTHON --write docs/benchmarks.md`` takes some minutes. SciPy lives in
this interpreter, GEKKO and Pyomo in the one that `--peers` names; Pyomo needs `cyipopt` and the library that
``pyomo build-extensions`` makes.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(HERE / "fit")]

from benchmarks import page  # noqa: E402
from benchmarks.scale import machine, version  # noqa: E402
from cases import CASES  # noqa: E402
from chain import Chain  # noqa: E402

from cartpend_dae import simulate  # noqa: E402

RUNS, RUN_SAMPLES, CHAIN_NOISE, LIMIT = 4, 2500, 1e-4, 900
CHAIN_TRUTH = {
    "mass_1.m": 1.0, "mass_2.m": 1.5, "mass_3.m": 0.7, "gap_1.c": 200.0, "gap_2.c": 300.0, "gap_3.c": 150.0,
    "gap_1.d": 1.0, "gap_2.d": 2.0, "gap_3.d": 0.5, "rail.d": 1.5,
}  # fmt: skip


def child(python, *arguments):
    """Run a script; return what it prints as JSON, or why there is nothing."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    try:
        done = subprocess.run(
            [python, *map(str, arguments)], capture_output=True, text=True, timeout=LIMIT, env=environment
        )
    except subprocess.TimeoutExpired:
        return {"failed": f"not done after {LIMIT} s"}
    if done.returncode:
        return {"failed": (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]}
    return json.loads(done.stdout.strip().splitlines()[-1])


def rig(case, peers, folder, kept):
    """Measure one of the two rigs; `kept` are peers with what was recorded of them."""
    times, clean = case.clean()
    noise = case.noise * np.random.default_rng(0).standard_normal(times.size)
    study = case.write(folder, times, clean + noise)
    found = {"ours": child(sys.executable, HERE / "fit" / "ours.py", study), "truth": dict(case.truth)}
    (near := folder / "near").mkdir(exist_ok=True)
    close = replace(case, guess={name: 1.02 * value for name, value in case.truth.items()})
    found["near"] = child(sys.executable, HERE / "fit" / "ours.py", close.write(near, times, clean + noise))
    found["truth"][f"run:{case.measured}"] = case.start
    found |= {"noise": float(np.sqrt(np.mean(noise**2))), "peers": {}}
    for name, python in (("scipy", sys.executable), ("gekko", peers), ("pyomo", peers)):
        if name in kept:
            found["peers"][name] = kept[name]
            continue
        script, log = HERE / "fit" / f"with_{name}.py", folder / "run.csv"
        found["peers"][name] = child(python, script, case.name, log, *case.truth.values())
    return found


def chain(folder):
    """Measure the larger problem: its runs are simulated by the package, for the time and the memory count."""
    times, generator = np.arange(RUN_SAMPLES) / 100, np.random.default_rng(0)
    text = ["[model]", f'path = "{HERE / "fit" / "chain.py"}"']
    for name, truth in CHAIN_TRUTH.items():
        text += [f'[parameters."{name}"]', f"guess = {1.3 * truth}", "min = 0.0"]
    for k in range(RUNS):
        force = np.repeat(generator.uniform(-20.0, 20.0, RUN_SAMPLES // 20 + 1), 20)[:RUN_SAMPLES]
        result = simulate(Chain(), times=times, inputs={"force.f": (times, force, "zoh")}, rtol=1e-8)
        outputs = [result[f"mass_{i}.s"] + CHAIN_NOISE * generator.standard_normal(times.size) for i in (1, 2, 3)]
        table = np.column_stack([times, force, *outputs])
        np.savetxt(folder / f"run{k}.csv", table, "%.17g", ",", header="time,f,s1,s2,s3", comments="")
        text += ["[[experiment]]", f'name = "run{k}"', f'file = "run{k}.csv"', 'time = { column = "time", unit = "s" }']
        text += ['inputs = { "force.f" = { column = "f" } }']
        columns = [f'"mass_{i}.s" = {{ column = "s{i}", sd = {CHAIN_NOISE} }}' for i in (1, 2, 3)]
        text += [f"outputs = {{ {', '.join(columns)} }}"]
    (folder / "study.toml").write_text("\n".join(text) + "\n")
    return {"ours": child(sys.executable, HERE / "fit" / "ours.py", folder / "study.toml"), "truth": CHAIN_TRUTH}


def main():
    """Measure, and print or write the section."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peers", default=sys.executable, metavar="PATH", help="interpreter with GEKKO and Pyomo")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="record the figures and write the page")
    parser.add_argument("--keep", nargs="*", default=[], metavar="PEER", help="peers whose record stays as it is")
    options = parser.parse_args()
    old = page.recorded().get("identify", {}) if options.keep else {}
    results = {"machine": machine(), "version": version("cartpend_dae", ""), "python": platform.python_version()}
    results |= {"date": time.strftime("%Y-%m-%d"), "load": os.getloadavg()[0], "casadi": ca.CasadiMeta.version()}
    with tempfile.TemporaryDirectory() as folder:
        results["rigs"] = {}
        for case in CASES:
            had = old["rigs"][case.name]["peers"] if old else {}
            kept = {name: had[name] for name in options.keep}
            results["rigs"][case.name] = rig(case, options.peers, Path(folder), kept)
        results["chain"] = chain(Path(folder))
    if old:
        results["kept"] = {
            "peers": options.keep,
            "of": old.get("kept", {}).get("of", f"{old['version']}, {old['date']}"),
        }
    if options.write:
        page.record("identify", results)
        options.write.write_text(page.text(page.recorded()))
    else:
        print(page.text({"identify": results}))


if __name__ == "__main__":
    main()
