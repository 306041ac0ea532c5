"""Measured runs in SI units as `Experiment`, what their noise is, and the `Trajectory` of a simulation.

A file that does not hold what the study says is refused with a sentence that names the file, the column and
the row (counted from 0, as `rows` of the study counts them).
"""

import math
import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cartpend_dae import units as si
from cartpend_dae.errors import ModelError, StudyError
from cartpend_dae.study_schema import ExperimentSpec, InputSpec, OutputSpec
from cartpend_dae.tables import Table, read_table

FloatArray = NDArray[np.float64]
MIN_SAMPLES = 10


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One signal of a run: `values` (n,) in `unit` (SI), NaN where an output was not measured.

    `hold` is how an input continues between samples, `sd` the stated noise of an output (None: to be
    estimated), `quantum` its quantisation step (0: none seen).
    """

    values: FloatArray
    hold: Literal["zoh", "foh"]
    sd: float | None
    unit: str
    quantum: float


@dataclass(frozen=True, slots=True)
class Start:
    """A start value [SI] and whether it is estimated; None for `value` keeps the model's."""

    value: float | None
    free: bool


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """One recorded run in SI; `time` (n,) [s] increases strictly and starts as it was recorded."""

    name: str
    role: Literal["train", "select", "test"]
    time: FloatArray
    inputs: Mapping[str, Channel]
    outputs: Mapping[str, Channel]
    start: Mapping[str, Start]
    score: Literal["free", "horizon", "innovation"]
    horizon: float | None


def load_experiment(spec: ExperimentSpec, units: Mapping[str, str]) -> Experiment:
    """Read the run that `spec` describes.

    Parameters
    ----------
    spec
        One `[[experiment]]` of a study.
    units
        The SI unit of each variable of the model, by dotted name.

    Raises
    ------
    StudyError
        If the file or one of its columns is not what the study says.
    """
    for kind in ("inputs", "outputs", "start"):
        for variable in getattr(spec, kind):
            _check_unit(spec, kind, variable, units)
    table = _used_columns(spec)
    time = _time(spec, table)
    low, high = spec.window or (-math.inf, math.inf)
    kept = np.flatnonzero((time >= low) & (time <= high))
    if spec.window and not len(kept) and len(time):
        recorded = f"recorded from {time.min():g} s to {time.max():g} s"
        raise StudyError(f"{_at(spec)} `window` = [{low:g}, {high:g}] s holds no sample; the run was {recorded}.")
    if len(kept) < MIN_SAMPLES:
        raise StudyError(f"{_at(spec)} {len(kept)} samples are too few; at least {MIN_SAMPLES} are needed.")
    time = _frozen(time[kept])
    _check_increasing(spec, time, kept)

    def channel(variable: str, entry: InputSpec | OutputSpec) -> Channel:
        return _channel(spec, table, kept, entry, units[variable])

    start = {
        variable: Start(_si_or_none(entry.guess if entry.value is None else entry.value, entry.unit), entry.is_free)
        for variable, entry in spec.start.items()
    }
    inputs = {variable: channel(variable, entry) for variable, entry in spec.inputs.items()}
    outputs = {variable: channel(variable, entry) for variable, entry in spec.outputs.items()}
    return Experiment(spec.name, spec.role, time, inputs, outputs, start, spec.score, spec.horizon)


def noise_sd(values: FloatArray) -> float:
    """Estimate the white noise of a smooth signal: median of its 6th differences, at least quantum/sqrt(12).

    The 6th difference of white noise has the variance C(12, 6) sd^2, and that of a well sampled signal is
    small. NaN are skipped. With fewer than seven values there is no such difference, and the result is NaN.
    """
    known = values[np.isfinite(values)]
    if len(known) < 7:
        return math.nan
    noise = np.median(np.abs(np.diff(known, n=6))) / 0.6745 / math.sqrt(math.comb(12, 6))
    return float(max(noise, quantum(known) / math.sqrt(12)))


def quantum(values: FloatArray) -> float:
    """Return the step of a quantised signal: 9 in 10 differences are multiples of it; 0 if there is none."""
    known = values[np.isfinite(values)]
    levels = np.unique(known)
    if len(levels) < 3:
        return 0.0
    steps = np.abs(np.diff(known))
    rounding = 64 * np.finfo(float).eps * np.abs(levels).max()
    steps, spacings = steps[steps > rounding], np.diff(levels)
    spacings = spacings[spacings > rounding]
    if not len(steps) or not len(spacings):
        return 0.0
    for step in np.quantile(spacings, (0.0, 0.01, 0.05, 0.2, 0.5)):
        small = steps[steps / step < 10.5]
        counts = np.round(small / step)
        if not counts.any():
            continue
        step = float(counts @ small / (counts @ counts))
        counts = np.round(steps / step)
        is_multiple = (counts >= 1) & (np.abs(steps / step - counts) < 0.1)
        # An even ramp stands on multiples of its own rise; it is not quantised.
        if is_multiple.mean() >= 0.9 and (len(np.unique(counts)) > 1 or len(steps) < len(known) - 1):
            return step
    return 0.0


