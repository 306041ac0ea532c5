"""One verb for all results: `plot(result, axes)` draws into the axes that it is given, and returns them.

Whole figures with several panels are in `plots`; here one panel stands for one result, to be put beside others.
"""

import math
from collections.abc import Sequence
from functools import singledispatch

import casadi as ca
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cartpend_dae.assess import Assessment, RunError
from cartpend_dae.bootstrap import Bootstrap
from cartpend_dae.data import Experiment, Trajectory, nearest
from cartpend_dae.data_report import DataReport
from cartpend_dae.discover import Discovery
from cartpend_dae.discover.records import Candidate, Gate, Search
from cartpend_dae.errors import ModelError
from cartpend_dae.everyday import for_people
from cartpend_dae.experiment_design import Ranking
from cartpend_dae.horizons import Ahead
from cartpend_dae.identify import Fit
from cartpend_dae.likelihood import Profile
from cartpend_dae.linear_model import LinearModel
from cartpend_dae.plots import AFTER, BEFORE, COLORS, DENSE, MEASURED, QUIET
from cartpend_dae.report.text import all_candidates, effect_name
from cartpend_dae.system import System
from cartpend_dae.uncertainty import NORMAL_95

MOST_BARS = 15
_GAINS = {
    "noise": "drop of the Bayesian information criterion",
    "disturbances": "cross-validated cost explained [%]",
    "forces": "drop of -2 ln likelihood",
}


@singledispatch
def plot(result: object, axes: Axes | None = None) -> Axes:
    """Draw a result, and return the axes that it is drawn in.

    Parameters
    ----------
    result
        A `Trajectory`, `Experiment`, `RunError`, `Assessment`, `Fit`, `Profile`, `Bootstrap`, `Search`, `Discovery`,
        `Gate`, `Ahead`, `Ranking`, `LinearModel`, `DataReport` or `System`.
    axes
        Axes of matplotlib; those of a new figure if None.

    Further keywords of some results: `names` (variables of a trajectory), `output` (of a run or an experiment), `name`
    (a parameter of a bootstrap).

    Raises
    ------
    ModelError
        If there is no picture of such a thing, or it has nothing of the name.
    """
    raise ModelError(f"There is no picture of a {type(result).__name__}.")


