"""The targets of the test bed, one row each: what is needed, and what was seen with this package and with all."""

from collections.abc import Iterator, Sequence
from statistics import median
from typing import Any, NamedTuple

from blind.keys import REGIMES, Regime
from blind.scorer import Score, wilson

Found = Sequence[tuple[dict[str, Any], Score]]
# percent of single effects that must come first, by regime
NEEDED: dict[Regime, int] = {"noise": 99, "quantised": 97, "noisy": 97, "wrong_start": 97, "disturbed": 93}


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


def target_table(now: Found, every: Found, n_packages: int) -> list[str]:
    """Return the lines of the table.

    Parameters
    ----------
    now, every
        Records and scores of this package, and of it and earlier ones.
    n_packages
        How many earlier packages these are.
    """
    lines = [
        "",
        "### Targets",
        "",
        f"The last column adds what {n_packages} earlier packages found in the sets that they were run on.",
        "",
        "| data sets | | needed | this package | all packages |",
        "|---|---|---|---|---|",
    ]
    for target in targets():
        cells = " | ".join(measured(target, found) for found in (now, every))
        regime = f", {target.regime}" if target.regime else ""
        lines.append(f"| {target.kind}{regime} | {target.what} | {target.needed} | {cells} |")
    return lines


def measured(target: Target, found: Found) -> str:
    """Return what was seen of a target; nothing without data sets."""
    scores = [
        s for r, s in found if r["truth"]["kind"] == target.kind and target.regime in (None, r["truth"]["regime"])
    ]
    if target.what.startswith("error removed"):
        gains = [s.recovered for s in scores if s.is_exact and s.recovered is not None]
        least_or_median = median if target.what.endswith("median") else min
        return f"{least_or_median(gains):.3f} ({len(gains)} sets)" if gains else ""
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


def share(n_hits: int, n: int) -> str:
    """Return a share with its interval, in words."""
    low, high = wilson(n_hits, n)
    return f"{n_hits}/{n} ({100 * low:.0f}–{100 * high:.0f} %)" if n else "0/0"
