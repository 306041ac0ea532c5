"""Make the table of the blind test bed: ``python tests/blind/table.py [--tuning] [--detail]``.

Each cell says how many data sets stand behind it; shares have 95 % intervals after Wilson. Of what is not exactly right
it says where a simpler case of the hidden law was found that explains as much, which counts as wrong. A table of the
targets comes first where earlier packages are named with `--before`. Without
`--tuning` only reported seeds count. With `--keep` what was run is kept in the repository, where the next table finds
it. With `--history` the tables of earlier packages go to a page of their own, and one row of each follows the table.
"""

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from blind import store
from blind.cases import KINDS, REPORTED_FROM
from blind.catalogue import hidden_on
from blind.keys import REGIMES
from blind.rigs import RIGS
from blind.same_data import simpler_laws
from blind.scorer import Score, score
from blind.targets import removed, share, target_table

Record = dict[str, Any]
TITLE, EARLIER = "## Blind data sets", "## What is kept"
COMMAND = "python tests/blind/run.py --report --seeds {}; python tests/blind/table.py --keep --write docs/validation.md"
KINDS_IN_ORDER = ("single", "pair", "triple", "none", "open")
FAILED = Score(False, False, 0, 0, None, "failed", False, False)


def scored(record: Record) -> Score:
    truth = record["truth"]
    return FAILED if record["result"] is None else score(record["result"], truth, simpler_laws(truth))


def row(label: str, kind: str, found: list[tuple[Record, Score]]) -> str:
    """Return a row: what counts as right depends on the kind of data set."""
    scores, n = [s for _, s in found], len(found)
    if kind == "none":
        right = f"{share(sum(s.n_steps > 0 for s in scores), n)} got an addition"
    elif kind == "open":
        claims = sum(s.is_false_claim for s in scores)
        right = f"{share(sum(s.is_flagged for s in scores), n)} flagged, {claims} false claims"
    elif kind == "single":
        right = f"{share(sum(s.is_first for s in scores), n)} first, {share(sum(s.is_exact for s in scores), n)} exact"
        simpler = sum(is_simpler(record) for record, s in found if not s.is_exact)
        right += f"; {simpler} a simpler case" if simpler else ""
    else:
        right = f"{share(sum(s.is_exact for s in scores), n)} exact"
    wrong = sum(s.n_wrong for s in scores) / max(n, 1)
    gains = [s.recovered for s in scores if s.is_exact and s.recovered is not None]
    error = f"{removed(median(gains))} / {removed(min(gains))} ({len(gains)})" if gains else "–"
    verdicts = ", ".join(f"{name} {count}" for name, count in Counter(s.verdict for s in scores).most_common())
    return f"| {label} | {right} | {wrong:.2f} | {error} | {verdicts} |"


def sections(found: list[tuple[Record, Score]], detail: bool) -> list[str]:
    """Return the tables by kind: one row a regime and rig, shapes apart, and with `detail` one an effect."""
    head = [
        "| data sets | right | wrong parts a set | error removed: median / worst (of) | verdicts |",
        "|---|---|---|---|---|",
    ]
    lines: list[str] = []
    by_kind: dict[str, list[tuple[Record, Score]]] = defaultdict(list)
    for entry in found:
        by_kind[entry[0]["truth"]["kind"]].append(entry)
    for kind in sorted(by_kind):
        lines += ["", f"### {kind}", "", *head]
        rows: dict[str, list[tuple[Record, Score]]] = defaultdict(list)
        for entry in by_kind[kind]:
            for label in labels(entry[0]["truth"], kind, detail):
                rows[label].append(entry)
        lines += [row(label, kind, rows[label]) for label in sorted(rows)]
    return lines


def labels(truth: dict[str, Any], kind: str, detail: bool) -> list[str]:
    regime, rig = truth["regime"], truth["rig"]
    found = [f"{regime}: all", f"{regime}: {rig}"]
    if kind == "single":
        found.append(f"{regime}: shape {truth['effects'][0]['shape']}")
    if detail and truth["effects"]:
        found.append(f"{regime}: {rig}: {name_of(truth).partition(': ')[2]}")
    return found


