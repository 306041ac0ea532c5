"""The section of docs/benchmarks.md on size: what `scale.py` recorded, as Markdown."""

import numpy as np

INTRODUCTION = """## Size

`python tests/benchmarks/scale.py --write docs/benchmarks.md`

A chain of n masses hangs on the ground by springs with dampers, connected flange to flange: about 14 n equations.
The first mass is displaced, and 1 s is simulated with relative tolerance 1e-8. Each size runs in a fresh process.
Times are wall times without imports, of the fastest of three runs (of one, where it took longer than 10 s; the
column "runs" says which); "processor" is the time that the processor worked for the total, less than the wall time
where other programs kept the machine busy. Memory is the largest resident set of the process; what the interpreter
and the imports take of it stands beside it. A run is stopped at its limit of wall time, or {memory_limit:g} GB, and
larger sizes are then not tried."""

COLUMNS = ("tool", "n", "equations", "build", "assemble", "first simulation", "total", "processor")
COLUMNS += ("peak memory", "imports", "runs", "error")
STAGES = {
    "cartpend_dae": (
        "components in Python",
        "`assemble`: flatten, check of units, aliases, index reduction, matching and ordering, linear blocks solved",
        "first `simulate`: CasADi functions, consistent start, cvodes, all variables at 11 times",
    ),
    "rumoca": (
        "Modelica text",
        "`Session.loads`: parse, flatten and check, up to its DAE; the equations are not ordered yet",
        "first `Model.simulate`: orders and lowers the equations, integrates, all variables at 11 times",
    ),
    "pymoca": (
        "Modelica text in a file",
        "`transfer_model` with alias detection: parse, flatten, CasADi equations; no index reduction, no ordering",
        "none: it has no simulator",
    ),
    "jaxonomy": (
        "components in Python",
        "`AcausalCompiler`: equations, aliases, index reduction, JAX functions",
        "first `simulate`: context, consistent start, compilation by XLA, BDF, states at the end only",
    ),
}
# OpenModelica and ModelingToolkit are the other free tools for such models; neither comes from a Python index.
ABSENT = "OpenModelica and ModelingToolkit are missing here: pip installs neither `omc` nor Julia."


def section(results):
    """Return the lines of the section."""
    tools = results["tools"]
    any_tool = next(iter(tools.values()))
    return [
        *INTRODUCTION.format(**any_tool).splitlines(),
        "",
        f"Machine: {results['machine']}.",
        *[line for tool, entry in tools.items() for line in ["", measured_with(tool, entry)]],
        *disturbed(tools),
        "",
        ABSENT,
        "",
        f"| {' | '.join(COLUMNS)} |",
        "|---|" + "--:|" * (len(COLUMNS) - 1),
        *[row(tool, run, entry) for tool, entry in tools.items() for run in entry["runs"]],
        "",
        "Equations are those of the flat model; for Pymoca and Jaxonomy, those that are left without aliases.",
        "The error is the largest of all positions at the end against the matrix exponential of the chain, relative to",
        "the displacement; for Pymoca it is the residual of its equations at a motion that obeys Newton's law.",
        "",
        "### What the columns contain",
        "",
        "| tool | build | assemble | first simulation |",
        "|---|---|---|---|",
        *[f"| {tool} | {' | '.join(STAGES[tool])} |" for tool in tools],
        "",
        "### Growth",
        "",
        "Slope of log time against log n, from 100 masses on, over the sizes that finished; 1 is proportional.",
        "",
        "| tool | sizes | assemble | total |",
        "|---|---|--:|--:|",
        *[growth(tool, entry) for tool, entry in tools.items()],
        "",
        "### Targets",
        "",
        "| target for cartpend_dae | found | met |",
        "|---|--:|---|",
        *[f"| {target} | {found} | {met} |" for target, found, met in targets(tools.get("cartpend_dae", {"runs": []}))],
    ]


def measured_with(tool, entry):
    """Say which version was measured when, or that it is absent."""
    if entry["version"] is None:
        return f"{tool}: absent, because it is not installed in the interpreter of this run; `pip install -e .[bench]`."
    busy = f"load average {entry['load']:.1f} at the start, limit {entry['limit']:g} s"
    return f"{tool}: {entry['version']}, Python {entry['python']}, {entry['date']}, {busy}."


