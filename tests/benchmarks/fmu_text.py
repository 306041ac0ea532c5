"""The section of docs/benchmarks.md on FMUs: what `fmu.py` recorded, as Markdown."""

from benchmarks.scale_text import verdict
from benchmarks.simulate_text import busy

RATIO, EXPORT = 1.5, 5.0

INTRODUCTION = """## Co-simulation of an FMU

`python tests/benchmarks/fmu.py --write docs/benchmarks.md`

The closed loop of `models/closed_loop.py`: sampled controller, encoders that count, dry friction. 60 s by 6,000
communication steps of its FMU 2.0, called through ctypes as FMPy does, beside the compiled native simulation with the
same 6,000 outputs; both with a relative tolerance of 1e-8. The times of both, in turns, are the fastest of {repeats}
runs, without the reading of the file and without compilation. The export is that of both kinds in one file, with
`gcc -O2`. The states of the two differ by {deviation:.2g} over the first 2.5 s; later single counts of the encoders
depend on their last digits."""


def targets(results):
    """Return rows of target, found, met."""
    return [
        verdict(f"60 s at most {RATIO:g} times as long as the native simulation", results["ratio"], RATIO, ""),
        verdict(f"export under {EXPORT:g} s", results["export"], EXPORT, " s"),
    ]


def section(results):
    """Return the lines of the section."""
    measured = f"commit {results['version'].removeprefix('commit ')}, Python {results['python']}, {results['date']}"
    return [
        *INTRODUCTION.format(**results).splitlines(),
        "",
        f"Machine: {results['machine']}; {measured}, load average {results['load']:.1f} at the start.",
        *busy(results["load"]),
        "",
        "| what | time |",
        "|---|--:|",
        f"| co-simulation FMU | {results['fmu']:.3f} s |",
        f"| native, compiled | {results['native']:.3f} s |",
        f"| export | {results['export']:.2f} s |",
        "",
        "| target | found | met |",
        "|---|--:|---|",
        *[f"| {' | '.join(row)} |" for row in targets(results)],
    ]
