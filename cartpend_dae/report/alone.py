"""One run at a time in a folder of results: a file that the system locks for as long as the process lives."""

import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cartpend_dae.errors import StudyError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

RUNNING = ".running"


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Have a folder to oneself; it is made if missing, and removed again if nothing came into it.

    A lock of a process that was killed is none any more, and what it had written half is removed.

    Raises
    ------
    StudyError
        If another process, of this machine or one that shares the disk, works there, or it cannot be written to.
    """
    is_new = not folder.is_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        number = _locked(folder)
    except OSError as error:
        raise StudyError(f"{folder}: this folder cannot be written to: {error.strerror or error}.") from None
    try:
        for rest in folder.glob(".*.partial-*"):
            rest.unlink() if rest.is_file() else shutil.rmtree(rest, ignore_errors=True)
        yield
    finally:
        with suppress(OSError):
            (folder / RUNNING).unlink()
        os.close(number)
        with suppress(OSError):
            if is_new:
                folder.rmdir()  # if it is empty


def _locked(folder: Path) -> int:
    """Return the descriptor of the locked file."""
    path = folder / RUNNING
    while True:
        number = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        holder = ""
        try:
            holder = os.read(number, 200).decode("utf-8", errors="replace").strip()
            if fcntl is not None:
                fcntl.lockf(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not _is_same(number, path):
                os.close(number)  # the one before has just ended, and removed it
                continue
            os.ftruncate(number, 0)
            os.lseek(number, 0, os.SEEK_SET)
            os.write(number, f"process {os.getpid()} on {socket.gethostname()}".encode())
        except (BlockingIOError, PermissionError):
            os.close(number)
            raise StudyError(
                f"{folder}: another run is at work in this folder ({holder or 'it has just begun'}); wait for its end, "
                "or choose another folder by `--out`."
            ) from None
        except BaseException:
            os.close(number)
            raise
        return number


def _is_same(number: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(number), os.stat(path))
    except FileNotFoundError:
        return False
