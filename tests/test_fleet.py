"""Many studies at once: each has its result whatever becomes of the others, and the same one wherever it was made."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from typer.testing import CliRunner

from cartpend_dae import cli
from cartpend_dae.demo import make_demo
from cartpend_dae.report.register import known_rows

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("fleet")]

FEW = '\n[discover]\ninclude = ["coulomb_friction", "constant_load"]\n'


def studies(folder, *names):
    made = []
    for name in names:
        path = make_demo(folder / name)
        path.write_text(path.read_text("utf-8") + FEW, "utf-8")
        made.append(str(path))
    return made


def fleet(*arguments):
    return CliRunner().invoke(cli.app, ["fleet", *map(str, arguments)])


def content(folder):
    """Return all results below a folder, but for what depends on the time that a run took."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.name == "result.json":
            result = json.loads(path.read_text("utf-8"))
            del result["seconds"]
            found[str(path.relative_to(folder))] = result
        elif path.suffix in (".csv", ".py"):
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def test_a_bad_study_stops_no_other_and_what_was_done_is_not_done_again(tmp_path):
    one, bad, two = studies(tmp_path, "one", "bad", "two")
    csv = tmp_path / "bad" / "release1.csv"
    good = csv.read_text("utf-8")
    csv.write_text(good.replace("angle", "angel"), "utf-8")
    out = tmp_path / "out"
    result = fleet(one, bad, two, "--out", out, "--jobs", 2)
    assert result.exit_code == 1
    assert "2 of 3 studies have a result." in result.stdout and "there is no column `angle`" in result.stdout
    rows = {row.folder: row for row in known_rows(out)}
    assert [(name, rows[name].state) for name in sorted(rows)] == [
        ("bad-rota_damp", "failed"),
        ("one-rota_damp", "done"),
        ("two-rota_damp", "done"),
    ]
    assert rows["one-rota_damp"].effects == ("coulomb_friction at bearing",)
    assert rows["one-rota_damp"].after < 0.1 * rows["one-rota_damp"].before
    first = content(out)
    assert not (out / "bad-rota_damp").exists()

    csv.write_text(good, "utf-8")
    times = {path: path.stat().st_mtime_ns for path in (out / "one-rota_damp").iterdir()}
    result = fleet(one, bad, two, "--out", out, "--resume")
    assert result.exit_code == 0, result.output
    assert {path: path.stat().st_mtime_ns for path in times} == times
    assert {row.folder: row.state for row in known_rows(out)}["bad-rota_damp"] == "done"
    whole = content(out)
    assert {name: whole[name] for name in first} == first


def test_one_process_several_and_more_than_studies_give_the_same(tmp_path):
    made = studies(tmp_path, "one", "two")
    found = []
    for jobs in (1, 2, 3):
        out = tmp_path / f"out{jobs}"
        result = fleet(*made, "--out", out, "--jobs", jobs, "--command", "identify")
        assert result.exit_code == 0, result.output
        found.append(content(out))
    assert found[0] == found[1] == found[2] and len(found[0]) == 10


def test_a_fleet_that_was_killed_goes_on(tmp_path):
    made, out = studies(tmp_path, "one", "two"), tmp_path / "out"
    command = [sys.executable, "-m", "cartpend_dae.cli", "fleet", *made, "--out", str(out)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    deadline = time.monotonic() + 300
    while not (out / "two-rota_damp" / "stages").exists():
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    (row,) = known_rows(out)
    assert (row.folder, row.state) == ("one-rota_damp", "done")
    result = fleet(*made, "--out", out, "--resume")
    assert result.exit_code == 0, result.output
    assert {row.folder: row.state for row in known_rows(out)} == {"one-rota_damp": "kept", "two-rota_damp": "done"}
    assert fleet(*made, "--out", tmp_path / "fresh").exit_code == 0
    assert content(out) == content(tmp_path / "fresh")


def test_a_folder_has_one_run_at_a_time(tmp_path):
    (study,) = studies(tmp_path, "one")
    out = tmp_path / "out"
    program = (
        "import sys, time\nfrom pathlib import Path\nfrom cartpend_dae.report.alone import alone\n"
        f"with alone(Path({str(out)!r})):\n    print('in', flush=True)\n    time.sleep(600)\n"
    )
    holder = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None and holder.stdout.readline() == "in\n"
        for command in ("identify", "discover", "fleet"):
            result = CliRunner().invoke(cli.app, [command, study, "--out", str(out)])
            assert result.exit_code == 2
            assert f"another run is at work in this folder (process {holder.pid} on " in result.stderr
    finally:
        holder.kill()
        holder.wait()
        holder.stdout.close()
    (out / ".out.partial-1").mkdir()
    result = CliRunner().invoke(cli.app, ["identify", study, "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert not [path.name for path in out.iterdir() if path.name.startswith(".")]
