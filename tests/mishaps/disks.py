"""Disks that are full or may not be written to."""

import os
import resource
import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path

from mishaps.scene import Row, content, is_a_sentence, run, small_study

FULL = r"(cannot be (kept|written)|File too large|No space left).*"


@contextmanager
def disk(place: Path, kilobytes: int):
    """Mount a disk of a size in memory; for root only."""
    place.mkdir(parents=True, exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", place], check=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", place], check=True)


def full_disk(folder: Path, sizes) -> list[Row]:
    """Discover onto disks that are too small, then make them larger and go on."""
    study, log, lost, stopped = small_study(folder / "study"), folder / "log", 0, 0
    assert run(log, "discover", study, "--out", folder / "whole").code == 0
    expected = content(folder / "whole")
    for size in sizes:
        with disk(folder / "disk", size) as place:
            out = place / "out"
            first = run(log, "discover", study, "--out", out)
            stopped += first.code != 0
            lost += first.code != 0 and not is_a_sentence(first, first.code, FULL)
            subprocess.run(["mount", "-o", "remount,size=100m", place], check=True)
            again = run(log, "discover", study, "--out", out, "--resume")
            lost += not (again.code == 0 and content(out) == expected)
    found = f"{stopped} ended in a sentence; after the disk was made larger `--resume` gave the same to the last bit"
    done = f"`discover` onto disks of {min(sizes)} to {max(sizes)} kB"
    return [Row("full disk", done, len(sizes), found, lost)]


def large_files(folder: Path, sizes) -> list[Row]:
    """The same with a bound on the size of files, which needs no root."""
    study, log, lost = small_study(folder / "study"), folder / "log", 0
    assert run(log, "discover", study, "--out", folder / "whole").code == 0
    expected = content(folder / "whole")
    for size in sizes:
        out = folder / "out"
        shutil.rmtree(out, ignore_errors=True)

        def bound(size=size):
            resource.setrlimit(resource.RLIMIT_FSIZE, (1024 * size, 1024 * size))

        first = run(log, "discover", study, "--out", out, setup=bound)
        lost += first.code != 0 and not is_a_sentence(first, 1, FULL)
        again = run(log, "discover", study, "--out", out, "--resume")
        lost += not (again.code == 0 and content(out) == expected)
    found = "a sentence; `--resume` without the bound gave the same to the last bit"
    return [Row("files that must not grow", f"bounds of {min(sizes)} to {max(sizes)} kB", len(sizes), found, lost)]


def read_only(folder: Path) -> list[Row]:
    """Write to a folder that must not be written to, as every command does that writes."""
    study, log, lost = small_study(folder / "study"), folder / "log", 0
    model = study.with_suffix(".py")
    with disk(folder / "disk", 1000) as place:
        (place / "old").mkdir()
        subprocess.run(["mount", "-o", "remount,ro", place], check=True)
        calls = [(command, study, "--out", place / "out") for command in ("identify", "discover", "fleet")]
        calls += [("identify", study, "--out", place / "old"), ("demo", "--out", place / "demo")]
        calls += [("new", place / "project"), ("simulate", model, "--stop", "1", "--out", place / "out")]
        calls += [("export-fmu", model, "--out", place / "x.fmu"), ("export-modelica", model, "--out", place / "x.mo")]
        for call in calls:
            found = run(log, *call)
            if not is_a_sentence(found, 2, str(place)) and not is_a_sentence(found, 1, str(place)):
                lost += 1
                print("read-only:", *call, found.code, found.stderr[-500:])
        lost += sorted(path.name for path in place.iterdir()) != ["old"]
    return [Row("read-only folder", "each command that writes", len(calls), "one sentence that names the folder", lost)]


def is_root() -> bool:
    """Return whether disks can be mounted."""
    return os.geteuid() == 0