def _axes(axes: Axes | None) -> Axes:
    if axes is None:
        axes = Figure(figsize=(7.0, 4.0), layout="constrained").subplots()
    axes.grid(color="#DDDDDD", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def _one(name: str | None, known: Sequence[str], what: str) -> str:
    if name is None:
        return known[0]
    if name not in known:
        raise ModelError(f"There is no {what} `{name}`; {nearest(name, known)}")
    return name


@plot.register
def _(result: Trajectory, axes: Axes | None = None, *, names: Sequence[str] = ()) -> Axes:
    """Draw variables of one unit, by default the first ones that share it."""
    units = dict(zip(result.names, result.units, strict=True))
    if unknown := [name for name in names if name not in units]:
        raise ModelError(f"The trajectory has no variable `{unknown[0]}`; {nearest(unknown[0], result.names)}")
    chosen = list(names) or [n for n in result.names if units[n] == result.units[0]][: len(COLORS)]
    if len({units[name] for name in chosen}) > 1:
        listing = ", ".join(f"`{name}` [{units[name]}]" for name in chosen)
        raise ModelError(f"One picture has one unit, but these have several: {listing}.")
    axes = _axes(axes)
    factor, unit = for_people(units[chosen[0]])
    for k, name in enumerate(chosen):
        axes.plot(result.time, factor * result[name], color=COLORS[k % len(COLORS)], lw=1.4, label=name)
    return _over_time(axes, f"[{unit}]" if len(chosen) > 1 else f"{chosen[0]} [{unit}]", len(chosen) > 1)


def _over_time(axes: Axes, label: str, has_legend: bool) -> Axes:
    if axes.xaxis.get_tick_params().get("labelbottom", True):  # not where a panel below has the same times
        axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    axes.margins(x=0.01)
    if has_legend:
        axes.legend(frameon=False, fontsize=9)
    return axes


@plot.register
def _(result: Experiment, axes: Axes | None = None, *, output: str | None = None) -> Axes:
    """Draw what was measured of an output."""
    name = _one(output, list(result.outputs), "output")
    channel = result.outputs[name]
    axes = _axes(axes)
    factor, unit = for_people(channel.unit)
    axes.plot(result.time, factor * channel.values, color=MEASURED, lw=1.0)
    axes.set_title(f"{result.name} ({result.role} run)", fontsize=10)
    return _over_time(axes, f"{name} [{unit}]", False)


@plot.register
def _(result: RunError, axes: Axes | None = None, *, output: str | None = None) -> Axes:
    """Draw an output as it was measured, and as the model has it."""
    name = _one(output, list(result.outputs), "output")
    column = list(result.outputs).index(name)
    axes = _axes(axes)
    factor, unit = for_people(result.outputs[name].unit)
    style = {"ls": "-", "lw": 3.5} if result.time.size > DENSE else {"ls": "none", "marker": "o", "ms": 5, "mew": 0}
    axes.plot(result.time, factor * result.measured[:, column], color=QUIET, alpha=0.7, label="measured", **style)
    axes.plot(result.time, factor * result.predicted[:, column], color=AFTER, lw=1.2, label="model")
    axes.set_title(f"{result.name} ({result.role} run)", fontsize=10)
    return _over_time(axes, f"{name} [{unit}]", True)


@plot.register
def _(result: Assessment, axes: Axes | None = None) -> Axes:
    """Draw the error of each output of each run, in units of the noise of its sensor."""
    rows = [
        (run, name, e.rmse / e.noise_sd) for run in result.runs for name, e in run.outputs.items() if e.noise_sd > 0
    ]
    axes = _bars(_axes(axes), [f"{run.name} ({run.role}): {name}" for run, name, _ in rows], [r for *_, r in rows])
    axes.axvline(1, color=MEASURED, lw=1, ls=":")
    axes.set_xlabel("rmse / noise of the sensor")
    return axes


def _bars(axes: Axes, labels: Sequence[str], values: Sequence[float], colors: Sequence[str] | str = AFTER) -> Axes:
    axes.barh(range(len(labels)), values, height=0.6, color=colors)
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    return axes


@plot.register
def _(result: Fit, axes: Axes | None = None) -> Axes:
    """Draw how well each parameter is known: the half width of its interval of 95 %, relative to its value."""
    known = [e for e in result.parameters if e.value and math.isfinite(e.sd)]
    axes = _axes(axes)
    axes.errorbar(
        [0.0] * len(known),
        range(len(known)),
        xerr=[100 * NORMAL_95 * e.sd / abs(e.value) for e in known],
        fmt="o",
        color=AFTER,
        capsize=3,
    )
    axes.set_yticks(range(len(known)), [f"{e.name} = {e.value:.4g}" for e in known])
    axes.set_ylim(len(known) - 0.4, -0.6)
    axes.axvline(0, color=QUIET, lw=0.8)
    axes.set_xlabel("interval of 95 % around the value [%]")
    return axes


@plot.register
def _(result: Profile, axes: Axes | None = None) -> Axes:
    """Draw how far the fit moves from the best one, in sds, along a parameter."""
    axes = _axes(axes)
    factor, unit = for_people(result.unit)
    axes.plot(factor * result.values, result.z, "o-", color=AFTER, ms=3.5)
    for limit in (-NORMAL_95, NORMAL_95):
        axes.axhline(limit, color=BEFORE, lw=1, ls="--")
    ends = [factor * end for end in result.interval if math.isfinite(end)]
    axes.vlines(ends, -NORMAL_95, NORMAL_95, color=BEFORE, lw=1)
    axes.set_xlabel(f"{result.name} [{unit}]")
    axes.set_ylabel("distance from the best fit [sd]")
    return axes


@plot.register
def _(result: Bootstrap, axes: Axes | None = None, *, name: str | None = None) -> Axes:
    """Draw how often a parameter came out where, and the middle 95 %."""
    column = result.names.index(_one(name, result.names, "parameter"))
    axes = _axes(axes)
    axes.hist(result.values[:, column], bins="auto", color=AFTER, alpha=0.8)
    axes.axvspan(*result.intervals[column], color=QUIET, alpha=0.25, lw=0)
    axes.set_xlabel(result.names[column])
    axes.set_ylabel(f"fits of {len(result.values)}")
    return axes


@plot.register
def _(result: Search, axes: Axes | None = None) -> Axes:
    """Draw what the best candidates gained; those that were taken are blue."""
    shown = [candidate for candidate in all_candidates(result) if candidate.fit is not None][:MOST_BARS]
    colors = [QUIET if candidate.why_not else AFTER for candidate in shown]
    axes = _bars(_axes(axes), [_label(candidate) for candidate in shown], [c.gain for c in shown], colors)
    axes.set_xlabel(_GAINS[result.judged])
    return axes


def _label(candidate: Candidate) -> str:
    return f"{effect_name(candidate.insertion.card.id).removeprefix('a ')} at {candidate.insertion.place.at}"


@plot.register
def _(result: Discovery, axes: Axes | None = None) -> Axes:
    """Draw the error of each output of each run over the noise of its sensor, before and after."""
    axes = _axes(axes)
    last = {run.name: run for run in result.after.runs}
    rows = [(run, name) for run in result.before.runs for name, e in run.outputs.items() if e.noise_sd > 0]
    for y, (run, name) in enumerate(rows):
        noise = run.outputs[name].noise_sd
        ends = [run.outputs[name].rmse / noise, last[run.name].outputs[name].rmse / noise]
        axes.plot(ends, [y, y], color=QUIET, lw=2.5, zorder=1)
        axes.plot(ends[0], y, "o", ms=8, mfc="white", mec=BEFORE, mew=2, label="before" if y == 0 else None)
        axes.plot(ends[1], y, "o", ms=8, color=AFTER, label="after" if y == 0 else None)
    axes.set_yticks(range(len(rows)), [f"{run.name} ({run.role}): {name}" for run, name in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xscale("log")
    axes.axvline(1, color=MEASURED, lw=1, ls=":")
    axes.set_xlabel("rmse / noise of the sensor")
    if rows:
        _legend_above(axes)
    return axes


def _legend_above(axes: Axes) -> None:
    axes.legend(frameon=False, fontsize=9, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0)


@plot.register
def _(result: Gate, axes: Axes | None = None) -> Axes:
    """Draw how far the residuals of each output are from white."""
    axes = _bars(_axes(axes), [f"{run}: {output}" for run, output, _ in result.z], [z for *_, z in result.z])
    axes.set_xlabel("von Neumann's z")
    return axes


@plot.register
def _(result: Ahead, axes: Axes | None = None) -> Axes:
    """Draw the error of each output (SI) by how far the model looks ahead."""
    axes = _axes(axes)
    for column, values in enumerate(result.error.T):
        axes.loglog(result.seconds, values, color=COLORS[column % len(COLORS)], label=f"output {column + 1}")
    axes.set_xlabel("ahead [s]")
    axes.set_ylabel("rms error [SI]")
    if result.error.shape[1] > 1:
        axes.legend(frameon=False, fontsize=9)
    return axes


@plot.register
def _(result: Ranking, axes: Axes | None = None) -> Axes:
    """Draw how well each candidate experiment would determine the weakest parameters."""
    shown = [c for c in (result.before, *result.candidates) if c.sd][:MOST_BARS]
    axes = _axes(axes)
    for k, name in enumerate(result.weak):
        at = [y + 0.15 * (k - (len(result.weak) - 1) / 2) for y in range(len(shown))]
        axes.plot([100 * c.sd.get(name, math.nan) for c in shown], at, "o", color=COLORS[k % len(COLORS)], label=name)
    axes.set_yticks(range(len(shown)), [c.name for c in shown])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xscale("log")
    axes.set_xlabel("standard deviation that would be left [%]")
    _legend_above(axes)
    return axes


@plot.register
def _(result: LinearModel, axes: Axes | None = None) -> Axes:
    """Draw the poles in the complex plane, with the boundary of stability."""
    poles = np.linalg.eigvals(result.A)
    axes = _axes(axes)
    if result.period is None:
        axes.axvline(0, color=QUIET, lw=0.8)
    else:
        angle = np.linspace(0, 2 * np.pi, 200)
        axes.plot(np.cos(angle), np.sin(angle), color=QUIET, lw=0.8)
        axes.set_aspect("equal")
    axes.plot(poles.real, poles.imag, "x", color=AFTER, ms=8, mew=2)
    unit = " [rad/s]" if result.period is None else ""
    axes.set_xlabel(f"real part{unit}")
    axes.set_ylabel(f"imaginary part{unit}")
    return axes


@plot.register
def _(result: DataReport, axes: Axes | None = None) -> Axes:
    """Draw when each run was recorded, with its gaps."""
    axes = _axes(axes)
    axes.barh(range(len(result.runs)), [r.end - r.begin for r in result.runs], left=[r.begin for r in result.runs],
              height=0.5, color=[AFTER if r.role == "train" else BEFORE for r in result.runs])  # fmt: skip
    for y, run in enumerate(result.runs):
        for begin, end in run.gaps:
            axes.barh(y, end - begin, left=begin, height=0.5, color="white")
    axes.set_yticks(range(len(result.runs)), [f"{run.name} ({run.role})" for run in result.runs])
    axes.set_ylim(len(result.runs) - 0.4, -0.6)
    axes.set_xlabel("time [s]")
    return axes


@plot.register
def _(result: System, axes: Axes | None = None) -> Axes:
    """Draw on which states and inputs the derivative of each state depends."""
    columns = (*result.states, *result.inputs)
    pattern = ca.jacobian_sparsity(result.ode, ca.vertcat(result.x, result.u))
    rows, places = pattern.get_triplet()
    axes = _axes(axes)
    axes.plot(places, rows, "s", color=AFTER, ms=9)
    axes.set_xticks(range(len(columns)), columns, rotation=45, ha="right")
    axes.set_yticks(range(len(result.states)), [f"der({name})" for name in result.states])
    axes.set_xlim(-0.6, len(columns) - 0.4)
    axes.set_ylim(len(result.states) - 0.4, -0.6)
    axes.set_title(result.name, fontsize=10)
    return axes
