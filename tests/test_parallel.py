"""Work in other processes: the same results, and no worker that dies takes any of them with it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import pytest

from cartpend_dae.errors import CutOffError
from cartpend_dae.parallel import DEATHS, Processes, in_parallel, is_shared


def test_results_come_in_the_order_of_the_items_however_long_each_takes(tmp_path):
    def late(k):
        if k == 5:
            (tmp_path / "last").touch()
        while k == 0 and not (tmp_path / "last").exists():
            time.sleep(0.01)
        return k * k

    arrived = []
    found = list(in_parallel(late, range(6), jobs=3, arrived=lambda k, value: arrived.append((k, value))))
    assert found == [k * k for k in range(6)]
    assert sorted(arrived) == list(enumerate(found))
    assert arrived[0] != (0, 0)  # the first item waits for the last, which need not wait for it


def test_what_cannot_be_sent_may_be_used_and_large_results_come_back():
    x = ca.SX.sym("x")
    square = ca.Function("square", [x], [x**2])
    found = list(in_parallel(lambda k: [float(square(k))] * 200_000, range(4), jobs=2))
    assert [len(values) for values in found] == [200_000] * 4 and found[3][-1] == 9.0


def test_what_a_worker_died_over_is_done_by_another(tmp_path):
    def once_deadly(k):
        mark = tmp_path / str(k)
        if k % 2 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return 10 * k

    assert list(in_parallel(once_deadly, range(5), jobs=2)) == [0, 10, 20, 30, 40]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1", "3"]


def test_an_item_that_kills_every_worker_is_given_up_and_the_others_are_done(tmp_path):
    def deadly(k):
        if k == 1:
            with (tmp_path / "deaths").open("a") as file:
                file.write("x")
            os.kill(os.getpid(), signal.SIGKILL)
        return k

    outcomes = {k: (value, error) for k, value, error in Processes(2).map(deadly, range(4))}
    assert {k: value for k, (value, error) in outcomes.items() if error is None} == {0: 0, 2: 2, 3: 3}
    assert len((tmp_path / "deaths").read_text()) == DEATHS
    with pytest.raises(CutOffError, match=f"given up after {DEATHS} processes had died over it.* fewer `--jobs`"):
        list(in_parallel(deadly, range(4), jobs=2))


def test_workers_end_with_the_process_that_waits_for_them(tmp_path):
    program = f"""
import os, time
from pathlib import Path
from cartpend_dae.parallel import in_parallel
def work(k):
    Path({str(tmp_path)!r}, str(os.getpid())).touch()
    time.sleep(0.2)
list(in_parallel(work, range(1000), jobs=2))
"""
    parent = subprocess.Popen([sys.executable, "-c", program])
    while len(list(tmp_path.iterdir())) < 2:
        assert parent.poll() is None
        time.sleep(0.02)
    parent.kill()
    parent.wait()
    workers = [int(path.name) for path in tmp_path.iterdir()]
    deadline = time.monotonic() + 30
    while any(_lives(number) for number in workers):
        assert time.monotonic() < deadline, "a worker outlived its parent"
        time.sleep(0.05)


def _lives(number):
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state not in "ZX"


def test_one_process_is_this_one():
    assert list(in_parallel(lambda _: os.getpid(), [0], jobs=1)) == [os.getpid()]
    assert not is_shared(1) and is_shared(2) and is_shared(Processes(1))
