"""Every model and reference example as FMU, in both versions and kinds, run by FMPy beside the native simulation.

``python tests/benchmarks/fmus.py --write docs/validation.md`` exports what is not recorded yet, records it in
`results/fmus.json` (so a run that was stopped goes on), and writes the section. ``--again`` forgets what is recorded;
names of models or examples restrict the run to these. The references are found by CARTPEND_MSL.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import fmpy
import numpy as np
from fmpy.sundials import CVodeSolver
from fmpy.validation import validate_fmu

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from benchmarks.page import put_section, record, recorded  # noqa: E402
from msl_bench import EXAMPLES, load, load_module, reference_of, tube_use  # noqa: E402

from cartpend_dae import assemble, simulate  # noqa: E402
from cartpend_dae.errors import CartpendError  # noqa: E402
from cartpend_dae.fmi import export_fmu  # noqa: E402
from cartpend_dae.study import load_model, model_reference  # noqa: E402

MODELS = sorted((ROOT / "models").glob("*.py"))
KINDS = {"me": "ModelExchange", "cs": "CoSimulation"}
STOP, TUBE, POINTS = 5.0, 0.002, 500
# beyond this time [s] single counts of the quantised encoders depend on the last digits of the states
STOPS = {"closed_loop": 2.5}
# FMPy gives CVode 500 steps for each output interval, too few for stiff contacts; the last default is that number
CVodeSolver.__init__.__defaults__ = (*(CVodeSolver.__init__.__defaults__ or ())[:-1], 100_000)
# all run with an absolute tolerance of 1e-12: small differences of large forces, as the acceleration of the spool in
# `pre_load`, are in the tube only then (at 1e-8 the native run leaves 5 % of its range, CVode three times all of it)
RTOL, ATOL = 1e-10, 1e-12
# FMPy makes CVode's absolute tolerance of the relative one by the nominal values, which are 1 for most
TOLERANCES = {"me": ATOL, "cs": RTOL}
# a square wave drives every input: FMPy holds inputs over each step, so that a sine would be another one there
AMPLITUDES = {"amplifier.u": 6.0, "drive.u": 0.5, "motor.tau": 0.5, "force.f": 50.0}
TITLE = "## Models as FMUs"


def folder_of_references():
    return Path(os.environ.get("CARTPEND_MSL") or ROOT.parent / "shared" / "msl").resolve()


def inputs_of(system, stop):
    """Return samples (times, values, held) of each input."""
    times = np.append(0.0, np.arange(0.505, stop, 0.5))  # no tick of a clock and no output time is there
    signs = np.where(np.arange(times.size) % 2, -1.0, 1.0)
    return {name: (times, AMPLITUDES.get(name, 0.1) * signs, "zoh") for name in system.inputs}


def as_table(inputs):
    """Return inputs as FMPy takes them."""
    if not inputs:
        return None
    times = next(iter(inputs.values()))[0]
    table = np.zeros(2 * times.size, dtype=[("time", float), *((name, float) for name in inputs)])
    table["time"] = np.repeat(np.append(times, times[-1] + 10.0), 2)[1:-1]  # two rows at a time are a jump
    for name, (_, values, _) in inputs.items():
        table[name] = np.repeat(values, 2)
    return table


def measured(system, stop, example):
    """Return what became of one model: seconds of export, and by version and kind the worst uses of the tubes."""
    compare = load_module(folder_of_references() / "compare.py")
    inputs = {} if example else inputs_of(system, stop)
    names = [v.name for v in system.variables]
    row = {"states": len(system.states), "frictions": len(system.frictions.places), "runs": {}}
    for version in ("2.0", "3.0"):
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / "model.fmu"
            begun = time.perf_counter()
            export_fmu(system, path, version=version, stop=stop, tolerance=RTOL)
            row[f"export {version}"] = time.perf_counter() - begun
            row[f"findings {version}"] = [str(finding) for finding in validate_fmu(str(path))]
            description = fmpy.read_model_description(str(path))
            row["indicators"] = description.numberOfEventIndicators
            for kind, name in KINDS.items():
                begun = time.perf_counter()
                result = fmpy.simulate_fmu(
                    str(path),
                    stop_time=stop,
                    fmi_type=name,
                    output=names,
                    input=as_table(inputs),
                    output_interval=stop / POINTS,
                    relative_tolerance=TOLERANCES[kind],
                )
                seconds = time.perf_counter() - begun
                times = around_events(result["time"], [jump for jumps, _, _ in inputs.values() for jump in jumps])
                native = simulate(system, times=times, inputs=inputs, rtol=RTOL, atol=ATOL)
                use, variable = worst_use(compare, native, result, names)
                run = {"seconds": seconds, "native": use, "variable": variable}
                if example:
                    use = tube_use(example, reference_of(example), result["time"], result)
                    run["dymola"] = max(use.values())
                row["runs"][f"{version} {kind}"] = run
    return row


def around_events(times, jumps=()):
    """Return the times of a result, those of its events (two rows at a time, jumps of inputs) from both sides."""
    events = np.union1d(times[1:][np.diff(times) == 0], jumps)
    duration = times[-1] - times[0]
    # the near ones follow what fades fast, the far ones stand on the right side however well an event is located
    near = np.concatenate([events + share * duration for share in (-1e-5, -1e-6, -2e-8, 2e-8, 1e-6, 1e-5)])
    grid = np.concatenate([np.setdiff1d(times, events), near, times[[0, -1]]])
    return np.unique(grid[(grid >= times[0]) & (grid <= times[-1])])


def worst_use(compare, native, result, names):
    """Return the worst use of the tube around the native run by any variable of the model, and which it is."""
    duration = native.time[-1] - native.time[0]
    worst = 0.0, ""
    for name in names:
        values = native[name]
        scale = float(np.ptp(values)) or float(np.max(np.abs(values)))
        # what is constant but for rounding has no range of its own
        height = max(TUBE * scale, 1e-9)
        use = compare.check_signal(native.time, values, result["time"], result[name], TUBE * duration, height)[1]
        worst = max(worst, (use, name))
    return worst


def cases(names):
    """Yield name, system, end of the run, and example or None."""
    for path in MODELS:
        if not names or path.stem in names:
            yield (
                f"models/{path.stem}",
                lambda path=path: (assemble(load_model(model_reference(str(path)))), STOPS.get(path.stem, STOP), None),
            )
    for path in EXAMPLES:
        if not names or path.stem in names:
            yield f"examples/{path.stem}", lambda path=path: opened(path)


def opened(path):
    example = load(path, folder_of_references())
    _, _, data = reference_of(example)
    return assemble(example.model), float(data[-1, 0]), example


def section(rows):
    """Return the section of the page."""
    n_runs = sum(len(row["runs"]) for row in rows.values())
    inside = [max(run["native"], run.get("dymola", 0.0)) <= 1 for row in rows.values() for run in row["runs"].values()]
    clean = sum(not row["findings 2.0"] and not row["findings 3.0"] for row in rows.values())
    frictions = sum(row["frictions"] > 0 for row in rows.values())
    lines = [
        TITLE,
        "",
        "`python tests/benchmarks/fmus.py --write docs/validation.md`",
        "",
        f"{len(rows)} models, {frictions} of them with dry friction, in both versions of FMI, run by FMPy as model",
        "exchange (CVode) and as co-simulation, all with an absolute tolerance of 1e-12.",
        f"`validate_fmu` has no findings for {clean} of {len(rows)}.",
        f"{sum(inside)} of {n_runs} runs are inside the tubes. The figures are the worst use of the tube (1 is its",
        "edge) in both versions: by all variables around the native simulation and, for the reference examples, by the",
        "listed ones around Dymola's result. Seconds are those of one export with `gcc -O2`, both kinds in one file,",
        "on two shared cores.",
        "",
        "| model | states | indicators | export | me: native | me: Dymola | cs: native | cs: Dymola |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for name, row in sorted(rows.items()):
        uses = [worst_of(row, kind, beside) for kind in KINDS for beside in ("native", "dymola")]
        facts = [name, str(row["states"]), str(row["indicators"]), f"{row['export 2.0']:.1f} s"]
        lines.append(f"| {' | '.join([*facts, *uses])} |")
    return [*lines, "", *outside(rows)]


def worst_of(row, kind, beside):
    """Return the worst use of the tube by a kind in both versions, as it stands in the table."""
    uses = [run[beside] for name, run in row["runs"].items() if name.endswith(kind) and beside in run]
    return f"{max(uses):.2g}" if uses else "–"


def outside(rows):
    """Return a line for each model with a variable outside of the tube around the native run."""
    lines = []
    for name, row in sorted(rows.items()):
        runs = {kind: run for kind, run in row["runs"].items() if run["native"] > 1}
        if runs:
            variables = sorted({f"`{run['variable']}`" for run in runs.values()})
            lines.append(f"- {name}: {', '.join(variables)} ({', '.join(runs)}).")
    return ["Outside of the tube around the native run:", "", *lines, ""] if lines else []


def figures(run):
    if run is None:
        return "-"
    return " ".join(f"{run[name]:.2g}" for name in ("native", "dymola") if name in run)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    rows = {} if options.again else recorded("fmus").get("fmus", {})
    for name, make in cases(options.names):
        if name in rows and not options.names:
            continue
        try:
            rows[name] = measured(*make())
        except (CartpendError, Exception) as error:  # the table goes on to the next model
            print(f"{name:<36} {type(error).__name__}: {str(error)[:300]}", flush=True)
            continue
        record("fmus", rows)
        print(f"{name:<36} {rows[name]['export 2.0']:5.1f} s ", end="")
        print(*(figures(run) for run in rows[name]["runs"].values()), sep=" | ", end="")
        print(*rows[name]["findings 2.0"], *rows[name]["findings 3.0"], flush=True)
    if options.write:
        put_section(options.write, section(rows))


if __name__ == "__main__":
    main()
