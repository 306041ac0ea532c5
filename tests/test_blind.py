"""The blind test bed: data sets from their keys alone, the scorer, the runner, and a few sets given to the tool."""

import json
import tomllib

import numpy as np
import pytest
from blind import law, store
from blind.cases import OPEN, PAIRS, TRIPLES, cases
from blind.catalogue import EFFECTS, hidden_on
from blind.generate import DataSet, _resized, draft, generate, kinds_of, sized
from blind.keys import REGIMES, Key
from blind.laws.elastic import CableLayers, Linear
from blind.laws.friction import Dahl, MaxwellSlip
from blind.laws.loads import Constant
from blind.rigs import NOISE, RIGS
from blind.run import in_turn, main, one, seeds_of
from blind.same_data import simpler_laws
from blind.scorer import equivalences, is_place, score, wilson
from blind.sizes import FINE, HIGHEST, LOWEST, Column, outputs
from blind.table import TITLE, page, put_into
from blind.table import main as table
from blind.writer import write

from cartpend_dae.effects import catalogue, places
from cartpend_dae.report.result import discovery_result
from cartpend_dae.session import discover_study, open_study
from cartpend_dae.study import load_model

LOAD = (("constant_load", "bearing"),)


@pytest.fixture(scope="module")
def loaded():
    """Data sets of one effect in two regimes and two seeds, made together."""
    keys = [Key("rota_damp", regime, LOAD, seed) for regime in ("noise", "quantised") for seed in (0, 1)]
    return dict(zip(keys, generate(keys), strict=True))


def written(data, folder):
    study = write(data, folder / data.key.name, folder / "truth")
    return {path.name: path.read_bytes() for path in study.parent.iterdir()}


def test_the_same_key_gives_the_same_bytes_alone_and_among_others(loaded, tmp_path):
    key = Key("rota_damp", "noise", LOAD, 1)
    (alone,) = generate([key])
    assert isinstance(alone, DataSet)
    assert written(alone, tmp_path / "a") == written(loaded[key], tmp_path / "b")
    assert alone.truth == loaded[key].truth


def test_the_tool_sees_nothing_of_the_truth(loaded, tmp_path):
    data = next(iter(loaded.values()))
    files = written(data, tmp_path)
    assert sorted(files) == ["rota_damp.py", "run1.csv", "run2.csv", "run3.csv", "study.toml"]
    study = files["study.toml"].decode()
    assert "constant" not in study and "truth" not in study
    roles = [entry["role"] for entry in tomllib.loads(study)["experiment"]]
    assert roles == ["train", "train", "test"]


def test_regimes_share_the_truth_and_differ_in_the_log(loaded):
    noise, steps = (loaded[Key("rota_damp", regime, LOAD, 0)] for regime in ("noise", "quantised"))
    assert noise.truth["effects"] == steps.truth["effects"]
    rows = steps.measured[0][0] / 1e-3
    assert abs(rows - rows.round()).max() < 1e-6
    assert steps.truth["floor"]["run1"]["bearing.phi"] == pytest.approx(1e-3 / 12**0.5, rel=0.1)
    assert noise.truth["floor"]["run1"]["bearing.phi"] == pytest.approx(3e-4, rel=0.1)
    assert 10 <= noise.truth["effects"][0]["share"] <= 360


def test_wrong_starts_are_wrong_by_a_factor_of_two_to_five():
    (data,) = generate([Key("linear_damp_mod", "wrong_start", (), 4)])
    assert isinstance(data, DataSet)
    for name, guess in data.guesses.items():
        factor = guess / data.truth["parameters"][name]
        assert 2 <= max(factor, 1 / factor) <= 5


def test_two_fifths_of_the_seeds_have_another_shape():
    keys = [Key("rota_damp", "noise", (("dahl_friction", "bearing"),), seed) for seed in range(10)]
    assert [key.shape("dahl_friction") for key in keys].count("other") == 4
    assert Key("rota_damp", "noise", LOAD, 1).shape("constant_load") == "same"


def test_unknown_effects_places_and_regimes_are_refused():
    with pytest.raises(ValueError, match="`cogging` at `bearing` cannot be hidden on `rota_damp`"):
        Key("rota_damp", "noise", (("cogging", "bearing"),), 0)
    with pytest.raises(ValueError, match="no regime `loud`"):
        Key("rota_damp", "loud", (), 0)  # type: ignore[arg-type]


