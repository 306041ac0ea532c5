"""Reading csv and txt files: encoding, comment lines, header, units, delimiter and number format are found out.

A file is read twice, a line at a time: once for its head, once by pandas for the columns that are wanted.
"""

import codecs
import csv
import io
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from statistics import mode
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cartpend_dae.columns import Table, check_size, located, readable_unit, split_unit
from cartpend_dae.errors import StudyError
from cartpend_dae.study_schema import FormatSpec

SAMPLE = 50
"""Lines by which the dialect is judged."""
MAX_LINE = 1_000_000
CHUNK = 100_000
_INFINITE = r"|[+-]?(?:inf|Inf|INF|infinity|Infinity)"

_MAGIC = {
    b"PK\x03\x04": "a zip archive or an Excel workbook: unpack it, or save the sheet as csv",
    b"\x1f\x8b": "packed by gzip: unpack it",
    b"\x89HDF": "an HDF5 file: name it .h5, or .mat if MATLAB wrote it",
    b"PAR1": "a parquet file: name it .parquet",
    b"MATLAB": "a MATLAB file: name it .mat",
    b"\xd0\xcf\x11\xe0": "an Excel workbook: save the sheet as csv",
    b"%PDF": "a PDF document: export the numbers as csv",
    b"\x93NUMPY": "an array of numpy: save it by numpy.savetxt",
    b"SQLite": "an SQLite database: export the table as csv",
}


@dataclass(frozen=True, slots=True)
class Dialect:
    """How the rows are written: `delimiter` (" " for any white space), `decimal` and `thousands` marks."""

    delimiter: str
    decimal: str
    thousands: str | None


@dataclass(frozen=True, slots=True)
class Head:
    """What the first lines say: dialect, column names (empty where a column has none), units, lines before the data."""

    dialect: Dialect
    names: tuple[str, ...]
    units: dict[str, str]
    skipped: int
    row_length: float


def read_text(path: Path, format: FormatSpec, wanted: Iterable[str]) -> Table:
    """Read the wanted columns of a text file.

    Raises
    ------
    StudyError
        If the file is not a table of one width.
    """
    encoding = _encoding(path)
    with path.open(encoding=encoding, errors="replace") as file:
        head = _head(file, format)
    found = located(wanted, filter(None, head.names))
    positions = {name: head.names.index(full) for name, full in found.items()}
    check_size(path.stat().st_size / head.row_length * len(set(positions.values())), "the columns")
    with path.open(encoding=encoding, errors="replace") as file:
        lines = islice(_data_lines(file, format, []), head.skipped, None)
        arrays = _parsed(lines, head, sorted(set(positions.values())))
    return Table(
        {name: arrays[position] for name, position in positions.items()},
        tuple(filter(None, head.names)),
        {name: head.units[full] for name, full in found.items() if full in head.units},
        _marks(head.dialect),
    )


def _marks(dialect: Dialect) -> str:
    thousands = f" and `{dialect.thousands}` between thousands" if dialect.thousands else ""
    return f"numbers are read with the decimal mark `{dialect.decimal}`{thousands}"


