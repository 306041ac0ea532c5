"""kill -9 at random moments of a discovery, and of two at once in one folder."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from mishaps.scene import Ended, Row, begun, content, ended, is_a_sentence, run, small_study
from mishaps.site import site


def kills(folder: Path, times: int, seed: int = 0) -> list[Row]:
    """Kill a discovery that often, each time at another moment, let it go on by `--resume`, and compare."""
    study, log = small_study(folder / "study"), folder / "log"
    whole = run(log, "discover", study, "--out", folder / "whole")
    assert whole.code == 0, whole.stderr
    expected, generator = content(folder / "whole"), np.random.default_rng(seed)
    whole = run(log, "discover", study, "--out", folder / "again")  # the first one also imports
    counts = {"killed": 0, "kept": 0, "lost": 0, "left": 0}
    while counts["killed"] < times:
        out = folder / "out"
        shutil.rmtree(out, ignore_errors=True)
        jobs = 1 + counts["killed"] % 2
        moment = generator.uniform(0, whole.seconds)
        pid = begun(log, "discover", study, "--out", out, "--jobs", jobs)
        begin = time.monotonic()
        while time.monotonic() - begin < moment and os.waitpid(pid, os.WNOHANG) == (0, 0):
            time.sleep(0.002)
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue  # it was done before
        ended(pid, log, begin)
        counts["killed"] += 1
        counts["kept"] += any((out / "stages").glob("*.npz")) if out.is_dir() else 0
        again = run(log, "discover", study, "--out", out, "--resume")
        is_same = again.code == 0 and content(out) == expected
        counts["lost"] += not is_same
        counts["left"] += any(path.name.startswith(".") or path.name == "stages" for path in out.iterdir())
    found = (
        f"results of `--resume` the same to the last bit: {times - counts['lost']} of {times}; with stages to go on "
        f"from: {counts['kept']}; with anything left over: {counts['left']}"
    )
    done = f"a discovery of {whole.seconds:.1f} s killed at a random moment (every other one with `--jobs 2`), resumed"
    return [Row("`kill -9`", done, times, found, counts["lost"] + counts["left"])]


def two_at_once(folder: Path, times: int) -> list[Row]:
    """Start a second run in the folder of one that is at work."""
    study, log, lost = small_study(folder / "study"), folder / "log", 0
    assert run(log, "discover", study, "--out", folder / "whole").code == 0
    expected = content(folder / "whole")
    for k in range(times):
        out = folder / f"out{k}"
        begin = time.monotonic()
        pid = begun(folder / "first", "discover", study, "--out", out)
        while not (out / ".running").exists():
            time.sleep(0.01)
        second = run(log, "discover", study, "--out", out)
        first = ended(pid, folder / "first", begin)
        is_refused = is_a_sentence(second, 2, "another run is at work in this folder")
        lost += not (is_refused and first.code == 0 and content(out) == expected)
    return [Row("two runs in one folder", "a second `discover` into it", times, "refused; the first undisturbed", lost)]


def cluster(folder: Path, times: int, seed: int = 0) -> list[Row]:
    """Kill a worker of a cluster while it works, and its scheduler."""
    study, log, generator = small_study(folder / "study"), folder / "log", np.random.default_rng(seed)
    whole = run(log, "discover", study, "--out", folder / "whole")
    assert whole.code == 0, whole.stderr
    expected, lost, stopped = content(folder / "whole"), {"worker": 0, "scheduler": 0}, 0
    for k in range(2 * times):
        what, out = ("worker", "scheduler")[k % 2], folder / f"out{k}"
        call = ["discover", study, "--out", out, "--cluster"]
        with site(folder) as (made, _):
            process = _apart(log, *call, made.address)
            while not any((out / "stages").glob("fit-*.npz")) and process.poll() is None:
                time.sleep(0.02)  # until its work begins
            time.sleep(generator.uniform(0, 0.7) * whole.seconds)
            (made.workers[0] if what == "worker" else made.scheduler).kill()
            found = _ended(process, log)
        if found.code != 0:
            stopped += 1
            lost[what] += what == "worker" or not is_a_sentence(found, 1, "The cluster at .* was lost")
            with site(folder) as (made, _):
                found = _ended(_apart(log, *call, made.address, "--resume"), log)
        lost[what] += not (found.code == 0 and content(out) == expected)
    done = "killed while `discover --cluster` works"
    same = f"{stopped} ended in a sentence; with another one `--resume` gave the same to the last bit"
    return [
        Row("a worker dies", f"one of two {done}", times, "the other did its part: the same result", lost["worker"]),
        Row("a scheduler dies", f"{done}", times, same, lost["scheduler"]),
    ]


def _apart(log: Path, *arguments: object) -> "subprocess.Popen[bytes]":
    """Start a command in a process that is no fork of this one, which is connected to the cluster itself."""
    command = [sys.executable, "-m", "cartpend_dae.cli", *map(str, arguments)]
    with log.with_suffix(".out").open("wb") as out, log.with_suffix(".err").open("wb") as err:
        return subprocess.Popen(command, stdout=out, stderr=err)


def _ended(process: "subprocess.Popen[bytes]", log: Path) -> Ended:
    process.wait()
    texts = [log.with_suffix(f".{stream}").read_text("utf-8", errors="replace") for stream in ("out", "err")]
    return Ended(process.returncode, *texts, 0.0)
