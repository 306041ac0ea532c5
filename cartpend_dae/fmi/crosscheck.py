"""An FMU beside the model composed here: same inputs, same start values, every shared variable compared."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cartpend_dae import units
from cartpend_dae.data import FloatArray, Trajectory, nearest
from cartpend_dae.errors import ModelError
from cartpend_dae.fmi.foreign import LIMIT, ForeignFmu, load_fmu
from cartpend_dae.fmi.instance import Kind
from cartpend_dae.inputs import Input
from cartpend_dae.simulate import simulate
from cartpend_dae.system import System

SMALLEST = 1e-9
# where a friction or a sampled controller decides, a looser tolerance of the FMU's run may decide otherwise
TIGHT = 1e-10
SHOWN = 6


@dataclass(frozen=True, slots=True)
class Compared:
    """One variable of both, in the unit of the model.

    `deviation` is the largest difference at equal times, at the time `when` [s]; `span` the range of the model's
    values; `use` the largest distance outside of what the model passes through within the time tolerance, as part of
    the half height of the tube: up to 1 it is inside.
    """

    fmu_name: str
    name: str
    unit: str
    span: float
    deviation: float
    when: float
    use: float


@dataclass(frozen=True, slots=True)
class CrossCheck:
    """The comparison of an FMU with a model; `compared` has the worst variable first."""

    path: Path
    model: str
    kind: Kind
    tube: float
    compared: tuple[Compared, ...]
    notes: tuple[str, ...]
    ours: Trajectory
    theirs: Trajectory

    @property
    def passed(self) -> bool:
        """Whether there are shared variables, and all of them are inside the tube."""
        return bool(self.compared) and all(row.use <= 1 for row in self.compared)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        rows = [{name: getattr(row, name) for name in Compared.__dataclass_fields__} for row in self.compared]
        return {
            "schema": 1,
            "command": "crosscheck",
            "fmu": str(self.path),
            "model": self.model,
            "kind": self.kind,
            "tube": self.tube,
            "passed": self.passed,
            "variables": rows,
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        """Return a report for people."""
        lines = [f"{self.path.name} ({self.kind.upper()}) beside {self.model}, tube {self.tube:g} of each range:"]
        width = max((len(row.name) for row in self.compared), default=0)
        lines += [
            f"  {'ok  ' if row.use <= 1 else 'FAIL'} {row.name:<{width}}  deviation {row.deviation:.3g} {row.unit} at "
            f"{row.when:.4g} s, range {row.span:.4g}, tube use {row.use:.3g}"
            for row in self.compared
        ]
        lines += [f"  note: {note}" for note in self.notes]
        inside = sum(row.use <= 1 for row in self.compared)
        lines.append(f"{'AGREES' if self.passed else 'DIFFERS'}: {inside} of {len(self.compared)} inside the tube")
        return "\n".join(lines)


def crosscheck(
    path: Path | str,
    system: System,
    *,
    mapping: Mapping[str, str] | None = None,
    inputs: Mapping[str, Input] | None = None,
    start: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | None = None,
    stop: float | None = None,
    points: int = 1001,
    kind: Kind | None = None,
    tube: float = 0.002,
    limit: float = LIMIT,
) -> CrossCheck:
    """Run an FMU and a model on the same inputs and start values, and compare what both have.

    Parameters
    ----------
    path, system
        The FMU and the assembled model.
    mapping
        Names of the FMU and what they are called in the model, where the names differ.
    inputs, start, parameters
        Given to both, by the names of the model, SI units. States of the model that nothing is said of start where
        the shared variables of the FMU start, inputs of both have the start values of the FMU.
    stop, points, kind, limit
        As in `ForeignFmu.simulate`.
    tube
        Half height of the tube as part of a variable's range, and half width as part of the time.

    Raises
    ------
    ModelError
        For names that the one or the other has not, and where no variable is shared.
    """
    fmu = load_fmu(path)
    names = _pairs(fmu, system, mapping or {})
    back = {ours: theirs for theirs, ours in names.items()}
    notes: list[str] = []
    given = _defaults(fmu, system, names) | dict(inputs or {})
    values = {back[name]: value for name, value in {**(start or {}), **(parameters or {})}.items() if name in back}
    notes += [
        f"`{name}` is set in the model only: the FMU has no such variable"
        for name in sorted({*(start or {}), *(parameters or {})} - set(back))
    ]
    theirs = fmu.simulate(
        stop,
        times=None,
        points=points,
        inputs={back[name]: value for name, value in given.items() if name in back},
        start=values,
        kind=kind,
        rtol=TIGHT,
        atol=1e-2 * TIGHT,
        limit=limit,
    )
    notes += _parameter_notes(system, theirs, names, parameters or {})
    begin = _begin(system, theirs, names) | dict(start or {})
    driven = {name: value for name, value in given.items() if name in system.inputs}
    ours = simulate(system, times=theirs.time, inputs=driven, start=begin, parameters=parameters)
    rows = [
        _compared(ours, theirs, theirs_name, name, tube, notes) for theirs_name, name in names.items() if name in ours
    ]
    if not rows:
        raise ModelError(
            f"{fmu.path.name} and {system.name} share no variable: say which are the same by `mapping` (`--map "
            f"theirs=ours`). The FMU has {', '.join(f'`{n}`' for n in theirs.names[:8])}."
        )
    rows.sort(key=lambda row: -row.use)
    used: Kind = kind or ("me" if "me" in fmu.description.kinds else "cs")
    return CrossCheck(fmu.path, system.name, used, tube, tuple(rows), tuple(dict.fromkeys(notes)), ours, theirs)


def _pairs(fmu: ForeignFmu, system: System, mapping: Mapping[str, str]) -> dict[str, str]:
    """Return what each variable of the FMU is called in the model, for those that both have."""
    known = {q.name for q in system.variables} | {q.name for q in system.parameters}
    have = {name for v in fmu.variables for name in v.elements}
    for theirs, ours in mapping.items():
        if theirs not in have:
            raise ModelError(f"{fmu.path.name} has no variable `{theirs}`; {nearest(theirs, have)}")
        if ours not in known:
            raise ModelError(f"{system.name} has no variable `{ours}`; {nearest(ours, known)}")
    taken = set(mapping.values())
    same = {name: name for v in fmu.variables for name in v.elements if name in known and name not in taken}
    return same | dict(mapping)


def _defaults(fmu: ForeignFmu, system: System, names: Mapping[str, str]) -> dict[str, Input]:
    """Return the start values of the FMU's inputs, by the names of the model."""
    return {
        names[v.name]: float(v.start)
        for v in fmu.variables
        if v.causality == "input" and v.name in names and names[v.name] in system.inputs and v.start is not None
    }


