"""Runs of several rates and with gaps: nothing is resampled, nothing unmeasured is weighed."""

import numpy as np
import pandas as pd
import pytest
from pydantic import TypeAdapter
from test_data_corpus import MAKE

from cartpend_dae import simulate
from cartpend_dae.errors import StudyError
from cartpend_dae.pieces import load_experiments
from cartpend_dae.session import identify_study, open_study
from cartpend_dae.study import load_model, model_reference
from cartpend_dae.study_schema import ExperimentSpec

UNITS = {"drive.u": "V", "encoder.s": "m", "cart.s": "m"}
TIME = np.arange(100) / 100
VOLTAGE = np.round(np.sin(11 * TIME), 6)
PLACE = np.round(0.2 * np.cos(7 * TIME), 6)


def load(folder, table, restart=(), other=None, **more):
    pd.DataFrame(table).to_csv(folder / "run.csv", index=False)
    if other is not None:
        pd.DataFrame(other).to_csv(folder / "other.csv", index=False)
    entry = {
        "name": "run",
        "file": str(folder / "run.csv"),
        "time": {"column": "t"},
        "inputs": {"drive.u": {"column": "u"}},
        "outputs": {"encoder.s": {"column": "s"}},
    } | more
    return load_experiments(TypeAdapter(ExperimentSpec).validate_python(entry), UNITS, restart)


def known(channel):
    return np.flatnonzero(np.isfinite(channel.values))


def without(rows, **columns):
    """Leave rows out, as a logger does that stopped for a while."""
    table = {"t": TIME, "u": VOLTAGE, "s": PLACE} | columns
    kept = np.setdiff1d(np.arange(len(TIME)), rows)
    return {name: values[kept] for name, values in table.items()}


def masked(values, rows):
    values = values.copy()
    values[rows] = np.nan
    return values


def test_an_output_of_another_rate_in_the_same_file(tmp_path):
    slow = masked(PLACE, np.arange(100) % 5 != 0)
    (run,) = load(tmp_path, without([], s=slow))
    np.testing.assert_array_equal(run.time, TIME)
    np.testing.assert_array_equal(known(run.outputs["encoder.s"]), np.arange(0, 100, 5))


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_an_input_of_another_rate_continues_as_it_is_held(tmp_path, hold):
    slow = masked(VOLTAGE, np.arange(100) % 5 != 0)
    (run,) = load(tmp_path, without([], u=slow), inputs={"drive.u": {"column": "u", "hold": hold}})
    stamps = np.arange(0, 100, 5)
    # A line ends at its last sample; a held value lasts until the next would have come.
    n = 96 if hold == "foh" else 100
    expected = np.interp(TIME, TIME[stamps], VOLTAGE[stamps]) if hold == "foh" else np.repeat(VOLTAGE[stamps], 5)
    np.testing.assert_allclose(run.inputs["drive.u"].values, expected[:n], rtol=1e-14)
    assert len(known(run.outputs["encoder.s"])) == n


def test_an_output_in_another_file_with_its_own_clock(tmp_path):
    stamps = 0.003 + np.arange(30) / 30
    other = {"ms": 1000 * (stamps + 2.0), "x": 1000 * np.sin(stamps)}
    entry = {
        "column": "x",
        "unit": "mm",
        "file": str(tmp_path / "other.csv"),
        "time": {"column": "ms", "unit": "ms", "shift": -2.0},
    }
    (run,) = load(tmp_path, without([]), other=other, outputs={"encoder.s": {"column": "s"}, "cart.s": entry})
    found = run.outputs["cart.s"]
    # 1e-9: the text of the time has 16 digits and its shift is subtracted.
    np.testing.assert_allclose(run.time[known(found)], stamps, atol=1e-9)
    np.testing.assert_allclose(found.values[known(found)], np.sin(stamps), rtol=1e-9)
    np.testing.assert_allclose(run.time[known(run.outputs["encoder.s"])], TIME, atol=1e-12)
    # Between its own samples the input is that of the sample before.
    before = np.searchsorted(TIME, run.time + 1e-9, side="right") - 1
    np.testing.assert_array_equal(run.inputs["drive.u"].values, VOLTAGE[before])


def test_stamps_of_two_files_that_differ_by_rounding_are_one(tmp_path):
    entry = {"column": "x", "file": str(tmp_path / "other.csv")}
    other = {"t": TIME + 1e-12, "x": PLACE}
    (run,) = load(tmp_path, without([]), other=other, outputs={"encoder.s": {"column": "s"}, "cart.s": entry})
    assert len(run.time) == 100
    np.testing.assert_array_equal(run.outputs["cart.s"].values, PLACE)


def test_missing_rows_of_a_few_steps_are_filled_without_weight(tmp_path):
    (run,) = load(tmp_path, without([30, 31, 32]))
    np.testing.assert_allclose(run.time, TIME, atol=1e-12)
    np.testing.assert_array_equal(known(run.outputs["encoder.s"]), np.setdiff1d(np.arange(100), [30, 31, 32]))
    np.testing.assert_array_equal(run.inputs["drive.u"].values[29:34], VOLTAGE[[29, 29, 29, 29, 33]])


