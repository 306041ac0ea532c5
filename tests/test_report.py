"""result.json keeps the contract, and the augmented model as a file is the model that was simulated."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from typing import Literal

import numpy as np
import pandas as pd
import pytest
from demo_run import demo_run
from pydantic import BaseModel, ConfigDict, TypeAdapter

from cartpend_dae import assemble, simulate
from cartpend_dae.assess import Assessment
from cartpend_dae.discover import Discovery
from cartpend_dae.discover.prove import set_values
from cartpend_dae.discover.records import Candidate, Step
from cartpend_dae.discover.workbench import augmented
from cartpend_dae.effects import Insertion, Place, catalogue
from cartpend_dae.identify import Estimate
from cartpend_dae.library import rotational, translational
from cartpend_dae.report.files import run_table
from cartpend_dae.report.model_plus import model_plus_source
from cartpend_dae.report.result import discovery_result, plain
from cartpend_dae.report.text import CUT_AFTER, discovery_sentence, uncertain
from cartpend_dae.session import open_study
from cartpend_dae.study import load_model
from cartpend_dae.study_schema import ModelReference


class Part(BaseModel):
    """A table of the contract; more keys may stand in it."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class ParameterPart(Part):
    value: float
    sd: float | None
    unit: str
    status: Literal["ok", "at-bound", "unidentifiable", "fixed"]


class OutputPart(Part):
    rmse: float
    unit: str
    nrmse: float | None
    noise_sd: float | None


class ExperimentPart(Part):
    role: Literal["train", "select", "test"]
    score: Literal["free", "horizon", "innovation"]
    outputs: dict[str, OutputPart]


class StatePart(Part):
    parameters: dict[str, ParameterPart]
    experiments: dict[str, ExperimentPart]
    scores: dict[str, dict[str, float | None]]


class StepParameterPart(Part):
    value: float
    sd: float | None
    unit: str


class StepPart(Part):
    effect: str
    at: str
    parameters: dict[str, StepParameterPart]
    aliases: list[str]
    contained_in: list[str]
    known_alike: dict[str, str]
    evidence: dict[str, float | None]


class PlacePart(Part):
    at: str
    evidence: float


class CandidatePart(Part):
    effect: str
    at: str
    score: float
    why_not: str


class ResultPart(Part):
    schema_: Literal[1]
    command: Literal["identify", "discover"]
    model: str
    verdict: Literal["explained", "improved", "no-discrepancy", "unexplained"] | None
    baseline: StatePart
    steps: list[StepPart]
    final: StatePart
    places: list[PlacePart]
    candidates: list[CandidatePart]


def checked(result):
    return TypeAdapter(ResultPart).validate_python({**result, "schema_": result["schema"]})


def written():
    return json.loads((demo_run().results / "result.json").read_text("utf-8"))


def test_result_keeps_the_contract():
    result = checked(written())
    assert result.verdict == "explained"
    assert [(step.effect, step.at) for step in result.steps] == [("coulomb_friction", "bearing")]
    assert set(result.final.parameters) == {"bearing.d", "bearing.coulomb_friction.tau_c"}
    assert {run.role for run in result.final.experiments.values()} == {"train", "test"}


def test_result_names_the_best_place_and_why_the_others_were_not_taken():
    result = checked(written())
    assert result.places[0].at == "bearing"
    assert result.places[0].evidence == max(candidate.score for candidate in result.candidates)
    assert [candidate.effect for candidate in result.candidates if not candidate.why_not] == ["coulomb_friction"]


def test_result_is_json_without_nan():
    bad = {"a": math.nan, "b": [np.float64(np.inf), np.float64(1.0), np.int64(2)], "c": (np.bool_(True), None, "x")}
    assert plain(bad) == {"a": None, "b": [None, 1.0, 2], "c": [True, None, "x"]}
    json.dumps(plain(bad), allow_nan=False)


def test_csv_holds_measured_values_and_what_the_error_is_made_of():
    discovery = demo_run().discovery
    for before, after in zip(discovery.before.runs, discovery.after.runs, strict=True):
        table = pd.read_csv(demo_run().results / f"{before.name}.csv")
        pd.testing.assert_frame_equal(table, run_table(before, after))
        for moment, run in (("before", before), ("after", after)):
            rmse = np.sqrt(np.mean(table[f"bearing.phi.residual_{moment}"] ** 2))
            assert rmse == pytest.approx(run.outputs["bearing.phi"].rmse)


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (0.0150162, 2.19e-5, "0.015016 ± 0.000022"),
        (95.11, 1.23, "95.1 ± 1.2"),
        (12345.6, 234.0, "12350 ± 230"),
        (-3.16, 0.2, "-3.16 ± 0.20"),
        (0.5, math.nan, "0.5"),
        (0.5, None, "0.5"),
        (1.234e9, 2e6, "1.234e+09 ± 2e+06"),
        (0.8222566, 4.93e32, "0.8223 ± 4.9e+32"),
    ],
)
def test_a_value_is_written_to_the_digit_that_its_sd_allows(value, sd, text):
    assert uncertain(value, sd) == text


