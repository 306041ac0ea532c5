"""What was read of a study, as tables for the terminal and as JSON."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict

from rich import box
from rich.table import Table

from cartpend_dae.data_report import DataReport, RunFigures
from cartpend_dae.everyday import for_people
from cartpend_dae.figures import ChannelFigures


def data_json(report: DataReport) -> str:
    """Write a report as JSON, in SI; a number that is not known is null."""
    content = asdict(report)
    content["weak"] = [{**asdict(group), "sentence": str(group)} for group in report.weak]
    return json.dumps(_finite({"schema": 1, "command": "data"} | content), indent=2)


def _finite(value: object) -> object:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def data_tables(report: DataReport) -> Iterator[Table]:
    """Make the tables of the runs, of their channels and of their spectra, and of delays if any were found."""
    runs = _table(
        "Runs", "run", "role", "samples", "from [s]", "to [s]", "step [s]", "least", "largest", "gaps", "pieces"
    )
    values = _table("Channels", "run", "channel", "column", "unit", "least", "largest", "quantum", "noise", "missing")
    motion = _table(
        "Excitation",
        "run",
        "channel",
        "sign changes",
        "reversals",
        "still",
        "saturated",
        "95 % of power [Hz]",
        "spectral lines",
    )
    delays = _table("Delays", "run", "from", "to", "delay [s]", "spread [s]", "seen by")
    for run in report.runs:
        runs.add_row(*_run_row(run))
        for channel in run.channels:
            values.add_row(run.name, *_value_row(channel))
            motion.add_row(run.name, *_motion_row(channel))
        for delay in run.delays:
            numbers = (f"{delay.seconds:.4g}", f"{delay.spread:.2g}" if math.isfinite(delay.spread) else "")
            delays.add_row(run.name, delay.early, delay.late, *numbers, delay.how)
    yield from (runs, values, motion, *((delays,) if delays.row_count else ()))


def data_sentences(report: DataReport) -> Iterator[str]:
    """Say what was done about gaps, and what the data cannot identify."""
    for run in report.runs:
        if run.gaps:
            begin, end = max(run.gaps, key=lambda gap: gap[1] - gap[0])
            done = f"it is read as {run.pieces} runs" if run.gap == "split" else "its inputs are held there"
            rest = f", and {run.left_out} samples between are too few to be one" if run.left_out else ""
            yield f"`{run.name}` has gaps, the longest from {begin:g} s to {end:g} s; {done}{rest}."
    if any(run.delays for run in report.runs):
        yield "Delays are reported only; none is taken out of the data."
    if report.not_judged:
        yield f"What the data cannot identify is not known at these guesses: {report.not_judged}"
    elif not report.free:
        yield "The study names no free parameter."
    elif not report.weak:
        yield "At the guesses the training runs tell all free parameters apart."
    for group in report.weak:
        yield f"What this data cannot identify: {group}"


def _run_row(run: RunFigures) -> tuple[str, ...]:
    return (
        run.name,
        run.role,
        str(run.samples),
        f"{run.begin:.6g}",
        f"{run.end:.6g}",
        *(f"{step:.4g}" for step in run.step),
        str(len(run.gaps)),
        str(run.pieces),
    )


def _value_row(channel: ChannelFigures) -> tuple[str, ...]:
    factor, unit = for_people(channel.unit)
    return (
        f"{channel.variable} ({channel.kind})",
        channel.column,
        unit,
        f"{factor * channel.low:.4g}",
        f"{factor * channel.high:.4g}",
        f"{factor * channel.quantum:.3g}" if channel.quantum else "",
        f"{factor * channel.noise_sd:.3g}" if math.isfinite(channel.noise_sd) else "",
        _share(channel.missing),
    )


def _motion_row(channel: ChannelFigures) -> tuple[str, ...]:
    low, high = channel.band
    return (
        channel.variable,
        str(channel.sign_changes),
        str(channel.reversals),
        _share(channel.still),
        _share(channel.saturated),
        f"{low:.3g} to {high:.3g}" if high else "",
        str(channel.lines),
    )


def _share(value: float) -> str:
    return f"{100 * value:.3g} %" if value else ""


def _table(title: str, *heads: str) -> Table:
    table = Table(title=f"\n{title}", box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
    table.title_justify, table.title_style, table.header_style = "left", "bold", "bold"
    for head in heads:
        table.add_column(head, overflow="fold")
    return table
