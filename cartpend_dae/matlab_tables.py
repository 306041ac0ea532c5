"""Reading MATLAB 5 files by scipy, MATLAB 7.3 and other HDF5 files by h5py; nothing in them is evaluated.

Vectors go by their name, columns of matrices as `A(:,1)`, fields of structures as `run.speed`, elements of
arrays of structures as `signals(1).values`, and cells as `c{1}`.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import scipy.io
from numpy.typing import NDArray

from cartpend_dae.columns import Table, check_size, located, readable_unit, split_unit
from cartpend_dae.errors import StudyError

if TYPE_CHECKING:
    from h5py import Dataset, File, Group  # pyright: ignore[reportMissingImports]

MAX_DEPTH = 10
MAX_ELEMENTS = 1000
"""Bounds on structures within structures and on arrays of cells: files may refer to themselves."""


@dataclass(frozen=True, slots=True)
class _Place:
    """A column of an HDF5 file: its dataset, and the column of it where it is a matrix."""

    dataset: Any
    column: int | None


def read_matlab(path: Path, wanted: Iterable[str]) -> Table:
    """Read the wanted columns of a .mat file of any version.

    Raises
    ------
    StudyError
        If the file is none, is damaged, or claims more than fits into memory.
    """
    with path.open("rb") as file:
        first = file.read(520)
    if first.startswith(b"\x89HDF") or first[512:].startswith(b"\x89HDF") or first[124:126] == b"\x00\x02":
        return read_hdf5(path, wanted, is_matlab=True)
    if not first.startswith(b"MATLAB") and first and all(byte in b"\t\n\r" or byte >= 32 for byte in first):
        raise _unreadable("it is text; name it .csv or .txt")
    wanted = tuple(wanted)
    variables = _claims(path)
    _check_claims(path, variables, wanted)
    arrays = _arrays(path, [name for name, _, _ in variables if any(_is_of(column, name) for column in wanted)])
    if len(located(wanted, arrays)) < len(set(wanted)):
        _check_claims(path, variables, [name for name, _, _ in variables])
        arrays = _arrays(path, None)
    found = located(wanted, arrays)
    objects = [name for name, _, kind in variables if kind in ("opaque", "object")]
    return Table(
        {name: arrays[full] for name, full in found.items()},
        tuple(arrays),
        {name: unit for name, full in found.items() if (unit := split_unit(full)[1])},
        _about_objects(objects),
    )


def _about_objects(names: list[str]) -> str:
    if not names:
        return ""
    listing = ", ".join(f"`{name}`" for name in names)
    return (
        f"{listing} cannot be read, being objects of MATLAB (timeseries, table); save their numbers, "
        "as in t = ts.Time; x = ts.Data"
    )


def _unreadable(reason: object) -> StudyError:
    clause = " ".join(str(reason).split()).rstrip(".") or type(reason).__name__
    return StudyError(f"the file is not a MATLAB file that can be read: {clause}; save it again with '-v7'.")


def _is_of(column: str, variable: str) -> bool:
    return column == variable or (column.startswith(variable) and column[len(variable)] in ".({")


def _claims(path: Path) -> list[tuple[str, tuple[int, ...], str]]:
    """Return name, shape and class of each variable, as their heads say."""
    try:
        return scipy.io.whosmat(path)
    except Exception as error:  # scipy raises what it stumbles over: ValueError, TypeError, zlib.error, ...
        raise _unreadable(error) from None


def _check_claims(path: Path, variables: list[tuple[str, tuple[int, ...], str]], wanted: Iterable[str]) -> None:
    """Refuse variables that would not fit, before scipy makes room for them."""
    wanted = tuple(wanted)
    for name, shape, kind in variables:
        if not any(_is_of(column, name) for column in wanted):
            continue
        check_size(float(np.prod(shape, dtype=float)), f"`{name}` ({'x'.join(map(str, shape))})")
        if kind in ("struct", "cell"):
            for n_bytes in _element_sizes(path):
                check_size(n_bytes / 8, "one of the variables")


def _element_sizes(path: Path) -> Iterator[int]:
    """Measure the elements of a MATLAB 5 file; packed ones are unpacked a piece at a time and thrown away."""
    with path.open("rb") as file:
        head = file.read(128)
        order = "<" if head[126:128] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, n_bytes = struct.unpack(order + "II", tag)
            end = file.tell() + n_bytes
            yield _unpacked_size(file, n_bytes) if kind == 15 else n_bytes
            file.seek(end)


def _unpacked_size(file: BinaryIO, n_bytes: int) -> int:
    unpack, size = zlib.decompressobj(), 0
    while n_bytes > 0 and (chunk := file.read(min(n_bytes, 1 << 16))):
        n_bytes -= len(chunk)
        while chunk:
            try:
                size += len(unpack.decompress(chunk, 1 << 20))
            except zlib.error as error:
                raise _unreadable(error) from None
            check_size(size / 8, "one of the variables")
            chunk = unpack.unconsumed_tail
    return size


def _arrays(path: Path, names: list[str] | None) -> dict[str, NDArray[Any]]:
    """Load variables (None: all) and name their columns."""
    if names == []:
        return {}
    try:
        content = scipy.io.loadmat(path, simplify_cells=True, variable_names=names)
    except Exception as error:  # as in `_claims`
        raise _unreadable(error) from None
    return {
        column: array
        for name, value in content.items()
        if not name.startswith("__")
        for column, array in _columns(name, value)
    }


def _columns(name: str, value: object) -> Iterator[tuple[str, NDArray[Any]]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _columns(f"{name}.{key}", inner)
        return
    if isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype.kind == "O"):
        for k, inner in enumerate(list(np.ravel(np.array(value, object)))[:MAX_ELEMENTS]):
            yield from _columns(f"{name}({k + 1})" if isinstance(inner, Mapping) else f"{name}{{{k + 1}}}", inner)
        return
    array = np.atleast_1d(np.asarray(value))
    if array.ndim > 2 or array.dtype.kind not in "fiub" or array.size < 2:
        return
    if array.ndim == 1 or 1 in array.shape:
        yield name, array.ravel()
    else:
        yield from ((f"{name}(:,{j + 1})", array[:, j]) for j in range(array.shape[1]))


def read_hdf5(path: Path, wanted: Iterable[str], *, is_matlab: bool = False) -> Table:
    """Read the wanted columns of an HDF5 file; MATLAB writes matrices transposed.

    Raises
    ------
    StudyError
        If h5py is missing, the file is none, or a dataset claims more than fits into memory.
    """
    try:
        import h5py  # pyright: ignore[reportMissingImports]
    except ImportError:
        kind = "MATLAB 7.3 (HDF5)" if is_matlab else "HDF5"
        raise StudyError(
            f"the file is {kind}, which needs h5py: pip install 'cartpend-dae[hdf5]', or save it with '-v7'."
        ) from None
    try:
        with h5py.File(path, "r") as file:
            places = dict(_Hdf5(h5py, file, is_matlab).places(file))
            found = located(wanted, places)
            columns = {name: _dataset(places[full], full, is_matlab=is_matlab) for name, full in found.items()}
            units = {name: unit for name, full in found.items() if (unit := _hdf5_unit(places[full].dataset, full))}
    except (OSError, RuntimeError, ValueError, KeyError) as error:  # what h5py raises for damaged files
        kind = "a MATLAB" if is_matlab else "an HDF5"
        clause = " ".join(str(error).split()).rstrip(".")
        raise StudyError(f"the file is not {kind} file that can be read: {clause}; save it again.") from None
    return Table(columns, tuple(places), units)


@dataclass(frozen=True, slots=True)
class _Hdf5:
    """An open HDF5 file and the module that reads it, which is optional."""

    h5py: Any
    file: "File"
    is_matlab: bool

    def places(self, group: "Group", prefix: str = "") -> Iterator[tuple[str, _Place]]:
        """Name all columns of a group; links to other files are not followed."""
        if prefix.count(".") + prefix.count("(") + prefix.count("{") > MAX_DEPTH:
            return
        for name in map(str, group):
            link = group.get(name, getlink=True)
            if name.startswith("#") or isinstance(link, self.h5py.ExternalLink | self.h5py.SoftLink):
                continue
            item: Any = group[name]
            if isinstance(item, self.h5py.Group):
                yield from self.places(item, f"{prefix}{name}.")
            elif isinstance(item, self.h5py.Dataset):
                yield from self._columns(item, prefix + name)

    def _columns(self, item: "Dataset", name: str) -> Iterator[tuple[str, _Place]]:
        if item.external or item.is_virtual:
            return
        if (
            item.dtype.kind == "O"
            and (item.size or 0) <= MAX_ELEMENTS
            and name.count("(") + name.count("{") < MAX_DEPTH
        ):
            for k, reference in enumerate(np.ravel(item[()])):
                inner: Any = self.file[reference] if isinstance(reference, self.h5py.Reference) and reference else None
                if isinstance(inner, self.h5py.Group):
                    yield from self.places(inner, f"{name}({k + 1}).")
                elif inner is not None:
                    yield from self._columns(inner, f"{name}{{{k + 1}}}")
        elif item.dtype.kind in "fiub" and item.attrs.get("MATLAB_class") != b"char" and (item.size or 0) > 1:
            shape = (item.shape or ())[::-1] if self.is_matlab else item.shape
            if len(shape) == 1 or (len(shape) == 2 and 1 in shape):
                yield name, _Place(item, None)
            elif len(shape) == 2:
                yield from ((f"{name}(:,{j + 1})", _Place(item, j)) for j in range(min(shape[1], MAX_ELEMENTS)))


def _dataset(place: _Place, name: str, *, is_matlab: bool) -> NDArray[Any]:
    item, j = place.dataset, place.column
    n_values = item.size if j is None else item.shape[1 if is_matlab else 0]
    check_size(n_values, f"`{name}` ({'x'.join(map(str, item.shape))})")
    return np.ravel(item[()] if j is None else item[j] if is_matlab else item[:, j])


def _hdf5_unit(item: "Dataset", name: str) -> str | None:
    for key in ("unit", "units"):
        text = item.attrs.get(key)
        if isinstance(text, bytes):
            text = text.decode("utf-8", errors="replace")
        if isinstance(text, str) and (unit := readable_unit(text)):
            return unit
    return split_unit(name)[1]