def outcome(**changes):
    discovery = demo_run().discovery
    return replace(discovery, search=replace(discovery.search, **changes))


def test_each_verdict_has_its_sentence():
    discovery = demo_run().discovery
    assert "What is left is no more than noise." in discovery_sentence(discovery)
    assert "still more than noise" in discovery_sentence(outcome(verdict="improved"))
    nothing = discovery_sentence(outcome(verdict="no-discrepancy", steps=()))
    assert nothing.startswith("The residuals of RotaDamp are no more than noise")
    refused = tuple(replace(c, why_not="it is too small") for c in discovery.search.candidates)
    unexplained = discovery_sentence(outcome(verdict="unexplained", steps=(), candidates=refused))
    assert "the best was Coulomb friction at `bearing`: it is too small" in unexplained
    assert "before an effect was accepted" in discovery_sentence(
        outcome(verdict="unexplained", steps=(), interrupted=True)
    )


def test_the_command_line_of_a_result_asks_for_all_that_was_asked_for():
    run = demo_run()
    asked = replace(run.discovery, beyond=replace(run.discovery.beyond, placebo=20, power=6))
    line = discovery_result(run.opened, asked, 1.0)["command_line"]
    assert line == f"cartpend discover {run.folder / 'rota_damp.toml'} --placebo 20 --power 6"


def test_a_result_says_where_only_what_follows_the_search_was_interrupted():
    run = demo_run()
    cut = replace(run.discovery, beyond=replace(run.discovery.beyond, interrupted=True))
    result = discovery_result(run.opened, cut, 1.0)
    assert result["interrupted"] and result["beyond_interrupted"]
    assert result["message"].endswith(CUT_AFTER) and "best so far" not in result["message"]


# --- the augmented model as a file -----------------------------------------------------------------------


def test_model_plus_of_the_demo_runs_elsewhere_and_gives_the_same_trajectory(tmp_path):
    script = (
        "import runpy, sys, numpy as np\n"
        "from cartpend_dae import simulate\n"
        "model = runpy.run_path(sys.argv[1])['RotaDampPlus']()\n"
        "run = simulate(model, 3.0, points=61, start={'bearing.phi': 0.9})\n"
        "np.save(sys.argv[2], run['bearing.phi'])\n"
    )
    out = tmp_path / "phi.npy"
    source = tmp_path / "model_plus.py"
    source.write_bytes((demo_run().results / "model_plus.py").read_bytes())
    subprocess.run([sys.executable, "-W", "error", "-c", script, str(source), str(out)], check=True, cwd=tmp_path)
    truth = simulate(demo_run().discovery.model_plus, 3.0, points=61, start={"bearing.phi": 0.9})
    np.testing.assert_allclose(np.load(out), truth["bearing.phi"], rtol=0, atol=1e-9)


def test_model_plus_prints_itself_when_run():
    printed = subprocess.run(
        [sys.executable, str(demo_run().results / "model_plus.py")], capture_output=True, text=True, check=True
    )
    assert printed.stdout.startswith("RotaDampPlus: 6 components")


RIG = '''#!/usr/bin/env python
# -*- coding: latin-1 -*-
"""Un chariot guidé."""

from __future__ import annotations

from neighbour import MASS

from cartpend_dae import Component, Param, connect, initial, param
from cartpend_dae.library.rotational import Flange, Inertia
from cartpend_dae.library.translational import Fixed, Mass, PositionSensor, RailFriction

assemble = "a name that the new class needs too"


class Drum(Component):
    """Two shafts, J together."""

    J: Param = param(unit="kg.m2", doc="inertia")

    def __post_init__(self) -> None:
        self.shafts = [Inertia(J=self.J / 2), Inertia(J=self.J / 2)]

    def equations(self):
        yield connect(self.shafts[0].flange_b, self.shafts[1].flange_a)


class RigPlus(Component):
    """The name that the new class would have."""


class Rig(Component):
    """A mass on a rail, and a drum that turns by itself."""

    d: Param = param(unit="N.s/m", default=1.0, doc="damping")
    guided: bool = False
    speed: float = 0.0

    def __post_init__(self) -> None:
        self.ground, self.mass, self.encoder = Fixed(), Mass(m=MASS), PositionSensor()
        self.drum = Drum(J=0.2)
        if self.guided:
            self.rail = RailFriction(d=2 * self.d)

    def equations(self):
        yield connect(self.encoder.flange, self.mass.flange_a)
        if self.guided:
            yield connect(self.ground.flange, self.rail.flange_a)
            yield connect(self.rail.flange_b, self.mass.flange_b)
        yield initial(self.mass.s == 0.3)
        yield initial(self.mass.v == self.speed)
        yield initial(self.drum.shafts[0].phi == 0)
        yield initial(self.drum.shafts[0].w == 2.0)


if __name__ == "__main__":
    raise SystemExit("the copy must not run this")
'''
STUDY = """
[model]
path = "rig.py"
name = "Rig"
arguments = { guided = true, speed = 1.5 }

[parameters."d"]
guess = 0.5

[parameters."mass.m"]
guess = 1.25
fixed = true
"""


