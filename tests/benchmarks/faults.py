"""Make happen what can happen to a run from outside, and say what was lost by it.

``python tests/benchmarks/faults.py --write docs/validation.md`` does all and writes the table; it takes about half an
hour. ``--only kills,fuzz`` does some and keeps the recorded rows of the others;
``--only fuzz --readers toml`` does one reader.
"""

import argparse
import importlib
import os
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
os.environ.setdefault("MPLBACKEND", "Agg")

from benchmarks import faults_text, page  # noqa: E402 - of this repository, wherever it stands
from fuzz.readers import READERS  # noqa: E402
from mishaps import disks, fuzzing, kills, surroundings  # noqa: E402

SIZES = (8, 20, 40, 80, 160, 300)
BOUNDS = (1, 8, 32, 100)
SECTIONS = {
    "kills": lambda folder, options: kills.kills(folder, options.kills),
    "two": lambda folder, options: kills.two_at_once(folder, 5),
    "cluster": lambda folder, options: kills.cluster(folder, options.kills // 10),
    "disk": lambda folder, options: disks.full_disk(folder, SIZES),
    "files": lambda folder, options: disks.large_files(folder, BOUNDS),
    "readonly": lambda folder, options: disks.read_only(folder),
    "compiler": lambda folder, options: surroundings.no_compiler(folder),
    "display": lambda folder, options: surroundings.no_display(folder),
    "names": lambda folder, options: surroundings.strange_names(folder),
    "large": lambda folder, options: surroundings.large_log(folder, options.gigabytes),
    "long": lambda folder, options: surroundings.long_use(folder, options.fits),
    "fuzz": lambda folder, options: fuzzing.fuzzed(folder, options.seconds, options.readers, keep=options.keep),
}


def main():
    """Do what is asked for, record it, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", type=Path, help="the page that the table goes into")
    parser.add_argument("--only", default=",".join(SECTIONS), help="sections, by comma")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--fits", type=int, default=1000)
    parser.add_argument("--gigabytes", type=float, default=1.0)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each fuzzed reader")
    parser.add_argument("--readers", type=lambda text: text.split(","), default=list(READERS), help="to fuzz, by comma")
    parser.add_argument("--keep", action="store_true", help="keep the corpus that the fuzzing found")
    options = parser.parse_args()
    for name in ("studies", "fleets", "models", "fmus"):  # once, before the forks
        importlib.import_module(f"cartpend_dae.commands.{name}")
    found = page.recorded("faults").get("faults", {})
    for name in options.only.split(","):
        with tempfile.TemporaryDirectory(prefix=f"faults-{name}-") as folder:
            rows = [asdict(row) for row in SECTIONS[name](Path(folder).resolve(), options)]
        for row in rows:
            print(" | ".join(str(value) for value in row.values()), flush=True)
        others = tuple(f"`{reader}`" for reader in READERS if name == "fuzz" and reader not in options.readers)
        found[name] = rows + [row for row in found.get(name, ()) if row["done"].startswith(others)]
        page.record("faults", found)
    rows = [row for name in SECTIONS for row in found.get(name, ())]
    if options.write is not None:
        faults_text.into(options.write, rows)
    sys.exit(1 if any(row["lost"] for row in rows) else 0)


if __name__ == "__main__":
    main()