def misses(found: list[tuple[Record, Score]]) -> list[str]:
    """Return a table of all data sets that are not exactly right, with what was found in them.

    A law is noted that the hidden one contains, where the data leave that no more to explain: they cannot tell it.
    """
    lines = [
        "",
        "### not exactly right, one by one",
        "",
        "| data set | shapes | found | verdict | error removed | |",
        "|---|---|---|---|--:|---|",
    ]
    wrong = [(r, s) for r, s in found if r["result"] is not None and not s.is_exact and r["truth"]["kind"] != "open"]
    for record, of in sorted(wrong, key=lambda entry: name_of(entry[0]["truth"])):
        truth, steps = record["truth"], record["result"]["steps"]
        names = ", ".join(f"`{step['effect']}` at `{step['at']}`" for step in steps) or "nothing"
        shapes = ", ".join(h["shape"] for h in truth["effects"])
        error = "–" if of.recovered is None else removed(of.recovered)
        note = "a simpler case of the hidden law, which explains no more" if is_simpler(record) else ""
        lines.append(f"| {name_of(truth)} | {shapes} | {names} | {of.verdict} | {error} | {note} |")
    return lines if wrong else []


def is_simpler(record: Record) -> bool:
    """Return whether a law was found that a hidden one contains, which explains no more in these data."""
    steps = record["result"]["steps"] if record["result"] else []
    hidden = [f"{h['effect']} at" for h in record["truth"]["effects"]]
    return any(law.startswith(h) for step in steps for law in step.get("contained_in", ()) for h in hidden)


def name_of(truth: dict[str, Any]) -> str:
    """Return what a data set is called in the table."""
    hidden = " + ".join(f"`{h['effect']}` at `{h['at']}`" for h in truth["effects"]) or "nothing"
    return f"{truth['rig']}, {truth['regime']}, {truth['seed']}: {hidden}"


def origin(every: list[Record], chosen: list[Record]) -> list[str]:
    """Say where the results come from, and whether reported seeds were run before."""
    commits = Counter(record["commit"] for record in chosen)
    listed = ", ".join(f"`{name}` ({count})" for name, count in commits.most_common())
    lines = [f"{len(chosen)} data sets, run from the commits {listed}."]
    earlier = {r["data"] for r in every if r["package"] != chosen[0]["package"]} & {r["data"] for r in chosen}
    if earlier and chosen[0]["truth"]["seed"] >= REPORTED_FROM:
        lines.append(f"{len(earlier)} of them had been run before with other sources: they are not blind any more.")
    return lines


def gaps(chosen: list[Record]) -> list[str]:
    """Say of which rigs, regimes and kinds there is no data set, and in how many cells there is one."""
    truths = [record["truth"] for record in chosen]
    lines = []
    for name, every in (("rig", RIGS), ("regime", REGIMES), ("kind", KINDS)):
        missing = [f"`{value}`" for value in every if value not in {truth[name] for truth in truths}]
        if missing:
            lines.append(f"No data set was run of the {name} {', '.join(missing)}.")
    found = {(t["rig"], *((h["effect"], h["at"]) for h in t["effects"])) for t in truths if t["kind"] == "single"}
    cells = sum(len(hidden_on(rig)) for rig in RIGS)
    return [*lines, f"Of {cells} pairs of a rig and a single effect {len(found)} were run."]


def page(every: list[Record], package: str, *, tuning: bool, detail: bool, earlier: Sequence[str] = ()) -> list[str]:
    """Return the lines of the table for one state of the package.

    Parameters
    ----------
    every
        All records of the store.
    package
        Hash of the package whose results count.
    tuning
        Count the seeds for tuning, in place of the reported ones.
    detail
        Give a row to each effect and place.
    earlier
        Hashes of earlier packages, which the table of targets counts beside this one; without any there is none.
    """
    chosen = [r for r in every if r["package"] == package and (r["truth"]["seed"] < REPORTED_FROM) == tuning]
    what = "seeds for tuning" if tuning else "reported seeds"
    if not chosen:
        return [f"No data set of the {what} has been run with these sources (package {package})."]
    lines = [f"Blind data sets, {what}, package {package}.", "", *origin(every, chosen), *gaps(chosen)]
    failed = Counter(r["failure"][:80] for r in chosen if r["result"] is None)
    lines += [f"Failed: {count} with `{reason}`." for reason, count in failed.most_common()]
    found = [(r, scored(r)) for r in chosen]
    if earlier:
        before = [name for name in dict.fromkeys(earlier) if name != package]
        counted_ones = [r for r in every if (r["truth"]["seed"] < REPORTED_FROM) == tuning]
        of = [[(r, scored(r)) for r in counted_ones if r["package"] == name] for name in before]
        lines += target_table(found, of)
    return [*lines, *sections(found, detail), *misses(found)]


