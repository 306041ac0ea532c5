"""What a report says of a stored result: sentences, and rows of tables with the places of their marks in percent."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from scipy.stats import beta

from cartpend_dae.report.text import effect_name, for_people, uncertain, with_unit

Json = dict[str, Any]

VERDICTS: dict[str | None, str] = {
    "explained": "explained",
    "improved": "improved, not all explained",
    "no-discrepancy": "nothing is missing",
    "unexplained": "not explained",
    None: "calibrated",
}
ROLES = {"train": "used for the fit", "select": "used to choose", "test": "never seen by the fit"}


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
        is_open = result["gate"]["final"]["is_more_than_noise"]
        return [Words(f"{model} is calibrated, {'but does not explain' if is_open else 'and explains'} its data.")]
    return [Words(result["message"])]


def summary(result: Json) -> list[str]:
    """Return what follows the verdict: what was fitted, and what is left."""
    gate = result["gate"]
    z, limit = gate["final"]["largest"], gate["limit"]
    kind = "innovations" if result.get("bandwidth") else "residuals"
    left = "still more than noise" if gate["final"]["is_more_than_noise"] else "no more than noise"
    found = ["The search was interrupted; this is the best so far."] if result.get("interrupted") else []
    if result["command"] == "discover" and not result["steps"]:
        return [*found, result["message"]]
    found.append(f"The {kind} that are left are {left}: z = {number(z)}, where {limit:g} is the limit.")
    if result["command"] == "identify" and gate["final"]["is_more_than_noise"]:
        found.append("`cartpend discover` looks for what the model lacks.")
    return found


def error_rows(result: Json) -> list[ErrorRow]:
    """Return the errors of all outputs on all runs, and the scores of the study."""
    before, after = result["baseline"], result["final"]
    has_after = bool(result["steps"])
    rows = []
    for run, head in before["experiments"].items():
        for name, error in head["outputs"].items():
            last = after["experiments"][run]["outputs"][name]
            factor, unit = for_people(error["unit"])
            more, unit = prefixed(unit, factor * error["rmse"])
            factor, noise = factor * more, error.get("noise_sd")
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


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with so many digits; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    if 10**digits <= abs(value) < 1e7:
        text = f"{value:,.0f}".replace(",", "\u202f") if abs(value) >= 10_000 else f"{value:.0f}"
    else:
        text = f"{value:.{digits}g}"
    mantissa, _, exponent = text.replace("-", "−").partition("e")
    return f"{mantissa}·10{_raised(exponent)}" if exponent else mantissa


def _raised(exponent: str) -> str:
    """Write an exponent such as −05 above the line."""
    sign = "⁻" if exponent.startswith("−") else ""
    return sign + exponent.lstrip("+−0").translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))


PREFIXES = ((1e3, "m"), (1e6, "µ"), (1e9, "n"))
PLAIN = ("1", "%", "deg", "rad", "kg", "g", "K")


def prefixed(unit: str, largest: float) -> tuple[float, str]:
    """Return the factor and the unit with a prefix that make a small number easy to read."""
    if unit.startswith(PLAIN) or not 0 < largest < 0.01:
        return 1.0, unit
    factor, prefix = next((pair for pair in PREFIXES if largest * pair[0] >= 0.1), PREFIXES[-1])
    return factor, prefix + unit


def percent(value: float | None) -> str:
    """Write a share as percent."""
    return "–" if value is None else f"{number(100 * value)} %"


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
    text = f"{100 * change / abs(before['value']):+.3g} %" if before["value"] else f"{change:+.3g}"
    sd = math.hypot(before["sd"] or 0.0, after["sd"] or 0.0)
    return f"{text.replace('-', '−')}, {abs(change) / sd:.2g} sd" if sd > 0 else text.replace("-", "−")


def effect(step: Json) -> str:
    """Name an addition and its place."""
    return f"{effect_name(step['effect']).removeprefix('a ')} at {step['at']}"


def gain_label(result: Json) -> str:
    """Say what the score of a candidate is."""
    return "drop of BIC" if result.get("regime") == "noise" else "% of the cost explained"


def gain_text(result: Json, gain: float) -> str:
    """Say what a gain means."""
    if result.get("regime") == "noise":
        return f"the Bayesian information criterion falls by {number(gain, 4)}"
    return f"it explains {number(gain)} % of the cross-validated cost"


@dataclass(frozen=True, slots=True)
class Bar:
    """A value with the length of its bar [%]."""

    label: str
    text: str
    length: float
    is_accepted: bool = False
    note: str = ""


def place_bars(result: Json) -> list[Bar]:
    """Return the evidence of each place, the accepted ones marked."""
    accepted = {step["at"] for step in result["steps"]}
    tried: dict[str, list[Json]] = {}
    for candidate in result["candidates"]:
        tried.setdefault(candidate["at"], []).append(candidate)
    top = max([place["evidence"] for place in result["places"]] + [1e-300])
    bars = []
    for place in result["places"]:
        at, evidence = place["at"], place["evidence"]
        fitted = [c for c in tried.get(at, ()) if c.get("was_fitted")]
        text = number(evidence, 4) if fitted else "none fitted"
        note = f"{len(tried.get(at, ()))} looked at, {len(fitted)} fitted"
        bars.append(Bar(at, text, max(0.0, 100 * evidence / top), at in accepted, note))
    return bars


@dataclass(frozen=True, slots=True)
class CandidateRow:
    """A candidate of the table."""

    effect: str
    at: str
    gain: str
    predicted: str
    why_not: str
    parameters: str
    length: float
    is_fitted: bool


def candidate_rows(result: Json) -> list[CandidateRow]:
    """Return what was tried."""
    top = max([c["score"] for c in result["candidates"] if c.get("was_fitted")] + [1e-300])
    return [
        CandidateRow(
            effect=effect_name(c["effect"]).removeprefix("a "),
            at=c["at"],
            gain=number(c["score"], 4) if c.get("was_fitted") else "–",
            predicted=number(c.get("predicted")),
            why_not=c["why_not"],
            parameters=", ".join(
                f"{name.rpartition('.')[2]} = {number(value)}" for name, value in c.get("parameters", {}).items()
            ),
            length=max(0.0, 100 * c["score"] / top) if c.get("was_fitted") else 0.0,
            is_fitted=bool(c.get("was_fitted")),
        )
        for c in result["candidates"]
    ]


def alias_bars(result: Json, step: Json) -> list[Bar]:
    """Return what the runs cannot tell from an addition, with how much of its gain each reaches."""
    gains = {f"{c['effect']} at {c['at']}": c["score"] for c in result["candidates"] if c.get("was_fitted")}
    own = gains.get(f"{step['effect']} at {step['at']}") or step["evidence"].get("gain") or 0.0
    bars = []
    for alias in step["aliases"]:
        effect, _, at = alias.partition(" at ")
        label = f"{effect_name(effect).removeprefix('a ')} at {at}" if at else alias
        share = gains[alias] / own if alias in gains and own > 0 else None
        text = "moves the data alike" if share is None else f"{percent(share)} of the gain"
        bars.append(Bar(label, text, 0.0 if share is None else max(0.0, min(100.0, 100 * share))))
    return bars


def confidence(result: Json) -> list[tuple[str, str]]:
    """Return what the verdict rests on, as pairs of a question and its answer."""
    found = []
    for step in result["steps"]:
        name, evidence = effect_name(step["effect"]).removeprefix("a "), step["evidence"]
        if evidence.get("gain") is not None:
            found.append((f"Evidence for {name}", gain_text(result, evidence["gain"])))
        sizes = (
            f"{parameter.rpartition('.')[2]} = {with_unit(uncertain(e['value'], e['sd']), e['unit'])}"
            for parameter, e in step["parameters"].items()
        )
        found.append((f"Size of {name}", ", ".join(sizes)))
    if rival := _rival(result):
        found.append(rival)
    return found


def _rival(result: Json) -> tuple[str, str] | None:
    """Say how far the best candidate that was not taken is behind."""
    steps = result["steps"]
    fitted = [c for c in result["candidates"] if c.get("was_fitted") and c["why_not"]]
    if not steps or not fitted:
        return None
    best = max(fitted, key=lambda c: c["score"])
    gap = (steps[-1]["evidence"].get("gain") or 0.0) - best["score"]
    name = f"{effect_name(best['effect']).removeprefix('a ')} at {best['at']}"
    what = "of BIC" if result.get("regime") == "noise" else "% of the cost"
    why = best["why_not"].replace("`", "")
    return "Next best", f"{name}, {number(abs(gap))} {what} {'behind' if gap >= 0 else f'ahead, but {why}'}"


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


def rate_bars(result: Json) -> list[Bar]:
    """Return how often the search was wrong, and right, on data made from its outcome."""
    bars = []
    for rate in result.get("rates", ()):
        n, hits, removed = rate["n"], rate["hits"], rate["removed"]
        if not n:
            continue
        low = beta.ppf(0.025, hits, n - hits + 1) if hits else 0.0
        high = beta.ppf(0.975, hits + 1, n - hits) if hits < n else 1.0
        label = "Placebo: added where nothing is missing" if removed is None else f"Power: {removed} found again"
        note = f"95 %: {number(100 * low, 2)} to {number(100 * high, 2)} %"
        bars.append(Bar(label, f"{hits} of {n}", 100 * hits / n, removed is not None, note))
    return bars


def ledger_lines(result: Json) -> list[str]:
    """Return what was done, in its order."""
    candidates = result["candidates"]
    fitted = sum(bool(c.get("was_fitted")) for c in candidates)
    runs = result["baseline"]["experiments"]
    by_role = {role: [name for name, head in runs.items() if head["role"] == role] for role in ROLES}
    gate = result["gate"]
    found = [
        f"The model as it was is fitted on {listed(by_role['train'])}; structure left: z = "
        f"{number(gate['baseline']['largest'])} (limit {gate['limit']:g})."
    ]
    if candidates:
        found.append(f"{len(candidates)} candidates are looked at, {fitted} of them fitted.")
    for step in result["steps"]:
        left = step["evidence"].get("largest_z_left")
        found.append(f"{_capital(effect(step))} is added; z = {number(left)} is left.")
    if by_role["select"]:
        found.append(f"{listed(by_role['select'])} chose between candidates.")
    if by_role["test"]:
        found.append(f"{listed(by_role['test'])} was opened once, at the end, for the errors on this page.")
    else:
        found.append("There is no test run: the errors are those of runs that the fit knew.")
    return found


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def listed(names: Iterable[str]) -> str:
    """Join names by commas and an `and`."""
    every = list(names)
    return every[0] if len(every) == 1 else f"{', '.join(every[:-1])} and {every[-1]}" if every else "no run"
