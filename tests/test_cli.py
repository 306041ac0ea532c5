"""What a user sees of the commands: results, sentences, exit codes, and nothing left behind by a failure."""

import json
import re
import signal
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from demo_run import demo_run
from typer.testing import CliRunner

from cartpend_dae import cli, fleet, simulate
from cartpend_dae.commands import studies
from cartpend_dae.compiled import SUFFIX
from cartpend_dae.errors import CutOffError
from cartpend_dae.report.files import complete
from cartpend_dae.session import discover_study, identify_study, open_study
from cartpend_dae.study import load_model, model_reference

MODELS = Path(__file__).resolve().parent.parent / "models"
ROTA_DAMP = str(MODELS / "rota_damp.py")


def run(*arguments):
    return CliRunner().invoke(cli.app, [str(argument) for argument in arguments])


def files_in(folder):
    found = (path for path in folder.rglob("*") if "__pycache__" not in path.parts)
    return {path: path.read_bytes() if path.is_file() else None for path in found}


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A right study in the working directory, to be made wrong."""
    monkeypatch.chdir(tmp_path)
    return demo_run().copy_inputs(tmp_path)


# --- the right way ---------------------------------------------------------------------------------------


def test_demo_names_coulomb_friction_and_prints_before_and_after():
    printed = demo_run().printed.stdout
    assert "The model lacked Coulomb friction at `bearing` (tau_c = 0.0150" in printed
    # the noise of the encoder is 0.057 deg; without friction the model is some 2 deg off at the end
    assert "on the test run `release3` fell from 2.17 deg to 0.06" in printed
    for head in ("What was tried", "Error of the model", "Parameters", "before", "after"):
        assert head in printed


def test_the_cache_is_shown_and_cleared(tmp_path, monkeypatch):
    monkeypatch.setenv("CARTPEND_CACHE", str(tmp_path))
    (tmp_path / "aa").mkdir()
    (tmp_path / "aa" / f"{'a' * 64}-{'b' * 64}{SUFFIX}").write_bytes(bytes(2_000_000))
    (tmp_path / "note.txt").write_text("not ours")
    where = f", 2.0 MB, in {tmp_path}\n"
    assert run("cache").stdout.endswith(f"1 compiled functions{where}")
    assert run("cache", "--clear").stdout.endswith(f"1 compiled functions deleted{where}")
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]


def test_demo_says_nothing_but_its_progress_on_stderr_where_there_is_no_terminal():
    # a line every 20 s, on a machine so slow
    assert all(re.match(r" *\d+\.\d s  ", line) for line in demo_run().printed.stderr.splitlines())


def test_demo_ships_the_model_and_the_study_of_the_repository():
    folder = demo_run().folder
    assert (folder / "rota_damp.py").read_bytes() == (MODELS / "rota_damp.py").read_bytes()
    of_repository = (MODELS / "studies" / "rota_damp.toml").read_text("utf-8")
    here = of_repository.replace('"../rota_damp.py"', '"rota_damp.py"').replace('"demo/', '"')
    shipped = (folder / "rota_damp.toml").read_text("utf-8")
    assert shipped.splitlines()[2:] == here.splitlines()[2:]


def test_demo_writes_every_file():
    names = {path.name for path in demo_run().results.iterdir()}
    runs = {f"{run}.{kind}" for run in ("release1", "release2", "release3") for kind in ("csv", "png")}
    rest = {"result.json", "model_plus.py", "parameters.csv", "candidates.csv", "candidates.png", "residuals.png"}
    rest |= {"report.html"}
    assert names == runs | rest


def test_linearize_prints_matrices_poles_and_damping():
    """The rod that hangs: w^2 = 3 g/(2 l), and 2 D w = 3 d/(m l^2)."""
    result = run("linearize", ROTA_DAMP, "--at", "steady", "--output", "bearing.phi")
    assert result.exit_code == 0
    w, decay = np.sqrt(1.5 * 9.81 / 0.86), 3 * 0.0375 / (0.1719 * 0.86**2)
    lines = result.stdout.splitlines()
    assert lines[0] == "RotaDamp, linear about a rest, continuous"
    *_, head, one, other = lines
    assert head.split() == ["pole", "[1/s]", "frequency", "[rad/s]", "damping", "ratio"]
    for row, sign in ((one, 1), (other, -1)):
        pole, frequency, damping = row.split()
        assert complex(pole) == pytest.approx(-decay / 2 + sign * 1j * np.sqrt(w**2 - decay**2 / 4), rel=1e-5)
        assert (float(frequency), float(damping)) == pytest.approx((w, decay / 2 / w), rel=1e-5)


def test_linearize_upright_and_sampled():
    target = MODELS / "driven_cart.py"
    options = ("--at", "bearing.phi=3.141592653589793", "--inputs", "amplifier.u=0", "--outputs", "motor.i")
    result = run("linearize", target, *options, "--period", "0.01", "--friction", "ignored", "--set", "motor.R=1")
    assert result.exit_code == 0
    assert "sampled every 0.01 s" in result.stdout and "amplifier.u = 0 V" in result.stdout
    assert re.search(r"^motor.i +1$|^  motor.i +1$", result.stdout, re.MULTILINE)  # D = 1/R


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--at", "rest"], "`--at rest`: expected NAME=VALUE"),
        (["--at", "bearing.x=1"], "has no variable `bearing.x`; did you mean"),
        (["--input", "u"], "RotaDamp has no input `u`; its inputs are: none."),
        (["--output", "bearing.x"], "has no variable `bearing.x`"),
        (["--period", "0"], "The sampling period must be a positive number of seconds, not 0.0."),
    ],
    ids=lambda v: " ".join(v) if isinstance(v, list) else "",
)
def test_linearize_refuses_in_a_sentence(options, sentence):
    result = run("linearize", ROTA_DAMP, *options)
    assert result.exit_code == 2
    assert sentence in " ".join(result.stderr.split()) and "Traceback" not in result.stderr


def test_check_shows_all_equations_then_what_is_left():
    result = run("check", ROTA_DAMP)
    assert result.exit_code == 0
    for line in (
        "flat equations (21):",
        "  bearing.tau = bearing.d*bearing.w    [bearing: equation 3]",
        "RotaDamp: 5 components, 21 variables, 21 equations, 7 parameters",
    ):
        assert line in result.stdout.splitlines()
    # which name of a quantity stands for its aliases is a matter of taste: counts and laws are not
    assert re.search(r"^eliminated, each as it follows from what is left \(\d+\):$", result.stdout, re.MULTILINE)
    assert "  states (2): " in result.stdout and re.search(r"equations left:\n(.*\n)*  rod: equation 6:", result.stdout)
    flat = result.stdout.split("eliminated")[0].splitlines()
    assert sum("[" in line for line in flat) == 21


def test_check_tells_on_request_how_the_states_were_chosen():
    result = run("check", "--structure", MODELS / "driven_cart.py")
    assert result.stdout.startswith(
        "DrivenCart: structural index 3 as written; 4 states and no algebraic unknowns are left"
    )
    assert "  rail.s = inertial.s" in result.stdout
    assert "flat equations" not in result.stdout


def test_check_shortens_long_lists_unless_told(tmp_path):
    short, long = (run("check", MODELS / "driven_cart.py", *flags) for flags in ((), ("--flat",)))
    assert "`--flat` shows all" in short.stdout and "`--flat`" not in long.stdout
    assert len(long.stdout.splitlines()) > len(short.stdout.splitlines())
    assert "@1" not in long.stdout.split("equations left")[0]


def test_check_of_a_study_shows_parameters_and_runs(study):
    result = run("check", study)
    assert result.exit_code == 0
    parameters, runs = (result.stdout.split(title)[1].split() for title in ("\nParameters", "\nRuns"))
    at = parameters.index("bearing.d")
    assert parameters[at : at + 6] == ["bearing.d", "0.03", "[0,", "1]", "N.m.s/rad", "free"]
    assert runs.count("train") == 2 and runs.count("test") == 1 and runs.count("601") == 3


def test_simulate_writes_what_the_library_computes(tmp_path):
    out = tmp_path / "run.csv"
    options = ["--set", "bearing.d=0.1", "--start", "bearing.phi=0.3", "--stop", "2", "--points", "21"]
    result = run("simulate", ROTA_DAMP, *options, "--out", out)
    assert result.exit_code == 0, result.output
    table = pd.read_csv(out)
    model = load_model(model_reference(ROTA_DAMP))
    truth = simulate(model, 2.0, points=21, parameters={"bearing.d": 0.1}, start={"bearing.phi": 0.3})
    np.testing.assert_array_equal(table["bearing.phi"], truth["bearing.phi"])
    assert table["time"].iloc[-1] == 2.0
    assert {path.name for path in tmp_path.iterdir()} == {"run.csv", "run.png"}
    assert f"{np.degrees(truth['bearing.phi'][-1]):.5g}" in result.stdout


def test_simulate_with_input_and_fixed_step_into_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = ["--input", "drive.u=2.0", "--method", "rk4", "--step", "0.01", "--stop", "1"]
    result = run("simulate", f"{MODELS / 'emps.py'}:EMPS", *options)
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "emps-simulation" / "simulation.csv")
    assert len(table) == 101
    # m v' = k u - d v from rest; rk4 at 0.01 s against a time constant of 0.475 s errs by some 1e-9
    speed = 35.15065 * 2 / 200 * (1 - np.exp(-200 / 95 * table["time"]))
    np.testing.assert_allclose(table["axis.v"], speed, rtol=0, atol=1e-8)


def test_identify_writes_a_result_and_says_that_something_is_missing(study):
    result = run("identify", study, "--out", "fit")
    assert result.exit_code == 0, result.output
    assert "The residuals are more than noise" in result.stdout
    found = json.loads(Path("fit/result.json").read_text("utf-8"))
    assert found["command"] == "identify" and found["verdict"] is None and found["steps"] == []
    assert found["baseline"] == found["final"]
    fit = demo_run().discovery.search.baseline
    # the same fits, one after the other, as the baseline of `discover`
    assert found["final"]["parameters"]["bearing.d"]["value"] == pytest.approx(fit.values["bearing.d"], rel=1e-6)
    assert not Path("fit/model_plus.py").exists()


def test_a_fixed_parameter_keeps_its_value_and_is_reported(study):
    text = study.read_text("utf-8") + '\n[parameters."rod.m"]\nguess = 171.9\nunit = "g"\nfixed = true\n'
    study.write_text(text, "utf-8")
    assert run("identify", study, "--out", "fit").exit_code == 0
    found = json.loads(Path("fit/result.json").read_text("utf-8"))["final"]["parameters"]
    assert found["rod.m"] == {"value": pytest.approx(0.1719), "sd": None, "unit": "kg", "status": "fixed"}
    assert found["bearing.d"]["status"] == "ok"


def test_the_functions_of_the_commands_take_a_path_or_an_opened_study(study):
    by_path, by_object = identify_study(study), identify_study(open_study(str(study)))
    assert by_path.values == by_object.values
    stages = []
    identify_study(study, report=lambda stage, label, error: stages.append(error))
    # the free fit at once leaves structure in the residuals, so that the four stages follow
    assert len(stages) == 5 and stages[-1] == pytest.approx(np.sqrt(by_path.chi2 / by_path.n_residuals))


def test_the_search_keeps_to_what_the_study_allows(study):
    append(study, '[discover]\ninclude = ["coulomb_friction", "quadratic_drag"]\nexclude = ["quadratic_drag"]\n')
    candidates = discover_study(study).search.candidates
    assert {candidate.insertion.card.id for candidate in candidates} == {"coulomb_friction"}


def test_results_go_into_a_folder_that_exists_beside_what_is_there(study):
    Path("fit").mkdir()
    Path("fit/mine.txt").write_text("mine")
    Path("fit/result.json").write_text("old")
    assert run("identify", study, "--out", "fit").exit_code == 0
    assert Path("fit/mine.txt").read_text() == "mine"
    assert json.loads(Path("fit/result.json").read_text("utf-8"))["schema"] == 1
    assert not [path for path in Path("fit").iterdir() if path.name.startswith(".")]


def test_version():
    result = run("--version")
    assert result.exit_code == 0 and result.stdout.startswith("cartpend_dae ")


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_the_example_of_a_command_can_be_called(name):
    command = cli.loaded(name)
    program, called, *arguments = cli.COMMANDS[name].example.split()
    assert (program, called) == ("cartpend", name) and command.epilog == f"Example: {cli.COMMANDS[name].example}"
    with command.make_context(name, arguments) as context:
        assert context.params and not context.args


def test_the_package_runs_as_a_module():
    done = subprocess.run([sys.executable, "-m", "cartpend_dae", "effects", "zzz"], capture_output=True, text=True)
    assert done.returncode == 2 and "no effect `zzz`" in done.stderr


# --- wrong inputs ----------------------------------------------------------------------------------------


def append(path, text):
    path.write_text(path.read_text("utf-8") + "\n" + text, "utf-8")


def change(old, new, name="rota_damp.toml"):
    def apply(folder):
        path = folder / name
        text = path.read_text("utf-8")
        assert old in text
        path.write_text(text.replace(old, new), "utf-8")

    return apply


def add(text):
    return lambda folder: append(folder / "rota_damp.toml", text)


SCORE = '[[score]]\nname = "force"\nkind = "inverse_dynamics"\ninput = "{}"\noutput = "bearing.phi"\ncutoff = 20.0\n'
WRONG_STUDIES = {
    "missing file": (lambda folder: (folder / "rota_damp.toml").unlink(), "there is no such study file"),
    "not toml": (change("[model]", "[model"), "not valid TOML"),
    "not text": (
        lambda folder: (folder / "rota_damp.toml").write_bytes(b"\xff\xfe\x00"),
        "is not UTF-8 text",
    ),
    "unknown key": (change('role = "test"', 'rolle = "test"'), "did you mean `role`"),
    "unknown parameter": (change("bearing.d", "bearing.dd"), "did you mean `bearing.d`"),
    "wrong unit of a parameter": (
        change("guess = 0.03", 'guess = 0.03\nunit = "kg"'),
        "is in `kg`, but the model has it in `N.m.s/rad`",
    ),
    "guess outside the bounds of the model": (
        change("guess = 0.03\nmin = 0.0", "guess = -0.5"),
        "outside the bounds [0, 1]",
    ),
    "bounds that exclude each other": (
        change("guess = 0.03\nmin = 0.0\nmax = 1.0", "max = -1.0"),
        "leaves nothing between its bounds",
    ),
    "unknown variable": (
        change('outputs = { "bearing.phi"', 'outputs = { "bearing.psi"'),
        "has no `bearing.psi`",
    ),
    "wrong unit of a column": (
        change('column = "angle", unit = "deg"', 'column = "angle", unit = "V"'),
        "is read in `V`",
    ),
    "missing column": (change('column = "angle"', 'column = "angel"'), "did you mean `angle`"),
    "missing data file": (change("release2.csv", "release9.csv"), "release9.csv"),
    "unknown input": (
        change("[[experiment]]", '[[experiment]]\ninputs = { "rod.m" = { column = "angle" } }'),
        "`rod.m`",
    ),
    "start that is no state": (
        change('"bearing.w" = { value = 0.0 }', '"bearing.tau" = { guess = 0.0, free = true }'),
        "cannot be free",
    ),
    "no runs": (
        lambda folder: (folder / "rota_damp.toml").write_text('[model]\npath = "rota_damp.py"\n'),
        "has no [[experiment]]",
    ),
    "missing model file": (change('"rota_damp.py"', '"rota.py"'), "there is no such model file"),
    "unknown class": (change('"RotaDamp"', '"RotaDump"'), "did you mean `RotaDamp`"),
    "unknown argument": (
        change('name = "RotaDamp"', 'name = "RotaDamp"\narguments = { length = 1.0 }'),
        "`length`",
    ),
    "syntax error in the model": (
        change("class RotaDamp(Component):", "class RotaDamp(Component:", "rota_damp.py"),
        "line 9",
    ),
    "name error in the equations": (
        change("self.ground.flange, self", "self.floor.flange, self", "rota_damp.py"),
        "rota_damp.py:25, `yield connect(self.floor.flange, self",
    ),
    "equation too many": (
        change("yield initial(self.bearing.w == 0)", "yield self.bearing.w == 0", "rota_damp.py"),
        "RotaDamp",
    ),
    "unknown effect": (add('[discover]\ninclude = ["coulomb"]'), "did you mean `coulomb_friction`"),
    "no effect left": (
        add('[discover]\ninclude = ["quadratic_drag"]\nexclude = ["quadratic_drag"]'),
        "leave no effect to try",
    ),
    "unknown place": (add('[discover]\nplaces = ["bearings"]'), "`bearings` is no place"),
    "score without its input": (add(SCORE.format("drive.u")), "has no input `drive.u`"),
}


@pytest.mark.parametrize("command", ["identify", "discover"])
@pytest.mark.parametrize(("spoil", "sentence"), WRONG_STUDIES.values(), ids=WRONG_STUDIES)
def test_wrong_study_gets_a_sentence_and_leaves_nothing(study, command, spoil, sentence):
    spoil(study.parent)
    before = files_in(study.parent)
    result = run(command, study, "--out", "results")
    assert result.exit_code == 2, result.output
    assert sentence in result.stderr
    assert "Traceback" not in result.output and result.stdout == ""
    # one line for each finding; three runs may all be wrong alike
    assert 1 <= len(result.stderr.strip().splitlines()) <= 4
    assert files_in(study.parent) == before


WRONG_CALLS = {
    "target of no kind": (["check", "rota_damp.csv"], "expected a study (FILE.toml) or a model"),
    "model that is not there": (["check", "rota.py"], "there is no such model file"),
    "class that is not there": (["check", "rota_damp.py:Rota"], "defines no Component `Rota`"),
    "setting without a value": (["simulate", "rota_damp.py", "--set", "bearing.d"], "expected NAME=VALUE"),
    "setting without a number": (["simulate", "rota_damp.py", "--set", "bearing.d=much"], "expected NAME=VALUE"),
    "setting that is not finite": (["simulate", "rota_damp.py", "--set", "bearing.d=nan"], "expected NAME=VALUE"),
    "setting of nothing known": (["simulate", "rota_damp.py", "--set", "bearing.dd=1"], "`bearing.d`"),
    "setting outside its bounds": (["simulate", "rota_damp.py", "--set", "bearing.d=-1"], "outside its bounds"),
    "start of nothing known": (["simulate", "rota_damp.py", "--start", "bearing.psi=1"], "`bearing.phi`"),
    "input of nothing known": (["simulate", "rota_damp.py", "--input", "u=1"], "no input `u`"),
    "no end": (["simulate", "rota_damp.py", "--stop", "-1"], "must be a positive number"),
    "rk4 without a step": (["simulate", "rota_damp.py", "--method", "rk4"], "go together"),
    "step without rk4": (["simulate", "rota_damp.py", "--step", "0.1"], "go together"),
    "results over a file": (["simulate", "rota_damp.py", "--out", "release1.csv/x"], "a file stands"),
    "fit over a file": (["identify", "rota_damp.toml", "--out", "release1.csv"], "a file stands"),
    "search over a file": (["discover", "rota_damp.toml", "--out", "release1.csv"], "a file stands"),
    "demo over a file": (["demo", "--out", "release1.csv"], "a file stands"),
    "unknown command": (["discovery", "rota_damp.toml"], "No such command"),
    "unknown option": (["check", "rota_damp.py", "--flatt"], "No such option"),
    "unknown method": (["simulate", "rota_damp.py", "--method", "euler"], "euler"),
    "missing argument": (["identify"], "Missing argument"),
}


@pytest.mark.parametrize(("arguments", "sentence"), WRONG_CALLS.values(), ids=WRONG_CALLS)
def test_wrong_call_gets_a_sentence_and_leaves_nothing(study, arguments, sentence):
    before = files_in(study.parent)
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert sentence in result.stderr
    assert "Traceback" not in result.output and result.stdout == ""
    assert files_in(study.parent) == before


def test_all_findings_of_a_study_are_reported_at_once(study):
    change("bearing.d", "bearing.dd")(study.parent)
    change("release2.csv", "release9.csv")(study.parent)
    add('[discover]\nexclude = ["coulomb"]')(study.parent)
    found = run("check", study).stderr.strip().splitlines()
    assert len(found) == 3
    for line, part in zip(found, ("bearing.dd", "release9.csv", "coulomb"), strict=True):
        assert part in line


def test_numbers_that_fail_are_exit_code_1(tmp_path):
    # d/J is 240 1/s: rk4 is stable up to a step of 2.8/240 s
    result = run("simulate", ROTA_DAMP, "--set", "bearing.d=10", "--method", "rk4", "--step", "0.1", "--out", tmp_path)
    assert result.exit_code == 1
    assert "use a smaller step" in result.stderr and "Traceback" not in result.output
    assert not list(tmp_path.iterdir())


def test_a_bug_is_one_line_that_says_how_to_see_more(study, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr(studies, "open_study", broken)
    result = run("identify", study)
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1 and "ZeroDivisionError: two lines" in result.stderr
    assert "CARTPEND_DEBUG=1" in result.stderr
    monkeypatch.setenv("CARTPEND_DEBUG", "1")
    assert isinstance(run("identify", study).exception, ZeroDivisionError)


def test_results_that_cannot_be_completed_leave_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError), complete(tmp_path / "new") as partial:
        (partial / "half.txt").write_text("half")
        _ = 1 / 0
    with pytest.raises(CutOffError, match=r"cannot be written: disk full"), complete(tmp_path / "new") as partial:
        (partial / "half.txt").write_text("half")
        raise OSError(28, "disk full")
    assert not list(tmp_path.iterdir())


# --- Ctrl-C ----------------------------------------------------------------------------------------------


def test_interrupt_of_a_fit_is_a_sentence_and_130(study, monkeypatch):
    def interrupted(opened, *, report, jobs):
        signal.raise_signal(signal.SIGINT)
        # the fit under way goes on, and the interrupt comes after it
        report("fit", "baseline", 1.0)
        raise AssertionError("the interrupt was lost")

    monkeypatch.setattr(fleet, "solve_study", interrupted)
    handler = signal.getsignal(signal.SIGINT)
    before = files_in(study.parent)
    result = run("identify", study)
    assert result.exit_code == 130
    assert "Interrupted; nothing was written." in result.stderr
    assert files_in(study.parent) == before
    assert signal.getsignal(signal.SIGINT) is handler


def test_interrupt_of_a_search_writes_the_best_so_far(study, monkeypatch):
    found = demo_run().discovery
    search = replace(found.search, interrupted=True)
    monkeypatch.setattr(fleet, "discover_study", lambda opened, **_: replace(found, search=search))
    result = run("discover", study, "--out", "results")
    assert result.exit_code == 0, result.output
    assert "The search was interrupted; this is the best so far." in result.stdout
    assert json.loads(Path("results/result.json").read_text("utf-8"))["interrupted"] is True


def test_the_module_runs_as_a_program():
    result = subprocess.run(
        [sys.executable, "-m", "cartpend_dae.cli", "check", "nothing.toml"], capture_output=True, text=True, check=False
    )
    assert result.returncode == 2
    assert result.stderr.strip().endswith("nothing.toml: there is no such study file.")


def test_the_list_of_commands_is_that_of_their_own_help():
    for name, command in cli.COMMANDS.items():
        assert cli.loaded(name).help.splitlines()[0] == command.summary
    for module in {command.module for command in cli.COMMANDS.values()}:
        assert import_module(f"cartpend_dae.commands.{module}")


def test_help_imports_nothing_that_takes_time():
    code = """
import sys
from cartpend_dae.cli import main
try:
    main(["--help"])
except SystemExit as end:
    assert not end.code
slow = {"casadi", "numpy", "scipy", "pandas", "matplotlib", "fmpy"} & set(sys.modules)
assert not slow, slow
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_command_that_is_misspelt_is_answered_by_the_nearest_one():
    result = run("simulat")
    assert result.exit_code == 2 and "simulate" in result.stderr
