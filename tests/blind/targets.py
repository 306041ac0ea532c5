"""The targets of the test bed, one row each: what is needed, and what was seen with this package and with all."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from statistics import median
from typing import Any, NamedTuple

from blind.keys import REGIMES, Regime
from blind.scorer import Score, wilson

Found = Sequence[tuple[dict[str, Any], Score]]
# percent of single effects that must come first, by regime
NEEDED: dict[Regime, int] = {"noise": 99, "quantised": 97, "noisy": 97, "wrong_start": 97, "disturbed": 93}
# so many of the newest sets of a cell count in the column of newest ones: the fewest that the targets ask for
NEWEST, NEWEST_NONE = 2, 20


class Target(NamedTuple):
    """What must hold, what is needed, and the kind and regime of the data sets that count; all regimes if None."""

    what: str
    needed: str
    kind: str
    regime: str | None = None


def targets() -> Iterator[Target]:
    """Yield the targets in the order of the table."""
    for regime in REGIMES:
        yield Target("right first", f"{NEEDED[regime]} %", "single", regime)
        yield Target("wrong parts a set", "at most 0.1", "single", regime)
    for regime in REGIMES:
        yield Target("got an addition", "at most 1 of 60", "none", regime)
    yield Target("exact", "32 of 36", "pair", "noise")
    yield Target("exact", "is reported", "triple", "noise")
    yield Target("error removed of those exactly right: median", "0.99", "single")
    yield Target("error removed of those exactly right: worst", "0.9", "single")
    yield Target("flagged", "all", "open")
    yield Target("wrong name with the verdict `explained`", "none", "open")


def target_table(now: Found, earlier: Sequence[Found]) -> list[str]:
    """Return the lines of the table.

    Parameters
    ----------
    now
        Records and scores of this package.
    earlier
        Those of each earlier package, newest first.
    """
    every = [entry for found in (now, *earlier) for entry in found]
    columns = now, newest(every), every
    lines = [
        "",
        "### Targets",
        "",
        f"The last column adds what {len(earlier)} earlier packages found in the sets that they were run on. The one",
        f"before it counts the newest {NEWEST} sets of each regime, rig and what is hidden at which place alone, and",
        f"the newest {NEWEST_NONE} of each regime and rig with nothing missing, whatever was found by which package.",
        "",
        "| data sets | | needed | this package | newest of each | all packages |",
        "|---|---|---|---|---|---|",
    ]
    for target in targets():
        cells = " | ".join(measured(target, found) for found in columns)
        regime = f", {target.regime}" if target.regime else ""
        lines.append(f"| {target.kind}{regime} | {target.what} | {target.needed} | {cells} |")
    return lines


def newest(every: Found) -> Found:
    """Return the newest sets of each cell, of records with the newest package first; of one package, of later seeds."""
    cells: dict[tuple[object, ...], list[tuple[dict[str, Any], Score]]] = defaultdict(list)
    age: dict[str, int] = {}
    for entry in every:
        truth = entry[0]["truth"]
        age.setdefault(entry[0]["package"], len(age))
        hidden = tuple(sorted((one["effect"], one["at"]) for one in truth["effects"]))
        cells[truth["kind"], truth["regime"], truth["rig"], hidden].append(entry)
    found: list[tuple[dict[str, Any], Score]] = []
    for (kind, *_), entries in cells.items():
        entries.sort(key=lambda entry: (age[entry[0]["package"]], -entry[0]["truth"]["seed"]))
        found += entries[: NEWEST_NONE if kind == "none" else NEWEST]
    return found


def measured(target: Target, found: Found) -> str:
    """Return what was seen of a target; nothing without data sets."""
    scores = [
        s for r, s in found if r["truth"]["kind"] == target.kind and target.regime in (None, r["truth"]["regime"])
    ]
    if target.what.startswith("error removed"):
        gains = [s.recovered for s in scores if s.is_exact and s.recovered is not None]
        least_or_median = median if target.what.endswith("median") else min
        return f"{removed(least_or_median(gains))} ({len(gains)} sets)" if gains else ""
    if not scores:
        return ""
    if target.what.startswith("wrong parts"):
        return f"{sum(s.n_wrong for s in scores) / len(scores):.2f}"
    return share(sum(hits(target, s) for s in scores), len(scores))


def hits(target: Target, score: Score) -> bool:
    """Return whether a data set counts as what the target says."""
    return {
        "right first": score.is_first,
        "got an addition": score.n_steps > 0,
        "exact": score.is_exact,
        "flagged": score.is_flagged,
    }.get(target.what, score.is_false_claim)


def removed(part: float) -> str:
    """Write the part of an error that was removed; of a simulation that diverged its size alone is of interest."""
    return f"{part:.3f}" if abs(part) < 1000 else f"{part:.0e}"


def share(n_hits: int, n: int) -> str:
    """Return a share with its interval, in words."""
    low, high = wilson(n_hits, n)
    return f"{n_hits}/{n} ({100 * low:.0f}–{100 * high:.0f} %)" if n else "0/0"
