"""The section of docs/benchmarks.md on identification: what `identify.py` recorded, as Markdown."""

INTRODUCTION = """## Identification

`python tests/benchmarks/identify.py --peers PYTHON --write docs/benchmarks.md`

1,000 samples at 100 Hz of a pendulum (noise 1 mrad) and of the cart between its springs (0.1 mm; it sticks from 1.5 s
on), by `tests/independent.py`. Viscous and Coulomb friction, of the cart the mass as well, and the start position are
estimated, from guesses that are off by a factor of two. Times are from the study file to the covariance, imports apart;
`first` is the first fit of a process, `again` the fastest of three. The peers solve equations by hand, their data in
memory. An optimum is the same where its sum of squares is within 0.1 % of the lowest."""

NEAR = ", from 2 % off the truth"
SAME, SECONDS, CHAIN_SECONDS, MEGABYTES = 1e-3, 1.0, 10.0, 2048


def section(results):
    """Return the lines of the section."""
    lines = [
        *INTRODUCTION.splitlines(),
        "",
        f"Machine: {results['machine']}; {results['version']}, Python {results['python']}, CasADi {results['casadi']}, "
        f"{results['date']}, load average {results['load']:.1f} at the start (the machine was shared: processor time "
        "counts, but GEKKO solves in a process of its own, whose time is in the wall time alone).",
        *_kept(results),
        "",
        "| rig | what | sum of squares | wall | processor | same optimum |",
        "|---|---|--:|--:|--:|---|",
    ]
    for name, entry in results["rigs"].items():
        lines += [*_own(name, entry["ours"], ""), *_own(name, entry["near"], NEAR), *_peers(name, entry)]
    lines += ["", "| rig | parameter | truth | estimate | sd | error |", "|---|---|--:|--:|--:|--:|"]
    for name, entry in [*results["rigs"].items(), ("chain", results["chain"])]:
        lines += _estimates(name, entry)
    return [
        *lines,
        "",
        *([_PYOMO.format(results["pyomo"].strip("[]") or "none"), ""] if "pyomo" in results else []),
        *_chain(results["chain"]),
        "",
        "### Targets of identification",
        "",
        *targets(results),
    ]


_PYOMO = (
    "Pyomo was not measured: no model of the rigs was written for it. It installs by pip; solvers that it found: {}."
)


def _kept(results):
    """Say which figures are older ones of the same machine."""
    if "kept" not in results:
        return []
    return [f"The rows of {' and '.join(results['kept']['peers'])} stand as recorded at {results['kept']['of']}."]


def _own(name, ours, start):
    return [
        f"| {name} | cartpend_dae, {kind}{start} | {ours['chi2']:.2f} | {ours[key]['wall']:.2f} s | "
        f"{ours[key]['processor']:.2f} s | yes |"
        for kind, key in (("first", "first"), ("again", "best"))
    ]


def _peers(name, entry):
    lines = []
    for peer, runs in entry["peers"].items():
        if "failed" in runs:
            lines.append(f"| {name} | {peer} | failed: {runs['failed']} | | | |")
            continue
        for kind, run in runs.items():
            lines.append(
                f"| {name} | {peer}, {kind} | {run['chi2']:.6g} | {run['wall']:.2f} s | {run['processor']:.2f} s | "
                f"{'yes' if is_same(run, entry) else 'no'} |"
            )
    return lines


def is_same(run, entry):
    """Return whether a peer ended at our optimum, or lower."""
    return run["chi2"] <= entry["ours"]["chi2"] * (1 + SAME)


def _like(kind, entry):
    """Return our times of the first fit from the same guesses."""
    return entry["near" if kind.endswith(NEAR) else "ours"]["first"]


def _estimates(name, entry):
    lines = []
    for parameter, (value, sd) in entry["ours"]["estimates"].items():
        if (truth := entry["truth"].get(parameter)) is not None:
            off = f"{100 * (value / truth - 1):+.3f} %, {(value - truth) / sd:+.1f} sd"
            lines.append(f"| {name} | `{parameter}` | {truth:g} | {value:.6g} | {sd:.2g} | {off} |")
    return lines


def _chain(entry):
    ours = entry["ours"]
    return [
        f"The chain: three masses with springs and dampers, 6 states, {len(entry['truth'])} parameters 30 % off, "
        f"4 runs, {ours['samples']:,} samples of three positions: {ours['first']['wall']:.1f} s, of the processor "
        f"{ours['first']['processor']:.1f} s, and {ours['memory']:.0f} MB in all."
    ]


def targets(results):
    """Return a line for each target, met or missed."""
    lines = []
    for name, entry in results["rigs"].items():
        ours, truth = entry["ours"], entry["truth"]
        errors = [(abs(v / truth[p] - 1), abs(v - truth[p]) / sd) for p, (v, sd) in ours["estimates"].items()]
        ratio = ours["rmse"][0] / entry["noise"]
        faster = [
            f"{peer}, {kind}"
            for peer, runs in entry["peers"].items()
            if "failed" not in runs
            for kind, run in runs.items()
            if is_same(run, entry) and any(run[clock] < _like(kind, entry)[clock] for clock in ("wall", "processor"))
        ]
        lines += [
            _line(f"{name}: estimates within 1 % and 3 sd of the truth", all(r < 0.01 and t < 3 for r, t in errors),
                  f"at most {100 * max(r for r, _ in errors):.2f} %, {max(t for _, t in errors):.1f} sd"),
            _line(f"{name}: rmse within 1 % of the noise added", abs(ratio - 1) < 0.01, f"{100 * (ratio - 1):+.2f} %"),
            _line(f"{name}: under 1 s", ours["first"]["wall"] < SECONDS, f"{ours['first']['wall']:.2f} s"),
            _line(f"{name}: none faster at the same optimum", not faster, ", ".join(faster) or "none"),
        ]  # fmt: skip
    ours = results["chain"]["ours"]
    fine = ours["first"]["wall"] < CHAIN_SECONDS and ours["memory"] < MEGABYTES
    lines.append(
        _line("chain: under 10 s and 2 GB", fine, f"{ours['first']['wall']:.1f} s, {ours['memory'] / 1024:.2f} GB")
    )
    return lines


def _line(what, is_met, found):
    return f"- {what}: {'met' if is_met else 'missed'} ({found})."
