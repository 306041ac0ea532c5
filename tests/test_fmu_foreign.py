"""FMUs that others made: read, run beside models composed here, and contained where they misbehave."""

import json
import math
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import casadi as ca
import foreign_fmus
import numpy as np
import pytest
from typer.testing import CliRunner

from cartpend_dae import (
    Component,
    Param,
    Statements,
    assemble,
    der,
    initial,
    param,
    reinit,
    signal,
    simulate,
    var,
    when,
)
from cartpend_dae.cli import app
from cartpend_dae.errors import ModelError, SolverError, StudyError
from cartpend_dae.fmi.crosscheck import crosscheck, tube_use
from cartpend_dae.fmi.foreign import load_fmu

ROOT = Path(__file__).resolve().parent.parent


class Hopper(Component):
    """The model of `foreign/hopper.c`, composed here."""

    s = var(unit="m")
    v = var(unit="m/s")
    f = signal("in", unit="N", default=0.0)
    m: Param = param(unit="kg", default=2.0)
    k: Param = param(unit="N/m", default=8.0)
    d: Param = param(unit="N.s/m", default=0.5)
    e: Param = param(unit="1", default=0.7)
    l: Param = param(unit="m", default=0.2)  # noqa: E741 (the name in the FMU)

    def equations(self) -> Statements:
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.f - self.d * self.v - self.k * (self.s - self.l)
        yield initial(self.s == 1)
        yield initial(self.v == 0)
        yield when(self.s < 0, reinit(self.v, -self.e * self.v))


@pytest.fixture(scope="module")
def hopper(tmp_path_factory):
    return foreign_fmus.build_hopper(tmp_path_factory.mktemp("hopper"))


@pytest.fixture(scope="module")
def lag(tmp_path_factory):
    return foreign_fmus.build_lag(tmp_path_factory.mktemp("lag"))


def test_what_an_fmu_says_of_itself(hopper):
    fmu = load_fmu(hopper)
    d = fmu.description
    assert (d.model, d.version, d.kinds, d.n_states, d.n_indicators, d.stop) == ("Hopper", "2.0", ("me",), 2, 1, 3.0)
    assert fmu.names("input") == ["f"] and fmu.names("parameter") == ["m", "k", "d", "e", "l", "misbehave"]
    assert {v.name: v.unit for v in fmu.variables}["v"] == "m/s"


@pytest.mark.parametrize(
    "force",
    [0.0, -3.0, lambda t: 4 * ca.sin(7 * t), ([0.0, 0.5, 1.3, 2.0], [0.0, 4.0, -6.0, 1.0], "zoh")],
    ids=["none", "constant", "function", "samples"],
)
def test_an_fmu_with_events_runs_as_the_model_composed_here(hopper, force):
    theirs = load_fmu(hopper).simulate(3.0, inputs={"f": force}, parameters={"d": 0.3}, contain=False)
    ours = simulate(Hopper(d=0.3), 3.0, inputs={"f": force})
    # both at rtol 1e-8, through bounces that magnify errors a little
    assert np.abs(theirs["s"] - ours["s"]).max() < 1e-6
    assert np.abs(theirs["v"] - ours["v"]).max() < 1e-5 or theirs["bounces"][-1] > 2


def test_an_fmu_3_of_casadi_meets_the_closed_form(lag):
    theirs = load_fmu(lag).simulate(2.0, inputs={"u": 1.5}, parameters={"T": 0.25, "k": 3.0})
    x = 4.5 + (theirs["x"][0] - 4.5) * np.exp(-theirs.time / 0.25)
    assert np.abs(theirs["x"] - x).max() < 1e-7
    assert np.abs(theirs["y"] - (x**2 + x)).max() < 1e-6


def test_a_crash_and_a_loop_are_contained_and_told(hopper):
    fmu = load_fmu(hopper)
    with pytest.raises(SolverError, match=r"the FMU crashed \(SIGSEGV\) while it had to run for ME"):
        fmu.simulate(parameters={"misbehave": 1})
    with pytest.raises(SolverError, match="was ended after 2 s while it had to run"):
        fmu.simulate(parameters={"misbehave": 2}, limit=2.0)
    with pytest.raises(SolverError, match=r"fails to compute its derivatives.*I refuse at 0.1"):
        fmu.simulate(parameters={"misbehave": 3})


def test_names_and_kinds_that_an_fmu_has_not(hopper):
    fmu = load_fmu(hopper)
    with pytest.raises(ModelError, match="has no input `g`; there are: `f`"):
        fmu.simulate(inputs={"g": 1.0})
    with pytest.raises(ModelError, match="has no variable `mass`"):
        fmu.simulate(parameters={"mass": 1.0})
    with pytest.raises(ModelError, match="offers ME, not 'cs'"):
        fmu.simulate(kind="cs")
    with pytest.raises(SolverError, match=r"`der\(s\)` cannot be set before a run"):
        fmu.simulate(start={"der(s)": 1.0}, contain=False)
    with pytest.raises(ModelError, match="must be numbers"):
        fmu.simulate(parameters={"k": "soft"})


