"""The report's numbers, sentences and drawings, without a browser."""

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from demo_run import demo_run
from typer.testing import CliRunner

from cartpend_dae import Component, Statements, assemble, der, initial, var
from cartpend_dae.cli import app
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.errors import StudyError
from cartpend_dae.horizons import error_ahead
from cartpend_dae.report import facts, findings
from cartpend_dae.report.charts import Line, panel, thinned
from cartpend_dae.report.diagram import diagram_json, read_diagram
from cartpend_dae.report.drawing import Mark, draw
from cartpend_dae.report.layout import layered
from cartpend_dae.report.numbers import number, prefixed
from cartpend_dae.report.page import page_of, write_page
from cartpend_dae.report.stored import Stored, read_stored
from cartpend_dae.study import load_model, model_reference

pytestmark = pytest.mark.xdist_group("report")

MODELS = Path(__file__).resolve().parent.parent / "models"


def stored_result() -> dict:
    return json.loads((demo_run().results / "result.json").read_text("utf-8"))


def sentence(result: dict) -> str:
    return "".join(words.text for words in facts.headline(result))


# --- from the folder alone ---------------------------------------------------------------------------------


def test_the_report_is_made_again_from_its_folder(tmp_path):
    """`result.json` and the tables alone give the same page to the byte."""
    source = demo_run().results
    for name in ("result.json", "release1.csv", "release2.csv", "release3.csv"):
        (tmp_path / name).write_bytes((source / name).read_bytes())
    answer = CliRunner().invoke(app, ["report", str(tmp_path)])
    assert answer.exit_code == 0, answer.output
    assert (tmp_path / "report.html").read_bytes() == (source / "report.html").read_bytes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "name a folder that `cartpend identify` or `discover` wrote to"),
        ("{", "this is not JSON"),
        ("[]", "this is no result of"),
        ('{"schema": 1, "command": "design"}', "this is no result of"),
        ('{"schema": 1, "command": "discover"}', "the result is not complete"),
        ('{"schema": 1, "command": "discover", "files": {"runs": {"a": "../a.csv"}}}', "is no file of this folder"),
        ('{"schema": 1, "command": "discover", "files": {"runs": {"a": "a.csv"}}}', "the result is not complete"),
    ],
)
def test_a_folder_without_a_result_is_a_sentence(tmp_path, content, message):
    if content is not None:
        (tmp_path / "result.json").write_text(content)
    answer = CliRunner().invoke(app, ["report", str(tmp_path)])
    assert answer.exit_code == 2
    assert message in answer.output and "Traceback" not in answer.output


def test_a_missing_table_and_a_wrong_one_are_sentences(tmp_path):
    (tmp_path / "result.json").write_text(json.dumps(stored_result()))
    with pytest.raises(StudyError, match=r"release1\.csv: .*the report needs the tables of all runs"):
        read_stored(tmp_path)
    (tmp_path / "release1.csv").write_text("time,x\n0,1\n")
    with pytest.raises(StudyError, match="this is not the table of the run `release1`"):
        read_stored(tmp_path)


def test_what_an_older_result_lacks_is_left_out_with_a_sentence(tmp_path):
    result = stored_result()
    for key in ("diagram", "ledger", "files", "horizons", "command_line"):
        del result[key]
    (tmp_path / "result.json").write_text(json.dumps(result))
    page = write_page(tmp_path).read_text("utf-8")
    assert page.count("it was written by an older version") == 4
    assert "does not hold errors over horizons" in page
    assert "RotaDamp lacked Coulomb friction at bearing." in page


def test_the_result_says_what_it_was_made_from():
    result = stored_result()
    assert result["command_line"] == f"cartpend discover {demo_run().folder / 'rota_damp.toml'}"
    assert [file["name"] for file in result["ledger"]["files"]][:2] == ["rota_damp.toml", "rota_damp.py"]
    assert {file["bytes"] for file in result["ledger"]["files"]} == {
        (demo_run().folder / file["name"]).stat().st_size for file in result["ledger"]["files"]
    }
    assert result["diagram"]["connections"] == [
        ["base.flange", "rod.pivot"],
        ["ground.flange", "bearing.flange_a"],
        ["bearing.flange_b", "rod.shaft"],
    ]


# --- sentences and numbers ---------------------------------------------------------------------------------