@pytest.mark.parametrize("rig", list(RIGS))
def test_each_hidden_place_is_in_the_table_of_places(rig):
    every = set(hidden_on(rig))
    for text in (*PAIRS[rig], *TRIPLES[rig], *(text for text, _ in OPEN[rig])):
        every |= {tuple(part.split("@")) for part in text.split()}
    for effect, at in every:
        assert effect in EFFECTS
        assert at in equivalences()["places"][rig]


@pytest.mark.parametrize("rig", list(RIGS))
def test_what_the_package_calls_one_motion_is_one_place_here(rig):
    from cartpend_dae.study_schema import ModelReference

    model = load_model(ModelReference(store.ROOT / "models" / f"{rig}.py"))
    found = [place for place in places(model) if place.insertion == "parallel"]
    every = [name for place in found for name in (place.at, *place.same_motion)]
    for place in found:
        ours = "bearing" if place.at == "bearing" else "rail"
        # the rod of the cart slides and turns: its name alone says neither, and the package never gives it
        for name in (name for name in (place.at, *place.same_motion) if every.count(name) == 1):
            assert is_place(rig, "coulomb_friction", ours, name), name


def result(steps, verdict="explained", after=3e-4):
    errors = {"run3": {"role": "test", "outputs": {"bearing.phi": {"rmse": after}}}}
    before = {"run3": {"role": "test", "outputs": {"bearing.phi": {"rmse": 3e-2}}}}
    named = [{"effect": effect, "at": at} for effect, at in steps]
    return {"verdict": verdict, "steps": named, "baseline": {"experiments": before}, "final": {"experiments": errors}}


def truth(*hidden, rig="rota_damp"):
    return {
        "rig": rig,
        "effects": [{"effect": effect, "at": at, "shape": "same"} for effect, at in hidden],
        "noise": {"bearing.phi": 3e-4},
        "floor": {"run3": {"bearing.phi": 3e-4}},
        "roles": {"run3": "test"},
    }


@pytest.mark.parametrize(
    ("hidden", "steps", "first", "exact", "wrong"),
    [
        ([("coulomb_friction", "bearing")], [("coulomb_friction", "bearing")], True, True, 0),
        ([("coulomb_friction", "bearing")], [("coulomb_friction", "rod")], True, True, 0),
        ([("coulomb_friction", "bearing")], [("stribeck_friction", "bearing")], False, False, 1),
        ([("coulomb_friction", "bearing")], [("coulomb_friction", "bearing.phi")], False, False, 1),
        ([("clock_drift", "clock")], [("added_inertia", "bearing")], True, True, 0),
        ([("sensor_offset", "bearing.phi")], [("imbalance", "bearing")], True, True, 0),
        ([("imbalance", "bearing")], [("sensor_offset", "bearing.phi")], False, False, 1),
        (
            [("coulomb_friction", "bearing"), ("constant_load", "bearing")],
            [("asymmetric_friction", "bearing")],
            True,
            True,
            0,
        ),
        (
            [("coulomb_friction", "bearing"), ("quadratic_drag", "bearing")],
            [("quadratic_drag", "bearing")],
            True,
            False,
            0,
        ),
        ([], [("coulomb_friction", "bearing")], False, False, 1),
        ([], [], False, True, 0),
    ],
)
def test_the_scorer_knows_right_from_wrong(hidden, steps, first, exact, wrong):
    found = score(result(steps), truth(*hidden))
    assert (found.is_first, found.is_exact, found.n_wrong) == (first, exact, wrong)
    assert found.is_false_claim == (wrong > 0)


@pytest.mark.parametrize(
    ("seed", "memory", "of"),
    [
        (20, Dahl, lambda level, slip: {"f_c": level, "c": level / slip}),
        (21, CableLayers, lambda level, slip: {"f_h": level, "x_slip": slip, "c": 0.0, "x_0": 0.0}),
    ],
)
def test_a_cable_on_springs_is_elastic_friction_and_a_load(seed, memory, of):
    """The identity behind `parts` in equivalences.toml, in the test bed's own simulator: its spring is not seen."""
    key = Key("linear_damp_mod", "noise", (("cable_drag", "rail"),), seed)
    item = draft(key)
    assert not sized([item])
    (cable,), p = item.laws, item.p
    share = (p["K1"] + p["K2"]) / (p["K1"] + p["K2"] + cable["c"])
    other = p | {"d_rail": share * p["d_rail"], "m_in": share * (p["m_c"] + p["m_in"]) - p["m_c"]}
    level, rest = share * cable["f_h"], (p["K2"] - p["K1"]) * p["a"]
    laws = (of(level, cable["x_slip"]), {"f_0": share * (rest + cable["c"] * cable["x_0"]) - rest})
    whole = outputs(item.rig, kinds_of(key), [Column(p, (cable,), run) for run in item.runs], FINE)
    kinds = [(memory, "rail"), (Constant, "rail")]
    parts = outputs(item.rig, kinds, [Column(other, laws, run) for run in item.runs], FINE)
    assert np.max(np.abs(parts - whole)) < 1e-3 * NOISE["encoder.s"]
    steps = [("dahl_friction", "rail"), ("constant_load", "rail")]
    hidden = truth(("cable_drag", "rail"), rig="linear_damp_mod")
    hidden["effects"][0]["shape"] = {20: "same", 21: "other"}[seed]
    assert score(result(steps), hidden).is_exact
    alone = score(result(steps[:1]), hidden)
    assert alone.is_first and not alone.is_exact


