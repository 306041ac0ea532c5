"""Reading columns of a log file of any kind: text of any dialect, MATLAB 5 and 7.3, HDF5, parquet.

The end of a file's name says which it is. Errors are clauses that `recording` completes with the file and the
experiment.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from cartpend_dae.columns import Table, check_size, located, readable_unit, split_unit
from cartpend_dae.errors import StudyError
from cartpend_dae.explain import nearest_file
from cartpend_dae.matlab_tables import read_hdf5, read_matlab
from cartpend_dae.parallel import survives
from cartpend_dae.study_schema import FormatSpec
from cartpend_dae.text_tables import plain, read_text

if TYPE_CHECKING:
    from pyarrow import Field  # pyright: ignore[reportMissingImports]


def read_table(path: Path, format: FormatSpec, wanted: Iterable[str]) -> Table:
    """Read the wanted columns of a file; those that it does not have are left out.

    Raises
    ------
    StudyError
        If the file is missing, is not a table, or claims more than fits into memory.
    """
    wanted, kind = tuple(dict.fromkeys(wanted)), path.suffix.lower()
    try:
        if path.is_dir():
            raise StudyError("this is a folder; name the data file in it.")
        if not path.exists():
            raise StudyError(f"there is no such data file{nearest_file(path)}")
        if not path.is_file():
            raise StudyError("this is no ordinary file; write the data to a csv, txt, mat or parquet file.")
        if path.stat().st_size == 0 and kind not in (".csv", ".txt"):
            raise StudyError(f"the file is empty{_EMPTY.get(kind, ': the file holds no data')}; export it again.")
        if kind in _IN_C:
            return _tried(_IN_C[kind], path, wanted)
        return _read_parquet(path, wanted) if kind == ".parquet" else read_text(path, format, wanted)
    except MemoryError:
        raise StudyError("the columns do not fit into memory; cut the file into runs.") from None
    except OSError as error:
        raise StudyError(f"the file cannot be read: {error.strerror or error}.") from None


_EMPTY = {
    ".mat": ": the file is not a MATLAB file that can be read",
    ".parquet": ": the file is not a parquet file",
}


_IN_C = {".mat": read_matlab, ".h5": read_hdf5, ".hdf5": read_hdf5}
"""What reads by libraries that damaged files can crash, with the process in which they are."""


def _tried(read: Callable[[Path, Iterable[str]], Table], path: Path, wanted: Iterable[str]) -> Table:
    """Read a file in a process apart first, which may die of it."""
    if not survives(lambda: read(path, wanted)):
        raise StudyError("the file is damaged, so that what reads it crashes; save it again.")
    return read(path, wanted)


def _read_parquet(path: Path, wanted: tuple[str, ...]) -> Table:
    try:
        from pyarrow import parquet  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise StudyError("reading parquet needs pyarrow: pip install 'cartpend-dae[parquet]'.") from None
    try:
        with parquet.ParquetFile(path) as file:
            fields = {field.name: field for field in file.schema_arrow}
            found = located(wanted, fields)
            check_size(file.metadata.num_rows * len(found), "the columns")
            read = file.read(columns=[*dict.fromkeys(found.values())], use_pandas_metadata=False)
            frame = {name: plain(read.column(full).to_pandas()) for name, full in found.items()}
    except StudyError:
        raise
    except Exception as error:  # pyarrow's errors have no common base
        clause = " ".join(str(error).split()).rstrip(".")[:200]
        raise StudyError(f"the file is not a parquet file that can be read: {clause}; export it again.") from None
    units = {name: unit for name, full in found.items() if (unit := _parquet_unit(fields[full]))}
    return Table(frame, tuple(fields), units)


def _parquet_unit(field: "Field") -> str | None:
    for key, text in (field.metadata or {}).items():
        if key.lower() in (b"unit", b"units") and (unit := readable_unit(text.decode("utf-8", errors="replace"))):
            return unit
    return split_unit(field.name)[1]
