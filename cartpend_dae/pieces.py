"""From recorded channels to runs on one time grid, without resampling: rates may differ, and rows may be missing.

The grid holds every time stamp of every channel. An output is known where it was measured and NaN elsewhere, so
that it has no weight there. An input continues between its samples as its `hold` says.

A gap is where the next sample comes later than `GAP` usual steps, in all channels or in an input. There, as the
study wants it, the run is cut into runs of their own, which start anew; or it goes on, its inputs held across the
gap and the outputs inside it without weight. Where rows are missing, others without measurements take their place,
so that the steps of the integration stay as short as they were.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from cartpend_dae import units as si
from cartpend_dae.data import Channel, Experiment, FloatArray, Start, quantum
from cartpend_dae.errors import StudyError
from cartpend_dae.recording import MIN_SAMPLES, Signal, at, read_signals
from cartpend_dae.study_schema import ExperimentSpec

GAP = 20.0
"""Steps of the usual length (their median) that may pass without a sample. Of stamps at random instants (a Poisson
process) one step in a million is longer than 20 medians."""
COARSE = 2.5
"""Usual steps that one step of the grid may last; longer ones are filled."""
SAME = 1e-6
"""Stamps of two files that differ by less than this share of a step are one."""

Gap = tuple[float, float]


def load_experiments(
    spec: ExperimentSpec, units: Mapping[str, str], restart: tuple[str, ...] = ()
) -> tuple[Experiment, ...]:
    """Read the run that `spec` describes; it is several runs if it has gaps and is split there.

    Parameters
    ----------
    spec
        One `[[experiment]]` of a study.
    units
        The SI unit of each variable of the model, by dotted name.
    restart
        Variables with which the state of the model is given; they start free after a gap.

    Raises
    ------
    StudyError
        If a file or one of its columns is not what the study says.
    """
    signals = read_signals(spec, units)
    grid = common_time(spec, signals)
    gaps = find_gaps(signals, grid)
    held = gaps if spec.gap == "hold" else []
    parts, _ = pieces_of(grid, [] if held else gaps)
    found = []
    for part in parts:
        start = _start(spec, units, restart if part[0] > grid[0] else ())
        run = _experiment(spec, signals, _filled(spec, part), held, start)
        run = replace(run, steady=False) if part[0] > grid[0] else run
        if len(parts) == 1:
            _check_outputs(spec, signals, run)
        found += [run] if run.outputs else []
    if not found:
        raise StudyError(
            f"{at(spec.name, spec.file)} {len(grid)} samples in {len(gaps) + 1} pieces are too few; at least "
            f'{MIN_SAMPLES} without a gap are needed; take more of the file, or say `gap = "hold"`.'
        )
    return tuple(replace(run, name=f"{spec.name}-{k}") for k, run in enumerate(found, 1)) if found[1:] else (found[0],)


def common_time(spec: ExperimentSpec, signals: tuple[Signal, ...]) -> FloatArray:
    """Return all time stamps of all channels, within the window and where every input is known."""
    grid = _merged({id(signal.time): signal.time for signal in signals}.values())
    first, last = _common_span(spec, signals)
    kept = grid[(grid >= first) & (grid <= last)]
    low, high = spec.window or (-np.inf, np.inf)
    inside = kept[(kept >= low) & (kept <= high)]
    place = at(spec.name, spec.file)
    if spec.window and not len(inside) and len(kept):
        recorded = f"recorded from {kept[0]:g} s to {kept[-1]:g} s"
        raise StudyError(
            f"{place} `window` = [{low:g}, {high:g}] s holds no sample; the run was {recorded}: choose a part of that."
        )
    if len(inside) < MIN_SAMPLES:
        raise StudyError(
            f"{place} {len(inside)} samples are too few; at least {MIN_SAMPLES} are needed; take more of the file."
        )
    return inside


def find_gaps(signals: tuple[Signal, ...], grid: FloatArray) -> list[Gap]:
    """Return the gaps (last sample before, first after) of all channels together and of each input, joined."""
    found = _long_steps(grid)
    for signal in signals:
        if signal.hold is not None:
            found += _long_steps(signal.time[np.isfinite(signal.values)])
    joined: list[Gap] = []
    for begin, end in sorted((a, b) for a, b in found if b > grid[0] and a < grid[-1]):
        if joined and begin < joined[-1][1]:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((begin, end))
    return joined


def _merged(times: Iterable[FloatArray]) -> FloatArray:
    first, *others = times
    if not others:
        return first
    every = np.unique(np.concatenate([first, *others]))
    step = min(float(np.median(np.diff(time))) for time in (first, *others))
    return every[np.concatenate([[True], np.diff(every) > SAME * step])]


def _common_span(spec: ExperimentSpec, signals: tuple[Signal, ...]) -> Gap:
    """Return from when to when the run's own file was recorded and every input is known."""
    own = [signal.time for signal in signals if signal.file == spec.file]
    spans = [(time[0], time[-1]) for time in own]
    for signal in signals:
        if signal.hold is not None:
            known = signal.time[np.isfinite(signal.values)]
            # A held value counts until the next sample would have come.
            reach = float(np.median(np.diff(known))) if signal.hold == "zoh" else 0.0
            spans.append((known[0], known[-1] + reach * (1 + SAME)))
    first, last = max(a for a, _ in spans or [(-np.inf, 0)]), min(b for _, b in spans or [(0, np.inf)])
    for signal in signals:
        if signal.time[0] > last or signal.time[-1] < first:
            raise StudyError(
                f"{at(spec.name, signal.file)} `{signal.column}` was recorded from {signal.time[0]:g} s to "
                f"{signal.time[-1]:g} s and the rest of the run from {first:g} s to {last:g} s; the clocks of "
                "the files differ: give the difference in seconds as `shift` in `time`."
            )
    return first, last


