"""Where results are kept: one file each, named by the content of the package and of the data set."""

import json
import subprocess
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
STORE = ROOT / "build" / "blind"


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


def records(store: Path) -> Iterator[dict[str, Any]]:
    """Yield all records of a store in the order of their names."""
    for path in sorted((store / "results").glob("*/*.json")):
        yield json.loads(path.read_text())
