"""Readers under atheris for a stated time; what they stumble over is a fault."""

import importlib.util
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from fuzz.readers import CORPUS, READERS

from mishaps.scene import Row

PROGRAM = Path(__file__).resolve().parents[1] / "fuzz" / "with_atheris.py"
# what is kept of a corpus: so many files of at most so many bytes
FILES, BYTES = 25, 1500
OPTIONS = ("-timeout=30", "-rss_limit_mb=4000", "-print_final_stats=1", "-max_len=20000")


def has_atheris() -> bool:
    """Return whether atheris is installed."""
    return importlib.util.find_spec("atheris") is not None


def fuzzed(folder: Path, seconds: float, names: Sequence[str] = tuple(READERS), *, keep: bool = False) -> list[Row]:
    """Run readers under atheris for so many seconds each."""
    rows = []
    for name in names:
        reader = READERS[name]
        mine = folder / name
        mine.mkdir(parents=True)
        for k, content in enumerate(reader.seeds()):
            (mine / f"seed{k}").write_bytes(content)
        for path in (CORPUS / name).glob("*"):
            shutil.copy(path, mine / path.name)
        faults = folder / f"{name}-faults"
        runs, deaths = _run(name, faults, mine, seconds)
        found = sorted(path.name for path in faults.glob("*.txt"))
        for path in faults.glob("*.txt"):
            print(name, path.read_text()[-1500:], flush=True)
        if keep:
            _keep(name, mine)
        what = ("1 fault" if len(found) == 1 else f"{len(found)} faults") + (f", died {deaths} times" if deaths else "")
        done = f"`{name}`: any bytes, led by what they reach (atheris), {seconds:.0f} s"
        rows.append(Row("fuzzed reader", done, runs, what, len(found) + deaths))
    return rows


def _run(name: str, faults: Path, corpus: Path, seconds: float) -> tuple[int, int]:
    """Return how often the reader ran, and how often its process died."""
    runs, deaths, end = 0, 0, time.monotonic() + seconds
    while (left := end - time.monotonic()) > 1 and deaths < 5:
        command = [sys.executable, str(PROGRAM), name, str(faults), str(corpus), *OPTIONS]
        done = subprocess.run(
            [*command, f"-max_total_time={left:.0f}", f"-artifact_prefix={faults}/"],
            capture_output=True,
            check=False,
            cwd=corpus.parent,
        )
        text = done.stderr.decode(errors="replace")
        counted = re.search(r"stat::number_of_executed_units:\s+(\d+)", text)
        runs += int(counted[1]) if counted else 0
        if done.returncode != 0:
            deaths += 1
            print(name, done.returncode, text[-3000:], flush=True)
    return runs, deaths


def _keep(name: str, corpus: Path) -> None:
    """Keep the smallest files that reach what all reach, beside those of a corpus that have a name of their own."""
    small = corpus.with_name(f"{name}-small")
    small.mkdir()
    command = [sys.executable, str(PROGRAM), name, str(small / "no"), "-merge=1", str(small), str(corpus)]
    done = subprocess.run([*command, "-timeout=30"], capture_output=True, check=False, cwd=corpus.parent)
    files = sorted((path for path in small.iterdir() if path.is_file()), key=lambda path: path.stat().st_size)
    if not files:
        raise RuntimeError(f"No corpus of `{name}` can be kept: {done.stderr.decode(errors='replace')[-300:]}")
    target = CORPUS / name
    target.mkdir(parents=True, exist_ok=True)
    for path in target.glob("*"):
        if re.fullmatch("[0-9a-f]{40}", path.name):  # of an earlier run
            path.unlink()
    for path in [path for path in files if path.stat().st_size <= BYTES][-FILES:]:
        shutil.copy(path, target / path.name)
