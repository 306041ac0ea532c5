"""`cartpend identify` with profile and bootstrap on the command line, and what it says of the form it rests on."""

import json
from pathlib import Path

import numpy as np
import pytest
from linear_runs import stuck_pendulum
from typer.testing import CliRunner

from cartpend_dae import cli

STUDY = """
[model]
path = "dry.py"

[parameters."bearing.d"]
guess = 0.02
min = 0.0

[parameters."bearing.tau_c"]
guess = 0.008
min = 0.0

[[experiment]]
name = "run"
file = "run.csv"
time = { column = "t", unit = "s" }
outputs = { "bearing.phi" = { column = "phi", unit = "rad", sd = 1e-3 } }
start = { "bearing.phi" = { guess = -0.7 }, "bearing.w" = { value = 0.0 } }
"""


def run(*arguments):
    return CliRunner().invoke(cli.app, [str(argument) for argument in arguments])


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A pendulum that comes to rest in its dry bearing."""
    monkeypatch.chdir(tmp_path)
    measured = stuck_pendulum().experiments[0]
    rows = zip(measured.time.tolist(), measured.outputs["bearing.phi"].values.tolist(), strict=True)
    Path("run.csv").write_text("t,phi\n" + "".join(f"{t!r},{y!r}\n" for t, y in rows))
    Path("dry.py").write_text('from linear_runs import Dry as Base\n\n\nclass Dry(Base):\n    """As there."""\n')
    Path("study.toml").write_text(STUDY)
    return Path("study.toml")


def result_of(folder):
    return json.loads(Path(folder, "result.json").read_text("utf-8"))


def test_profile_and_bootstrap_stand_beside_the_formula(study):
    asked = ["--profile", "bearing.tau_c", "--bootstrap", "100"]
    result = run("identify", study, "--out", "fit", *asked, "--jobs", "2")
    assert result.exit_code == 0, result.output
    found = result_of("fit")
    item = found["final"]["parameters"]["bearing.tau_c"]
    half = 1.96 * item["sd"]
    low, high = found["profiles"]["bearing.tau_c"]["interval"]
    # nearly linear over two sds: profile and formula agree to 5 % of the interval
    assert [low, high] == pytest.approx([item["value"] - half, item["value"] + half], abs=0.05 * half)
    again = found["bootstrap"]
    assert (again["kind"], again["fits"] + again["failed"], again["failed"]) == ("parametric", 100, 0)
    for name, drawn in again["parameters"].items():
        if name in found["final"]["parameters"]:
            # the sd of 100 fits is known to 1/sqrt(200) = 7 %
            assert drawn["sd"] == pytest.approx(found["final"]["parameters"][name]["sd"], rel=0.25)
    # what is printed is what was written
    line = next(
        line for line in result.stdout.splitlines() if line.strip().startswith("bearing.tau_c [N.m]") and "to" in line
    )
    assert f"{low:.5g} to {high:.5g}" in line
    assert f"{again['parameters']['bearing.tau_c']['sd']:.3g}" in line


def test_the_bootstrap_does_not_depend_on_the_number_of_processes_and_takes_blocks(study):
    found = []
    for jobs in ("1", "2"):
        asked = ["--bootstrap", "6", "--bootstrap-kind", "block", "--jobs", jobs]
        assert run("identify", study, "--out", f"fit{jobs}", *asked).exit_code == 0
        found.append(result_of(f"fit{jobs}")["bootstrap"])
    assert found[0] == found[1]
    assert found[0]["kind"] == "block" and found[0]["block"] > 1


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        (
            ["--profile", "rod.m"],
            "There is no estimated parameter `rod.m` to profile; those of the fit are: `bearing.d`",
        ),
        (["--bootstrap", "1"], "Of 1 fits of the bootstrap 1 converged: too few to say anything."),
        (["--bootstrap-kind", "blocks"], "'blocks' is not one of 'parametric', 'block'"),
    ],
)
def test_what_cannot_be_asked_is_said(study, asked, sentence):
    result = run("identify", study, "--out", "fit", *asked)
    assert result.exit_code in (1, 2)
    assert sentence in " ".join(result.output.replace("│", " ").split())
    assert not Path("fit", "result.json").exists()


def test_the_result_says_on_which_form_of_friction_it_rests(study):
    result = run("identify", study, "--out", "fit")
    assert "The figures rest on the exact form of the model" in " ".join(result.stdout.split())
    exact = result_of("fit")
    study.write_text("[identify]\nexact = false\n" + STUDY)
    assert run("identify", study, "--out", "fast").exit_code == 0
    fast = result_of("fast")
    assert (exact["form"], fast["form"]) == ("exact", "time-stepping")
    for name, item in exact["final"]["parameters"].items():
        moved = abs(item["value"] - fast["final"]["parameters"][name]["value"])
        assert 0 < moved < item["sd"]


def test_method_and_hessian_of_a_study_lead_to_the_same_optimum(study):
    study.write_text('[identify]\nmethod = "collocation"\nhessian = "exact"\n' + STUDY)
    assert run("identify", study, "--out", "all").exit_code == 0
    study.write_text(STUDY)
    assert run("identify", study, "--out", "steps").exit_code == 0
    one, two = (result_of(folder)["final"]["parameters"] for folder in ("all", "steps"))
    for name in one:
        np.testing.assert_allclose(one[name]["value"], two[name]["value"], atol=0.02 * two[name]["sd"])


def test_a_method_that_does_not_exist_is_refused(study):
    study.write_text('[identify]\nmethod = "magic"\n' + STUDY)
    result = run("identify", study, "--out", "fit")
    assert result.exit_code == 2
    assert "method" in result.output and "shooting" in result.output