def von_neumann_z(residual: FloatArray) -> float:
    """Return how many standard deviations a residual is from white: about N(0, 1) if it is, large if smooth.

    With von Neumann's ratio q of the mean square successive difference to the variance about zero it is
    z = (1 - q/2) sqrt(n) over the n pairs of neighbours that are both known. The variance is taken about
    zero, not about the mean, because a residual with an offset has structure too.

    References
    ----------
    J. von Neumann (1941), Distribution of the ratio of the mean square successive difference to the variance,
    Ann. Math. Statist. 12(4), 367-395, doi:10.1214/aoms/1177731677.
    """
    before, after = residual[:-1], residual[1:]
    both = np.isfinite(before) & np.isfinite(after)
    before, after = before[both], after[both]
    power = (before @ before + after @ after) / 2
    return float(math.sqrt(len(before)) * (before @ after) / power) if power > 0 else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """The result of a run: `values` (n, n_columns) at `time` (n,) [s]; `units` holds one SI unit a name.

    `columns` says where each name stands in `values`: variables that are equal share a column. Without it the names
    stand in order. `n_events` counts the instants at which something was decided anew or an input jumped.
    """

    time: FloatArray
    names: tuple[str, ...]
    values: FloatArray
    units: tuple[str, ...]
    columns: Mapping[str, int] = field(default_factory=dict, repr=False)
    n_events: int = 0

    def __post_init__(self) -> None:
        """Make the table of names."""
        if not self.columns:
            object.__setattr__(self, "columns", {name: k for k, name in enumerate(self.names)})

    def __getitem__(self, name: str) -> FloatArray:
        if name == "time":
            return self.time
        if name not in self.columns:
            raise KeyError(f"The trajectory has no variable `{name}`; {_nearest(name, self.names)}")
        return self.values[:, self.columns[name]]

    def __contains__(self, name: object) -> bool:
        return name == "time" or name in self.columns

    def with_constants(self, constants: Mapping[str, float], units: Iterable[str]) -> "Trajectory":
        """Return the trajectory with a column more for each constant, in SI `units`."""
        if not constants:
            return self
        values = np.hstack([self.values, np.tile([*constants.values()], (self.time.size, 1))])
        more = {name: self.values.shape[1] + k for k, name in enumerate(constants)}
        names, columns = (*self.names, *more), {**self.columns, **more}
        return Trajectory(self.time, names, values, (*self.units, *units), columns, self.n_events)

    def to_frame(self) -> pd.DataFrame:
        """Return the variables as columns, with `time` as the index."""
        values = self.values[:, [self.columns[name] for name in self.names]]
        return pd.DataFrame(values, pd.Index(self.time, name="time"), pd.Index(self.names))

    def to_csv(self, path: Path | str) -> None:
        """Write a csv file with a column `time`; numbers read back exactly, and no half file is ever left."""
        path = Path(path)
        with NamedTemporaryFile("w", dir=path.parent, suffix=".part", delete=False, newline="") as file:
            try:
                self.to_frame().to_csv(file)
                file.close()
                os.chmod(file.name, 0o644)
                os.replace(file.name, path)
            except BaseException:
                os.unlink(file.name)
                raise


def _at(spec: ExperimentSpec) -> str:
    return f"{spec.file}: experiment `{spec.name}`:"


def _nearest(name: str, known: Collection[str]) -> str:
    close = get_close_matches(name, list(known), n=3, cutoff=0.5)
    if close:
        return "did you mean " + " or ".join(f"`{other}`" for other in close) + "?"
    return f"there are: {_listing(islice(known, 20))}."


def _check_unit(spec: ExperimentSpec, kind: str, variable: str, units: Mapping[str, str]) -> None:
    entry = getattr(spec, kind)[variable]
    if variable not in units:
        raise StudyError(f"{_at(spec)} `{kind}`: the model has no `{variable}`; {_nearest(variable, units)}")
    if entry.unit is None:
        return
    try:
        si.to_si(0.0, entry.unit, units[variable])
    except ModelError as error:
        raise StudyError(
            f'{_at(spec)} `{kind}."{variable}"` is read in `{entry.unit}`, '
            f"but the model has it in `{units[variable]}`: {error}"
        ) from None


def _si_or_none(value: float | None, unit: str | None) -> float | None:
    return value if value is None or unit is None else float(si.to_si(value, unit))