def test_each_verdict_has_its_sentence():
    result = stored_result()
    assert sentence(result) == "RotaDamp lacked Coulomb friction at bearing."
    assert sentence(result | {"verdict": "improved"}).endswith("at bearing, and still lacks something.")
    nothing = result | {"steps": [], "verdict": "no-discrepancy"}
    assert sentence(nothing) == "RotaDamp explains its data: nothing is missing."
    assert "no effect of the catalogue" in sentence(nothing | {"verdict": "unexplained"})
    assert sentence(nothing | {"verdict": "not in the catalogue", "message": "It drags."}) == "It drags."
    fitted = nothing | {"command": "identify", "verdict": None}
    assert sentence(fitted) == "RotaDamp is calibrated, and explains its data."
    vague = json.loads(json.dumps(fitted))
    vague["final"]["parameters"]["bearing.d"]["status"] = "unidentifiable"
    assert "do not determine all of its parameters" in sentence(vague)
    assert "These runs do not determine bearing.d" in " ".join(facts.summary(vague))
    assert not facts.is_good(vague)


def test_the_first_screen_shows_the_run_that_the_fit_never_saw():
    (row,) = facts.deciding(facts.error_rows(stored_result()))
    assert (row.run, row.role, row.what, row.unit) == ("release3", "test", "bearing.phi", "deg")
    marks = row.marks()
    # the track is logarithmic: distances are ratios
    ratio = (marks["before"] - marks["after"]) / (marks["before"] - marks["noise"])
    assert ratio == pytest.approx(math.log(row.before / row.after) / math.log(row.before / row.noise))


def test_the_errors_of_an_output_have_one_unit_on_all_runs():
    """Of runs that are off by 12 mm, 5 mm and 11 mm none is told in metres."""
    result = json.loads(json.dumps(stored_result()))
    for moment in ("baseline", "final"):
        for run, rmse in (("release1", 0.0124), ("release2", 0.0053), ("release3", 0.0106)):
            result[moment]["experiments"][run]["outputs"]["bearing.phi"].update(unit="m", rmse=rmse, noise_sd=2e-5)
    rows = facts.error_rows(result)
    assert [row.unit for row in rows] == ["mm"] * 3
    assert [row.before for row in rows] == pytest.approx([12.4, 5.3, 10.6])
    assert [row.noise for row in rows] == pytest.approx([0.02] * 3)


def test_a_parameter_says_how_far_it_moved():
    rows = {row.name: row for row in facts.parameter_rows(stored_result())}
    assert rows["bearing.coulomb_friction.tau_c"].is_new
    # 0.01932(17) to 0.009988(14): the difference over the root of the summed variances
    # in a narrow column a line ends after the comma, not between a number and its unit
    assert rows["bearing.d"].moved == "−48.3\N{NO-BREAK SPACE}%, 54\N{NO-BREAK SPACE}sd"
    before, after = rows["bearing.d"].intervals
    assert before.low < before.middle < before.high and after.high < before.low


@pytest.mark.parametrize(
    ("z", "is_more", "words"), [(9.5, True, "structure is left"), (-2.6, False, "no structure is left")]
)
def test_the_ledger_says_whether_structure_is_left(z, is_more, words):
    gate = {"baseline": {"largest": z, "is_more_than_noise": is_more}, "limit": 4.0}
    runs = {"first": {"role": "train"}}
    said = findings.ledger_lines({"candidates": [], "baseline": {"experiments": runs}, "gate": gate, "steps": []})
    assert said[0] == f"The model as it was is fitted on first; {words}: z = {number(z)} (limit 4)."


@pytest.mark.parametrize(
    ("regime", "n_candidates", "words"),
    [
        ("forces", 1, "chose between candidates."),
        ("noise", 1, "was not needed: noise alone decided between candidates."),
        ("noise", 0, "was not needed: only a search against random forces reads a run that is kept to choose."),
        ("disturbances", 1, "was not needed: only a search against random forces reads a run that is kept to choose."),
        (None, 0, "was not needed: only a search against random forces reads a run that is kept to choose."),
    ],
)
def test_the_ledger_says_of_a_run_of_selection_what_it_did(regime, n_candidates, words):
    """It is read where effects are judged against random forces, and nowhere else."""
    gate = {"baseline": {"largest": 9.0, "is_more_than_noise": True}, "limit": 4.0}
    runs = {"first": {"role": "train"}, "second": {"role": "select"}}
    result = {"candidates": [{}] * n_candidates, "baseline": {"experiments": runs}, "gate": gate, "steps": []}
    assert f"second {words}" in findings.ledger_lines(result | {"regime": regime})


