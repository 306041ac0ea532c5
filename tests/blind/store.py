"""Where results are kept: one file each, named by the content of the package and of the data set."""

import json
import subprocess
from hashlib import sha256
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
STORE = ROOT / "build" / "blind"
# what the table needs of all records, one line each: this outlasts a checkout
KEPT = ROOT / "tests" / "benchmarks" / "results" / "blind.jsonl"


def content(folder: Path, pattern: str = "*") -> str:
    """Return a hash over the names and contents of the files of a folder."""
    digest = sha256()
    for path in sorted(folder.rglob(pattern)):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
            digest.update(sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


def package() -> str:
    """Return the hash of the package's sources."""
    return content(ROOT / "cartpend_dae", "*.py*")


def commit() -> tuple[str, bool]:
    """Return the commit of the checkout, and whether package and test bed are as it has them."""
    here = ["git", "-C", str(ROOT)]
    head = subprocess.run([*here, "rev-parse", "--short=10", "HEAD"], capture_output=True, text=True)
    changed = [*here, "status", "--porcelain", "--", "cartpend_dae", "models", "tests/blind"]
    status = subprocess.run(changed, capture_output=True, text=True)
    return head.stdout.strip() or "unknown", head.returncode == 0 and not status.stdout.strip()


def path_of(store: Path, package_hash: str, data_hash: str) -> Path:
    return store / "results" / package_hash / f"{data_hash}.json"


def save(path: Path, record: dict[str, Any]) -> None:
    """Write a record in one piece, so that an interruption leaves none or all of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".part")
    partial.write_text(json.dumps(record, indent=1) + "\n")
    partial.replace(path)


def records(store: Path, kept: Path = KEPT) -> list[dict[str, Any]]:
    """Return all records of a store and those kept, which are brief, in the order of package and data."""
    lines = kept.read_text().splitlines() if kept.exists() else []
    found = {(r["package"], r["data"]): r for r in map(json.loads, lines)}
    for path in sorted((store / "results").glob("*/*.json")):
        record = json.loads(path.read_text())
        found[(record["package"], record["data"])] = record
    return [found[key] for key in sorted(found)]


def kept_record(package_hash: str, data_hash: str, kept: Path = KEPT) -> dict[str, Any] | None:
    """Return the record that is kept of a data set, if there is one."""
    lines = kept.read_text().splitlines() if kept.exists() else []
    key = (package_hash, data_hash)
    return next((r for r in map(json.loads, lines) if (r["package"], r["data"]) == key), None)


def keep(found: list[dict[str, Any]], kept: Path = KEPT) -> None:
    """Write what the table needs of records, in one piece."""
    partial = kept.with_suffix(".part")
    partial.write_text("".join(json.dumps(brief(record), separators=(",", ":")) + "\n" for record in found))
    partial.replace(kept)


def brief(record: dict[str, Any]) -> dict[str, Any]:
    """Return a record with what its score needs: names of the additions, and errors of the test runs."""
    truth = {name: value for name, value in record["truth"].items() if name != "parameters"}
    result = record["result"]
    if result is not None:
        steps = [{n: step[n] for n in ("effect", "at", "contained_in") if n in step} for step in result["steps"]]
        stages = {stage: {"experiments": _errors(result[stage]["experiments"])} for stage in ("baseline", "final")}
        result = {"verdict": result["verdict"], "steps": steps, **stages, "seconds": result["seconds"]}
    return {**record, "truth": _rounded(truth), "result": _rounded(result)}


def _errors(experiments: dict[str, Any]) -> dict[str, Any]:
    return {
        run: {"role": "test", "outputs": {name: {"rmse": e["rmse"]} for name, e in entry["outputs"].items()}}
        for run, entry in experiments.items()
        if entry["role"] == "test"
    }


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value
