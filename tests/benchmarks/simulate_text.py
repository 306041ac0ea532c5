"""The section of docs/benchmarks.md on simulation: what `simulate.py` recorded, as Markdown."""

from benchmarks.scale_text import verdict

LIMIT = 1e-6  # of all states, in SI units

INTRODUCTION = """## Simulation

`python tests/benchmarks/simulate.py --write docs/benchmarks.md`

The closed loop: amplifier, motor with inductance, gears, cart, rod upright, and a controller in continuous time that
feeds back all six states. The cart follows a sine of 0.1 m and 0.5 Hz; the rod starts 10 degrees off. The eigenvalues
reach from -0.5/s to -3,300/s (the current), so the problem is stiff. 60 s, 6,000 outputs. Each row has the loosest
relative tolerance (the absolute one is a hundredth of it) that keeps the error of all states at all outputs below
1e-6 in SI units, as the next two tighter ones do; steps of 4 a decade. The reference is `rosenbrock` with 1e-12, from
which `cvodes` with 1e-12 differs by {doubt:.1g}; the current reaches 37 A. Times are wall times: the mean of five
runs, with that tolerance and four tighter ones up to the next quarter of a decade (the number of steps jumps by some
8 % from one to the next), and of up to 60 such means in turns the fastest. Peers run afterwards, three times, with the
first tolerance of 2 a decade that is right."""

WHY = """The engine in C follows what a jump starts, the transient of the current, by steps where friction stops and
starts, and by one exponential step between two samples of the controller (`cartpend_dae/native/exponential.c`), which
made the sampled loop five times as fast. Without a compiler CasADi interprets the located events: the row in which
neither is compiled is missed, and what was tried there (explicit steps, other step limits) was no faster. The smooth
loop without a compiler gained from what parameters alone decide being computed before the run, from Newton's iteration
ending where SUNDIALS' IDA ends it, and from all variables being written where they stand in the result. The yardstick
is called as its users call it, which copies its result once more. How much is gained by compiling depends on the
processor: the equations by hand in CasADi's `rosenbrock`, compiled, took 0.38 to 0.42 times the yardstick on an AMD
EPYC and 0.64 times on an Intel Xeon; the target of 0.5 is held by the package's own engine."""

ROWS = {
    "yardstick": ("equations by hand", "cvodes"),
    "hand, rosenbrock, compiled": ("equations by hand", "rosenbrock, compiled"),
    "cvodes": ("components, integration alone", "cvodes"),
    "rosenbrock": ("components, integration alone", "rosenbrock"),
    "erk": ("components, integration alone", "erk"),
    "rosenbrock, compiled": ("components, integration alone", "rosenbrock, compiled"),
    "erk, compiled": ("components, integration alone", "erk, compiled"),
    "simulate, cvodes": ("components, `simulate`, all variables", "cvodes"),
    "simulate, rosenbrock": ("components, `simulate`, all variables", "rosenbrock"),
    "simulate, compiled": ("components, `simulate`, all variables", "rosenbrock, engine in C"),
    "friction": ("components, `simulate`, dry friction by events", "rosenbrock"),
    "friction, compiled": ("components, `simulate`, dry friction by events", "rosenbrock, engine in C"),
    "sampled": ("components, `simulate`, controller sampled at 100 Hz", "rosenbrock, engine in C"),
    "clutches": ("CoupledClutches, `simulate`, 1.5 s, 1,501 outputs", "erk"),
}


def section(results):
    """Return the lines of the section."""
    runs = results["runs"]
    measured = f"commit {results['version'].removeprefix('commit ')}, Python {results['python']}"
    return [
        *INTRODUCTION.format(**results).splitlines(),
        "",
        f"Machine: {results['machine']}; {measured}, CasADi {results['casadi']}, {results['date']}, load average "
        f"{results['load']:.1f} at the start.",
        *busy(results["load"]),
        "",
        "| what | integrator | tolerance | error | time | times yardstick | to prepare | again |",
        "|---|---|--:|--:|--:|--:|--:|--:|",
        *[row(ROWS[name], runs[name], fastest(runs["yardstick"])) for name in ROWS if name in runs],
        *[
            row((f"{peer} {entry['version']}, equations by hand", name), run, fastest(runs["yardstick"]))
            for peer, entry in results["peers"].items()
            for name, run in entry["runs"].items()
        ],
        "",
        *absent(results["peers"]),
        "To prepare is to make the integrator and, where it is compiled, its C and the library; again is the same with",
        "the library in the cache. For `simulate` it is the first call on a system: functions, start, integrator. The",
        "system keeps these, and the time is that of a later call with the same start values, parameters and outputs.",
        "With another start or parameter the start is solved anew, some 10 ms, and the targets for `simulate` are",
        "missed by more. The engine in C is the package's own; the other compiled rows are C that CasADi writes.",
        *more(results),
        "",
        "### Targets of simulation",
        "",
        "| target for cartpend_dae | found | met |",
        "|---|--:|---|",
        *[f"| {target} | {found} | {met} |" for target, found, met in targets(runs)],
        "",
        *WHY.splitlines(),
    ]


