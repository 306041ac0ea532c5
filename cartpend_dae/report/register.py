"""The table of a fleet of studies: what became of each, as a file that the next run can take up."""

import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from cartpend_dae.errors import CutOffError
from cartpend_dae.report.files import RESULT

FLEET = "fleet.json"


@dataclass(frozen=True, slots=True)
class Row:
    """What became of a study: it was `done`, its result of before was `kept`, or it `failed`, as `message` says.

    `before` and `after` are the largest normalised errors of an output on the test runs, or on all where there is none;
    `digest` is the content of all that the result depends on.
    """

    study: str
    folder: str
    state: Literal["done", "kept", "failed"]
    verdict: str = ""
    effects: tuple[str, ...] = ()
    before: float | None = None
    after: float | None = None
    seconds: float = 0.0
    message: str = ""
    digest: str = ""


@dataclass(slots=True)
class Table:
    """The rows so far, by folder below `out`; `before` are those of an earlier run."""

    out: Path
    told: Callable[[Row], None]
    before: dict[str, Row] = field(default_factory=dict)
    rows: dict[str, Row] = field(default_factory=dict)

    def has(self, row: Row) -> bool:
        """Return whether an earlier run did the same; its row is taken over."""
        old = self.before.get(row.folder)
        if old is None or old.state == "failed" or old.digest != row.digest:
            return False
        if not (self.out / row.folder / RESULT).is_file():
            return False
        self.add(replace(old, study=row.study, state="kept"))
        return True

    def add(self, row: Row) -> None:
        """Take in a row, and write the table.

        Raises
        ------
        CutOffError
            If it cannot be written.
        """
        self.rows[row.folder] = row
        path = self.out / FLEET
        partial = path.with_name(f".{FLEET}.partial-{os.getpid()}")
        rows = [asdict(other) for other in {**self.before, **self.rows}.values()]
        try:
            partial.write_text(json.dumps({"schema": 1, "command": "fleet", "studies": rows}, indent=2), "utf-8")
            os.replace(partial, path)
        except OSError as error:
            raise CutOffError(
                f"{path}: the table cannot be written: {error.strerror or error}; make room, and go on by `--resume`."
            ) from None
        self.told(row)


def known_rows(out: Path) -> tuple[Row, ...]:
    """Return the rows of an earlier run; none if there was none, or its table was damaged."""
    try:
        table = json.loads((out / FLEET).read_text("utf-8"))
        return tuple(Row(**{**row, "effects": tuple(row["effects"])}) for row in table["studies"])
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def told_by(row: Row, folder: Path) -> Row:
    """Complete a row from the result in a folder."""
    result = json.loads((folder / RESULT).read_text("utf-8"))
    effects = tuple(f"{step['effect']} at {step['at']}" for step in result.get("steps", ()))
    before, after = (_largest(result.get(moment)) for moment in ("baseline", "final"))
    verdict = result.get("verdict", "fitted")
    return replace(row, verdict=verdict, effects=effects, before=before, after=after, message=result["message"])


def _largest(state: dict[str, Any] | None) -> float | None:
    """Return the largest normalised error on the test runs, or on all runs if there are none."""
    runs = [] if state is None else list(state["experiments"].values())
    tests = [run for run in runs if run["role"] == "test"] or runs
    errors = [output["nrmse"] for run in tests for output in run["outputs"].values() if output["nrmse"] is not None]
    return max(errors, default=None)