class EvenlySpaced(MaxwellSlip):
    """Seven elements of one stiffness, whose limits are evenly spaced."""

    shares = tuple((2 * k + 1) / 49 for k in range(7))
    slips = tuple((2 * k + 1) / 7 for k in range(7))


@pytest.mark.parametrize(
    ("effect", "kinds", "laws"),
    [
        (
            "bearing_torsion",
            [(Linear, "bearing"), (Dahl, "bearing")],
            lambda p: ({"c": p["c"], "x_0": 0.0}, {"f_c": 0.05 * p["c_m"], "c": 0.5 * p["c_m"]}),
        ),
        (
            "hysteresis",
            [(EvenlySpaced, "bearing")],
            lambda p: ({"f_c": p["c_h"] * p["z_h"], "x_slip": p["z_h"]},),
        ),
    ],
)
def test_laws_of_other_shapes_that_are_other_effects(effect, kinds, laws):
    """The identities behind entries of equivalences.toml for other shapes, in the test bed's own simulator."""
    key = Key("rota_damp", "noise", ((effect, "bearing"),), 21)
    item = draft(key)
    assert not sized([item])
    (law,), p = item.laws, item.p
    hidden = outputs(item.rig, kinds_of(key), [Column(p, (law,), run) for run in item.runs], FINE)
    found = outputs(item.rig, kinds, [Column(p, laws(law), run) for run in item.runs], FINE)
    assert np.max(np.abs(found - hidden)) < 1e-6 * NOISE["bearing.phi"]


@pytest.mark.parametrize(
    ("effect", "steps"),
    [("bearing_torsion", ["linear_stiffness", "dahl_friction"]), ("hysteresis", ["maxwell_slip_friction"])],
)
def test_laws_of_other_shapes_count_as_other_effects_in_that_shape_alone(effect, steps):
    named, hidden = result([(step, "bearing") for step in steps]), truth((effect, "bearing"))
    assert not score(named, hidden).is_first
    other = hidden | {"effects": [one | {"shape": "other"} for one in hidden["effects"]]}
    assert score(named, other).is_exact


def breakaway(seed):
    return truth(("breakaway_friction", "bearing")) | {"regime": "noise", "seed": seed}


def test_a_level_that_no_run_reaches_is_no_part_of_the_truth():
    # run 1 of seed 7 waits at a reversal under a force between f_c and f_s; nothing does in seed 2
    never, reached = breakaway(2), breakaway(7)
    assert simpler_laws(never) == (("coulomb_friction", "bearing"),)
    assert simpler_laws(reached) == ()
    steps = [("coulomb_friction", "bearing")]
    assert score(result(steps), never, simpler_laws(never)).is_exact
    assert not score(result(steps), reached, simpler_laws(reached)).is_exact
    assert not score(result([("lugre_friction", "bearing")]), never, simpler_laws(never)).is_first


def test_the_error_removed_is_measured_down_to_the_floor():
    steps, hidden = [("coulomb_friction", "bearing")], truth(("coulomb_friction", "bearing"))
    assert score(result(steps), hidden).recovered == pytest.approx(1.0)
    assert score(result(steps, after=3e-2), hidden).recovered == pytest.approx(0.0)
    assert score(result(steps, after=3e-3), hidden).recovered == pytest.approx((3e-2 - 3e-3) / (3e-2 - 3e-4))