def more(results):
    """Return what was measured besides, if it was."""
    if "million" not in results:
        return []
    million, held, doubts = results["million"], results["held"], results["doubts"]
    return [
        "",
        "With dry friction (6 N) or the sampled controller CasADi's `rosenbrock`, 1e-10, is the truth,",
        f"from which the engine's `erk` with 1e-10 differs by {doubts['friction']:.1g} and {doubts['sampled']:.1g}.",
        "CoupledClutches runs with the tolerances that `simulate` has by default.",
        "",
        "| size | first call | memory |",
        "|---|--:|--:|",
        f"| the smooth loop, 1,000,001 outputs of {million['names']} variables | {million['seconds']:.3g} s | "
        f"{million['memory']:.0f} MB, of which the result {million['result']:.0f} MB |",
        f"| `models/driven_cart.py`, 50 s, 5,000 held samples of the voltage | {held['first']:.3g} s, "
        f"again {held['seconds']:.3g} s | – |",
    ]


def row(labels, run, yardstick):
    """Return one row of the table."""
    prepare = [f"{1e3 * run[key]:.3g} ms" if key in run else "–" for key in ("prepare", "prepare_again")]
    error = "–" if run["error"] is None else f"{run['error']:.1g}"
    figures = [f"{run['tolerance']:.1g}", error, f"{1e3 * fastest(run):.3g} ms"]
    return f"| {' | '.join([*labels, *figures, f'{fastest(run) / yardstick:.2f}', *prepare])} |"


def busy(load):
    """Say so if other programs worked as well; two processors are the least that a machine has."""
    if load <= 2:
        return []
    return [
        "",
        "**The machine was busy with other programs.** Compare the ratios, not the times, and repeat on an idle one.",
    ]


def absent(peers):
    """Say which peers were not measured."""
    missing = [name for name, entry in peers.items() if not entry["runs"]]
    return (
        [f"Not measured, because the interpreter given for them does not have them: {', '.join(missing)}.", ""]
        if missing
        else []
    )


def fastest(run):
    """Return the shortest time [s]."""
    return min(run["seconds"])


def targets(runs):
    """Return each target, what was found, and whether it is met."""

    def ratio(name, to="yardstick"):
        return fastest(runs[name]) / fastest(runs[to]) if name in runs and to in runs else None

    smooth, fast = "simulate, cvodes", "simulate, compiled"
    clutches = fastest(runs["clutches"]) if "clutches" in runs else None
    return [
        verdict("integration alone at most 1.1 times the yardstick", ratio("cvodes"), 1.1, ""),
        verdict("CasADi's `rosenbrock` alone, compiled, at most 0.5 times", ratio("rosenbrock, compiled"), 0.5, ""),
        verdict(
            "CasADi's `rosenbrock` alone, compiled, at most 1.1 times the same by hand",
            ratio("rosenbrock, compiled", "hand, rosenbrock, compiled"),
            1.1,
            "",
        ),
        verdict("`simulate`, all variables, at most 1.1 times", ratio(smooth), 1.1, ""),
        verdict("`simulate`, all variables, compiled, at most 0.5 times", ratio("simulate, compiled"), 0.5, ""),
        verdict(
            "friction events at most 1.5 times the smooth run, both compiled",
            ratio("friction, compiled", fast),
            1.5,
            "",
        ),
        verdict("friction events at most 1.5 times the smooth run, both not", ratio("friction", smooth), 1.5, ""),
        verdict("sampled at most 3 times the continuous loop, both compiled", ratio("sampled", fast), 3.0, ""),
        verdict("sampled, compiled, at most 3 times the continuous loop, not", ratio("sampled", smooth), 3.0, ""),
        verdict("CoupledClutches in less than 0.15 s", clutches, 0.15, " s"),
    ]
