"""Machines without a compiler or a display, folders with strange names, logs that are large, and long use."""

import gc
import os
import resource
from pathlib import Path

import numpy as np

from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.identify import estimate
from cartpend_dae.session import open_study
from mishaps.scene import Row, content, is_a_sentence, run, small_study

STRANGE = (
    "Prüfstand № 1 – étude",
    "実験 データ",
    "with 'quotes' and \"more\"",
    "a%20b&c;d $HOME",
    "-dash",
    "τ_c = 0.02",
)
HEAD = """
[model]
path = "rota_damp.py"
name = "RotaDamp"
[parameters."bearing.d"]
guess = 0.03
[[experiment]]
name = "large"
file = "large.csv"
format = { sample_rate = 1000.0 }
outputs = { "bearing.phi" = { column = "angle", unit = "deg" } }
rows = [0, 1999]
"""


def no_compiler(folder: Path) -> list[Row]:
    """Do everything on a machine without a C compiler."""
    study, log, lost = small_study(folder / "study"), folder / "log", 0
    model = study.with_suffix(".py")

    def bare():
        os.environ.update(PATH=str(folder), CC="")
        os.environ.pop("CC")
        os.environ["XDG_CACHE_HOME"] = str(folder / "cache")

    assert run(log, "discover", study, "--out", folder / "whole").code == 0
    for call in (
        ("discover", study, "--out", folder / "out"),
        ("simulate", model, "--stop", "1", "--compile", "--out", folder / "simulated"),
        ("export-modelica", model, "--out", folder / "x.mo"),
    ):
        found = run(log, *call, setup=bare)
        if found.code != 0:
            lost += 1
            print("no compiler:", *call, found.code, found.stderr[-500:])
    lost += content(folder / "out") != content(folder / "whole")
    exported = run(log, "export-fmu", model, "--out", folder / "x.fmu", setup=bare)
    lost += not is_a_sentence(exported, 0, "the FMU holds its sources only")
    found = "the same results; `export-fmu` says that the FMU holds its sources only"
    return [Row("no C compiler", "`discover`, `simulate --compile`, both exports", 4, found, lost)]


def no_display(folder: Path) -> list[Row]:
    """Draw all figures where there is no display."""
    study, log, lost = small_study(folder / "study"), folder / "log", 0

    def bare():
        for name in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND", "HOME"):
            os.environ.pop(name, None)

    calls = [("discover", study, "--out", folder / "out")]
    calls += [("simulate", study.with_suffix(".py"), "--stop", "1", "--out", folder / "simulated")]
    for call in calls:
        found = run(log, *call, setup=bare)
        lost += not (found.code == 0 and list(Path(call[3 if call[0] == "discover" else 5]).glob("*.png")))
    return [Row("no display, no home", "`discover` and `simulate` with their figures", len(calls), "as ever", lost)]


def strange_names(folder: Path, names: tuple[str, ...] = STRANGE) -> list[Row]:
    """Work in folders with spaces, accents and signs in their names, named from inside and from outside."""
    lost, times = 0, 0
    for name in names:
        study = small_study(folder / name / "study")
        place, model = study.parent, study.with_suffix(".py")
        out = place.parent / f"results of {name}"
        calls = [("discover", study, "--out", out), ("report", out), ("data", study)]
        calls += [("simulate", model, "--stop", "1", "--out", out / "s")]
        calls += [("export-modelica", model, "--out", place / f"{name}.mo")]
        calls += [("export-fmu", model, "--out", place / f"{name}.fmu"), ("check-fmu", place / f"{name}.fmu")]
        for call in calls:
            found = run(folder / "log", *call)
            times += 1
            if found.code != 0 or "Traceback" in found.stderr:
                lost += 1
                print("strange name:", *call, found.code, found.stderr[-500:])
    done = f"{len(calls)} commands in {len(names)} folders such as `{names[0]}`"
    return [Row("spaces, accents and signs in paths", done, times, "as ever", lost)]


def large_log(folder: Path, gigabytes: float = 1.0) -> list[Row]:
    """Read a log that is larger than what is wanted of it; the file is made and removed here."""
    study = small_study(folder / "study")
    (study.parent / "large.toml").write_text(HEAD, "utf-8")
    path, generator, n = study.parent / "large.csv", np.random.default_rng(0), 100_000
    block = "".join(f"{a:.6f},{','.join(f'{x:.7f}' for x in more)}\n" for a, *more in generator.normal(size=(n, 10)))
    times = max(1, round(1e9 * gigabytes / len(block)))
    with path.open("w") as file:
        file.write("angle," + ",".join(f"other{k}" for k in range(9)) + "\n")
        for _ in range(times):
            file.write(block)
    size, rows = path.stat().st_size, n * times
    numbers = os.pipe()

    def read():
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        (one,) = open_study(study.parent / "large.toml").setup.train
        assert one.time.size == 2000
        os.write(numbers[1], f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before}".encode())
        os._exit(0)

    found = run(folder / "log", "--version", setup=read)
    path.unlink()
    os.close(numbers[1])
    text = os.read(numbers[0], 100).decode()
    os.close(numbers[0])
    grown = int(text) / 1024 if text else float("nan")  # MB
    allowed = 100 + 3 * 8 * rows / 1e6  # the wanted column three times
    lost = not (found.code == 0 and grown < allowed)
    done = f"{size / 1e9:.2f} GB, {rows:,} rows, one column of ten wanted"
    what = f"read in {found.seconds:.0f} s; memory grew by {grown:.0f} MB (the column alone is {8 * rows / 1e6:.0f} MB)"
    return [Row("large csv", done, 1, what, int(lost))]


def resident() -> float:
    """Return the memory of this process now [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def long_use(folder: Path, fits: int) -> list[Row]:
    """Fit again and again, on the same problem and on problems made anew, and weigh the process."""
    setup = open_study(small_study(folder / "study")).setup
    series = []
    for k in range(fits):
        if k % 10 == 0:
            bench = Workbench(setup)
            problem = bench.problem(())
        estimate(problem, guess={"bearing.d": 0.01 + 0.02 * (k % 7) / 7})
        if (k + 1) % (fits // 10) == 0:
            gc.collect()
            series.append(resident())
    # what the first fifth warms up is no growth; then less than a kB a fit
    growth = (series[-1] - series[1]) / (0.8 * fits) * 1000
    found = f"{series[1]:.0f} MB after {fits // 5} fits, {series[-1]:.0f} MB at the end: {growth:+.2f} kB a fit"
    return [Row("long use", "fits in one process, a problem made anew after each ten", fits, found, int(growth > 5))]
