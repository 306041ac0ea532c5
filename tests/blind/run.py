"""Run the tool on blind data sets: ``python tests/blind/run.py --regime noise --rig rota_damp --seeds 0-4``.

Each data set is made, given to the tool as `cartpend discover` does it, and its result is kept under
`build/blind` by the content of package and data: what is there already, or was kept with `table.py --keep`, is not run
again, so that the same command continues after an interruption. Every cell comes once, in one regime after the other,
before any comes twice. Seeds 0 to 99 are for tuning; seeds from 1000 on are run for the report only, once, with
`--report`, from a clean checkout.
"""

import argparse
import json
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Any, get_args

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from blind import store
from blind.cases import KINDS, REPORTED_FROM, TUNING, cases
from blind.generate import DataSet, generate
from blind.keys import Key, Regime
from blind.rigs import RIGS
from blind.same_data import simpler_laws
from blind.scorer import score
from blind.writer import write

# parts of a step, of all data sets so far, after which a pass is compiled: sooner than for a single search, as the code
# serves all of them; it gives the same to the last bit
OFTEN = 40_000
# seconds after which a data set that is too late is interrupted again: IPOPT swallows an interruption
AGAIN = 2.0


def seeds_of(text: str, is_report: bool) -> list[int]:
    """Read `3`, `0-4` or `0-4,7`; the ranges for tuning and for the report are kept apart.

    Raises
    ------
    ValueError
        If a seed is not of the range that the run is for.
    """
    seeds: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        seeds += range(int(first), int(last or first) + 1)
    wrong = [seed for seed in seeds if (seed < REPORTED_FROM if is_report else seed not in TUNING)]
    if wrong:
        allowed = f"from {REPORTED_FROM} on" if is_report else f"{TUNING[0]} to {TUNING[-1]}"
        hint = "" if is_report else f" Seeds from {REPORTED_FROM} on are run once, with --report."
        raise ValueError(f"The seeds {wrong[:5]} are not for this run, which takes {allowed}.{hint}")
    return seeds


def known_effects() -> frozenset[str]:
    from cartpend_dae.effects import catalogue

    return frozenset(card.id for card in catalogue())


class TooLongError(Exception):
    """A data set took longer than it may."""


def _interrupt(signal_number: int, frame: Any) -> None:
    if signal.getitimer(signal.ITIMER_PROF)[0] > 0:  # else it comes late, once the time is stopped
        raise TooLongError


def discover(study: Path, timeout: float) -> tuple[dict[str, Any] | None, str]:
    """Run the tool as its command does, without the figures and what is not scored; return its result, or why not."""
    from cartpend_dae import passes
    from cartpend_dae.report.result import discovery_result
    from cartpend_dae.session import discover_study, open_study

    passes.WORTH = OFTEN
    before, begin = signal.signal(signal.SIGPROF, _interrupt), time.monotonic()
    signal.setitimer(signal.ITIMER_PROF, timeout, AGAIN)
    try:
        opened = open_study(study)
        found = discovery_result(opened, discover_study(opened, beyond=False), time.monotonic() - begin)
    except TooLongError:
        return None, f"no result after {timeout:g} s of processor time"
    except Exception as error:  # whatever ends the command is a failure of the tool
        return None, f"{type(error).__name__}: {str(error)[-500:]}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    result = json.loads(json.dumps(found))
    return {name: result[name] for name in ("verdict", "baseline", "steps", "final", "seconds")}, ""


def one(data: DataSet, home: Path, known: frozenset[str], package: str, timeout: float) -> tuple[dict[str, Any], bool]:
    """Return the record of a data set, from the store or by running the tool, and whether it was run."""
    folder = home / "data" / data.key.name
    shutil.rmtree(folder, ignore_errors=True)
    study = write(data, folder, home / "truth", known)
    data_hash = store.content(folder)
    path = store.path_of(home, package, data_hash)
    if path.exists():
        return json.loads(path.read_text()), False
    if kept := store.kept_record(package, data_hash):
        return kept, False
    begin, worked = time.monotonic(), time.process_time()
    result, failure = discover(study, timeout)
    head, is_clean = store.commit()
    record = {
        "name": data.key.name,
        "package": package,
        "data": data_hash,
        "commit": head if is_clean else f"{head} with changes",
        "seconds": round(time.monotonic() - begin, 1),
        "processor_seconds": round(time.process_time() - worked, 1),
        "failure": failure,
        "truth": data.truth,
        "result": result,
    }
    store.save(path, record)
    return record, True


