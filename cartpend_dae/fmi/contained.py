"""Running the code of an FMU in a process of its own: a crash or an endless loop there is reported, not suffered.

The answer comes back as JSON and plain arrays, which carry no code. It is no sandbox: what runs there may do all that
the user may do.
"""

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from cartpend_dae.errors import SolverError, StudyError

SHOWN = 400
# Python itself may take so long to start on a busy machine [s]; the limit of a task counts from there
START, PAUSE = 600.0, 0.02


def contained(task: str, arguments: dict[str, Any], *, limit: float, label: str) -> dict[str, Any]:
    """Carry out a task of `fmi.child` in a process of its own.

    Parameters
    ----------
    task, arguments
        Name of the task, and what it needs, as plain data and arrays.
    limit
        Seconds after which the process is ended, without the start of Python.
    label
        The FMU, for messages.

    Returns
    -------
    dict
        What the task returned; arrays by name under `arrays`, the seconds it took under `seconds`.

    Raises
    ------
    SolverError
        If the process crashed, took too long, or the task failed.
    """
    with tempfile.TemporaryDirectory(prefix="cartpend-run-") as name:
        folder = Path(name)
        arrays = {key: value for key, value in arguments.items() if isinstance(value, np.ndarray)}
        np.savez(folder / "given.npz", allow_pickle=False, **arrays)
        plain = {key: value for key, value in arguments.items() if key not in arrays}
        (folder / "task.json").write_text(json.dumps({"task": task, "arguments": plain}), "utf-8")
        begin = time.monotonic()
        code = _run(folder, limit, label)
        answer = _answer(folder, code, label)
        answer["seconds"] = time.monotonic() - begin
        return answer


def _run(folder: Path, limit: float, label: str) -> int:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with open(folder / "said.txt", "wb") as said:
        child = subprocess.Popen(
            [sys.executable, "-m", "cartpend_dae.fmi.child", str(folder)],
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env=environment,
            start_new_session=True,
            preexec_fn=_bounded if os.name == "posix" else None,
        )
        try:
            return _waited(child, folder, limit)
        except subprocess.TimeoutExpired:
            _end(child)
            raise SolverError(
                f"{label}: the FMU was ended after {limit:g} s while it had to {_stage(folder)}; its own code loops, "
                f"or the run needs a longer `limit`."
            ) from None
        except BaseException:
            _end(child)
            raise


def _waited(child: "subprocess.Popen[bytes]", folder: Path, limit: float) -> int:
    begin = time.monotonic()
    while not (folder / "stage.txt").exists() and time.monotonic() - begin < START:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return child.wait(timeout=PAUSE)
    return child.wait(timeout=limit)


def _end(child: "subprocess.Popen[bytes]") -> None:
    with contextlib.suppress(ProcessLookupError):
        if os.name == "posix":
            os.killpg(child.pid, signal.SIGKILL)
        else:
            child.kill()
    child.wait()


def _bounded() -> None:
    """Let the process leave no core, and no file larger than 4 GB."""
    resource: Any = importlib.import_module("resource")  # Windows has no such module
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_FSIZE, (4 << 30, 4 << 30))


def _stage(folder: Path) -> str:
    with contextlib.suppress(OSError):
        return (folder / "stage.txt").read_text("utf-8", errors="replace")[:SHOWN] or "start"
    return "start"


def said_by(folder: Path) -> str:
    """Return the last words of the process, in one line."""
    with contextlib.suppress(OSError):
        text = (folder / "said.txt").read_bytes()[-4 * SHOWN :].decode(errors="replace")
        return " ".join(text.split())[-SHOWN:]
    return ""


def _answer(folder: Path, code: int, label: str) -> dict[str, Any]:
    words = said_by(folder)
    said = f" Its last words: {words}" if words else ""
    if code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        raise SolverError(f"{label}: the FMU crashed ({name}) while it had to {_stage(folder)}.{said}")
    try:
        answer = json.loads((folder / "answer.json").read_text("utf-8"))
    except (OSError, ValueError):
        raise SolverError(
            f"{label}: the process of the FMU ended with code {code} and no answer while it had to "
            f"{_stage(folder)}.{said}"
        ) from None
    if "error" in answer:
        wrong = StudyError if answer.get("kind") == "input" else SolverError
        raise wrong(answer["error"])
    with np.load(folder / "arrays.npz", allow_pickle=False) as found:
        answer["arrays"] = {key: found[key] for key in found.files}
    return answer