def test_rates_have_their_intervals():
    """1 of 20: 0.1 to 25 % (Clopper and Pearson); 20 of 20: 83 to 100 %."""
    rates = [{"removed": None, "n": 20, "hits": 1}, {"removed": "bearing.coulomb_friction", "n": 20, "hits": 20}]
    placebo, power = findings.rate_bars(stored_result() | {"rates": rates})
    assert placebo.text == "1 of 20" and placebo.note == "95 %: 0.13 to 25 %" and not placebo.is_accepted
    assert power.text == "20 of 20" and power.note == "95 %: 83 to 100 %"


def test_what_is_left_and_what_would_tell_answers_apart_are_shown():
    place = {"at": "bearing", "evidence": 12.0, "placebo": 3.0, "rms": 0.02, "unit": "N.m", "is_seen": True}
    unseen = place | {"at": "rod", "evidence": 0.0, "is_seen": False}
    left = {"message": "A force of `bearing` is left.", "at": "bearing", "places": [place, unseen]}
    left["portraits"] = [{"at": "rod", "shares": {"x": 0.9}}, {"at": "bearing", "shares": {"x": 0.1, "sign v": 0.7}}]
    left["closures"] = [{"kind": "spline", "at": "bearing", "gain": 812.3, "largest_z_left": 1.7}]
    run, head = next(iter(stored_result()["final"]["experiments"].items()))
    name = next(iter(head["outputs"]))
    left["experiments"] = {run: {"role": head["role"], "outputs": {name: {"rmse": 0.00012345, "unit": "rad"}}}}
    result = stored_result() | {"open_set": left} | {"splits": [{"message": "A step of `u` tells them apart."}]}
    first, second = findings.unknown_bars(result)
    assert (first.length, first.is_accepted, first.note) == (100.0, True, "placebo 3, rms 0.02 N.m")
    assert second.text == "not seen"
    assert [(bar.label, bar.text) for bar in findings.share_bars(result)] == [("sign v", "70 %"), ("x", "10 %")]
    (closure,) = findings.closure_rows(result)
    assert (closure.kind, closure.at, closure.gain) == ("splines", "bearing", "812.3")
    (ceiling,) = findings.ceiling_rows(result)
    assert ceiling[:3] == (run, head["role"], name) and ceiling[-1].startswith("0.00707")  # degrees
    page = page_of(Stored(result, ()))
    assert "A step of <code>u</code> tells them apart." in page
    assert "A force of <code>bearing</code> is left." in page
    assert "splines" in page and "with the best closure" in page


def test_numbers_are_short_and_have_no_computer_exponent():
    assert [number(x) for x in (0.0602, 7024.7, 123456.0, 3.4e-10, -0.06, None, math.nan)] == [
        "0.0602",
        "7025",
        "123\u202f456",
        "3.4·10⁻¹⁰",
        "−0.06",
        "–",
        "–",
    ]
    assert number(2.5e8) == "2.5·10⁸"
    assert prefixed("m", 7.12e-5) == (1e6, "µm")
    assert prefixed("N.m", 2e-3) == (1e3, "mN.m")
    assert prefixed("rad/s", 2e-3) == (1.0, "rad/s") and prefixed("m", 0.2) == (1.0, "m")


# --- pictures ----------------------------------------------------------------------------------------------


def test_no_edge_is_longer_than_a_layer_and_no_boxes_overlap():
    """A cube is bipartite, and has cycles."""
    graph = [[j for j in range(8) if (i ^ j).bit_count() == 1] for i in range(8)]
    sizes = [10.0 + 3 * i for i in range(8)]
    placed = layered(graph, sizes, 5.0)
    for node, near in enumerate(graph):
        assert all(abs(placed[node][0] - placed[other][0]) == 1 for other in near)
    for level in range(4):
        row = sorted((at, node) for node, (layer, at) in enumerate(placed) if layer == level)
        for (a, i), (b, j) in pairwise(row):
            assert b - a >= (sizes[i] + sizes[j]) / 2 + 5.0 - 1e-9