def test_the_interval_of_wilson():
    # 9 of 10: (0.9 + 0.192 -+ ...)/1.384, as tabulated by R. G. Newcombe, Stat. Med. 17 (1998)
    low, high = wilson(9, 10)
    assert (low, high) == (pytest.approx(0.5958, abs=1e-4), pytest.approx(0.9821, abs=1e-4))
    assert wilson(0, 0) == (0.0, 1.0)


def test_seeds_for_tuning_and_for_the_report_are_kept_apart(capsys):
    assert seeds_of("0-2,7", False) == [0, 1, 2, 7]
    assert seeds_of("1000", True) == [1000]
    for text, is_report in (("1000", False), ("500", False), ("5", True)):
        with pytest.raises(ValueError, match="are not for this run"):
            seeds_of(text, is_report)
    assert main(["--seeds", "1000"]) == 2
    assert "--report" in capsys.readouterr().err


def test_a_result_is_kept_by_content_and_not_made_twice(loaded, tmp_path, monkeypatch):
    calls = []

    def fake(study, timeout):
        calls.append(study)
        return result([("constant_load", "bearing")]) | {"seconds": 1.0}, ""

    monkeypatch.setattr("blind.run.discover", fake)
    data = loaded[Key("rota_damp", "noise", LOAD, 0)]
    first, was_run = one(data, tmp_path, frozenset(), "p1", 1.0)
    again, was_run_again = one(data, tmp_path, frozenset(), "p1", 1.0)
    assert (was_run, was_run_again, len(calls)) == (True, False, 1)
    assert first == again
    one(data, tmp_path, frozenset(), "p2", 1.0)
    assert len(calls) == 2
    lines = "\n".join(page(store.records(tmp_path), "p1", tuning=True, detail=True))
    assert "1 data sets, run from the commits" in lines
    assert "No data set was run of the rig `linear_damp_mod`, `driven_cart`." in lines
    assert "pairs of a rig and a single effect 1 were run." in lines
    assert "| noise: rota_damp | 1/1 (21–100 %) first, 1/1 (21–100 %) exact | 0.00 |" in lines
    assert "No data set of the reported seeds" in page(store.records(tmp_path), "p1", tuning=False, detail=False)[0]


def test_what_is_kept_of_a_result_gives_the_same_table(loaded, tmp_path, monkeypatch):
    found = result([("constant_load", "bearing")]) | {"seconds": 1.0}
    monkeypatch.setattr("blind.run.discover", lambda study, timeout: (found, ""))
    data, kept = loaded[Key("rota_damp", "noise", LOAD, 0)], tmp_path / "kept.jsonl"
    record, _ = one(data, tmp_path, frozenset(), "p1", 1.0)
    every = store.records(tmp_path, kept)
    store.keep(every, kept)
    alone = store.records(tmp_path / "none", kept)
    assert page(every, "p1", tuning=True, detail=True) == page(alone, "p1", tuning=True, detail=True)
    assert store.kept_record("p1", record["data"], kept) == alone[0]
    assert store.kept_record("p2", record["data"], kept) is None
    monkeypatch.setattr("blind.store.kept_record", lambda package, of: store.brief(record))
    assert one(data, tmp_path / "other", frozenset(), "p1", 1.0) == (alone[0], False)


def test_a_new_table_takes_the_place_of_the_old_one(tmp_path):
    target = tmp_path / "validation.md"
    target.write_text("# Validation\n\n## First\n\nText.\n\n## Last\n")
    put_into(target, TITLE, "command", ["old"])
    put_into(target, TITLE, "command", ["new"])
    text = target.read_text()
    assert text.count(TITLE) == 1 and "old" not in text and "new" in text
    assert text.startswith("# Validation\n\n## First\n\nText.\n\n## Last\n")
    target.write_text(text + "\n## After\n\nMore.\n")
    put_into(target, TITLE, "command", ["third"])
    assert target.read_text().endswith("third\n\n## After\n\nMore.\n")