def summary(every: list[Record], packages: list[str], *, tuning: bool) -> list[str]:
    """Return a table of earlier packages, newest first: what of each kind of data set was right."""
    lines = [
        "",
        "### Earlier packages",
        "",
        "| package | data sets | single: first | pair: exact | triple: exact | none: got an addition | open: flagged |",
        "|---|--:|---|---|---|---|---|",
    ]
    for package in packages:
        chosen = [r for r in every if r["package"] == package and (r["truth"]["seed"] < REPORTED_FROM) == tuning]
        cells = [counted(kind, [scored(r) for r in chosen if r["truth"]["kind"] == kind]) for kind in KINDS_IN_ORDER]
        lines.append(f"| {package} | {len(chosen)} | {' | '.join(cells)} |")
    return lines


def counted(kind: str, scores: list[Score]) -> str:
    """Return how many of the data sets of a kind count as what the head of its column says."""
    hits = {
        "none": sum(s.n_steps > 0 for s in scores),
        "open": sum(s.is_flagged for s in scores),
        "single": sum(s.is_first for s in scores),
    }.get(kind, sum(s.is_exact for s in scores))
    return f"{hits}/{len(scores)}" if scores else ""


def main(argv: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tuning", action="store_true", help="the seeds for tuning in place of the reported ones")
    parser.add_argument("--detail", action="store_true", help="a row for each effect and place")
    parser.add_argument("--store", type=Path, default=store.STORE)
    parser.add_argument("--package", default=None, help="hash of the package; that of the checkout if absent")
    parser.add_argument(
        "--before", action="append", default=[], help="hash of an earlier package, whose table follows; may be repeated"
    )
    parser.add_argument("--write", type=Path, help="put the table into this page, in place of the one that is there")
    parser.add_argument("--history", type=Path, help="put the tables of earlier packages into this page")
    parser.add_argument("--keep", action="store_true", help="put what was run beside what the repository keeps")
    options = parser.parse_args(argv)
    package = options.package or store.package()
    found = store.records(options.store)
    if options.keep:
        store.keep(found)
    lines = page(found, package, tuning=options.tuning, detail=options.detail, earlier=options.before)
    history: list[str] = []
    for before in options.before:
        earlier = page(found, before, tuning=options.tuning, detail=options.detail)
        history += ["", f"### By the earlier package {before}", "", *(k.replace("### ", "#### ") for k in earlier)]
    if options.history:
        lines += summary(found, options.before, tuning=options.tuning)
    else:
        lines += history
    print("\n".join(lines))
    chosen = f" --package {options.package}" if options.package else ""
    further = chosen + "".join(f" --before {before}" for before in options.before)
    if options.write:
        pages = f" --history {options.history}" if options.history else ""
        put_into(options.write, TITLE, COMMAND.format(seeds_of(found, package)) + pages + further, lines)
    if options.history:
        command = f"python tests/blind/table.py --history {options.history}{further}"
        put_into(options.history, EARLIER, command, history)
    return 0


def seeds_of(found: list[Record], package: str) -> str:
    """Return the reported seeds that a package was run on, as the command takes them."""
    seeds = sorted({r["truth"]["seed"] for r in found if r["package"] == package} - set(range(REPORTED_FROM)))
    return f"{seeds[0]}-{seeds[-1]}" if seeds else f"{REPORTED_FROM}"


def put_into(target: Path, title: str, command: str, lines: list[str]) -> None:
    """Put the table into a page as a section of its own, in place of the one that stands there, or at its end."""
    before, _, rest = target.read_text("utf-8").partition(f"\n{title}\n")
    _, mark, tail = rest.partition("\n## ")
    section = [title, "", f"`{command}`", "", *lines]
    target.write_text(before.rstrip("\n") + "\n\n" + "\n".join(section).rstrip("\n") + "\n" + mark + tail, "utf-8")


if __name__ == "__main__":
    sys.exit(main())
