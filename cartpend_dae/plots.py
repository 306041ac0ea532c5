"""Figures: measured against model, what was tried, how far the errors are above the noise, simulations.

Every function returns a `Figure` of its own; nothing is shown, and pyplot's global state is not touched. The
colours are those of Okabe and Ito, which people with any colour vision tell apart.
"""

import math
import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from cartpend_dae.assess import Assessment, RunError
from cartpend_dae.data import Trajectory
from cartpend_dae.discover.disturbed import penalty
from cartpend_dae.discover.predicted import MIN_SHARE
from cartpend_dae.discover.records import Candidate, Search
from cartpend_dae.discover.trial import MIN_BIC_GAIN
from cartpend_dae.errors import ModelError
from cartpend_dae.everyday import for_people
from cartpend_dae.linear_model import LinearModel
from cartpend_dae.report.text import all_candidates, effect_name
from cartpend_dae.system import System
from cartpend_dae.uncertainty import NORMAL_95

DPI = 130
MEASURED, BEFORE, AFTER, QUIET = "#000000", "#D55E00", "#0072B2", "#9A9A9A"
COLORS = (AFTER, BEFORE, "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DENSE = 2000
"""Samples from which on measured values are a line, not dots."""
MOST_PANELS = 6


def run_figure(before: RunError, after: RunError | None = None, *, sd: np.ndarray | None = None) -> Figure:
    """Draw a run: measured values and model, below them the residuals with the band of the noise.

    Parameters
    ----------
    before
        The run with the model as it was; the only model if there is no `after`.
    after
        The same run with the augmented model.
    sd
        How sure the outputs of the last model are, shape (n, n_outputs) [SI]: the band of 95 % around them.
    """
    models = [("model", before, AFTER)]
    if after is not None:
        models = [("model before", before, BEFORE), ("model after", after, AFTER)]
    n = len(before.outputs)
    figure = Figure(figsize=(max(8.5, 5.6 * n), 4.2 + 1.5 * len(models)), layout="constrained")
    axes = figure.subplots(1 + len(models), n, sharex=True, squeeze=False, height_ratios=[3.0] + [1.2] * len(models))
    for column, name in enumerate(before.outputs):
        _draw_output(list(axes[:, column]), column, name, models)
        if sd is not None:
            _draw_band(axes[0, column], axes[-1, column], column, models[-1][1], sd[:, column])
    figure.align_ylabels(axes)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), frameon=False)
    figure.suptitle(f"{before.name} ({before.role} run{_ahead(before)})", x=0.02, ha="left", weight="bold")
    return figure


def _ahead(run: RunError) -> str:
    return {"free": "", "horizon": ", predicted over a horizon", "innovation": ", predicted one sample ahead"}[
        run.score
    ]


def _draw_output(axes: Sequence[Axes], column: int, name: str, models: list[tuple[str, RunError, str]]) -> None:
    _, first, _ = models[0]
    factor, unit = for_people(first.outputs[name].unit)
    time, measured = first.time, factor * first.measured[:, column]
    # wide and grey under the thin lines of the models, so that both are seen where they agree
    style = {"ls": "-", "lw": 3.5} if time.size > DENSE else {"ls": "none", "marker": "o", "ms": 5, "mew": 0}
    axes[0].plot(time, measured, color=QUIET, alpha=0.7, label="measured", **style)
    for label, run, color in models:
        dashes = "--" if color == BEFORE else "-"
        axes[0].plot(time, factor * run.predicted[:, column], dashes, color=color, lw=1.2, label=label)
    axes[0].set_ylabel(f"{name} [{unit}]")
    axes[0].margins(x=0.01)
    for axis, (label, run, color) in zip(axes[1:], models, strict=True):
        residual = measured - factor * run.predicted[:, column]
        noise = factor * run.outputs[name].noise_sd
        if math.isfinite(noise):
            axis.axhspan(-2 * noise, 2 * noise, color=QUIET, alpha=0.35, lw=0)
        axis.axhline(0, color=QUIET, lw=0.8)
        axis.plot(time, residual, color=color, lw=0.9)
        axis.set_ylabel(f"residual\n{label.removeprefix('model ')} [{unit}]".replace("\nmodel", "\n"))
        rmse = factor * run.outputs[name].rmse
        axis.set_title(_residual_title(rmse, noise, unit), loc="right", fontsize=9, pad=3)
        axis.yaxis.set_major_locator(MaxNLocator(4))
    for axis in axes:
        _plain(axis)


def _draw_band(top: Axes, bottom: Axes, column: int, run: RunError, sd: np.ndarray) -> None:
    """Draw where the outputs of the model lie with 95 %: around the model, and around the residual zero."""
    name = list(run.outputs)[column]
    factor, _ = for_people(run.outputs[name].unit)
    model, half = factor * run.predicted[:, column], factor * NORMAL_95 * sd
    top.fill_between(run.time, model - half, model + half, color=AFTER, alpha=0.3, lw=0, label="95 % of the model")
    bottom.plot(run.time, half, ":", color=AFTER, lw=0.9)
    bottom.plot(run.time, -half, ":", color=AFTER, lw=0.9)