def disturbed(tools):
    """Say which wall times are too long, because the processor worked for other programs meanwhile."""
    names = []
    for tool, entry in tools.items():
        runs = [run for run in entry["runs"] if run["status"] == "right"]
        if any(total(run, "processor") < 0.8 * total(run) for run in runs):
            names.append(tool)
    if not names:
        return []
    listing = ", ".join(names)
    return [
        "",
        f"**The machine was busy with other programs: the wall times of {listing} are too long.** Compare the",
        "processor times, take no run as too slow that was stopped, and repeat the command on an idle machine.",
    ]


def row(tool, run, entry):
    """Return one row of the table."""
    seconds, memory = run["seconds"], run.get("memory")
    stages = [seconds.get(stage) for stage in ("build", "assemble", "simulate")]
    cells = ["–" if value is None else f"{value:.3g} s" for value in stages]
    if run["status"] == "time":
        cells[len([value for value in stages if value is not None])] = f"> {entry['limit']:g} s"
    whole = {"time": f"> {entry['limit']:g} s", "failed": "failed"}.get(run["status"], f"{total(run):.3g} s")
    worked = "–" if memory is None else f"{total(run, 'processor'):.3g} s"
    sizes = [f"{memory[key]:.0f} MB" for key in ("peak", "imports")] if memory else ["–", "–"]
    first = [tool, f"{run['n']:,}", str(run.get("equations", "–"))]
    return f"| {' | '.join([*first, *cells, whole, worked, *sizes, str(run['repeats']), error(run)])} |"


def error(run):
    """Return the error of a run in words."""
    if run["status"] == "failed":
        return run["message"].replace("|", "/")
    if "error" in run or "residual" in run:
        found = f"{run['error']:.1g}" if "error" in run else f"residual {run['residual']:.1g}"
        return found if run["status"] == "right" else f"**wrong** ({found})"
    return "–"


def total(run, clock="seconds"):
    """Return the wall time, or with `clock` the ``"processor"`` time, of all stages but the import [s]."""
    return sum(seconds for stage, seconds in run[clock].items() if stage != "import")


def slope(runs, time):
    """Return the slope of log time against log n, None with fewer than two sizes."""
    if len(runs) < 2:
        return None
    return float(np.polyfit(np.log([run["n"] for run in runs]), np.log([time(run) for run in runs]), 1)[0])


def finished(entry):
    """Return the runs from 100 masses on that gave a right answer."""
    return [run for run in entry["runs"] if run["n"] >= 100 and run["status"] == "right"]


def growth(tool, entry):
    """Return one row of the table of slopes."""
    runs = finished(entry)
    slopes = [slope(runs, lambda run: run["seconds"]["assemble"]), slope(runs, total)]
    cells = ["–" if value is None else f"{value:.2f}" for value in slopes]
    sizes = ", ".join(f"{run['n']:,}" for run in runs)
    return f"| {tool} | {sizes or '–'} | {' | '.join(cells)} |"


def targets(entry):
    """Return each target, what was found, and whether it is met."""
    runs = {run["n"]: run for run in finished(entry)}
    assemble = {n: run["seconds"]["assemble"] for n, run in runs.items()}
    peak = runs[10_000]["memory"]["peak"] / 1024 if 10_000 in runs else None
    found = slope([runs[n] for n in (100, 1000, 10_000)], total) if {100, 1000, 10_000} <= set(runs) else None
    return [
        verdict("slope of the total, 100 to 10,000 masses, at most 1.1", found, 1.1, ""),
        verdict("1,000 masses assembled in less than 0.7 s", assemble.get(1000), 0.7, " s"),
        verdict("10,000 masses assembled in less than 8 s", assemble.get(10_000), 8.0, " s"),
        verdict("10,000 masses in less than 1.5 GB", peak, 1.5, " GB"),
    ]


def verdict(target, found, limit, unit):
    """Return a row of the table of targets."""
    if found is None:
        return target, "not measured", "–"
    return target, f"{found:.4g}{unit}", "yes" if found <= limit else "**no**"