def test_earlier_packages_get_a_row_each_and_a_page_of_their_own(loaded, tmp_path, monkeypatch, capsys):
    found = result([("constant_load", "bearing")]) | {"seconds": 1.0}
    monkeypatch.setattr("blind.run.discover", lambda study, timeout: (found, ""))
    monkeypatch.setattr("blind.store.KEPT", tmp_path / "kept.jsonl")
    one(loaded[Key("rota_damp", "noise", LOAD, 0)], tmp_path, frozenset(), "p1", 1.0)
    target, history = tmp_path / "validation.md", tmp_path / "history.md"
    target.write_text("# Validation\n")
    history.write_text("# Earlier\n")
    options = ["--tuning", "--package", "p2", "--before", "p1", "--store", str(tmp_path)]
    table([*options, "--write", str(target), "--history", str(history)])
    assert "| p1 | 1 | 1/1 |  |  |  |  |" in target.read_text()
    assert "### By the earlier package p1" not in target.read_text()
    assert "### By the earlier package p1" in history.read_text()
    table([*options, "--package", "p1", "--before", "p0"])
    assert "| single, noise | right first | 99 % | 1/1 (21–100 %) | 1/1 (21–100 %) |" in capsys.readouterr().out
    table(options)
    assert "### By the earlier package p1" in capsys.readouterr().out


def test_all_cases_have_keys():
    for rig in RIGS:
        for regime in REGIMES:
            assert len(cases("single", rig, regime, 0)) == len(hidden_on(rig))
            assert cases("none", rig, regime, 0)[0].kind == "none"
            assert all(key.kind == "open" for key in cases("open", rig, regime, 0))


def test_every_cell_and_regime_has_its_turn_before_any_has_two():
    keys = [
        key
        for kind in ("none", "single", "pair")
        for rig in RIGS
        for regime in REGIMES
        for seed in (1000, 1001)
        for key in cases(kind, rig, regime, seed)
    ]
    turns = in_turn(keys)
    cells = {(key.rig, key.effects) for key in keys}
    assert len(turns) == len(set(turns)) == len(keys)
    first = turns[: len(cells)]
    assert {(key.rig, key.effects) for key in first} == cells
    assert {key.rig for key in first[:3]} == set(RIGS)
    counts = [sum(key.regime == regime for key in first) for regime in REGIMES]
    assert max(counts) - min(counts) <= 1
    assert all(key.seed == 1000 for key in turns[: 5 * len(cells)])


def test_a_pair_of_effects_has_two_sizes():
    (data,) = generate([Key("linear_damp_mod", "noise", (("coulomb_friction", "rail"), ("constant_load", "rail")), 0)])
    assert isinstance(data, DataSet)
    assert [hidden["effect"] for hidden in data.truth["effects"]] == ["coulomb_friction", "constant_load"]
    assert all(LOWEST <= hidden["share"] <= 1.2 * HIGHEST for hidden in data.truth["effects"])


def test_an_effect_that_left_nothing_grows_and_one_that_broke_the_run_shrinks():
    assert _resized(0.05, 0.0) == pytest.approx(0.2)
    assert _resized(0.05, float("nan")) == pytest.approx(0.025)
    assert _resized(0.5, 5.0) > 0.5 > _resized(0.5, 600.0)


# Sets through the whole chain, cut to 4 or 3 s (a pendulum) and 2 s (a cart), for about a minute. In the last
# but one each of two effects hides the other; in the last a law of friction explains five sixths of disturbances.
SMALL = (
    (Key("rota_damp", "noise", (("coulomb_friction", "bearing"),), 0), 4.0),
    (Key("rota_damp", "noise", (("quadratic_drag", "bearing"),), 0), 4.0),
    (Key("rota_damp", "quantised", LOAD, 0), 4.0),
    (Key("linear_damp_mod", "noise", (), 0), 2.0),
    (Key("rota_damp", "noise", (("coulomb_friction", "bearing"), ("cubic_stiffness", "bearing")), 20), 6.0),
    (Key("rota_damp", "disturbed", (), 31), 3.0),
)


@pytest.mark.parametrize(("key", "window"), SMALL, ids=lambda x: x.name if isinstance(x, Key) else f"{x:g}s")
def test_a_small_part_of_the_bed_is_solved(key, window, tmp_path):
    (data,) = generate([key])
    assert isinstance(data, DataSet)
    known = frozenset(card.id for card in catalogue())
    study = write(data, tmp_path / "data", tmp_path / "truth", known)
    study.write_text(study.read_text().replace("time = {", f"window = [0.0, {window}]\ntime = {{"))
    opened = open_study(study)
    found = score(
        discovery_result(opened, discover_study(opened), 0.0),
        json.loads(next((tmp_path / "truth").iterdir()).read_text()),
    )
    assert found.is_exact
    assert found.n_wrong == 0
    assert not found.is_false_claim


def test_a_law_alone_leaves_noise(capsys):
    assert law.main(["--rig", "rota_damp", "--seed", "10", "--only", "quadratic_drag"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("quadratic_drag@bearing (same): noise: chi2/n ") and said.count("\n") == 1