def _residual_title(rmse: float, noise: float, unit: str) -> str:
    known = f", band: ±2 sd of the noise ({noise:.3g} {unit})" if math.isfinite(noise) else ""
    return f"rmse {rmse:.3g} {unit}{known}"


def _plain(axis: Axes) -> None:
    axis.grid(color="#DDDDDD", lw=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def candidate_figure(search: Search) -> Figure:
    """Draw what each candidate would gain, and why it was not taken."""
    shown = all_candidates(search)
    texts = [textwrap.fill(_reason(candidate), 46) for candidate in shown]
    heights = [max(2, text.count("\n") + 1) for text in texts]
    middles = -(np.cumsum(heights) - np.array(heights) / 2)
    figure = Figure(figsize=(10.5, 1.3 + 0.2 * sum(heights)), layout="constrained")
    bars, notes = figure.subplots(1, 2, width_ratios=[1.0, 0.62], sharey=True)
    limits = {"noise": MIN_BIC_GAIN, "disturbances": 100 * MIN_SHARE, "forces": penalty(len(search.candidates))}
    limit = limits[search.judged]
    gains = [candidate.gain if candidate.fit is not None else 0.0 for candidate in shown]
    colors = [QUIET if candidate.why_not else AFTER for candidate in shown]
    bars.barh(middles, gains, height=1.1, color=colors)
    bars.axvline(0, color=MEASURED, lw=0.8)
    bars.axvline(limit, color=BEFORE, lw=1.2, ls="--")
    bars.annotate(
        f"needed: {limit:.3g}", (limit, 1.0), (3, 2), color=BEFORE, fontsize=9,
        xycoords=("data", "axes fraction"), textcoords="offset points",
    )  # fmt: skip
    if search.judged == "disturbances":
        bars.set_xlim(min(0.0, 1.1 * min(gains, default=0.0)), max(100.0, 1.1 * max(gains, default=0.0)))
        bars.set_xlabel("cross-validated cost explained [%]")
    else:
        what = "the Bayesian information criterion" if search.judged == "noise" else "-2 ln likelihood"
        bars.set_xscale("symlog", linthresh=MIN_BIC_GAIN, linscale=0.8)
        bars.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bars.xaxis.set_minor_formatter(NullFormatter())
        bars.set_xlim(min(-MIN_BIC_GAIN, 1.5 * min(gains, default=0.0)), 3 * max([*gains, 3 * MIN_BIC_GAIN]))
        bars.set_xlabel(f"drop of {what} (logarithmic above 20)")
    bars.set_yticks(middles, [_place_label(candidate) for candidate in shown])
    bars.set_ylim(-sum(heights) - 0.3, 0.3)
    _plain(bars)
    bars.grid(visible=False, axis="y")
    notes.axis("off")
    for middle, text, candidate in zip(middles, texts, shown, strict=True):
        weight = "normal" if candidate.why_not else "bold"
        notes.text(0.0, middle, text, va="center", fontsize=9, weight=weight, transform=notes.get_yaxis_transform())
    figure.suptitle("What was tried", x=0.02, ha="left", weight="bold")
    return figure


def _place_label(candidate: Candidate) -> str:
    name = effect_name(candidate.insertion.card.id).removeprefix("a ")
    return f"{name}\nat {candidate.insertion.place.at}"


def _reason(candidate: Candidate) -> str:
    """Say why a candidate was not taken, with its gain where the sentence has none."""
    text = candidate.why_not.replace("`", "") or "accepted"
    has_number = any(character.isdigit() for character in text)
    return text if has_number or candidate.fit is None else f"{candidate.gain:.1f}: {text}"


def level_figure(before: Assessment, after: Assessment | None = None) -> Figure:
    """Draw the error of each output of each run in units of its noise; 1 is as good as the sensor."""
    last = {run.name: run for run in (after or before).runs}
    rows = [
        (run, name)
        for run in before.runs
        for name in run.outputs
        if _noise(run, name) > 0 and min(run.outputs[name].rmse, last[run.name].outputs[name].rmse) > 0
    ]
    figure = Figure(figsize=(8.5, 1.7 + 0.42 * len(rows)), layout="constrained")
    axis = figure.subplots()
    for y, (run, name) in enumerate(rows):
        noise = _noise(run, name)
        first, second = run.outputs[name].rmse / noise, last[run.name].outputs[name].rmse / noise
        axis.plot([first, second], [y, y], color=QUIET, lw=2.5, zorder=1)
        if after:
            axis.plot(first, y, "o", ms=8, mfc="white", mec=BEFORE, mew=2)
        axis.plot(second, y, "o", ms=8, color=AFTER)
        # where both dots are nearly the same only the second has its number
        values = {first: BEFORE, second: AFTER} if abs(math.log(first / second)) > 0.3 else {second: AFTER}
        for value, color in values.items():
            axis.annotate(
                f"{value:.3g}", (value, y), (0, 8), textcoords="offset points", ha="center", color=color, fontsize=9,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
            )  # fmt: skip
    axis.axvline(1, color=MEASURED, lw=1, ls=":")
    axis.set_xscale("log")
    low, high = axis.get_xlim()
    axis.set_xlim(min(0.5, low / 1.3), max(3.0, high * 1.3))
    axis.xaxis.set_major_locator(LogLocator(10, subs=(1.0, 2.0, 5.0) if high / low < 300 else (1.0,)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_yticks(range(len(rows)), [f"{run.name} ({run.role}): {name}" for run, name in rows])
    axis.set_ylim(len(rows) - 0.5, -0.7)
    axis.set_xlabel("rmse / noise of the sensor (1: as good as the sensor)")
    _plain(axis)
    axis.grid(visible=False, axis="y")
    if after:
        marks = [
            Line2D([], [], ls="none", marker="o", ms=8, mfc="white", mec=BEFORE, mew=2, label="before"),
            Line2D([], [], ls="none", marker="o", ms=8, color=AFTER, label="after"),
        ]
        figure.legend(handles=marks, loc="outside upper right", ncols=2, frameon=False)
    figure.suptitle("Errors above the noise", x=0.02, ha="left", weight="bold")
    return figure


def _noise(run: RunError, name: str) -> float:
    noise = run.outputs[name].noise_sd
    return noise if math.isfinite(noise) else 0.0


def trajectory_figure(system: System, trajectory: Trajectory) -> Figure:
    """Draw the states and inputs of a simulation, one panel for each unit."""
    groups: dict[str, list[str]] = {}
    for name in (*system.inputs, *system.states) or trajectory.names[:MOST_PANELS]:
        groups.setdefault(system.unit_of(name), []).append(name)
    chosen = list(groups.items())[:MOST_PANELS]
    figure = Figure(figsize=(8.5, 1.0 + 2.1 * len(chosen)), layout="constrained")
    axes = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (unit, names) in zip(axes, chosen, strict=True):
        factor, shown = for_people(unit)
        for name, color in zip(names[:MOST_PANELS], COLORS, strict=False):
            axis.plot(trajectory.time, factor * trajectory[name], color=color, lw=1.4, label=name)
        axis.set_ylabel(f"[{shown}]")
        axis.margins(x=0.01)
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02), frameon=False, fontsize=9)
        _plain(axis)
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(system.name, x=0.02, ha="left", weight="bold")
    return figure


def bode_figure(linear: LinearModel, omega: Sequence[float] | None = None) -> Figure:
    """Draw amplitude and phase of every output over the frequency, a column of panels for each input.

    Parameters
    ----------
    linear
        The linear model, continuous or sampled.
    omega
        Frequencies [rad/s], above 0; by default from a decade below the slowest mode to a decade above the fastest,
        of a sampled model to half the sampling frequency.

    Raises
    ------
    ModelError
        If the model has no input or no output, or a frequency is not above 0.
    """
    if not linear.inputs or not linear.outputs:
        raise ModelError(f"{linear.name} has {len(linear.inputs)} inputs and {len(linear.outputs)} outputs to draw.")
    frequencies = _decades(linear) if omega is None else np.asarray(omega, dtype=float)
    if np.any(frequencies <= 0):
        raise ModelError("The frequencies of a Bode diagram must be above 0 rad/s: its axis is logarithmic.")
    response = linear.frequency_response(frequencies)
    n = len(linear.inputs)
    figure = Figure(figsize=(max(8.5, 4.6 * n), 6.0), layout="constrained")
    axes = figure.subplots(2, n, sharex=True, squeeze=False)
    for j, (name, unit) in enumerate(zip(linear.inputs, linear.input_units, strict=True)):
        for i, output in enumerate(linear.outputs):
            color, value = COLORS[i % len(COLORS)], response[:, i, j]
            label = f"{output} [{linear.output_units[i]}]"
            axes[0, j].plot(frequencies, 20 * np.log10(np.maximum(np.abs(value), 1e-300)), color=color, label=label)
            axes[1, j].plot(frequencies, np.degrees(np.unwrap(np.angle(value))), color=color)
        axes[0, j].set_title(f"from {name} [{unit}]", fontsize=10)
        axes[1, j].yaxis.set_major_locator(MaxNLocator(7, steps=[1, 1.5, 3, 4.5, 9, 10]))
        axes[1, j].set_xlabel("frequency [rad/s]")
    axes[0, 0].set_ylabel("amplitude [dB]")
    axes[1, 0].set_ylabel("phase [deg]")
    for axis in axes.ravel():
        axis.set_xscale("log")
        axis.margins(x=0.0)
        _plain(axis)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right upper", frameon=False)
    figure.suptitle(linear.name, x=0.02, ha="left", weight="bold")
    return figure


def _decades(linear: LinearModel) -> np.ndarray:
    """Return frequencies around those of the modes [rad/s]."""
    modes = [mode.frequency for mode in linear.damping() if 0 < mode.frequency < math.inf]
    low, high = 0.1 * min(modes, default=1.0), 10 * max(modes, default=1.0)
    if linear.period is not None:
        high = math.pi / linear.period
    return np.geomspace(min(low, 0.01 * high), high, 1000)
