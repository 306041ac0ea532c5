"""Opening an FMU file safely: an FMU is a zip that somebody else made, with XML and native code inside.

No path may leave the folder of extraction, sizes and counts are bounded while unpacking (what the file says of itself
is not believed), and XML with a document type is refused before a parser expands anything.
"""

import os
import re
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO
from xml.parsers import expat

from cartpend_dae.errors import StudyError

DESCRIPTION = "modelDescription.xml"
CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of what is unpacked: files, bytes of one and of all, bytes of XML, expansion of what is larger than a MB.

    Deflate reaches 1000 at most; libraries and tables of real FMUs stay below 30.
    """

    files: int = 20_000
    file_bytes: int = 1 << 30
    total_bytes: int = 2 << 30
    xml_bytes: int = 1 << 27
    xml_depth: int = 200
    ratio: float = 200.0
    name_length: int = 400


@contextmanager
def unpacked(path: Path | str, limits: Limits | None = None) -> Iterator[Path]:
    """Yield a folder with the files of an FMU; it is removed afterwards.

    Parameters
    ----------
    path
        An FMU file.
    limits
        Bounds of what is unpacked.

    Raises
    ------
    StudyError
        If there is no such file, it is no zip, breaks the bounds, or holds a path that leads elsewhere.
    """
    folder = Path(tempfile.mkdtemp(prefix="cartpend-fmu-"))
    try:
        unpack(path, folder, limits)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def unpack(path: Path | str, folder: Path, limits: Limits | None = None) -> None:
    """Unpack an FMU into a folder, as `unpacked` does."""
    path, limits = Path(path), limits or Limits()
    if not path.is_file():
        raise StudyError(f"{path}: there is no such file.")
    try:
        with zipfile.ZipFile(path) as archive:
            entries = _entries(path, archive, limits)
            left = limits.total_bytes
            for entry in entries:
                left -= _copy(path, archive, entry, folder, min(left, limits.file_bytes))
    except StudyError:
        raise
    except (zipfile.BadZipFile, EOFError, ValueError, NotImplementedError, RuntimeError, IndexError) as error:
        raise StudyError(f"{path}: this is no FMU, or a damaged one: {_said(error)}.") from None
    except zipfile.LargeZipFile as error:
        raise StudyError(f"{path}: this is no FMU: {_said(error)}.") from None
    except OSError as error:
        raise StudyError(f"{path}: it cannot be read or unpacked: {error.strerror or error}.") from None
    except Exception as error:  # zlib and lzma have errors of their own
        raise StudyError(f"{path}: this is a damaged FMU: {_said(error)}.") from None
    check_description(path, folder, limits)


def _said(error: BaseException) -> str:
    text = " ".join(str(error).split()).rstrip(".")
    return text[:1].lower() + text[1:200] if text else type(error).__name__


def _entries(path: Path, archive: zipfile.ZipFile, limits: Limits) -> list[zipfile.ZipInfo]:
    """Return what is to be unpacked, all of it checked by name, kind and the sizes that the file states."""
    entries = archive.infolist()
    if len(entries) > limits.files:
        raise StudyError(f"{path}: it holds {len(entries)} files, and {limits.files} at most are unpacked.")
    if (total := sum(entry.file_size for entry in entries)) > limits.total_bytes:
        raise StudyError(
            f"{path}: its files would take {total / 1e6:.0f} MB, and {limits.total_bytes / 1e6:.0f} MB at most are "
            f"unpacked."
        )
    seen: dict[str, zipfile.ZipInfo] = {}
    for entry in entries:
        _check_entry(path, entry, limits)
        other = seen.setdefault(entry.filename, entry)
        if (other.CRC, other.file_size) != (entry.CRC, entry.file_size):
            raise StudyError(f"{path}: it holds `{_shown(entry.filename)}` twice, so that nobody knows which is meant.")
    return list(seen.values())


def _check_entry(path: Path, entry: zipfile.ZipInfo, limits: Limits) -> None:
    name = entry.filename
    wrong = wrong_name(entry.orig_filename, limits)
    if wrong:
        raise StudyError(f"{path}: it holds the path `{_shown(entry.orig_filename)}`, which {wrong}; nothing was kept.")
    if stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
        raise StudyError(f"{path}: `{_shown(name)}` in it is a link or a device, and no file; nothing was kept.")
    if entry.flag_bits & 1:
        raise StudyError(f"{path}: `{_shown(name)}` in it is encrypted.")
    if entry.file_size > limits.file_bytes:
        raise StudyError(
            f"{path}: `{_shown(name)}` in it would take {entry.file_size / 1e6:.0f} MB, and "
            f"{limits.file_bytes / 1e6:.0f} MB at most are unpacked."
        )
    if entry.file_size > CHUNK and entry.file_size > limits.ratio * max(entry.compress_size, 1):
        raise StudyError(
            f"{path}: `{_shown(name)}` in it grows {entry.file_size / max(entry.compress_size, 1):.0f} times when "
            f"unpacked ({limits.ratio:.0f} at most): it looks like a zip bomb."
        )


def wrong_name(name: str, limits: Limits | None = None) -> str:
    """Return what is wrong with a path inside an FMU, empty where nothing is."""
    limits = limits or Limits()
    parts = PurePosixPath(name).parts
    if not name or not parts:
        return "is empty"
    if len(name) > limits.name_length or any(len(part.encode(errors="replace")) > 255 for part in parts):
        return f"is {len(name)} characters long"
    if "\\" in name:
        return "has backslashes"
    if name.startswith("/") or re.match(r"[A-Za-z]:", name):
        return "is absolute"
    if ".." in parts:
        return "leads out of the FMU"
    if any(ord(character) < 32 for character in name):
        return "has control characters"
    return ""


def _shown(name: str) -> str:
    text = name.encode("unicode_escape").decode("ascii")
    return text if len(text) <= 80 else f"{text[:60]}...{text[-15:]}"


def _copy(path: Path, archive: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path, most: int) -> int:
    """Unpack one entry, and return its size; stop as soon as it is larger than may be."""
    target = folder.joinpath(*PurePosixPath(entry.filename).parts)
    if entry.is_dir():
        target.mkdir(parents=True, exist_ok=True)
        return 0
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.resolve().is_relative_to(folder.resolve()):
        raise StudyError(f"{path}: the path `{_shown(entry.filename)}` leads out of the FMU; nothing was kept.")
    with archive.open(entry) as source, open(target, "xb") as sink:
        return _pour(path, entry, source, sink, most)


def _pour(path: Path, entry: zipfile.ZipInfo, source: IO[bytes], sink: IO[bytes], most: int) -> int:
    size = 0
    while block := source.read(CHUNK):
        size += len(block)
        if size > most:
            raise StudyError(f"{path}: `{_shown(entry.filename)}` in it grows beyond {most / 1e6:.0f} MB.")
        sink.write(block)
    return size


def check_description(path: Path | str, folder: Path, limits: Limits | None = None) -> None:
    """Refuse an FMU without a model description, or with one that a parser had better not see.

    Parameters
    ----------
    path, folder
        The FMU, and where it was unpacked.
    limits
        Bounds of the XML.

    Raises
    ------
    StudyError
        If it is missing, too long, too deep, no XML, has a document type, or does not say which FMI it follows.
    """
    limits = limits or Limits()
    file = folder / DESCRIPTION
    if not file.is_file():
        raise StudyError(f"{path}: it holds no {DESCRIPTION}, so that it is no FMU.")
    if (size := os.path.getsize(file)) > limits.xml_bytes:
        raise StudyError(f"{path}: its {DESCRIPTION} has {size / 1e6:.0f} MB ({limits.xml_bytes / 1e6:.0f} at most).")
    root, attributes = _root(path, file, limits)
    version = attributes.get("fmiVersion", "")
    if root != "fmiModelDescription":
        raise StudyError(f"{path}: its {DESCRIPTION} is about `{_shown(root)}`, and no fmiModelDescription.")
    if not (version == "2.0" or version.startswith("3.0")):
        raise StudyError(f"{path}: it follows FMI `{_shown(version)}`; FMI 2.0 and 3.0 are read.")


def _root(path: Path | str, file: Path, limits: Limits) -> tuple[str, dict[str, str]]:
    """Read a whole XML file without keeping it, and return the name and attributes of its root."""
    found: list[tuple[str, dict[str, str]]] = []
    parser, depth = expat.ParserCreate(), 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if not found:
            found.append((name, attributes))
        if depth > limits.xml_depth:
            raise StudyError(f"{path}: its {DESCRIPTION} is nested deeper than {limits.xml_depth} elements.")

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    def refuse(*arguments: object) -> int:
        raise StudyError(
            f"{path}: its {DESCRIPTION} has a document type or entities, which no FMU needs and which could make a "
            f"parser read other files; it was not read."
        )

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.ExternalEntityRefHandler = refuse
    try:
        with open(file, "rb") as stream:
            parser.ParseFile(stream)
    except expat.ExpatError as error:
        raise StudyError(f"{path}: its {DESCRIPTION} is no XML: {error}.") from None
    except (ValueError, LookupError) as error:
        raise StudyError(f"{path}: its {DESCRIPTION} cannot be read: {_said(error)}.") from None
    return found[0]