def _encoding(path: Path) -> str:
    """UTF-16 and UTF-32 by their marks or zeros, UTF-8 if all of the file is, else the western code page of Windows."""
    with path.open("rb") as file:
        first = file.read(4096)
        _check_magic(first)
        for mark, name in ((codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF8, "utf-8-sig")):
            if first.startswith(mark):
                return name
        if first.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return "utf-16"
        even, odd = (first[k::2].count(0) / max(1, len(first) // 2) for k in (0, 1))
        if max(even, odd) > 0.9 and min(even, odd) < 0.1:
            return "utf-16-le" if odd > even else "utf-16-be"
        return _scanned(first, file)


def _check_magic(first: bytes) -> None:
    for magic, what in _MAGIC.items():
        if first.startswith(magic) and (magic != b"MATLAB" or b"\0" in first):
            raise StudyError(f"the file is not text; csv, txt, mat and parquet files can be read, and this is {what}.")


def _scanned(first: bytes, file: io.BufferedReader) -> str:
    decoder, encoding, position, chunk = codecs.getincrementaldecoder("utf-8")(), "utf-8", 0, first
    while chunk:
        if (zero := chunk.find(0)) >= 0:
            raise StudyError(
                "the file is not text; csv, txt, mat and parquet files can be read, but this one holds a NUL byte "
                f"at position {position + zero}: it is binary or was damaged; export it again."
            )
        position += len(chunk)
        following = file.read(1 << 20)
        try:
            if encoding == "utf-8":
                decoder.decode(chunk, final=not following)
        except UnicodeDecodeError:
            encoding = "cp1252"
        chunk = following
    return encoding


def _lines(file: io.TextIOBase) -> Iterator[str]:
    number = 0
    while line := file.readline(MAX_LINE):
        number += 1
        if len(line) == MAX_LINE:
            raise StudyError(
                f"line {number} has more than {MAX_LINE} characters, so the file is no table of one row a line; "
                "export it again as csv."
            )
        yield line.rstrip("\r\n")


def _data_lines(file: io.TextIOBase, format: FormatSpec, preamble: list[str]) -> Iterator[str]:
    """Yield the lines that are neither empty nor comments; comments before the first go to `preamble`."""
    marks = (format.comment,) if format.comment else ("%", "#")
    begun = False
    for line in islice(_lines(file), format.skip_rows, None):
        text = line.strip()
        if not begun and re.fullmatch(r"sep=.", text):  # Excel's own line
            continue
        if text.startswith(marks):
            if not begun and (comment := text.lstrip("".join(marks)).strip()):
                preamble.append(comment)
        elif text:
            begun = True
            yield line.split(format.comment)[0] if format.comment else line


def _head(file: io.TextIOBase, format: FormatSpec) -> Head:
    preamble: list[str] = []
    sample = list(islice(_data_lines(file, format, preamble), SAMPLE + 3))
    dialect = _dialect(sample[1:-1] or sample, format)
    split = [_cells(line, dialect.delimiter) for line in sample[:3]]
    skipped, header, units = 0, _header_in_comment(preamble, dialect.delimiter), []
    if split and any(split[0]) and not any(_is_number(cell, dialect) for cell in split[0]):
        header, skipped = split[0], 1
    # One row is a unit row only if data follow it.
    if len(split) > skipped + 1 and _is_unit_row(split[skipped], dialect):
        units, skipped = split[skipped], skipped + 1
    if len(split) <= skipped:
        raise StudyError("the file holds no data.")
    first = split[skipped]
    names = _named(first, header, format)
    found = {}
    for name, unit in zip(names, [*units, *[""] * len(names)], strict=False):
        if name and (known := readable_unit(unit) if unit else split_unit(name)[1]):
            found[name] = known
    data = sample[skipped:]
    return Head(dialect, names, found, skipped, sum(map(len, data)) / len(data) + 1)


def _header_in_comment(preamble: list[str], delimiter: str) -> list[str]:
    """Names in the last comment line, which may part them in another way than the rows part their numbers."""
    header = preamble[-1] if preamble else ""
    cells = _cells(header, delimiter) if header and delimiter in header else []
    return cells if delimiter != " " and len(cells) > 1 else re.findall(r"[^\s,;|]+", header)


def _named(first: list[str], header: list[str], format: FormatSpec) -> tuple[str, ...]:
    n, names = len(first), list(format.columns or header)
    if not any(first[len(names) :]):  # a delimiter at the end of each line
        names += [""] * (n - len(names))
    if len(names) != n:
        source = "`format.columns`" if format.columns else "the header"
        found = f"{source} names {len(names)} columns" if names else "the file has no header"
        raise StudyError(
            f"{found}, but the rows have {n}, such as {_shown(first)}; give all names by `format.columns`, or the "
            "lines before the header by `format.skip_rows`."
        )
    return tuple(_unique(names))


def _shown(cells: list[str]) -> str:
    text = str(cells)
    return text if len(text) <= 80 else text[:77] + "..."


def _is_unit_row(cells: list[str], dialect: Dialect) -> bool:
    texts = [cell for cell in cells if cell]
    has_text = any(not _is_number(cell, dialect) for cell in texts)
    return has_text and all(readable_unit(cell) for cell in texts)


def _parsed(lines: Iterator[str], head: Head, positions: list[int]) -> dict[int, NDArray[Any]]:
    """Let pandas read the columns at `positions`, in chunks so that the other columns take no memory."""
    n, dialect = len(head.names), head.dialect
    stream = _Stream(_checked(lines, dialect.delimiter, n))
    source: Any = stream  # what pandas needs of a file is `read`
    parts: dict[int, list[NDArray[Any]]] = {j: [] for j in positions}
    # pandas would read 1,23 as 123 where the comma stands between thousands
    as_text: dict[str, Any] = {"dtype": str} if dialect.thousands else {}
    try:
        frames = pd.read_csv(
            source,
            sep=r"\s+" if dialect.delimiter == " " else dialect.delimiter,
            decimal=dialect.decimal,
            header=None,
            names=range(n),
            usecols=positions,
            index_col=False,
            skipinitialspace=True,
            low_memory=False,
            chunksize=CHUNK,
            **as_text,
        )
        for frame in frames if positions else ():
            for j in positions:
                parts[j].append(plain(frame[j], dialect))
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        complaint = str(error).strip().rstrip(".")
        raise stream.error or StudyError(f"the file is not a table of {n} columns: {complaint}.") from None
    return {j: np.concatenate(part) for j, part in parts.items()}


def plain(column: pd.Series, dialect: Dialect = Dialect(",", ".", None)) -> NDArray[Any]:
    """Return a column as numbers, NaN where it is empty; what is no number stays text, a date a date."""
    if column.dtype.kind in "fiubMm":
        return column.to_numpy()
    texts = column.astype("string").str.strip().replace("", None)
    is_number = texts.str.fullmatch(_number_pattern(dialect) + _INFINITE).fillna(False).to_numpy(bool)
    pointed = texts.str.replace(dialect.thousands or " ", "", regex=False).str.replace(
        dialect.decimal, ".", regex=False
    )
    values = np.where(texts.isna(), np.nan, texts.to_numpy(object, na_value=np.nan)).astype(object)
    values[is_number] = pointed[is_number].to_numpy(float)
    return values if any(isinstance(value, str) for value in values) else values.astype(float)


def _checked(lines: Iterator[str], delimiter: str, n: int) -> Iterator[str]:
    """Refuse rows of another length than the first, and quotes that stay open."""
    for row, line in enumerate(lines):
        if line.count('"') % 2:
            raise StudyError(
                f"the file is not a table of {n} columns: row {row} opens a quote inside string {line[:60]!r} "
                "that is never closed; mend the row or leave it out."
            )
        is_plain = delimiter != " " and '"' not in line
        found = line.count(delimiter) + 1 if is_plain else len(_cells(line, delimiter))
        if found != n:
            cure = "or leave out the lines before the header by `format.skip_rows`" if row < 5 else "or leave it out"
            raise StudyError(f"row {row} has {found} cells, the first row {n}: {line[:60]!r}; mend the row {cure}.")
        yield line


class _Stream:
    """Lines as a file that pandas reads; it keeps the error that ended them, which pandas would replace."""

    def __init__(self, lines: Iterator[str]) -> None:
        self.lines, self.rest = lines, ""
        self.error: StudyError | None = None

    def __iter__(self) -> Iterator[str]:
        return self.lines

    def read(self, size: int = -1) -> str:
        parts, length = [self.rest], len(self.rest)
        try:
            while size < 0 or length < size:
                line = next(self.lines)
                parts += (line, "\n")
                length += len(line) + 1
        except StopIteration:
            pass
        except StudyError as error:
            self.error = error
            raise pd.errors.ParserError("refused") from error
        text = "".join(parts)
        cut = len(text) if size < 0 else size
        self.rest = text[cut:]
        return text[:cut]


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:  # a cell of more than 131,072 characters
        return line.split(delimiter)


def _number_pattern(dialect: Dialect) -> str:
    point = re.escape(dialect.decimal)
    whole = r"\d+" if not dialect.thousands else rf"(?:\d+|\d{{1,3}}(?:{re.escape(dialect.thousands)}\d{{3}})+)"
    return rf"[+-]?(?:{whole}(?:{point}\d*)?|{point}\d+)(?:[eE][+-]?\d+)?"


def _is_number(cell: str, dialect: Dialect) -> bool:
    return re.fullmatch(_number_pattern(dialect), cell) is not None


def _dialect(sample: list[str], format: FormatSpec) -> Dialect:
    """Choose the delimiter and the marks that make most cells numbers, then most cells.

    `csv.Sniffer` counts characters: it takes the commas of `0,1 0,2` and the dots of numbers for delimiters. A
    mark between thousands is assumed only where the cells are no numbers without it, as `1.234,5` is none.
    """
    best, choice = (-1.0, 0), Dialect(format.delimiter or ",", format.decimal or ".", format.thousands)
    for dialect in _candidates(format, is_quoted=any('"' in line for line in sample)):
        rows = [_cells(line, dialect.delimiter) for line in sample]
        if not rows:
            continue
        n = mode(map(len, rows))
        cells = [cell for row in rows if len(row) == n for cell in row if cell]
        numbers = sum(_is_number(cell, dialect) for cell in cells)
        score = (numbers / max(len(cells), 1) * sum(len(row) == n for row in rows), n)
        if score > best:
            best, choice = score, dialect
        if n > 1 and numbers == len(cells) and score[0] == len(rows):
            break  # a cell that is a number has no delimiter in it
    return choice


def _candidates(format: FormatSpec, *, is_quoted: bool) -> Iterator[Dialect]:
    """All dialects that the study leaves open, the plainest first: a later one must do better.

    The delimiter can stand between thousands only inside quotes.
    """
    for thousands in (format.thousands,) if format.thousands else (None, ",", ".", "'", " "):
        for delimiter in (format.delimiter,) if format.delimiter else (",", ";", "\t", "|", " "):
            for decimal in (format.decimal,) if format.decimal else (".", ","):
                if decimal not in (delimiter, thousands) and (thousands != delimiter or is_quoted):
                    yield Dialect(delimiter, decimal, thousands)


def _unique(names: list[str]) -> list[str]:
    """Number repeated names as pandas does: `w`, `w.1`."""
    return [name if not (k := names[:j].count(name)) or not name else f"{name}.{k}" for j, name in enumerate(names)]