@pytest.fixture
def rig(tmp_path):
    folder = tmp_path / "a 'rig'"
    folder.mkdir()
    (folder / "neighbour.py").write_text("MASS = 2.0\n")
    (folder / "rig.py").write_text(RIG, "latin-1")
    (folder / "rig.toml").write_text(STUDY)
    return open_study(folder / "rig.toml", needs_runs=False)


def discovery_of(opened, insertions, values):
    """What the engine would return for these effects and numbers."""
    found = demo_run().discovery
    estimates = tuple(Estimate(name, value, 0.01, "1", "ok") for name, value in values.items())
    steps = tuple(Step(Candidate(i, {}, 0.0, 1.0, 1.0, None, ""), found.search.final_gate, ()) for i in insertions)
    model_plus = augmented(opened.model, insertions)
    set_values(model_plus, values)
    search = replace(found.search, steps=steps, final=replace(found.search.final, parameters=estimates))
    return Discovery(opened.setup, search, Assessment((), {}), Assessment((), {}), model_plus)


def insertion(effect, place):
    return Insertion(next(card for card in catalogue() if card.id == effect), place)


RAIL = Place("rail", translational.Flange, "flange_a", "flange_b", ())
MASS = Place("mass", translational.Flange, None, "flange_b", ())
SHAFT = Place("drum.shafts[1]", rotational.Flange, None, "flange_b", ())
ENCODER = Place("encoder.s", None, None, None, (), "sensor")
EFFECTS = {
    "between two flanges": [("coulomb_friction", RAIL, "f_c", 0.7)],
    "against ground": [("cubic_stiffness", MASS, "c3", 30.0)],
    "nested, in a list": [("quadratic_drag", SHAFT, "d2", 0.4)],
    "sensor": [("sensor_offset", ENCODER, "y_0", 0.05)],
    "several at a place": [
        ("coulomb_friction", MASS, "f_c", 0.2),
        ("constant_load", MASS, "f_0", -0.3),
        ("quadratic_drag", RAIL, "d2", 0.1),
        ("sensor_offset", ENCODER, "y_0", 0.05),
    ],
}


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_model_plus_is_the_augmented_model(rig, tmp_path, effects):
    insertions = tuple(insertion(effect, place) for effect, place, _, _ in effects)
    values = {"d": 0.123456789012345} | {
        f"{i.prefix}.{name}": value for i, (_, _, name, value) in zip(insertions, effects, strict=True)
    }
    discovery = discovery_of(rig, insertions, values)
    path = tmp_path / "model_plus.py"
    path.write_text(model_plus_source(rig, discovery), "utf-8")
    model = load_model(ModelReference(path=path, name="RigPlusPlus"))
    ours, truth = (simulate(m, 2.0, points=41) for m in (model, discovery.model_plus))
    assert set(ours.names) == set(truth.names)
    for name in truth.names:
        np.testing.assert_allclose(ours[name], truth[name], rtol=0, atol=1e-9, err_msg=name)
    # the arguments of the study, the estimate and what the study fixes are in it
    parameters = {q.name: q.value for q in assemble(model).flat.parameters}
    assert parameters["d"] == 0.123456789012345
    assert parameters["mass.m"] == 1.25
    assert truth["mass.v"][0] == ours["mass.v"][0] == 1.5
    plain_run = simulate(rig.model, 2.0, points=41)
    assert any(np.abs(plain_run[name] - truth[name]).max() > 1e-3 for name in plain_run.names)


def test_model_plus_without_additions_is_the_calibrated_model(rig, tmp_path):
    discovery = discovery_of(rig, (), {"d": 0.75})
    path = tmp_path / "model_plus.py"
    path.write_text(model_plus_source(rig, discovery), "utf-8")
    model = load_model(ModelReference(path=path, name="RigPlusPlus"))
    assert "Nothing was added." in type(model).__doc__
    np.testing.assert_allclose(
        simulate(model, 1.0)["mass.s"], simulate(discovery.model_plus, 1.0)["mass.s"], rtol=0, atol=1e-9
    )


def test_fixed_parameters_stand_in_the_result(rig):
    found = checked(discovery_result(rig, discovery_of(rig, (), {"d": 0.75}), 1.0))
    assert found.final.parameters["mass.m"].status == "fixed"
    assert found.final.parameters["mass.m"].sd is None
