"""The co-simulation FMU of the closed loop over 60 s beside the compiled native simulation, and the time of its export.

``python tests/benchmarks/fmu.py --write docs/benchmarks.md`` takes half a minute, records both in `results/fmu.json`
and writes the page. Both sides give the same 6,000 outputs of the states, in turns; the best run of each counts, and
FMPy's own reading of the file does not.
"""

import argparse
import os
import platform
import sys
import tempfile
import time
from ctypes import c_double, c_uint
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from benchmarks import page  # noqa: E402
from benchmarks.scale import machine, version  # noqa: E402

from cartpend_dae import assemble, simulate  # noqa: E402
from cartpend_dae.fmi import export_fmu  # noqa: E402
from cartpend_dae.study import load_model, model_reference  # noqa: E402

STOP, POINTS, TOLERANCE, REPEATS = 60.0, 6000, 1e-8, 5


def native(system):
    begun = time.perf_counter()
    found = simulate(system, STOP, points=POINTS + 1, rtol=TOLERANCE, atol=0.01 * TOLERANCE, compile=True)
    return time.perf_counter() - begun, np.column_stack([found[name] for name in system.states])


def stepped(folder, description, states):
    """Return the seconds of a run by communication steps, and the states after each."""
    fmu = FMU2Slave(
        guid=description.guid,
        unzipDirectory=str(folder),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="loop",
    )
    fmu.instantiate()
    fmu.setupExperiment(tolerance=TOLERANCE, startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    number = {v.name: v.valueReference for v in description.modelVariables}
    references, values = (c_uint * len(states))(*(number[name] for name in states)), (c_double * len(states))()
    rows = np.zeros((POINTS + 1, len(states)))
    begun = time.perf_counter()
    for k in range(POINTS + 1):
        fmu.fmi2GetReal(fmu.component, references, len(states), values)
        rows[k] = values
        if k < POINTS:
            fmu.doStep(k * STOP / POINTS, STOP / POINTS)
    seconds = time.perf_counter() - begun
    fmu.terminate()
    fmu.freeInstance()
    return seconds, rows


def measured():
    system = assemble(load_model(model_reference(str(ROOT / "models" / "closed_loop.py"))))
    with tempfile.TemporaryDirectory() as scratch:
        path, folder = Path(scratch) / "loop.fmu", Path(scratch) / "unpacked"
        begun = time.perf_counter()
        export_fmu(system, path, stop=STOP, tolerance=TOLERANCE)
        export = time.perf_counter() - begun
        fmpy.extract(str(path), str(folder))
        description = fmpy.read_model_description(str(path))
        native(system)  # compiles
        pairs = [(stepped(folder, description, system.states), native(system)) for _ in range(REPEATS)]
    runs, others = zip(*pairs, strict=True)
    fmu, own = min(run[0] for run in runs), min(run[0] for run in others)
    calm = slice(0, POINTS // 24)  # 2.5 s: later, single counts of the encoders depend on the last digits
    deviation = np.abs(runs[0][1] - others[0][1])[calm].max()
    found = {"export": export, "fmu": fmu, "native": own, "ratio": fmu / own, "deviation": float(deviation)}
    return found | {"repeats": REPEATS}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, metavar="PAGE", help="record the figures and write the page")
    options = parser.parse_args()
    results = {"machine": machine(), "version": version("cartpend_dae", ""), "python": platform.python_version()}
    results |= {"date": time.strftime("%Y-%m-%d"), "load": os.getloadavg()[0]} | measured()
    if options.write:
        page.record("fmu", results)
        options.write.write_text(page.text(page.recorded()))
    else:
        print(page.text({"fmu": results}))


if __name__ == "__main__":
    main()
