"""Two results beside each other: what changed from one run of a study to another."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cartpend_dae.errors import StudyError


@dataclass(frozen=True, slots=True)
class Difference:
    """A value in two results; None where one of them lacks it. `distance` is in standard deviations, where known."""

    what: str
    name: str
    unit: str
    first: float | str | None
    second: float | str | None
    distance: float | None = None


def read_result(path: Path) -> dict[str, Any]:
    """Return the result in a folder, or in a result.json itself.

    Raises
    ------
    StudyError
        If there is none, or it is no result of this package.
    """
    file = path / "result.json" if path.is_dir() else path
    try:
        found = json.loads(file.read_text("utf-8"))
    except OSError as error:
        raise StudyError(f"{file}: cannot be read ({error.strerror or error}); name a folder of results.") from None
    except ValueError as error:
        raise StudyError(f"{file}: is no JSON ({error}).") from None
    if not isinstance(found, dict) or not isinstance(found.get("final"), dict) or "parameters" not in found["final"]:
        raise StudyError(f"{file}: is no result of `identify` or `discover`: it holds no final parameters.")
    return found


def differences(first: dict[str, Any], second: dict[str, Any]) -> tuple[Difference, ...]:
    """Return what two results say differently: verdict, effects, parameters, errors of runs."""
    return (*_verdicts(first, second), *_effects(first, second), *_parameters(first, second), *_errors(first, second))


def _verdicts(first: dict[str, Any], second: dict[str, Any]) -> Iterator[Difference]:
    a, b = first.get("verdict"), second.get("verdict")
    if a != b:
        yield Difference("verdict", "", "", a, b)


def _effects(first: dict[str, Any], second: dict[str, Any]) -> Iterator[Difference]:
    a, b = ({f"{step['effect']} at {step['at']}" for step in side.get("steps") or ()} for side in (first, second))
    for name in sorted(a ^ b):
        yield Difference("effect", name, "", "added" if name in a else None, "added" if name in b else None)


def _parameters(first: dict[str, Any], second: dict[str, Any]) -> Iterator[Difference]:
    sides = [result["final"]["parameters"] for result in (first, second)]
    for name in sorted({*sides[0], *sides[1]}):
        a, b = (side.get(name) for side in sides)
        first_value, second_value = (None if entry is None else entry["value"] for entry in (a, b))
        if first_value != second_value:
            yield Difference("parameter", name, (a or b)["unit"], first_value, second_value, _distance(a, b))


def _distance(a: dict[str, Any] | None, b: dict[str, Any] | None) -> float | None:
    """Return how far two estimates are apart over both their standard deviations."""
    if a is None or b is None or a.get("sd") is None or b.get("sd") is None:
        return None
    sd = math.hypot(a["sd"], b["sd"])
    return abs(a["value"] - b["value"]) / sd if sd > 0 else None


def _errors(first: dict[str, Any], second: dict[str, Any]) -> Iterator[Difference]:
    sides = [dict(_errors_of(result)) for result in (first, second)]
    for key in sorted({*sides[0], *sides[1]}):
        (a, unit), (b, other) = (side.get(key, (None, "")) for side in sides)
        if a != b:
            yield Difference("error", f"{key[1]} in {key[0]}", unit or other, a, b)


def _errors_of(result: dict[str, Any]) -> Iterator[tuple[tuple[str, str], tuple[float, str]]]:
    for run, entry in result["final"].get("experiments", {}).items():
        for output, numbers in entry.get("outputs", {}).items():
            if isinstance(numbers, dict) and "rmse" in numbers:
                yield (run, output), (numbers["rmse"], numbers.get("unit", ""))
