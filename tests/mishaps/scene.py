"""A small study, commands in processes that can be killed, and what their results are but for the time they took."""

import json
import logging
import os
import re
import sys
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

from cartpend_dae import cli
from cartpend_dae.demo import make_demo

FEW = '\n[discover]\ninclude = ["coulomb_friction", "constant_load", "quadratic_drag"]\n'


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code (negative: the signal), what it printed, how long it took."""

    code: int
    stdout: str
    stderr: str
    seconds: float


@dataclass(frozen=True)
class Row:
    """A row of the fault table: what was done, how often, what was found, and in how many cases something was lost."""

    fault: str
    done: str
    times: int
    found: str
    lost: int


def small_study(folder: Path, seconds: float = 2.0) -> Path:
    """Make the demonstration with short logs and few effects: a discovery of some seconds."""
    study = make_demo(folder)
    for log in folder.glob("*.csv"):
        lines = log.read_text("utf-8").splitlines(keepends=True)
        log.write_text("".join(lines[: 2 + round(100 * seconds)]), "utf-8")
    study.write_text(study.read_text("utf-8") + FEW, "utf-8")
    return study


def begun(log: Path, *arguments: object, setup=lambda: None) -> int:
    """Start a command in a fork, which has everything imported already; return its process id."""
    sys.stdout.flush()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads of numpy's, which the fork does without
        pid = os.fork()
    if pid:
        return pid
    code = 70
    try:
        os.setsid()
        for stream, number in (("out", 1), ("err", 2)):
            file = os.open(log.with_suffix(f".{stream}"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, number)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        logging.getLogger().handlers.clear()  # those of pytest, which a command of its own process has not
        setup()
        cli.main([str(argument) for argument in arguments])
        code = 0
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def ended(pid: int, log: Path, begin: float) -> Ended:
    """Wait for a command."""
    _, status = os.waitpid(pid, 0)
    texts = [log.with_suffix(f".{stream}").read_text("utf-8", errors="replace") for stream in ("out", "err")]
    return Ended(os.waitstatus_to_exitcode(status), *texts, time.monotonic() - begin)


def run(log: Path, *arguments: object, setup=lambda: None) -> Ended:
    """Run a command to its end."""
    begin = time.monotonic()
    return ended(begun(log, *arguments, setup=setup), log, begin)


def is_a_sentence(found: Ended, code: int, pattern: str) -> bool:
    """Return whether a command ended in one sentence with an exit code."""
    said = " ".join(found.stderr.split())  # a console breaks long lines
    return found.code == code and "Traceback" not in said and bool(re.search(pattern, said))


def content(folder: Path) -> dict[str, object]:
    """Return all results in a folder, but for what depends on time and place."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        if path.name == "result.json":
            result = json.loads(path.read_text("utf-8"))
            for key in ("seconds", "study", "command_line"):
                result.pop(key, None)
            found[str(path.relative_to(folder))] = result
        elif path.suffix in (".csv", ".py"):
            found[str(path.relative_to(folder))] = path.read_bytes()
        elif path.is_file():
            found[str(path.relative_to(folder))] = "there"
    return found