def test_a_tree_is_drawn_without_crossings():
    graph = [[1, 2], [0, 3, 4], [0, 5, 6], [1], [1], [2], [2]]
    placed = layered(graph, [10.0] * 7, 4.0, first=[0])
    edges = [(placed[i], placed[j]) for i in range(7) for j in graph[i] if placed[i][0] < placed[j][0]]
    for (a, b), (c, d) in ((e, f) for e in edges for f in edges if e[0][0] == f[0][0]):
        assert (a[1] - c[1]) * (b[1] - d[1]) >= 0


def test_a_chain_is_a_straight_line():
    placed = layered([[1], [0, 2], [1, 3], [2]], [10.0, 0.0, 30.0, 0.0], 5.0)
    assert sorted(layer for layer, _ in placed) == [0, 1, 2, 3]
    assert np.ptp([at for _, at in placed]) < 1e-6


@pytest.mark.parametrize("name", ["rota_damp", "emps", "driven_cart", "linear_damp", "closed_loop"])
def test_a_drawing_has_every_part_and_marks_the_place(name):
    system = assemble(load_model(model_reference(str(MODELS / f"{name}.py"))))
    diagram = read_diagram(diagram_json(system, []))
    place = diagram.parts[-1].path
    for upright in (False, True):
        drawing = draw(diagram, [Mark(f"{place}.flange", "+ a load")], upright=upright)
        assert drawing.svg.count('<g class="part') == len(diagram.parts)
        assert drawing.svg.count('class="part marked"') == 1
        assert f"a load at {place}.flange" in drawing.words


def test_the_parts_of_an_assembly_are_drawn_as_one_when_there_are_many():
    system = assemble(load_model(model_reference(str(MODELS / "linear_damp.py"))))
    paths = [part.path for part in read_diagram(diagram_json(system, [])).parts]
    assert "drive.gears" in paths and "drive.gears.mesh" not in paths and "drive" not in paths


def test_a_thinned_curve_keeps_its_extremes():
    values = np.sin(np.linspace(0, 300, 100_000))
    values[54_321], values[60_000:70_000] = 5.0, np.nan
    rows = thinned(values, 400)
    assert rows.size <= 2 * 400 + 2 and np.all(np.diff(rows) > 0)
    assert np.nanmax(values[rows]) == 5.0 and np.nanmin(values[rows]) == np.nanmin(values)
    drawn = panel([Line(np.arange(100_000.0), values, "after")], "x [m]", 100.0)
    assert drawn.count("M") == 2 + drawn.count('class="grid"')  # the gap parts the curve in two


def test_names_are_escaped_everywhere(tmp_path):
    """The tests in the browser show that nothing runs; this one that no text comes through as it is."""
    text = json.dumps(stored_result()).replace("bearing", "<b onclick=x>").replace("RotaDamp", "<i>&amp;")
    page = page_of(Stored(json.loads(text), ()))
    assert "<b onclick" not in page and "<i>&amp;" not in page
    assert "&lt;b onclick=x&gt;" in page


# --- the error over a horizon ------------------------------------------------------------------------------


class Still(Component):
    """A point that does not move, x' = 0."""

    x = var(unit="m")

    def equations(self) -> Statements:
        yield der(self.x) == 0
        yield initial(self.x == 0)


def test_a_model_at_rest_is_off_by_the_way_that_was_gone():
    """What moves with c is c (t + lag) away t after the state of an observer of bandwidth w.

    The observer, x+ = x + (1 - exp(-w h)) (y - x), trails the ramp by h / (1 - exp(-w h)).
    """
    c, w, h = 2.0, 50.0, 0.01
    time = h * np.arange(400)
    channel = Channel(c * time, "zoh", None, "m", 0.0)
    run = Experiment("ramp", "test", time, {}, {"x": channel}, {"x": Start(0.0, False)}, "free", None)
    ahead = error_ahead(assemble(Still()), run, bandwidth=w)
    lag = h / (1 - math.exp(-w * h))
    leads = np.round(ahead.seconds / h).astype(int)
    assert leads[0] == 1 and leads[-1] == 200
    for before, last, error in zip([0, *leads], leads, ahead.error[:, 0], strict=False):
        away = c * (h * np.arange(before + 1, last + 1) + lag)
        # the observer has settled to exp(-w t) where the first prediction begins, at a tenth of the run
        assert error == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-6)
