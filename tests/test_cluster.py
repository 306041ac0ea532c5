"""Work on a Dask cluster: the same numbers to the last bit, whichever worker dies; nothing is lost with a scheduler."""

import json
import os
import sys
import threading
import time
from contextlib import ExitStack

import casadi as ca
import numpy as np
import pytest
from mishaps.site import site
from test_discover_pendulum import clean_run, noisy_setup
from test_fleet import content, fleet, studies
from test_resume import CARDS, numbers
from test_resume import setup as study
from typer.testing import CliRunner

from cartpend_dae import cli
from cartpend_dae.bootstrap import bootstrap
from cartpend_dae.cluster import Cluster, cluster
from cartpend_dae.demo import make_demo
from cartpend_dae.discover import discover, store_for
from cartpend_dae.errors import CutOffError, LostError, ModelError, StudyError
from cartpend_dae.multistart import Route, fit_study
from cartpend_dae.parallel import in_parallel
from cartpend_dae.parcel import packed, unpacked

pytest.importorskip("distributed", reason="Dask is an optional extra")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.xdist_group("cluster"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    with site(tmp_path_factory.mktemp("site")) as (_, place):
        yield place


def test_a_discovery_on_a_cluster_is_the_same_to_the_last_bit(shared, tmp_path):
    alone = discover(study(), cards=CARDS, power=1)
    there = discover(study(), cards=CARDS, power=1, jobs=shared, store=store_for(study(), tmp_path))
    assert numbers(alone) == numbers(there)
    assert alone.beyond.rates == there.beyond.rates and alone.beyond.rates[0].hits == 1
    again = discover(study(), cards=CARDS, power=1, jobs=2, store=store_for(study(), tmp_path))
    assert numbers(again) == numbers(alone)


def test_starts_and_bootstrap_on_a_cluster_are_the_same_to_the_last_bit(shared):
    problem, one = fit_study(noisy_setup(clean_run(0.0), 4), Route(starts=4), lambda *_: None)
    _, two = fit_study(noisy_setup(clean_run(0.0), 4), Route(starts=4, jobs=shared), lambda *_: None)
    assert one.point == two.point and one.cost == two.cost
    here, there = (bootstrap(problem, one, 6, seed=3, jobs=jobs) for jobs in (1, shared))
    assert np.array_equal(here.values, there.values)


def test_a_symbol_that_stands_in_two_functions_stays_one():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    inner = ca.Function("inner", [x], [ca.sin(x)])
    symbol, expression, function = unpacked(packed((x, x * y + inner(x), inner)))
    assert ca.is_equal(ca.jacobian(expression, symbol), ca.symvar(expression)[1] + ca.cos(symbol), 3)
    assert float(function(0.5)) == np.sin(0.5)


def test_what_belongs_to_this_process_is_refused():
    with pytest.raises(TypeError, match=r"cannot pickle|cannot be sent"):
        packed(threading.Lock())


def test_an_error_on_a_worker_is_that_of_the_caller(shared):
    def fail(k):
        raise ModelError(f"no {k}")

    with pytest.raises(ModelError, match="no 1"):
        list(in_parallel(fail, [1, 2], jobs=shared))


def test_work_that_a_worker_cannot_read_is_a_sentence(shared):
    with pytest.raises(CutOffError, match=r"A worker of the cluster cannot read its work: .*No module named"):
        list(in_parallel(site, [1], jobs=shared))  # a function of the tests, which is not on the path of the workers


def test_a_worker_with_another_version_is_refused(shared, monkeypatch):
    monkeypatch.setattr("cartpend_dae.cluster._versions", lambda: ("another",) * 6)
    with pytest.raises(
        CutOffError, match=r"A worker of the cluster differs in cartpend_dae \(another here, \w+ there\)"
    ):
        list(in_parallel(abs, [1], jobs=shared))


def test_a_worker_that_dies_is_replaced_by_the_others(tmp_path):
    mark = tmp_path / "died"

    def once_deadly(k):
        if k == 2 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), 9)
        return k * k

    with site(tmp_path) as (made, place):
        assert list(in_parallel(once_deadly, range(6), jobs=place)) == [k * k for k in range(6)]
        assert sum(worker.poll() is not None for worker in made.workers) == 1


def test_a_discovery_outlives_a_worker_that_is_killed_while_it_works(tmp_path):
    expected = numbers(discover(study(), cards=CARDS))
    with site(tmp_path) as (made, place):
        killed = []

        def report(stage, label, error):
            if stage == "first fit" and not killed:
                killed.append(made.workers[0].pid)
                made.workers[0].kill()

        assert numbers(discover(study(), cards=CARDS, jobs=place, report=report)) == expected
        assert killed


def test_what_was_finished_outlives_the_scheduler(tmp_path):
    expected = numbers(discover(study(), cards=CARDS))
    folder = tmp_path / "stages"
    with ExitStack() as stack:
        made, place = stack.enter_context(site(tmp_path))

        def report(stage, label, error):
            if stage == "first fit":
                made.scheduler.kill()
                made.scheduler.wait()

        with pytest.raises(LostError, match=r"was lost with \d+ parts of the work to come .*`--resume`"):
            discover(study(), cards=CARDS, jobs=place, report=report, store=store_for(study(), folder))
    kept = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert any(path.name.startswith("candidate-") for path in kept)
    with site(tmp_path) as (_, place):
        found = discover(study(), cards=CARDS, jobs=place, store=store_for(study(), folder))
    assert numbers(found) == expected
    assert {path: path.stat().st_mtime_ns for path in kept} == kept  # nothing was done twice


def test_a_cluster_without_workers_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr("cartpend_dae.cluster.DESERTED", 0.2)
    monkeypatch.setattr("cartpend_dae.cluster.LOOK", 0.1)
    with site(tmp_path, workers=1) as (made, place):
        made.workers[0].kill()
        with pytest.raises(LostError, match="no worker is left"):
            list(in_parallel(time.sleep, [0.1], jobs=place))


def test_no_scheduler_is_a_sentence(monkeypatch):
    monkeypatch.setattr("cartpend_dae.cluster.PATIENCE", 0.5)
    for address, clause in (("tcp://127.0.0.1:9", "Timed out"), ("junk://here", "unknown address scheme")):
        with (
            pytest.raises(StudyError, match=rf"`--cluster {address}`: no scheduler with workers answers.*{clause}"),
            cluster(address),
        ):
            pass


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(StudyError, match=r"pip install 'cartpend-dae\[cluster\]'"), cluster("tcp://127.0.0.1:9"):
        pass


def test_a_fleet_on_a_cluster_has_the_results_of_one_process(shared, tmp_path):
    made = studies(tmp_path, "one", "two", "three")
    assert shared.size <= len(made)  # so that whole studies go to the workers
    for out, options in (("here", []), ("there", ["--cluster", shared.address])):
        result = fleet(*made, "--out", tmp_path / out, "--command", "identify", *options)
        assert result.exit_code == 0, result.output
    assert content(tmp_path / "here") == content(tmp_path / "there")


def test_the_commands_take_a_cluster(shared, tmp_path):
    assert isinstance(shared, Cluster)
    results = []
    for name, options in (("here", []), ("there", ["--cluster", shared.address])):
        path = make_demo(tmp_path / name)
        out = tmp_path / f"{name}-out"
        done = CliRunner().invoke(cli.app, ["identify", str(path), "--out", str(out), "--bootstrap", "4", *options])
        assert done.exit_code == 0, done.output
        results.append(json.loads((out / "result.json").read_text("utf-8")))
    one, two = results
    assert one["baseline"] == two["baseline"] and one["bootstrap"] == two["bootstrap"]
