"""A new project runs as it stands; the lists name what there is; two results are compared."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from cartpend_dae import ModelError, StudyError
from cartpend_dae.cli import app
from cartpend_dae.effects import catalogue
from cartpend_dae.project import COULOMB, MASS, STIFFNESS, force, make_project, position
from cartpend_dae.report.comparison import differences, read_result
from cartpend_dae.shelf import component, components, matching


def run(*arguments, code=0):
    done = CliRunner().invoke(app, [*map(str, arguments)])
    assert done.exit_code == code, done.output
    return done.output


def test_the_cart_of_the_logs_stays_where_friction_holds_it():
    # 90 % of the break-away force moves nothing; then the spring and the friction share the force
    assert not position(np.full(200, 0.9 * COULOMB)).any()
    end = position(np.full(3000, 6.0))[-1]
    assert abs(STIFFNESS * end - 6.0) <= COULOMB
    # without damping to speak of the first swing takes half a period
    swing = position(np.full(200, 6.0))
    assert np.argmax(swing) * 0.01 == pytest.approx(np.pi * np.sqrt(MASS / STIFFNESS), abs=0.02)
    assert force(np.array([0.0]), 6.0, 0.35) == 0.0


def test_a_new_project_is_identified_as_it_stands(tmp_path):
    folder = tmp_path / "my rig ü"
    said = run("new", folder)
    assert "rig.py" in said and "cartpend discover" in said
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        ["README.md", "rig.py", "study.toml", "test.csv", "train1.csv", "train2.csv"]
    )
    run("check", folder / "study.toml")
    run("identify", folder / "study.toml", "--out", tmp_path / "found")
    result = read_result(tmp_path / "found")
    # what the model lacks bends what it has, by less than a tenth
    assert result["final"]["parameters"]["cart.m"]["value"] == pytest.approx(MASS, rel=0.1)


def test_the_same_seed_gives_the_same_files(tmp_path):
    for name in ("a", "b"):
        make_project(tmp_path / name)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_a_folder_that_holds_something_is_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(StudyError, match="is there already; name a folder that is new or empty"):
        make_project(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_every_component_is_listed_with_its_law():
    entries = components()
    assert len(entries) > 150
    assert all(entry.summary for entry in entries)
    friction = component("RailFriction")
    assert friction.parameters["f_c"]["unit"] == "N"
    assert friction.ports == {"flange_a": "Flange", "flange_b": "Flange"}
    assert friction in matching(entries, "RAIL friction")
    assert json.loads(run("components", "RailFriction", "--json"))["name"] == "translational.RailFriction"
    assert "f = d v + f_c sgn v" in run("components", "translational.RailFriction")


def test_an_unknown_or_ambiguous_component_is_answered_by_names():
    with pytest.raises(ModelError, match=r"no component `RailFricton`; did you mean .*`RailFriction`"):
        component("RailFricton")
    with pytest.raises(ModelError, match=r"several components `Fixed`: say which of .*`rotational.Fixed`"):
        component("Fixed")
    with pytest.raises(ModelError, match=r"no component `zzz`; `cartpend components` lists all"):
        component("zzz")
    shown = run("components", "Fixed")
    assert "rotational.Fixed" in shown and "translational.Fixed" in shown and "Force" not in shown


def test_words_need_no_quotes():
    assert run("components", "rail", "friction") == run("components", "rail friction")
    assert "quadratic_drag" in run("effects", "drag", "square")
    assert "lists all" in run("effects", "zzz", code=2)


@pytest.mark.parametrize("command", ["components", "effects"])
def test_the_word_list_in_front_lists(command):
    assert run(command, "list") == run(command)
    assert run(command, "list", "friction") == run(command, "friction")


def test_every_effect_is_listed():
    listed = json.loads(run("effects", "--json"))
    assert {card["id"] for card in listed} == {card.id for card in catalogue()}
    assert "small reversals" in run("effects", "backlash")
    run("effects", "backlach", code=2)


def result_of(mass, sd, error, steps=()):
    parameters = {"cart.m": {"value": mass, "sd": sd, "unit": "kg"}}
    outputs = {"encoder.s": {"rmse": error, "unit": "m"}}
    final = {"parameters": parameters, "experiments": {"test": {"outputs": outputs}}}
    return {"verdict": "explained" if steps else "unexplained", "final": final, "steps": list(steps)}


def test_two_results_differ_in_what_they_say(tmp_path):
    first = result_of(2.0, 0.03, 1e-3)
    second = result_of(2.1, 0.04, 2e-5, [{"effect": "coulomb_friction", "at": "rail"}])
    found = {(d.what, d.name): d for d in differences(first, second)}
    assert found["verdict", ""].second == "explained"
    assert found["effect", "coulomb_friction at rail"].first is None
    assert found["parameter", "cart.m"].distance == pytest.approx(0.1 / 0.05)
    assert found["error", "encoder.s in test"].second == 2e-5
    assert differences(first, first) == ()
    for name, result in (("a", first), ("b", second)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(json.dumps(result))
    assert "coulomb_friction at rail" in run("diff", tmp_path / "a", tmp_path / "b", code=1)
    assert "tell the same" in run("diff", tmp_path / "a", tmp_path / "a")


@pytest.mark.parametrize(
    ("text", "sentence"), [("{", "is no JSON"), ("[]", "is no result of `identify` or `discover`"), (None, "cannot be")]
)
def test_what_is_no_result_is_refused(tmp_path, text, sentence):
    if text is not None:
        (tmp_path / "result.json").write_text(text)
    with pytest.raises(StudyError, match=sentence):
        read_result(tmp_path)


def test_check_names_the_ends_that_hang_free(tmp_path):
    make_project(tmp_path / "rig")
    said = run("check", tmp_path / "rig" / "rig.py")
    assert "where nothing acts (1):\n  cart.flange_b\n" in said
