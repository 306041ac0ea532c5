"""A result as it was written to a folder: `result.json`, and the series of its runs."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cartpend_dae.errors import StudyError
from cartpend_dae.everyday import for_people

COMMANDS = ("identify", "discover")


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """What a model says of an output: `values` and `residual`, shape (n,), in everyday units."""

    label: str
    values: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """An output of a run, in everyday units; `sd` is how sure the last model is of it, None where not known."""

    name: str
    unit: str
    noise_sd: float | None
    measured: np.ndarray
    curves: tuple[Curve, ...]
    sd: np.ndarray | None


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A run with its series; `file` is the name of the table that holds them."""

    name: str
    role: str
    score: str
    file: str
    time: np.ndarray
    series: tuple[Series, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """What stands in `result.json`, and the runs whose tables are there."""

    result: dict[str, Any]
    runs: tuple[Run, ...]


def read_stored(folder: Path) -> Stored:
    """Read a result from the folder that it was written to.

    Raises
    ------
    StudyError
        If there is no result, it is none of `identify` or `discover`, or a table does not fit it.
    """
    path = folder / "result.json"
    try:
        result = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise StudyError(
            f"{path}: {error.strerror or error}; name a folder that `cartpend identify` or `discover` wrote to."
        ) from None
    except ValueError as error:
        raise StudyError(f"{path}: this is not JSON ({error}); make the result again.") from None
    if not isinstance(result, dict) or result.get("schema") != 1 or result.get("command") not in COMMANDS:
        raise StudyError(f"{path}: this is no result of `cartpend identify` or `cartpend discover` (schema 1).")
    try:
        files = result.get("files", {}).get("runs", {})
        if outside := [file for file in files.values() if Path(file).name != file]:
            raise StudyError(f"{path}: `{outside[0]}` is no file of this folder; make the result again.")
        return Stored(result, tuple(_run(result, name, folder / file) for name, file in files.items()))
    except (KeyError, TypeError, AttributeError) as error:
        raise StudyError(f"{path}: the result is not complete ({error}); make it again.") from None


def _run(result: dict[str, Any], name: str, path: Path) -> Run:
    head = result["baseline"]["experiments"][name]
    try:
        table = pd.read_csv(path)
        time = table["time"].to_numpy(float)
        series = tuple(_series(table, output, entry) for output, entry in head["outputs"].items())
    except OSError as error:
        raise StudyError(f"{path}: {error.strerror or error}; the report needs the tables of all runs.") from None
    except (ValueError, KeyError) as error:
        raise StudyError(f"{path}: this is not the table of the run `{name}`: {error}.") from None
    return Run(name, head["role"], head["score"], path.name, time, series)


def _series(table: pd.DataFrame, output: str, entry: dict[str, Any]) -> Series:
    factor, unit = for_people(entry["unit"])

    def column(what: str) -> np.ndarray:
        return factor * table[f"{output}.{what}"].to_numpy(float)

    if f"{output}.model" in table:
        curves = (Curve("model", column("model"), column("residual")),)
    else:
        curves = tuple(
            Curve(f"model {moment}", column(moment), column(f"residual_{moment}")) for moment in ("before", "after")
        )
    noise = entry.get("noise_sd")
    sd = column("sd") if f"{output}.sd" in table else None
    return Series(output, unit, None if noise is None else factor * noise, column("measured"), curves, sd)
