"""What a report says of a search: evidence, candidates, aliases, rates, and what was done in which order."""

from dataclasses import dataclass
from typing import Any

from scipy.special import betaincinv

from cartpend_dae.everyday import quantity, uncertain, with_unit
from cartpend_dae.report.facts import ROLES
from cartpend_dae.report.numbers import capital, listed, number, percent
from cartpend_dae.report.text import effect_name

Json = dict[str, Any]
CLOSURES = {"spline": "splines", "process": "Gaussian process", "network": "network of six neurons"}
"""What the kinds of closures are called."""


def effect(step: Json) -> str:
    """Name an addition and its place."""
    return f"{effect_name(step['effect']).removeprefix('a ')} at {step['at']}"


def gain_label(result: Json) -> str:
    """Say what the gain of a candidate is."""
    return result.get("gain_label", "gain")


def gain_text(result: Json, gain: float) -> str:
    """Say what a gain means."""
    return f"{number(gain, 4)}, {gain_label(result)}"


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


def richer(step: Json) -> list[str]:
    """Return the names of the laws that contain an addition and explain no more."""
    return [effect_name(name.partition(" at ")[0]).removeprefix("a ") for name in step.get("contained_in", ())]


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
    why = best["why_not"].replace("`", "")
    return "Next best", f"{name}, {number(abs(gap))} {'behind' if gap >= 0 else f'ahead, but {why}'}"


def unknown_bars(result: Json) -> list[Bar]:
    """Return the evidence per place of an unknown force, with the level that a placebo reaches there."""
    places = (result.get("open_set") or {}).get("places", [])
    top = max([place["evidence"] for place in places] + [1e-300])
    return [
        Bar(
            place["at"],
            f"{number(place['evidence'])}" if place["is_seen"] else "not seen",
            max(0.0, 100 * place["evidence"] / top),
            place["at"] == result["open_set"]["at"],
            f"placebo {number(place['placebo'])}, rms {number(place['rms'])} {place['unit']}",
        )
        for place in places
    ]


def share_bars(result: Json) -> list[Bar]:
    """Return what the unknown input at the place where most is left follows: shares of its variance."""
    left = result.get("open_set") or {}
    portrait = next((p for p in left.get("portraits", ()) if p["at"] == left.get("at")), None)
    shares = sorted((portrait or {"shares": {}})["shares"].items(), key=lambda item: -(item[1] or 0.0))
    return [Bar(what, percent(share), max(0.0, min(100.0, 100 * share))) for what, share in shares if share is not None]


@dataclass(frozen=True, slots=True)
class ClosureRow:
    """A law without a name that was trained where something is left."""

    kind: str
    at: str
    gain: str
    z: str


def closure_rows(result: Json) -> list[ClosureRow]:
    """Return the closures, the best first."""
    return [
        ClosureRow(
            CLOSURES.get(kind := str(c["kind"]), kind), c["at"], number(c["gain"], 4), number(c["largest_z_left"], 2)
        )
        for c in (result.get("open_set") or {}).get("closures", ())
    ]


def ceiling_rows(result: Json) -> list[tuple[str, str, str, str, str]]:
    """Return run, role, output, the error of the final model and that with the best closure in it."""
    rows = []
    for run, head in ((result.get("open_set") or {}).get("experiments") or {}).items():
        for name, with_it in head["outputs"].items():
            error = result["final"]["experiments"][run]["outputs"][name]
            both = (quantity(value["rmse"], error["unit"]) for value in (error, with_it))
            rows.append((run, head["role"], name, *both))
    return rows


def rate_bars(result: Json) -> list[Bar]:
    """Return how often the search was wrong, and right, on data made from its outcome."""
    bars = []
    for rate in result.get("rates", ()):
        n, hits, removed = rate["n"], rate["hits"], rate["removed"]
        if not n:
            continue
        low = float(betaincinv(hits, n - hits + 1, 0.025)) if hits else 0.0
        high = float(betaincinv(hits + 1, n - hits, 0.975)) if hits < n else 1.0
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
    z = f"z = {number(gate['baseline']['largest'])} (limit {gate['limit']:g})"
    left = "structure is left" if gate["baseline"]["is_more_than_noise"] else "no structure is left"
    found = [f"The model as it was is fitted on {listed(by_role['train'])}; {left}: {z}."]
    if candidates:
        found.append(f"{len(candidates)} candidates are looked at, {fitted} of them fitted.")
    for step in result["steps"]:
        left = step["evidence"].get("largest_z_left")
        found.append(f"{capital(effect(step))} is added; z = {number(left)} is left.")
    if by_role["select"]:
        found.append(f"{listed(by_role['select'])} {_part_of_selection(result)}")
    if by_role["test"]:
        found.append(f"{listed(by_role['test'])} was opened once, at the end, for the errors on this page.")
    else:
        found.append("There is no test run: the errors are those of runs that the fit knew.")
    return found


def _part_of_selection(result: Json) -> str:
    """Say what the runs kept for selection did: they are only read where effects are judged against random forces."""
    if result.get("regime") == "forces":
        return "chose between candidates."
    if result.get("regime") == "noise" and result["candidates"]:
        return "was not needed: noise alone decided between candidates."
    return "was not needed: only a search against random forces reads a run that is kept to choose."