def _begin(system: System, theirs: Trajectory, names: Mapping[str, str]) -> dict[str, float]:
    """Return where states of the model start, as far as the FMU shows them."""
    states = set(system.states)
    return {
        ours: float(_in_unit(theirs, name, system.unit_of(ours))[0][0])
        for name, ours in names.items()
        if ours in states
    }


def _parameter_notes(
    system: System, theirs: Trajectory, names: Mapping[str, str], changed: Mapping[str, float]
) -> list[str]:
    values = {q.name: changed.get(q.name, q.value) for q in system.parameters}
    notes = []
    for name, ours in names.items():
        value = values.get(ours)
        if value is not None and name in theirs and not np.isclose(theirs[name][0], value, rtol=1e-9, atol=1e-12):
            notes.append(f"parameter `{ours}` is {theirs[name][0]:.8g} in the FMU and {value:.8g} in the model")
    return notes


def _in_unit(run: Trajectory, name: str, unit: str) -> tuple[FloatArray, str]:
    """Return values of an FMU in a unit of the model, and a note where the unit of the FMU is not understood."""
    given = run.units[run.names.index(name)]
    if given == unit or given in ("", "1"):
        return run[name], ""
    try:
        return np.asarray(units.to_si(run[name], given, unit), dtype=float), ""
    except ModelError:
        return run[name], f"the unit `{given}` of `{name}` is not `{unit}`: it was compared without conversion"


def _compared(
    ours: Trajectory, theirs: Trajectory, theirs_name: str, name: str, tube: float, notes: list[str]
) -> Compared:
    unit = ours.units[ours.names.index(name)]
    values, note = _in_unit(theirs, theirs_name, unit)
    if note:
        notes.append(note)
    reference = ours[name]
    difference = np.abs(values - reference)
    worst = int(np.nanargmax(difference)) if np.isfinite(difference).any() else 0
    span = float(np.ptp(reference))
    use = tube_use(ours.time, reference, values, tube)
    return Compared(theirs_name, name, unit, span, float(difference[worst]), float(ours.time[worst]), use)


def tube_use(time: FloatArray, reference: FloatArray, values: FloatArray, tube: float) -> float:
    """Return how far values leave the tube around a reference, in its half heights: inside it is up to 1.

    Parameters
    ----------
    time
        Times of both (n,) [s].
    reference, values
        The reference and what is compared (n,).
    tube
        Half height as part of the reference's range, and half width as part of the time.
    """
    scale = float(np.ptp(reference)) or float(np.abs(reference).max(initial=0.0))
    height, width = max(tube * scale, SMALLEST), tube * (time[-1] - time[0])
    low, high = np.interp(time - width, time, reference), np.interp(time + width, time, reference)
    least, most = np.minimum(low, high), np.maximum(low, high)
    first, last = np.searchsorted(time, time - width), np.searchsorted(time, time + width, side="right")
    for k, (i, j) in enumerate(zip(first, last, strict=True)):
        least[k] = min(least[k], reference[i:j].min())
        most[k] = max(most[k], reference[i:j].max())
    outside = np.maximum(np.maximum(values - most, least - values), 0.0)
    return float(np.where(np.isfinite(values), outside, np.inf).max() / height)


def crosscheck_figure(result: CrossCheck) -> Figure:
    """Return a figure of the variables that differ most: both curves, and their difference."""
    rows = result.compared[:SHOWN]
    figure = Figure(figsize=(10, 2.2 * len(rows) + 0.6), layout="constrained")
    axes = figure.subplots(len(rows), 2, squeeze=False, sharex=True)
    for (left, right), row in zip(axes, rows, strict=True):
        time, ours = result.ours.time, result.ours[row.name]
        theirs, _ = _in_unit(result.theirs, row.fmu_name, row.unit)
        left.plot(time, ours, label="model")
        left.plot(time, theirs, "--", label="FMU")
        left.set_ylabel(f"{row.name} [{row.unit}]")
        right.plot(time, theirs - ours, color="C3")
        right.set_title(f"FMU minus model, tube use {row.use:.3g}", fontsize="small")
    axes[0, 0].legend()
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    return figure
