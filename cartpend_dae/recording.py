"""The channels of a run as they were recorded: each with its own time stamps, checked and in SI units.

A file that does not hold what the study says is refused with a sentence that names the file, the column and
the row (counted from 0, as `rows` of the study counts them).
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartpend_dae import units as si
from cartpend_dae.columns import Table
from cartpend_dae.data import FloatArray, nearest, quantum
from cartpend_dae.errors import ModelError, StudyError
from cartpend_dae.study_schema import ChannelSpec, ExperimentSpec, FormatSpec, InputSpec, OutputSpec, TimeSpec
from cartpend_dae.tables import read_table

MIN_SAMPLES = 10


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """A recorded channel: `values` (n,) in the SI `unit` at `time` (n,) [s], NaN where there is none.

    `hold` is None for an output, `sd` its stated noise, `quantum` the step in which it is counted, `given` the
    unit in the file.
    """

    variable: str
    column: str
    file: Path
    time: FloatArray
    values: FloatArray
    unit: str
    given: str
    hold: Literal["zoh", "foh"] | None
    sd: float | None
    quantum: float


@dataclass(frozen=True, slots=True)
class Source:
    """A file with the time column that its channels share."""

    file: Path
    time: TimeSpec | None
    format: FormatSpec
    rows: tuple[int, int] | None

    @property
    def first_row(self) -> int:
        """The row of the file at which the columns begin."""
        return self.rows[0] if self.rows else 0


def read_signals(spec: ExperimentSpec, units: Mapping[str, str]) -> tuple[Signal, ...]:
    """Read the channels that `spec` describes, inputs first, those of the run's own file within its `rows`.

    Parameters
    ----------
    spec
        One `[[experiment]]` of a study.
    units
        The SI unit of each variable of the model, by dotted name.

    Raises
    ------
    StudyError
        If a file or one of its columns is not what the study says.
    """
    for kind in ("inputs", "outputs", "start"):
        for variable in getattr(spec, kind):
            _check_unit(spec, kind, variable, units)
    groups: dict[Source, dict[str, ChannelSpec]] = {}
    for variable, entry in (*spec.inputs.items(), *spec.outputs.items()):
        groups.setdefault(_source(spec, entry), {})[variable] = entry
    found = {
        signal.variable: signal
        for source, entries in groups.items()
        for signal in _Reader(spec.name, source).signals(entries, units)
    }
    return tuple(found[variable] for variable in (*spec.inputs, *spec.outputs))


def at(name: str, file: Path) -> str:
    """Begin a sentence about a run with its file."""
    return f"{file}: experiment `{name}`:"


def _source(spec: ExperimentSpec, entry: ChannelSpec) -> Source:
    if entry.file is None:
        return Source(spec.file, spec.time, spec.format, spec.rows)
    format = entry.format or FormatSpec()
    return Source(entry.file, entry.time or (None if format.sample_rate else spec.time), format, None)


def _check_unit(spec: ExperimentSpec, kind: str, variable: str, units: Mapping[str, str]) -> None:
    entry = getattr(spec, kind)[variable]
    place = at(spec.name, spec.file)
    if variable not in units:
        raise StudyError(f"{place} `{kind}`: the model has no `{variable}`; {nearest(variable, units)}")
    if entry.unit is None:
        return
    try:
        si.to_si(0.0, entry.unit, units[variable])
    except ModelError as error:
        raise StudyError(
            f'{place} `{kind}."{variable}"` is read in `{entry.unit}`, '
            f"but the model has it in `{units[variable]}`: {error}"
        ) from None


@dataclass(frozen=True, slots=True)
class _Reader:
    """The source that sentences are about, and the run that asks for it."""

    run: str
    source: Source

    def refuse(self, clause: str) -> StudyError:
        return StudyError(f"{at(self.run, self.source.file)} {clause}")

    def signals(self, entries: Mapping[str, ChannelSpec], units: Mapping[str, str]) -> list[Signal]:
        table = self.table(entries.values())
        time = self.time(table)
        self.check_increasing(time)
        if len(time) < MIN_SAMPLES:
            raise self.refuse(f"{len(time)} samples are too few; at least {MIN_SAMPLES} are needed; take more `rows`.")
        return [self.signal(variable, entry, table, time, units[variable]) for variable, entry in entries.items()]

    def table(self, entries: Iterable[ChannelSpec]) -> Table:
        """Read the columns that the study names, cut to its rows."""
        source, stamp = self.source, self.source.time
        names: list[str] = [stamp.column] if stamp else []
        used = list(dict.fromkeys([*names, *(str(entry.column) for entry in entries)]))
        try:
            table = read_table(source.file, source.format, used)
        except StudyError as error:
            raise self.refuse(str(error)) from None
        self._check_columns(table, used)
        last_row = max((len(column) for column in table.columns.values()), default=0) - 1
        first, last = source.rows or (0, last_row)
        if last > last_row:
            raise self.refuse(
                f"`rows` ends at {last}, but the last row of the file is {last_row}; end it there at the latest."
            )
        cut = {name: column[first : last + 1] for name, column in table.columns.items()}
        return Table(cut, table.names, table.units, table.note)

    def _check_columns(self, table: Table, used: list[str]) -> None:
        missing = [name for name in used if name not in table.columns]
        if missing:
            known = list(table.names)
            hints = [close[0] for name in missing if (close := get_close_matches(name, known, n=1, cutoff=0.5))]
            hint = f"did you mean {_listing(hints)}? " if hints else ""
            note = f" ({table.note})" if table.note and not table.note.startswith("numbers") else ""
            there = f"The columns are: {_listing(known[:40])}" if known else "It has no numeric columns"
            raise self.refuse(f"there is no column {_listing(missing)}{f'; {hint}' if hint else '. '}{there}{note}.")
        lengths = {name: len(column) for name, column in table.columns.items()}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"`{name}` {n}" for name, n in lengths.items())
            raise self.refuse(
                f"the columns differ in length: {found}; name a column with a `file` and `time` of its own, "
                "or mend the file."
            )

    def time(self, table: Table) -> FloatArray:
        """The time [s] of the rows that `rows` leaves; by the sample rate it is 0 at row 0 of the file."""
        stamp, rate = self.source.time, self.source.format.sample_rate
        if stamp is None:
            if rate is None:
                raise self.refuse("there is no time column; give `time` or `format.sample_rate` in Hz.")
            n = len(next(iter(table.columns.values()), ()))
            return (self.source.first_row + np.arange(n)) / rate
        column = table.columns[stamp.column]
        if column.dtype.kind in "Mm":
            seconds = (column - column[:1]) / np.timedelta64(1, "s")
            return self.complete(seconds.astype(float), stamp.column) + stamp.shift
        time = self.complete(self.numbers(column, stamp.column, table), stamp.column)
        return si.to_si(time, self.unit(stamp, table, "s")) + stamp.shift

    def complete(self, time: FloatArray, column: str) -> FloatArray:
        missing = np.flatnonzero(np.isnan(time))
        if missing.size:
            row = missing[0] + self.source.first_row
            raise self.refuse(
                f"the time column `{column}` is empty in row {row} ({missing.size} such rows); choose a part "
                "by `rows`, leave the column out and give `format.sample_rate`, or mend the file."
            )
        return time

    def check_increasing(self, time: FloatArray) -> None:
        steps = np.diff(time)
        wrong = np.flatnonzero(steps <= 0)
        if not wrong.size:
            return
        k = int(wrong[0])
        is_double = bool((steps[wrong] == 0).all())
        raise self.refuse(
            f"the time does not increase at row {k + 1 + self.source.first_row}: {time[k + 1]:.10g} s after "
            f"{time[k]:.10g} s ({wrong.size} such rows); choose a part by `rows` or mend the file: "
            + ("the time stamps are doubled, so keep one row of each." if is_double else "its time runs backwards.")
        )

    def signal(self, variable: str, entry: ChannelSpec, table: Table, time: FloatArray, unit: str) -> Signal:
        given = self.unit(entry, table, unit)
        raw = self.numbers(table.columns[entry.column], entry.column, table)
        known = np.isfinite(raw)
        if np.count_nonzero(known) < MIN_SAMPLES:
            kind = "input" if isinstance(entry, InputSpec) else "output"
            raise self.refuse(
                f"the {kind} column `{entry.column}` has {np.count_nonzero(known)} finite values; "
                f"at least {MIN_SAMPLES} are needed; name another column or more `rows`."
            )
        offset = 0.0 if isinstance(entry.subtract, str | None) else float(entry.subtract)
        values = si.to_si(raw - offset, given)
        is_output = isinstance(entry, OutputSpec)
        sd = float(si.to_si(entry.sd, given, difference=True)) if is_output and entry.sd is not None else None
        hold = None if is_output else entry.hold
        return Signal(variable, entry.column, self.source.file, time, values, unit, given, hold, sd, quantum(values))

    def unit(self, entry: ChannelSpec | TimeSpec, table: Table, unit: str) -> str:
        """The unit of a column: the study's, else the file's, else the model's; they may not contradict each other."""
        found = table.units.get(entry.column) if self.source.format.units == "file" else None
        if entry.unit is None and found is not None:
            try:
                si.to_si(0.0, found, unit)
            except ModelError as error:
                whose = "a time is needed" if isinstance(entry, TimeSpec) else f"the model has it in `{unit}`"
                raise self.refuse(
                    f"the file gives the column `{entry.column}` in `{found}`, but {whose}: {error} "
                    'Name another column, or give its `unit` and `format = { units = "study" }`.'
                ) from None
        if entry.unit is not None and found is not None and not _are_equal(entry.unit, found):
            raise self.refuse(
                f"the file gives the column `{entry.column}` in `{found}`, but the study in `{entry.unit}`; mend the "
                'study, or say `format = { units = "study" }` where the file is wrong.'
            )
        return entry.unit or found or unit

    def numbers(self, column: NDArray[Any], name: str, table: Table) -> FloatArray:
        """Return a column as floats; text in it and infinite numbers are refused."""
        if column.dtype.kind not in "fiub":
            self.refuse_texts(column, name, table)
        values = column.astype(float)
        infinite = np.flatnonzero(np.isinf(values))
        if infinite.size:
            raise self.refuse(
                f"the column `{name}` has no finite value in row {infinite[0] + self.source.first_row}, but "
                f"{values[infinite[0]]} ({infinite.size} such rows); leave cells empty where nothing was measured."
            )
        return values

    def refuse_texts(self, column: NDArray[Any], name: str, table: Table) -> None:
        if column.dtype.kind in "Mm":
            raise self.refuse(f"the column `{name}` holds dates, which only `time` may hold; name another column.")
        wrong = [k for k, value in enumerate(column) if not isinstance(value, int | float | np.number | np.bool_)]
        if not wrong:
            return
        text, row = str(column[wrong[0]]), wrong[0] + self.source.first_row
        is_date = re.match(r"\d{4}-\d\d-\d\d|\d\d?[./]\d\d?[./]\d{2}|\d\d?:\d\d", text) is not None
        cure = "write the time in seconds" if is_date else "leave cells empty where nothing was measured"
        note = f"; {table.note}" if table.note else ""
        raise self.refuse(
            f"the column `{name}` holds {text[:40]!r} in row {row}, which is not a number "
            f"({len(wrong)} such rows){note}; {cure}."
        )


def _are_equal(a: str, b: str) -> bool:
    """Whether two units measure the same on the same scale; `1/s` and `Hz` are not `rad/s`."""
    try:
        si.to_si(0.0, a, b)
    except ModelError:
        return False
    one, other = si.parse(a), si.parse(b)
    return abs(one.factor / other.factor - 1) < 1e-9 and one.offset == other.offset


def _listing(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