def _long_steps(time: FloatArray) -> list[Gap]:
    steps = np.diff(time)
    long = np.flatnonzero(steps > GAP * np.median(steps)) if len(steps) else []
    return [(float(time[k]), float(time[k + 1])) for k in long]


def _split(grid: FloatArray, gaps: list[Gap]) -> list[FloatArray]:
    edges = [-np.inf, *(x for gap in gaps for x in gap), np.inf]
    return [grid[(grid >= begin) & (grid <= end)] for begin, end in zip(edges[::2], edges[1::2], strict=True)]


def _filled(spec: ExperimentSpec, grid: FloatArray) -> FloatArray:
    """Put times into long steps, so that no step is much longer than usual."""
    steps = np.diff(grid)
    usual = float(np.median(steps))
    long = np.flatnonzero(steps > COARSE * usual)
    counts = np.ceil(steps[long] / usual - 1e-6)
    if counts.sum() > 10 * len(grid) + 1000:
        k = long[np.argmax(counts)]
        raise StudyError(
            f'{at(spec.name, spec.file)} `gap` = "hold" across {steps[k]:g} s after {grid[k]:g} s would take '
            f"{counts.sum():.0f} steps of {usual:g} s between {len(grid)} samples; split the run there."
        )
    inner = [np.linspace(grid[k], grid[k + 1], int(n) + 1)[1:-1] for k, n in zip(long, counts, strict=True)]
    return np.sort(np.concatenate([grid, *inner])) if inner else grid


def _start(spec: ExperimentSpec, units: Mapping[str, str], restart: tuple[str, ...]) -> dict[str, Start]:
    """Return what the study says of the start, or free states where the run starts after a gap."""
    if restart:
        return {variable: Start(None, True) for variable in restart}
    return {
        variable: Start(
            _si_or_none(entry.guess if entry.value is None else entry.value, entry.unit),
            entry.is_free,
            None if entry.sd is None else float(si.to_si(entry.sd, entry.unit or units[variable], difference=True)),
        )
        for variable, entry in spec.start.items()
    }