def said(record: dict[str, Any]) -> str:
    """Return one line on a record."""
    if record["result"] is None:
        return f"{record['name']}: {record['failure']}"
    found = score(record["result"], record["truth"], simpler_laws(record["truth"]))
    steps = ", ".join(f"{s['effect']}@{s['at']}" for s in record["result"]["steps"]) or "nothing"
    mark = "right" if found.is_exact else "WRONG"
    return f"{record['name']}: {mark}: {steps}; {found.verdict}; {record['processor_seconds']} s"


def in_turn(keys: list[Key]) -> list[Key]:
    """Put keys in an order in which each cell (rig, effects, what is excluded) comes once before any comes twice.

    The next cell has the next regime, and the next seed comes when a cell has had all; the rigs take turns.
    """
    cells: dict[tuple[Any, ...], dict[tuple[int, str], Key]] = {}
    for key in keys:
        cells.setdefault((key.rig, key.effects, key.exclude), {})[(key.seed, key.regime)] = key
    seeds, regimes = (
        sorted({key.seed for key in keys}),
        [r for r in get_args(Regime) if any(k.regime == r for k in keys)],
    )
    turns: list[Key] = []
    for turn in range(len(seeds) * len(regimes)):
        by_rig: dict[str, list[Key]] = {}
        for number, cell in enumerate(cells.values()):
            seed, regime = seeds[turn // len(regimes)], regimes[(number + turn) % len(regimes)]
            if (seed, regime) in cell:
                key = cell[(seed, regime)]
                by_rig.setdefault(key.rig, []).append(key)
        longest = max(map(len, by_rig.values()), default=0)
        turns += [line[k] for k in range(longest) for line in by_rig.values() if k < len(line)]
    return turns


def arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--regime", choices=get_args(Regime), action="append", help="may be repeated; all if absent")
    parser.add_argument("--rig", choices=list(RIGS), action="append", help="may be repeated; all if absent")
    parser.add_argument("--kind", choices=KINDS, action="append", help="may be repeated; all if absent")
    parser.add_argument("--seeds", default="0-4", help="as 0-4 or 0,3,7-9")
    parser.add_argument("--effect", action="append", help="only data sets with this effect; may be repeated")
    parser.add_argument("--limit-minutes", type=float, default=float("inf"), help="begin nothing after this time")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds of processor time for one data set")
    parser.add_argument("--store", type=Path, default=store.STORE, help="folder of data and results")
    parser.add_argument("--report", action="store_true", help=f"run seeds from {REPORTED_FROM} on, once")
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run what the command line asks for; return the exit code."""
    options = arguments(argv)
    try:
        seeds = seeds_of(options.seeds, options.report)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    if options.report and not store.commit()[1]:
        print("Package, models or test bed differ from the commit; commit them before a reported run.", file=sys.stderr)
        return 2
    keys = [
        key
        for kind in options.kind or KINDS
        for rig in options.rig or RIGS
        for regime in options.regime or get_args(Regime)
        for seed in seeds
        for key in cases(kind, rig, regime, seed)
        if not options.effect or any(effect in options.effect for effect, _ in key.effects)
    ]
    n_run, end = work(keys, options, time.monotonic() + 60 * options.limit_minutes)
    print(f"{n_run} data sets were run now{end}; `python tests/blind/table.py` makes the table.")
    return 0


def work(keys: list[Key], options: argparse.Namespace, deadline: float) -> tuple[int, str]:
    """Run data sets until the deadline; return how many were run, and why it ended early."""
    package, known, n_run = store.package(), known_effects(), 0
    for key in in_turn(keys):
        if time.monotonic() > deadline:
            return n_run, ", then the time was up"
        (data,) = generate([key])
        if not isinstance(data, DataSet):
            print(f"not shown: {data}", flush=True)
            continue
        record, is_new = one(data, options.store, known, package, options.timeout)
        n_run += is_new
        print(said(record), flush=True)
    return n_run, ""


if __name__ == "__main__":
    sys.exit(main())
