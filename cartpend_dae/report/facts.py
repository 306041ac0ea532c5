"""What a report says of a stored result: sentences, and rows of tables with the places of their marks in percent."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from cartpend_dae.everyday import for_people, uncertain, with_unit
from cartpend_dae.report.numbers import listed, number, prefixed
from cartpend_dae.report.text import CUT_AFTER, effect_name

Json = dict[str, Any]

VERDICTS: dict[str | None, str] = {
    "explained": "explained",
    "improved": "improved, not all explained",
    "no-discrepancy": "nothing is missing",
    "unexplained": "not explained",
    None: "calibrated",
}
ROLES = {"train": "used for the fit", "select": "kept to choose", "test": "never seen by the fit"}


@dataclass(frozen=True, slots=True)
class Words:
    """A piece of a sentence; `is_place` for what the drawing highlights."""

    text: str
    is_place: bool = False


@dataclass(frozen=True, slots=True)
class ErrorRow:
    """The error of an output (or a score of the study) on a run, in everyday units; `after` None: one model only."""

    run: str
    role: str
    what: str
    unit: str
    before: float
    after: float | None
    noise: float | None
    shares: tuple[float | None, float | None]

    @property
    def last(self) -> float:
        """The error of the last model."""
        return self.before if self.after is None else self.after

    @property
    def factor(self) -> float:
        """By how much the error fell; 1 if there is one model only."""
        return self.before / self.last if self.last > 0 else math.inf

    def marks(self) -> dict[str, float]:
        """Return the places of before, after and noise on a logarithmic track [%]."""
        known = {"before": self.before, "after": self.after, "noise": self.noise}
        positive = {name: value for name, value in known.items() if value and value > 0}
        if not positive:
            return {}
        low, high = 0.6 * min(positive.values()), 1.6 * max(positive.values())
        return {name: 100 * math.log(value / low) / math.log(high / low) for name, value in positive.items()}


def headline(result: Json) -> list[Words]:
    """Return the verdict in one sentence."""
    model, steps = result["model"], result["steps"]
    if steps:
        words = [Words(f"{model} lacked ")]
        for k, step in enumerate(steps):
            joint = "" if k == 0 else " and " if k == len(steps) - 1 else ", "
            words += [Words(f"{joint}{effect_name(step['effect'])} at "), Words(step["at"], True)]
        rest = ", and still lacks something." if result["verdict"] == "improved" else "."
        return [*words, Words(rest)]
    if result["verdict"] == "no-discrepancy":
        return [Words(f"{model} explains its data: nothing is missing.")]
    if result["verdict"] == "unexplained":
        return [Words(f"{model} does not explain its data, and no effect of the catalogue could be accepted.")]
    if result["command"] == "identify":
        if result["gate"]["final"]["is_more_than_noise"]:
            return [Words(f"{model} is calibrated, but does not explain its data.")]
        if undetermined(result):
            return [Words(f"{model} explains its data, but these do not determine all of its parameters.")]
        return [Words(f"{model} is calibrated, and explains its data.")]
    return [Words(result["message"])]


def is_good(result: Json) -> bool:
    """Tell whether nothing is left open: no structure in the residuals, and every estimate determined."""
    return not result["gate"]["final"]["is_more_than_noise"] and not undetermined(result)


def undetermined(result: Json) -> list[str]:
    """Return the estimates of the last model that the data do not determine."""
    entries = result["final"]["parameters"].items()
    return [name for name, entry in entries if entry["status"] == "unidentifiable"]


def summary(result: Json) -> list[str]:
    """Return what follows the verdict: what was fitted, and what is left."""
    gate = result["gate"]
    z, limit = gate["final"]["largest"], gate["limit"]
    kind = "innovations" if result.get("bandwidth") else "residuals"
    left = "still more than noise" if gate["final"]["is_more_than_noise"] else "no more than noise"
    is_cut_after = result.get("beyond_interrupted", False)
    is_cut = result.get("interrupted") and not is_cut_after
    found = ["The search was interrupted; this is the best so far."] if is_cut else []
    if result["command"] == "discover" and not result["steps"]:
        return [*found, result["message"]]
    found += [CUT_AFTER] if is_cut_after else []
    found.append(f"The {kind} that are left are {left}: z = {number(z)}, where {limit:g} is the limit.")
    if names := undetermined(result):
        found.append(f"These runs do not determine {listed(names)}: other values explain them as well.")
    if result["command"] == "identify" and gate["final"]["is_more_than_noise"]:
        found.append("`cartpend discover` looks for what the model lacks.")
    return found


def error_rows(result: Json) -> list[ErrorRow]:
    """Return the errors of all outputs on all runs, and the scores of the study."""
    before, after = result["baseline"], result["final"]
    has_after = bool(result["steps"])
    rows, scales = [], _scales(before["experiments"])
    for run, head in before["experiments"].items():
        for name, error in head["outputs"].items():
            last = after["experiments"][run]["outputs"][name]
            (factor, unit), noise = scales[name], error.get("noise_sd")
            rows.append(
                ErrorRow(
                    run,
                    head["role"],
                    name,
                    unit,
                    factor * error["rmse"],
                    factor * last["rmse"] if has_after else None,
                    None if noise is None else factor * noise,
                    (error["nrmse"], last["nrmse"] if has_after else None),
                )
            )
    return rows


def _scales(experiments: Json) -> dict[str, tuple[float, str]]:
    """Return factor and unit of each output, the same on all runs, so that their errors can be compared."""
    units: dict[str, str] = {}
    least: dict[str, float] = {}
    for head in experiments.values():
        for name, error in head["outputs"].items():
            units[name] = error["unit"]
            least[name] = min(error["rmse"], least.get(name, math.inf))
    scales = {}
    for name, given in units.items():
        factor, unit = for_people(given)
        more, unit = prefixed(unit, factor * least[name])
        scales[name] = factor * more, unit
    return scales


def score_rows(result: Json) -> list[ErrorRow]:
    """Return the scores that the study defines, in percent."""
    rows = []
    for score, values in result["baseline"]["scores"].items():
        for run, value in values.items():
            last = result["final"]["scores"][score][run]
            role = result["baseline"]["experiments"][run]["role"]
            if value is not None and last is not None:
                after = 100 * last if result["steps"] else None
                rows.append(ErrorRow(run, role, score, "%", 100 * value, after, None, (None, None)))
    return rows


def deciding(rows: Sequence[ErrorRow]) -> list[ErrorRow]:
    """Return the rows of the test runs; where there are none those of selection, else all."""
    for role in ("test", "select"):
        if found := [row for row in rows if row.role == role]:
            return found
    return list(rows)


@dataclass(frozen=True, slots=True)
class Interval:
    """A value and its interval of 95 % on the track of its row [%], and in words."""

    moment: str
    text: str
    low: float
    middle: float
    high: float


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """A parameter before and after; `moved` says by how much."""

    name: str
    unit: str
    intervals: tuple[Interval, ...]
    moved: str
    status: str
    is_new: bool


STATUS = {
    "ok": "",
    "at-bound": "on its bound",
    "unidentifiable": "the data do not determine it",
    "fixed": "fixed",
}


def parameter_rows(result: Json) -> list[ParameterRow]:
    """Return all parameters that were estimated or fixed, those that were added first."""
    before, after = result["baseline"]["parameters"], result["final"]["parameters"]
    names = sorted(after, key=lambda name: (name in before, after[name]["status"] == "fixed"))
    return [_parameter_row(name, before.get(name), after[name], bool(result["steps"])) for name in names]


def _parameter_row(name: str, before: Json | None, after: Json, has_after: bool) -> ParameterRow:
    entries = [("before", before)] * (before is not None and has_after) + [("after" if has_after else "fit", after)]
    ends = [end for _, e in entries for end in (*(e.get("interval") or ()), e["value"]) if end is not None]  # type: ignore[index]
    low, high = min(ends), max(ends)
    margin = 0.08 * (high - low) or abs(high) or 1.0
    span = high - low + 2 * margin

    def at(value: float | None, otherwise: float) -> float:
        return 100 * ((otherwise if value is None else value) - low + margin) / span

    intervals = []
    for moment, entry in entries:
        assert entry is not None
        value = entry["value"]
        ends = entry.get("interval") or (None, None)
        text = uncertain(value, entry["sd"])
        intervals.append(Interval(moment, text, at(ends[0], value), at(value, value), at(ends[1], value)))
    return ParameterRow(
        name=name,
        unit="" if after["unit"] == "1" else after["unit"],
        intervals=tuple(intervals),
        moved=_moved(before, after) if has_after else "",
        status=STATUS.get(after["status"]) or "",
        is_new=before is None,
    )


def _moved(before: Json | None, after: Json) -> str:
    if before is None:
        return "new"
    change = after["value"] - before["value"]
    if after["status"] == "fixed" or change == 0:
        return "unchanged"
    joint = "\N{NO-BREAK SPACE}"  # in a narrow column a number keeps its unit
    text = f"{100 * change / abs(before['value']):+.3g}{joint}%" if before["value"] else f"{change:+.3g}"
    sd = math.hypot(before["sd"] or 0.0, after["sd"] or 0.0)
    return f"{text.replace('-', '−')}, {abs(change) / sd:.2g}{joint}sd" if sd > 0 else text.replace("-", "−")


def estimates(result: Json) -> list[tuple[str, str]]:
    """Return the estimated parameters of the last model with their values."""
    entries = result["final"]["parameters"].items()
    return [
        (
            name,
            with_unit(uncertain(e["value"], e["sd"]), e["unit"])
            + (f" ({why})" if (why := STATUS[e["status"]]) else ""),
        )
        for name, e in entries
        if e["status"] != "fixed"
    ]