def _si_or_none(value: float | None, unit: str | None) -> float | None:
    return value if value is None or unit is None else float(si.to_si(value, unit))


def _experiment(
    spec: ExperimentSpec, signals: tuple[Signal, ...], grid: FloatArray, held: list[Gap], start: dict[str, Start]
) -> Experiment:
    """Put the channels on a grid; an output that was hardly measured there is left out."""
    channels = {signal.variable: _channel(spec, signal, grid, held) for signal in signals}
    outputs = {variable: channels[variable] for variable in spec.outputs}
    return Experiment(
        spec.name,
        spec.role,
        _frozen(grid.copy()),
        {variable: channels[variable] for variable in spec.inputs},
        {variable: channel for variable, channel in outputs.items() if _n_known(channel.values) >= MIN_SAMPLES},
        start,
        spec.score,
        spec.horizon,
        spec.steady,
        spec.piece,
    )


def _check_outputs(spec: ExperimentSpec, signals: tuple[Signal, ...], run: Experiment) -> None:
    for signal in signals:
        if signal.hold is None and signal.variable not in run.outputs:
            values = _measured(signal, run.time, [])
            raise StudyError(
                f"{at(spec.name, signal.file)} the output column `{signal.column}` has {_n_known(values)} finite "
                f"values from {run.time[0]:g} s to {run.time[-1]:g} s; at least {MIN_SAMPLES} are needed; widen the "
                "`window` or the `rows`."
            )


def _n_known(values: FloatArray) -> int:
    return int(np.count_nonzero(np.isfinite(values)))


def _channel(spec: ExperimentSpec, signal: Signal, grid: FloatArray, held: list[Gap]) -> Channel:
    values = _measured(signal, grid, held) if signal.hold is None else _driven(signal, grid)
    entry = {**spec.inputs, **spec.outputs}[signal.variable]
    if entry.subtract == "mean" and _n_known(values):
        values = values - np.nanmean(values)
    return Channel(_frozen(values), signal.hold or "foh", signal.sd, signal.unit, quantum(values))


def _driven(signal: Signal, grid: FloatArray) -> FloatArray:
    """Return an input on the grid: held from its last sample, or on the line between its samples."""
    known = np.isfinite(signal.values)
    time, values = signal.time[known], signal.values[known]
    if signal.hold == "foh":
        return np.interp(grid, time, values)
    tolerance = SAME * float(np.median(np.diff(time)))
    return values[np.searchsorted(time, grid + tolerance, side="right") - 1]


def _measured(signal: Signal, grid: FloatArray, held: list[Gap]) -> FloatArray:
    """Return an output on the grid, NaN where it was not measured and inside the gaps that are bridged."""
    k = np.clip(np.searchsorted(signal.time, grid), 0, len(signal.time) - 1)
    before = np.clip(k - 1, 0, None)
    k = np.where(np.abs(signal.time[before] - grid) < np.abs(signal.time[k] - grid), before, k)
    tolerance = SAME * float(np.median(np.diff(signal.time)))
    values = np.where(np.abs(signal.time[k] - grid) <= tolerance, signal.values[k], np.nan)
    for begin, end in held:
        values[(grid > begin) & (grid < end)] = np.nan
    return values


def _frozen(values: FloatArray) -> FloatArray:
    values.flags.writeable = False
    return values


def pieces_of(grid: FloatArray, gaps: list[Gap]) -> tuple[list[FloatArray], int]:
    """Return the pieces between gaps that are long enough to be fitted, and how many samples the others hold."""
    parts = _split(grid, gaps)
    kept = [part for part in parts if len(part) >= MIN_SAMPLES]
    return kept, sum(map(len, parts)) - sum(map(len, kept))


def step_range(grid: FloatArray) -> tuple[float, float, float]:
    """Return the median, least and largest step [s]."""
    steps = np.diff(grid)
    return float(np.median(steps)), float(steps.min()), float(steps.max())