@pytest.mark.parametrize("missing", ["rows", "input"])
def test_a_long_gap_splits_the_run(tmp_path, missing):
    gap = np.arange(40, 60)
    table = without(gap) if missing == "rows" else without([], u=masked(VOLTAGE, gap))
    start = {"encoder.s": {"value": 0.2}}
    first, second = load(tmp_path, table, ("encoder.s", "cart.s"), start=start)
    assert (first.name, second.name) == ("run-1", "run-2")
    np.testing.assert_array_equal(first.time, TIME[:40])
    np.testing.assert_array_equal(second.time, TIME[60:])
    np.testing.assert_array_equal(second.inputs["drive.u"].values, VOLTAGE[60:])
    assert (first.start["encoder.s"].value, first.start["encoder.s"].free) == (0.2, False)
    assert set(second.start) == {"encoder.s", "cart.s"}
    assert all(start.free and start.value is None for start in second.start.values())


@pytest.mark.parametrize("missing", ["rows", "input"])
def test_a_long_gap_is_bridged_on_request(tmp_path, missing):
    gap = np.arange(40, 60)
    table = without(gap) if missing == "rows" else without([], u=masked(VOLTAGE, gap))
    (run,) = load(tmp_path, table, gap="hold")
    np.testing.assert_allclose(run.time, TIME, atol=1e-12)
    np.testing.assert_array_equal(known(run.outputs["encoder.s"]), np.setdiff1d(np.arange(100), gap))
    np.testing.assert_array_equal(run.inputs["drive.u"].values[gap], np.full(20, VOLTAGE[39]))


def test_a_gap_of_an_output_alone_is_none(tmp_path):
    (run,) = load(tmp_path, without([], s=masked(PLACE, np.arange(30, 70))))
    assert len(run.time) == 100 and len(known(run.outputs["encoder.s"])) == 60


def test_a_piece_without_enough_samples_is_left_out(tmp_path):
    first, second = load(tmp_path, without([*range(30, 53), *range(59, 83)]))
    assert (first.time[-1], second.time[0], second.name) == (TIME[29], TIME[83], "run-2")


def test_the_run_begins_where_every_input_is_known(tmp_path):
    (run,) = load(tmp_path, without([], u=masked(VOLTAGE, [*range(7), 98, 99])))
    assert (run.time[0], run.time[-1]) == (TIME[7], TIME[98])


def test_irregular_stamps_are_kept(tmp_path):
    time = np.sort(np.random.default_rng(5).uniform(0, 1, 200).round(6))
    (run,) = load(tmp_path, {"t": time, "u": time, "s": time**2})
    own = known(run.outputs["encoder.s"])
    np.testing.assert_array_equal(run.time[own], time)
    np.testing.assert_array_equal(run.outputs["encoder.s"].values[own], time**2)
    # Others are added only where the integration would step too far: 2.5 medians, and half of a step in rounding up.
    assert np.diff(run.time).max() <= 2.5 * np.median(np.diff(time)) * (1 + 1e-9)


def test_the_window_counts_in_seconds_for_all_files(tmp_path):
    entry = {"column": "x", "file": str(tmp_path / "other.csv")}
    other = {"t": TIME[::2], "x": PLACE[::2]}
    more = {"outputs": {"cart.s": entry}, "window": [0.2, 0.5]}
    (run,) = load(tmp_path, without([]), other=other, **more)
    np.testing.assert_array_equal(run.time, TIME[20:51])
    np.testing.assert_array_equal(known(run.outputs["cart.s"]), np.arange(0, 31, 2))


PENDULUM = """
[model]
path = "{model}"
name = "RotaDamp"
[parameters."bearing.d"]
guess = 0.03
[[experiment]]
name = "run"
file = "run.csv"
time = {{ column = "t" }}
outputs = {{ "rod.phi" = {{ column = "phi" }} }}
start = {{ "bearing.phi" = {{ guess = 0.5, free = true }} }}
gap = "{gap}"
"""


@pytest.mark.parametrize("gap", ["split", "hold"])
def test_a_fit_across_a_gap_finds_the_truth(tmp_path, gap):
    model = load_model(model_reference(str(MAKE.MODELS / "rota_damp.py")))
    run = simulate(model, 10.0, points=1001, parameters={"bearing.d": 0.02}, start={"bearing.phi": 0.6})
    noisy = run["rod.phi"] + 1e-3 * np.random.default_rng(1).standard_normal(1001)
    kept = (run.time < 4) | (run.time > 5.5)
    pd.DataFrame({"t": run.time[kept], "phi": noisy[kept]}).to_csv(tmp_path / "run.csv", index=False)
    path = tmp_path / "study.toml"
    path.write_text(PENDULUM.format(model=MAKE.MODELS / "rota_damp.py", gap=gap))
    opened = open_study(path)
    assert len(opened.setup.train) == (2 if gap == "split" else 1)
    (found,) = identify_study(opened).parameters
    # three standard deviations of one parameter
    assert abs(found.value - 0.02) < 3 * found.sd and found.sd < 2e-4


def test_pieces_and_runs_of_one_name_are_refused(tmp_path):
    MAKE.column(0, MAKE.gappy(20, 1.0))(tmp_path / "run.csv")
    path = MAKE.Case("run.csv", lambda file: None).make(tmp_path)
    MAKE.text(MAKE.rows())(tmp_path / "good.csv")
    whole = path.read_text().split("[[experiment]]")[1].replace('"run"', '"run-1"').replace("run.csv", "good.csv")
    path.write_text(path.read_text() + "[[experiment]]\n" + whole)
    with pytest.raises(StudyError, match="`run-1` names a run and the piece of another"):
        open_study(path)