def _time(spec: ExperimentSpec, table: Table) -> FloatArray:
    """The time [s] of the rows that `rows` leaves; by the sample rate it is 0 at row 0 of the file."""
    if spec.time is not None:
        time = _numbers(spec, table[spec.time.column], spec.time.column)
        if (missing := np.flatnonzero(~np.isfinite(time))).size:
            row = missing[0] + _first_row(spec)
            raise StudyError(f"{_at(spec)} the time column `{spec.time.column}` is empty in row {row}.")
        return si.to_si(time, spec.time.unit)
    if spec.format.sample_rate is None:
        raise StudyError(f"{_at(spec)} there is no time column; give `time` or `format.sample_rate` in Hz.")
    n = len(next(iter(table.values())))
    return (_first_row(spec) + np.arange(n)) / spec.format.sample_rate


def _first_row(spec: ExperimentSpec) -> int:
    return spec.rows[0] if spec.rows else 0


def _check_increasing(spec: ExperimentSpec, time: FloatArray, kept: NDArray[np.intp]) -> None:
    wrong = np.flatnonzero(np.diff(time) <= 0)
    if wrong.size:
        k = int(wrong[0])
        raise StudyError(
            f"{_at(spec)} the time does not increase at row {kept[k + 1] + _first_row(spec)}: "
            f"{time[k + 1]:.10g} s after {time[k]:.10g} s ({wrong.size} such rows); "
            "choose a part by `rows` or mend the file."
        )


def _channel(
    spec: ExperimentSpec, table: Table, kept: NDArray[np.intp], entry: InputSpec | OutputSpec, unit: str
) -> Channel:
    raw = _numbers(spec, table[entry.column], entry.column)[kept]
    known = np.isfinite(raw)
    if isinstance(entry, InputSpec) and not known.all():
        row = kept[np.argmin(known)] + _first_row(spec)
        raise StudyError(
            f"{_at(spec)} the input column `{entry.column}` has no finite value in row {row} "
            f"({np.count_nonzero(~known)} such rows); an input must be known throughout."
        )
    if np.count_nonzero(known) < MIN_SAMPLES:
        raise StudyError(
            f"{_at(spec)} the output column `{entry.column}` has {np.count_nonzero(known)} finite values; "
            f"at least {MIN_SAMPLES} are needed."
        )
    offset = float(raw[known].mean()) if entry.subtract == "mean" else float(entry.subtract or 0.0)
    given = entry.unit or unit
    # Without its mean a value is a difference, so the zero of degC does not count.
    values = si.to_si(np.where(known, raw, np.nan) - offset, given, difference=entry.subtract == "mean")
    hold = entry.hold if isinstance(entry, InputSpec) else "foh"
    sd = entry.sd if isinstance(entry, OutputSpec) else None
    sd = None if sd is None else float(si.to_si(sd, given, difference=True))
    return Channel(_frozen(values), hold, sd, unit, quantum(values))


def _frozen(values: FloatArray) -> FloatArray:
    values.flags.writeable = False
    return values


def _used_columns(spec: ExperimentSpec) -> Table:
    """Read the columns that the study names, cut to its `rows`."""
    try:
        table = read_table(spec.file, spec.format)
    except StudyError as error:
        raise StudyError(f"{_at(spec)} {error}") from None
    used = [entry.column for entry in (*spec.inputs.values(), *spec.outputs.values())]
    used = dict.fromkeys([spec.time.column, *used] if spec.time else used)
    missing = [name for name in used if name not in table]
    if missing:
        hints = [close[0] for name in missing if (close := get_close_matches(name, list(table), n=1, cutoff=0.5))]
        hint = f"did you mean {_listing(hints)}? " if hints else ""
        raise StudyError(
            f"{_at(spec)} there is no column {_listing(missing)}; {hint}The columns are: {_listing(table)}."
        )
    lengths = {name: len(table[name]) for name in used}
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"`{name}` {n}" for name, n in lengths.items())
        raise StudyError(f"{_at(spec)} the columns differ in length: {found}.")
    first, last = spec.rows or (0, max(lengths.values()) - 1)
    if last >= max(lengths.values()):
        raise StudyError(
            f"{_at(spec)} `rows` ends at {last}, but the last row of the file is {max(lengths.values()) - 1}."
        )
    return {name: table[name][first : last + 1] for name in used}


def _listing(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _numbers(spec: ExperimentSpec, column: NDArray[Any], name: str) -> FloatArray:
    if column.dtype.kind in "fiub":
        return column.astype(float)
    texts = pd.Series(column).astype("string").str.strip().replace("", None)
    numbers = pd.Series(pd.to_numeric(texts, errors="coerce")).to_numpy(float, na_value=np.nan)
    wrong = np.flatnonzero(np.isnan(numbers) & texts.notna().to_numpy())
    if wrong.size:
        raise StudyError(
            f"{_at(spec)} the column `{name}` holds {str(column[wrong[0]])[:40]!r} in row "
            f"{wrong[0] + _first_row(spec)}, which is not a number ({wrong.size} such rows)."
        )
    return numbers
