"""Reading a log file into columns: text of any dialect, MATLAB 5 and 7.3, parquet.

Errors are clauses that `data.load_experiment` completes with the file and the experiment.
"""

import csv
import io
import re
from collections.abc import Mapping
from pathlib import Path
from statistics import mode
from typing import Any

import numpy as np
import pandas as pd
import scipy.io
from numpy.typing import NDArray

from cartpend_dae.errors import StudyError
from cartpend_dae.study_schema import FormatSpec

Table = dict[str, NDArray[Any]]


def read_table(path: Path, format: FormatSpec) -> Table:
    """Read all columns of a file, by name; a column of text stays text.

    Raises
    ------
    StudyError
        If the file is missing or is not a table.
    """
    if not path.is_file():
        raise StudyError("there is no such data file.")
    readers = {".mat": _read_mat, ".parquet": _read_parquet}
    try:
        return readers.get(path.suffix.lower(), _read_text)(path, format)
    except OSError as error:
        raise StudyError(f"the file cannot be read: {error.strerror or error}.") from None


def _read_parquet(path: Path, _: FormatSpec) -> Table:
    try:
        frame = pd.read_parquet(path)
    except ImportError:
        raise StudyError("reading parquet needs pyarrow: pip install 'cartpend-dae[parquet]'.") from None
    except Exception as error:  # pyarrow's errors have no common base
        raise StudyError(f"the file is not a parquet file: {error}.") from None
    return {str(name): frame[name].to_numpy() for name in frame.columns}


def _read_mat(path: Path, _: FormatSpec) -> Table:
    """Read MATLAB variables: vectors by name, matrices as `A(:,1)`, fields of structures as `run.speed`."""
    try:
        content = scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError:
        content = _read_hdf5(path)
    except Exception as error:  # loadmat raises what it stumbles over: ValueError, TypeError, zlib.error, ...
        raise StudyError(f"the file is not a MATLAB file that can be read: {error}.") from None
    table: Table = {}
    _add_arrays(table, "", {name: value for name, value in content.items() if not name.startswith("__")})
    return table


def _read_hdf5(path: Path) -> dict[str, Any]:
    try:
        import h5py  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise StudyError(
            "the file is MATLAB 7.3 (HDF5), which needs h5py: `pip install h5py`, or save it with '-v7'."
        ) from None
    try:
        with h5py.File(path) as file:
            return {name: np.asarray(item).T for name, item in file.items() if isinstance(item, h5py.Dataset)}
    except OSError as error:
        raise StudyError(f"the file is not a MATLAB file that can be read: {error}.") from None


def _add_arrays(table: Table, prefix: str, content: Mapping[str, Any]) -> None:
    for name, value in content.items():
        if isinstance(value, dict):
            _add_arrays(table, f"{prefix}{name}.", value)
            continue
        array = np.atleast_1d(np.asarray(value))
        if array.ndim > 2 or array.dtype.kind not in "fiub" or array.size < 2:
            continue
        if array.ndim == 1 or 1 in array.shape:
            table[prefix + name] = array.ravel()
        else:
            table |= {f"{prefix}{name}(:,{j + 1})": array[:, j] for j in range(array.shape[1])}


def _read_text(path: Path, format: FormatSpec) -> Table:
    """Read csv or txt: encoding, comment lines, header, delimiter and decimal comma are found out."""
    lines = _decoded(path.read_bytes()).splitlines()[format.skip_rows :]
    marks = (format.comment,) if format.comment else ("%", "#")
    header = ""
    while lines and (not lines[0].strip() or lines[0].lstrip().startswith(marks)):
        header = lines.pop(0).strip().lstrip("".join(marks)).strip() or header
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith(marks)]
    sample = lines[:50]
    delimiter, decimal = _dialect(sample[1:-1] or sample, format)
    split = [_cells(line, delimiter) for line in sample[:2]]
    if split and not any(_is_number(cell, decimal) for cell in split[0]) and any(split[0]):
        header_cells = split.pop(0)
        lines.pop(0)
    else:
        # A comment line may part its names in another way than the rows part their numbers.
        header_cells = _cells(header, delimiter) if header and delimiter in header.strip() else []
        if delimiter == " " or len(header_cells) < 2:
            header_cells = re.findall(r"[^\s,;|]+", header)
    if not split:
        raise StudyError("the file holds no data.")
    n = len(split[0])
    names = list(format.columns or header_cells)
    if not any(split[0][len(names) :]):  # a delimiter at the end of each line
        names += [""] * (n - len(names))
    if len(names) != n:
        source = "`format.columns`" if format.columns else "the header"
        found = f"{source} names {len(names)} columns" if names else "the file has no header"
        raise StudyError(f"{found}, but the rows have {n}, such as {split[0]}; give all names by `format.columns`.")
    try:
        frame = pd.read_csv(
            io.StringIO("\n".join(lines)),
            sep=r"\s+" if delimiter == " " else delimiter,
            decimal=decimal,
            header=None,
            names=range(n),
            index_col=False,
            comment=format.comment,
            skipinitialspace=True,
            low_memory=False,
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        raise StudyError(_not_a_table(lines, delimiter, n, str(error).strip().rstrip("."))) from None
    texts = frame.select_dtypes(exclude="number").columns if decimal == "," else []
    for j in texts:
        frame[j] = frame[j].astype("string").str.replace(",", ".")
    return {name: frame[j].to_numpy() for j, name in enumerate(_unique(names)) if name}


def _not_a_table(lines: list[str], delimiter: str, n: int, complaint: str) -> str:
    for row, line in enumerate(lines):
        if (found := len(_cells(line, delimiter))) != n:
            return f"row {row} has {found} cells, the first row {n}: {line[:60]!r}."
    return f"the file is not a table of {n} columns: {complaint}."


def _decoded(content: bytes) -> str:
    """Text of the file: UTF-16 where a mark says so, UTF-8, else the western code page of Windows."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if b"\0" in content:
        raise StudyError("the file is not text; csv, txt, mat and parquet files can be read.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]


def _is_number(cell: str, decimal: str) -> bool:
    return re.fullmatch(rf"[+-]?(\d+{re.escape(decimal)}?\d*|{re.escape(decimal)}\d+)([eE][+-]?\d+)?", cell) is not None


def _dialect(sample: list[str], format: FormatSpec) -> tuple[str, str]:
    """Choose the delimiter and the decimal mark that make most cells numbers, then most cells.

    `csv.Sniffer` counts characters: it takes the commas of `0,1 0,2` and the dots of numbers for delimiters.
    """
    best, choice = (-1.0, 0), (format.delimiter or ",", format.decimal or ".")
    for delimiter in (format.delimiter,) if format.delimiter else (",", ";", "\t", "|", " "):
        for decimal in (format.decimal,) if format.decimal else (".", ","):
            rows = [_cells(line, delimiter) for line in sample]
            if decimal == delimiter or not rows:
                continue
            n = mode(map(len, rows))
            cells = [cell for row in rows if len(row) == n for cell in row if cell]
            numbers = sum(_is_number(cell, decimal) for cell in cells)
            score = (numbers / max(len(cells), 1) * sum(len(row) == n for row in rows), n)
            if score > best:
                best, choice = score, (delimiter, decimal)
    return choice


def _unique(names: list[str]) -> list[str]:
    """Number repeated names as pandas does: `w`, `w.1`."""
    return [name if not (k := names[:j].count(name)) or not name else f"{name}.{k}" for j, name in enumerate(names)]
