"""Write docs/benchmarks.md from the figures that the benchmarks recorded in `results/`, one JSON file a section.

A benchmark is a script that measures and calls `record`, and a module `<section>_text.py` with a function `section`
that makes Markdown of what was recorded; its name stands in `SECTIONS`. ``python tests/benchmarks/page.py`` writes
the page again without measuring.
"""

import importlib
import json
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
SECTIONS = ("scale", "simulate", "identify", "fmu")


def commit():
    """Return the commit of the sources, with a sign if they were changed since; what benchmarks write is no source."""
    here = ["git", "-C", str(HERE.parents[1])]
    head = subprocess.run([*here, "rev-parse", "--short=7", "HEAD"], capture_output=True, text=True).stdout.strip()
    sources = ["--", ":/", ":(top,exclude)docs", ":(top,exclude)tests/benchmarks/results"]
    changed = subprocess.run([*here, "status", "--porcelain", *sources], capture_output=True, text=True).stdout.strip()
    return f"{head}-dirty" if changed else head


def record(name, results):
    """Keep what a benchmark found."""
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.json").write_text(json.dumps(results, indent=1) + "\n")


def recorded(*names):
    """Return what the benchmarks found, by section; of all that are on the page if none is named."""
    files = {name: RESULTS / f"{name}.json" for name in names or SECTIONS}
    return {name: json.loads(file.read_text()) for name, file in files.items() if file.exists()}


def text(results):
    """Return the page."""
    lines = ["# Benchmarks", "", "Made by the commands that each section names; the figures are what they found.", ""]
    for name in SECTIONS:
        if name in results:
            lines += [*importlib.import_module(f"benchmarks.{name}_text").section(results[name]), ""]
    return "\n".join(lines)


def put_section(page, lines):
    """Put a section, whose first line is its title, into a page in place of the one that is there, else at its end."""
    before, _, after = page.read_text().partition(f"{lines[0]}\n")
    rest = after.partition("\n## ")
    tail = f"## {rest[2]}" if rest[1] else ""
    page.write_text("\n".join([before.rstrip(), "", *lines]).rstrip() + "\n" + (f"\n{tail}" if tail else ""))


if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    (HERE.parents[1] / "docs" / "benchmarks.md").write_text(text(recorded()))
