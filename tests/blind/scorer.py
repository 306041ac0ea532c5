"""Compare what the tool found with the truth."""

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

Named = tuple[str, str]
FOUND_WRONG = "explained"


@dataclass(frozen=True, slots=True)
class Score:
    """How a result compares with the truth.

    `is_first`: the first addition is right; `is_exact`: all hidden effects and nothing else; `n_wrong`: additions
    that are not hidden; `recovered`: (before - after)/(before - floor) of the held-out error, None without an
    error to remove; `is_flagged`: the verdict admits that something is left unexplained; `is_false_claim`: a wrong
    addition with the verdict that all is explained.
    """

    is_first: bool
    is_exact: bool
    n_wrong: int
    n_steps: int
    recovered: float | None
    verdict: str
    is_flagged: bool
    is_false_claim: bool


@cache
def equivalences() -> dict[str, Any]:
    return tomllib.loads((Path(__file__).parent / "equivalences.toml").read_text())


def score(result: Mapping[str, Any], truth: Mapping[str, Any], same: Sequence[Named] = ()) -> Score:
    """Score a result.json against the truth of its data set.

    Parameters
    ----------
    result
        What the tool wrote.
    truth
        What the generator wrote.
    same
        What gives the same data as the hidden effect, in this data set; see `same_data`.
    """
    steps = [(step["effect"], step["at"]) for step in result["steps"]]
    hidden = [(h["effect"], h["at"], h["shape"]) for h in truth["effects"]]
    forms = [*_forms(truth["rig"], hidden), *([(effect, at, "same")] for effect, at in same)]
    matched = max(_matched(truth["rig"], form, steps) for form in forms)
    is_exact = any(len(form) == len(steps) == _matched(truth["rig"], form, steps) for form in forms)
    is_first = bool(steps) and any(_is(truth["rig"], h, steps[0]) for form in forms for h in form)
    verdict = str(result["verdict"])
    n_wrong = len(steps) - matched
    return Score(
        is_first=is_first,
        is_exact=is_exact,
        n_wrong=n_wrong,
        n_steps=len(steps),
        recovered=_recovered(result, truth),
        verdict=verdict,
        is_flagged=verdict in ("unexplained", "improved"),
        is_false_claim=n_wrong > 0 and verdict == FOUND_WRONG,
    )


def _forms(rig: str, hidden: list[tuple[str, str, str]]) -> Iterator[list[tuple[str, str, str]]]:
    """Yield the truth, and the truth with parts taken as the whole that they make, or a whole as its parts."""
    yield hidden
    for entry in equivalences()["parts"]:
        whole = [h for h in hidden if f"{h[0]}@{h[1]}" == entry["whole"] and h[2] in entry["shapes"]]
        if rig in entry["rigs"] and whole:
            parts = [(*part.split("@"), "same") for part in entry["parts"]]
            yield [h for h in hidden if h not in whole] + parts
    for entry in equivalences()["compound"]:
        parts = [tuple(part.split("@")) for part in entry["parts"]]
        names = [(effect, at) for effect, at, _ in hidden]
        if rig in entry["rigs"] and all(part in names for part in parts):
            whole, _, at = entry["whole"].partition("@")
            yield [h for h in hidden if (h[0], h[1]) not in parts] + [(whole, at, "same")]


def _matched(rig: str, hidden: list[tuple[str, str, str]], steps: list[Named]) -> int:
    """Return the largest number of hidden effects that can be given a step each."""
    if not hidden or not steps:
        return 0
    first, rest = hidden[0], hidden[1:]
    best = _matched(rig, rest, steps)
    for k, step in enumerate(steps):
        if _is(rig, first, step):
            best = max(best, 1 + _matched(rig, rest, steps[:k] + steps[k + 1 :]))
    return best


def _is(rig: str, hidden: tuple[str, str, str], step: Named) -> bool:
    """Return whether a step names a hidden effect or its exact equivalent, at the right place."""
    effect, at, shape = hidden
    right = [(effect, at)]
    for entry in equivalences()["also"]:
        if rig in entry["rigs"] and entry["truth"] == f"{effect}@{at}" and shape in entry.get("shapes", [shape]):
            right += [tuple(name.split("@")) for name in entry["effects"]]
    return any(step[0] == name and is_place(rig, name, place, step[1]) for name, place in right)


def is_place(rig: str, effect: str, place: str, at: str) -> bool:
    """Return whether the name `at` in a model is the place of an effect, or cannot be told apart from it."""
    table = equivalences()
    names = table["effect_places"].get(rig, {}).get(effect) if place not in ("bearing", "rail", "chain") else None
    names = names or table["places"][rig][place]
    sensor = place in ("bearing.phi", "encoder.s", "motor.i")
    return any(at == name or (not sensor and at.startswith(f"{name}.") and not _is_output(rig, at)) for name in names)


def _is_output(rig: str, at: str) -> bool:
    return at in table_of_outputs().get(rig, ())


@cache
def table_of_outputs() -> dict[str, tuple[str, ...]]:
    places = equivalences()["places"]
    return {
        rig: tuple(name for name in names if name in ("bearing.phi", "encoder.s", "motor.i"))
        for rig, names in places.items()
    }


def _recovered(result: Mapping[str, Any], truth: Mapping[str, Any]) -> float | None:
    """Return (before - after)/(before - floor), errors of all test runs over the noise of each output."""
    before, after = (_held_out(result[stage]["experiments"], truth) for stage in ("baseline", "final"))
    floor = _mean_square(
        truth["floor"][run][name] / noise
        for run, role in truth["roles"].items()
        if role == "test"
        for name, noise in truth["noise"].items()
    )
    if before is None or after is None or before <= 1.05 * floor:
        return None
    return (before - after) / (before - floor)


def _held_out(experiments: Mapping[str, Any], truth: Mapping[str, Any]) -> float | None:
    errors = [
        entry["rmse"] / truth["noise"][name]
        for run in experiments.values()
        if run["role"] == "test"
        for name, entry in run["outputs"].items()
        if entry["rmse"] is not None
    ]
    return _mean_square(errors) if errors else None


def _mean_square(errors: Any) -> float:
    values = list(errors)
    return math.sqrt(sum(x * x for x in values) / len(values))


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Return the interval of a share after E. B. Wilson, J. Am. Stat. Assoc. 22 (1927), 209-212."""
    if n == 0:
        return 0.0, 1.0
    share, zz = hits / n, z * z / n
    middle = (share + zz / 2) / (1 + zz)
    half = z / (1 + zz) * math.sqrt(share * (1 - share) / n + zz / (4 * n))
    return max(0.0, middle - half), min(1.0, middle + half)
