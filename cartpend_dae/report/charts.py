"""Curves of a report: the numbers for the interactive chart, and a drawn one for paper."""

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from matplotlib.ticker import LogLocator, MaxNLocator

from cartpend_dae.everyday import for_people
from cartpend_dae.report.numbers import number
from cartpend_dae.report.stored import Run, Series

WIDTH, LEFT, RIGHT = 720.0, 62.0, 8.0
BINS = 480
"""Columns of a drawn curve: each shows the least and the largest value in it."""


def run_data(run: Run) -> dict[str, Any]:
    """Return a run as the chart of the page reads it: arrays as base64 of 32-bit floats, the time of 64-bit floats."""
    return {
        "name": run.name,
        "time": packed(run.time, "<f8"),
        "outputs": [
            {
                "name": series.name,
                "unit": series.unit,
                "noise": series.noise_sd,
                "measured": packed(series.measured),
                "sd": None if series.sd is None else packed(series.sd),
                "curves": [
                    {"label": curve.label, "values": packed(curve.values), "residual": packed(curve.residual)}
                    for curve in series.curves
                ],
            }
            for series in run.series
        ],
    }


def packed(values: np.ndarray, kind: str = "<f4") -> str:
    """Return an array as base64 of its bytes."""
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A curve of a drawn chart; `look` is a class of the style sheet."""

    x: np.ndarray
    y: np.ndarray
    look: str


@dataclass(frozen=True, slots=True)
class Scale:
    """From values to px: linear, or logarithmic."""

    low: float
    high: float
    begin: float
    end: float
    is_log: bool = False

    def __call__(self, values: np.ndarray | float) -> Any:  # noqa: ANN401 - a number for a number
        """Return where values stand."""
        low, high = (math.log10(x) if self.is_log else x for x in (self.low, self.high))
        at = np.log10(values) if self.is_log else np.asarray(values)
        return self.begin + (at - low) / (high - low) * (self.end - self.begin)

    def ticks(self, count: int) -> list[float]:
        """Return round values on the scale."""
        locator = LogLocator(10, subs=(1.0, 2.0, 5.0), numticks=count + 8) if self.is_log else MaxNLocator(count)
        return [float(x) for x in locator.tick_values(self.low, self.high) if self.low <= x <= self.high]


def paper_charts(run: Run, series: Series) -> list[str]:
    """Return the drawn charts of an output: measured against model, and the residual of each model."""
    looks = ("before", "after") if len(series.curves) > 1 else ("after",)
    values = [Line(run.time, series.measured, "measured")]
    values += [Line(run.time, c.values, look) for c, look in zip(series.curves, looks, strict=True)]
    charts = [panel(values, f"{series.name} [{series.unit}]", 170.0)]
    for k, (curve, look) in enumerate(zip(series.curves, looks, strict=True)):
        is_last = k == len(looks) - 1
        label = f"residual{' ' + look if len(looks) > 1 else ''} [{series.unit}]"
        band = 2 * series.noise_sd if series.noise_sd else 0.0
        line = Line(run.time, curve.residual, look)
        charts.append(panel([line], label, 92.0 if is_last else 74.0, band=band, x_label="time [s]" * is_last))
    return charts


def panel(
    lines: Sequence[Line],
    label: str,
    height: float,
    *,
    band: float = 0.0,
    x_label: str = "",
    is_log: bool = False,
    width: float = WIDTH,
) -> str:
    """Draw curves over a common axis.

    Parameters
    ----------
    lines
        The curves; NaN leave gaps.
    label
        Name and unit of what is drawn.
    height
        Of the picture [px].
    band
        Half width of a band around zero.
    x_label
        Name and unit of the lower axis; without it no ticks are written there.
    is_log
        True makes both axes logarithmic.
    width
        Of the picture [px].
    """
    below = 34.0 if x_label else 6.0
    x = Scale(*_range([line.x for line in lines], 0.0, is_log), LEFT, width - RIGHT, is_log)
    tall = [line.y for line in lines] + ([np.array([-band, band])] if band else [])
    y = Scale(*_range(tall, 0.06, is_log), height - below, 18.0, is_log)
    parts = [f'<text class="axis" x="{LEFT:g}" y="11">{escape(label)}</text>']
    if band:
        top, bottom = y(band), y(-band)
        parts.append(
            f'<rect class="band" x="{LEFT:g}" y="{top:.1f}" width="{width - LEFT - RIGHT:g}" '
            f'height="{bottom - top:.1f}"/>'
        )
    for value in y.ticks(4):
        at = y(value)
        parts.append(f'<path class="grid" d="M{LEFT:g} {at:.1f}H{width - RIGHT:g}"/>')
        parts.append(f'<text class="tick y" x="{LEFT - 6:g}" y="{at + 3.5:.1f}">{number(value, 4)}</text>')
    for value in x.ticks(8) if x_label else ():
        parts.append(f'<text class="tick x" x="{x(value):.1f}" y="{height - below + 14:.1f}">{number(value, 4)}</text>')
    if x_label:
        parts.append(f'<text class="axis x" x="{width - RIGHT:g}" y="{height - 5:.1f}">{escape(x_label)}</text>')
    parts += [f'<path class="curve {line.look}" d="{_path(line, x, y)}"/>' for line in lines]
    return (
        f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" aria-hidden="true" focusable="false">'
        f"{''.join(parts)}</svg>"
    )


def _range(arrays: Sequence[np.ndarray], margin: float, is_log: bool) -> tuple[float, float]:
    known = np.concatenate(arrays)
    known = known[np.isfinite(known) & ((known > 0) | (not is_log))]
    low, high = (float(known.min()), float(known.max())) if known.size else (1.0, 2.0)
    if is_log:
        margin = max(1.15, math.sqrt(10 * low / high))  # a decade at least, so that what is level looks level
        return low / margin, high * margin
    span = (high - low) or max(abs(high), 1.0)
    return low - margin * span, high + margin * span


def _path(line: Line, x: Scale, y: Scale) -> str:
    rows = thinned(line.y, BINS)
    pieces, is_down = [], False
    for at, height in zip(x(line.x[rows]), y(line.y[rows]), strict=True):
        if not math.isfinite(height):
            is_down = False
            continue
        pieces.append(f"{'L' if is_down else 'M'}{at:.1f} {height:.1f}")
        is_down = True
    return "".join(pieces)


def thinned(values: np.ndarray, bins: int) -> np.ndarray:
    """Return the rows of a curve that draw it like all of them do: of each bin the least and the largest value."""
    if values.size <= 2 * bins:
        return np.arange(values.size)
    rows: list[int] = []
    for part in np.array_split(np.arange(values.size), bins):
        known = part[np.isfinite(values[part])]
        if known.size == 0:
            rows.append(int(part[0]))
            continue
        pair = (int(known[np.argmin(values[known])]), int(known[np.argmax(values[known])]))
        rows += sorted(set(pair))
    return np.array(sorted({0, *rows, values.size - 1}))


@dataclass(frozen=True, slots=True, eq=False)
class HorizonChart:
    """The error of an output by how far ahead it is predicted: drawn, and as rows of numbers."""

    run: str
    role: str
    output: str
    unit: str
    labels: tuple[str, ...]
    rows: tuple[tuple[float | None, ...], ...]
    svg: str


def horizon_chart(entry: dict[str, Any]) -> HorizonChart:
    """Draw the stored errors over horizons of an output of a run."""
    factor, unit = for_people(entry["unit"])
    moments = tuple(entry["errors"])
    errors = {moment: [None if x is None else factor * x for x in values] for moment, values in entry["errors"].items()}
    seconds = np.array(entry["seconds"])
    looks = dict(zip(moments, ("before", "after") if len(moments) > 1 else ("after",), strict=True))
    lines = [Line(seconds, np.array(values, dtype=float), looks[moment]) for moment, values in errors.items()]
    least = min((x for values in errors.values() for x in values if x), default=math.inf)
    if (noise := entry["noise_sd"] or 0.0) > 0 and factor * noise > 0.01 * least:
        lines.append(Line(seconds[[0, -1]], np.full(2, factor * noise), "noise"))
    svg = panel(lines, f"error [{unit}]", 250.0, width=480.0, x_label="ahead [s]", is_log=True)
    return HorizonChart(
        entry["run"],
        entry["role"],
        entry["output"],
        unit,
        moments if len(moments) > 1 else ("error",),
        tuple(zip(entry["seconds"], *errors.values(), strict=True)),
        svg,
    )