def test_a_crosscheck_finds_agreement_and_a_wrong_parameter(hopper):
    system = assemble(Hopper())
    same = crosscheck(hopper, system, inputs={"f": -1.0}, parameters={"k": 9.0})
    assert same.passed and {row.name for row in same.compared} == {"s", "v", "f"}
    assert all(row.use < 1e-3 for row in same.compared)
    other = crosscheck(hopper, assemble(Hopper(e=0.5)), inputs={"f": -1.0})
    assert not other.passed
    assert "parameter `e` is 0.7 in the FMU and 0.5 in the model" in other.notes
    assert str(other).splitlines()[-1].startswith("DIFFERS")


class Renamed(Component):
    """The lag of CasADi under other names, in other units."""

    z = var(unit="1")
    drive = signal("in", unit="1")

    def equations(self) -> Statements:
        yield der(self.z) == (2 * self.drive - self.z) / 0.4


def test_a_crosscheck_with_names_of_its_own(lag):
    """The start is the FMU's where it shows the state."""
    result = crosscheck(lag, assemble(Renamed()), mapping={"x": "z", "u": "drive"}, inputs={"drive": 1.0}, stop=1.0)
    assert result.passed and {row.name for row in result.compared} == {"z", "drive"}
    with pytest.raises(ModelError, match="share no variable"):
        crosscheck(lag, assemble(Renamed()), inputs={"drive": 1.0}, stop=1.0)


def test_a_tube_allows_a_jump_that_comes_a_little_late():
    time = np.linspace(0.0, 1.0, 1001)
    step, late, too_late = (np.where(time > at, 1.0, 0.0) for at in (0.5, 0.5015, 0.51))
    assert tube_use(time, step, late, 0.002) == 0.0
    assert tube_use(time, step, too_late, 0.002) == pytest.approx(500.0)
    assert tube_use(time, step, step + 0.001, 0.002) == pytest.approx(0.5)
    assert math.isinf(tube_use(time, step, np.where(time > 0.9, np.nan, step), 0.002))


def test_the_commands(hopper, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    report = run(app, ["check-fmu", str(hopper), "--json"])
    assert report.exit_code == 0 and json.loads(report.stdout)["passed"]
    Path("hop.py").write_text(
        textwrap.dedent(
            """
            from cartpend_dae import Component, der, initial, param, reinit, var, when

            class Hop(Component):
                s = var(unit="m")
                v = var(unit="m/s")
                m = param(unit="kg", default=2.0)
                k = param(unit="N/m", default=8.0)
                d = param(unit="N.s/m", default=0.5)
                l = param(unit="m", default=0.2)

                def equations(self):
                    yield der(self.s) == self.v
                    yield self.m * der(self.v) == -self.d * self.v - self.k * (self.s - self.l)
                    yield when(self.s < 0, reinit(self.v, -0.7 * self.v))
            """
        )
    )
    result = run(app, ["crosscheck", str(hopper), "hop.py", "--out", "out"])
    assert result.exit_code == 0 and "AGREES: 2 of 2" in result.stdout
    assert sorted(p.name for p in Path("out").iterdir()) == [
        "crosscheck.json",
        "crosscheck.png",
        "fmu.csv",
        "model.csv",
    ]
    Path("list.toml").write_text(
        f'[[check]]\nfmu = "{hopper}"\nmodel = "hop.py"\n[[check]]\nfmu = "none.fmu"\nmodel = "hop.py"\n'
    )
    result = run(app, ["crosscheck", "list.toml"])
    assert result.exit_code == 0 and "absent: none.fmu" in result.stdout and "AGREES" in result.stdout
    Path("bad.toml").write_text('[[check]]\nfmu = "a"\nmodel = "b"\ntubes = 3\n')
    for arguments, code, text in [
        (["crosscheck", "bad.toml"], 2, "check.0.tubes"),
        (["crosscheck", str(hopper)], 2, "name the model"),
        (["crosscheck", str(hopper), "hop.py", "--map", "s"], 2, "joined by `=`"),
        (["crosscheck", str(hopper), "hop.py", "--kind", "xx"], 2, "choose `me`"),
        (["check-fmu", "hop.py"], 2, "this is no FMU"),
    ]:
        result = run(app, arguments)
        assert result.exit_code == code and text in result.stderr, (arguments, result.stderr)


def test_the_standing_list_of_the_repository_is_well_formed():
    result = CliRunner().invoke(app, ["crosscheck", str(ROOT / "fmu" / "crosscheck.toml")])
    assert result.exit_code == 0, result.stderr


def test_a_run_that_is_interrupted_leaves_no_process(hopper):
    """The process of the FMU is ended with the run that waits for it."""
    code = (
        "import sys; from cartpend_dae.fmi.foreign import load_fmu\n"
        f"try:\n load_fmu({str(hopper)!r}).simulate(parameters={{'misbehave': 2}}, limit=5.0)\n"
        "except Exception as error:\n print(error)\n"
        "import subprocess; print(subprocess.run(['ps', '-o', 'args', '--ppid', str(__import__('os').getpid())],"
        " capture_output=True, text=True).stdout)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert "was ended after 5 s" in run.stdout and "fmi.child" not in run.stdout


def test_a_file_that_is_no_fmu_is_a_study_error(tmp_path):
    path = tmp_path / "a.fmu"
    path.write_text("no zip")
    with pytest.raises(StudyError, match="this is no FMU"):
        load_fmu(path)
