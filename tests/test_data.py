"""Measured runs: what is read, what is refused, and what the estimates of noise and whiteness are worth."""

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pydantic import TypeAdapter

from cartpend_dae.data import Trajectory, noise_sd, quantum, von_neumann_z
from cartpend_dae.errors import StudyError
from cartpend_dae.pieces import load_experiments
from cartpend_dae.study_schema import ExperimentSpec

UNITS = {"amplifier.u": "V", "bearing.phi": "rad", "bearing.w": "rad/s"}
TIME = np.arange(20) * 0.01
THETA = np.round(20 * np.cos(3 * TIME), 3)
VOLTAGE = np.where(TIME < 0.1, 1.5, -0.5)


def spec(file, **more):
    table = {
        "name": "run",
        "file": str(file),
        "time": {"column": "time"},
        "outputs": {"bearing.phi": {"column": "theta", "unit": "deg"}},
    }
    return TypeAdapter(ExperimentSpec).validate_python(table | more)


def load_experiment(spec, units):
    (run,) = load_experiments(spec, units)
    return run


def load(file, **more):
    return load_experiment(spec(file, **more), UNITS)


def log(folder, text=None, name="run.csv", encoding="utf-8", **columns):
    path = folder / name
    if text is None:
        frame = pd.DataFrame({"time": TIME, "theta": THETA, "u": VOLTAGE} | columns)
        text = frame.to_csv(index=False)
    path.write_text(text, encoding=encoding)
    return path


INPUT = {"amplifier.u": {"column": "u", "unit": "mV", "hold": "foh"}}


def test_a_run_is_in_si(tmp_path):
    run = load(
        log(tmp_path),
        inputs=INPUT,
        outputs={"bearing.phi": {"column": "theta", "unit": "deg", "sd": 0.1}},
        start={"bearing.phi": {"guess": 20, "unit": "deg"}, "bearing.w": {"value": 0.5}},
    )
    # 1e-14: one rounding in the conversion.
    np.testing.assert_allclose(run.outputs["bearing.phi"].values, np.radians(THETA), rtol=1e-14)
    np.testing.assert_allclose(run.inputs["amplifier.u"].values, VOLTAGE / 1000, rtol=1e-14)
    np.testing.assert_array_equal(run.time, TIME)
    assert run.outputs["bearing.phi"].sd == pytest.approx(math.radians(0.1), rel=1e-14)
    assert (run.inputs["amplifier.u"].hold, run.inputs["amplifier.u"].sd) == ("foh", None)
    assert run.start["bearing.phi"].value == pytest.approx(math.radians(20), rel=1e-14)
    assert (run.start["bearing.phi"].free, run.start["bearing.w"].free) == (True, False)


def test_a_run_cannot_be_changed(tmp_path):
    run = load(log(tmp_path))
    with pytest.raises(FrozenInstanceError):
        run.name = "other"
    with pytest.raises(ValueError, match="read-only"):
        run.outputs["bearing.phi"].values[0] = 1.0


ROWS = list(zip(TIME, THETA, VOLTAGE, strict=True))


def written(delimiter, decimal=".", header=True, end="\n", comment=""):
    lines = [comment + delimiter.join(("time", "theta", "u"))] if header else []
    lines += [delimiter.join(f"{x:.6f}".replace(".", decimal) for x in row) for row in ROWS]
    return end.join(lines) + end


DIALECTS = {
    "comma": written(","),
    "semicolon": written(";"),
    "german": written(";", ","),
    "tab and decimal comma": written("\t", ","),
    "spaces": written("   "),
    "spaces and decimal comma": written(" ", ","),
    "comma and space": written(", "),
    "bar": written("|"),
    "windows": written(",", end="\r\n"),
    "delimiter at the end of lines": written(",", end=",\n"),
    "header in a comment": written(" ", comment="% "),
    "header with commas in a comment": "# time, theta, u\n" + written(" ", header=False),
    "comments before the header": "# rig 3, Tuesday\n\n# second try\n" + written(","),
    "leading spaces": "\n".join("  " + line for line in written("  ").splitlines()),
    "comments after the header": written(",").replace("\n0.05", "\n# halfway\n\n0.05"),
    "quoted": written(",").replace("time,theta,u", '"time","theta","u"'),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("text", DIALECTS.values(), ids=DIALECTS.keys())
def test_the_dialect_of_a_text_file_is_found_out(tmp_path, text, encoding):
    run = load(log(tmp_path, text, encoding=encoding), inputs={"amplifier.u": {"column": "u"}})
    # 1e-6: the last digit in the file is 1e-6, and time is written exactly.
    np.testing.assert_allclose(run.time, TIME, atol=1e-12)
    np.testing.assert_allclose(np.degrees(run.outputs["bearing.phi"].values), THETA, atol=1e-6)
    np.testing.assert_array_equal(run.inputs["amplifier.u"].values, VOLTAGE)


def test_format_overrides_what_the_file_says(tmp_path):
    text = "logged by hand\n" + written(";", ",", header=False)
    form = {"columns": ["t", "theta", "u"], "skip_rows": 1, "delimiter": ";", "decimal": ","}
    run = load(log(tmp_path, text), time={"column": "t", "unit": "ms"}, format=form)
    np.testing.assert_allclose(run.time, TIME / 1000, rtol=1e-12)
    renamed = load(log(tmp_path), time={"column": "t"}, format={"columns": ["t", "theta", "u"]})
    np.testing.assert_array_equal(renamed.time, TIME)


def test_a_header_in_another_encoding_is_read(tmp_path):
    text = written(",").replace("theta", "angle [°]")
    run = load(log(tmp_path, text, encoding="cp1252"), outputs={"bearing.phi": {"column": "angle [°]"}})
    # the degrees of the header count, because the study gives no unit
    np.testing.assert_allclose(np.degrees(run.outputs["bearing.phi"].values), THETA, atol=1e-6)


def test_rows_and_window_keep_the_recorded_time(tmp_path):
    path = log(tmp_path)
    np.testing.assert_array_equal(load(path, rows=[2, 13]).time, TIME[2:14])
    np.testing.assert_array_equal(load(path, window=[0.05, 0.15]).time, TIME[5:16])
    sampled = load(path, time=None, rows=[5, 19], format={"sample_rate": 200.0})
    np.testing.assert_allclose(sampled.time, np.arange(5, 20) / 200, rtol=1e-15)


def test_subtract_takes_the_mean_of_what_is_kept_or_a_number(tmp_path):
    kept = {"column": "theta", "unit": "deg"}
    centred = load(log(tmp_path), rows=[0, 11], outputs={"bearing.phi": kept | {"subtract": "mean"}})
    # 1e-15 rad: rounding of the mean of twelve numbers near 0.35 rad.
    assert abs(centred.outputs["bearing.phi"].values.mean()) < 1e-15
    shifted = load(log(tmp_path), outputs={"bearing.phi": kept | {"subtract": 5}})
    np.testing.assert_allclose(np.degrees(shifted.outputs["bearing.phi"].values), THETA - 5, rtol=1e-13)


def test_outputs_may_have_gaps(tmp_path):
    theta = THETA.copy()
    theta[[3, 7]] = np.nan
    run = load(log(tmp_path, theta=theta))
    assert list(np.flatnonzero(np.isnan(run.outputs["bearing.phi"].values))) == [3, 7]


def test_matlab_vectors_matrices_and_structures(tmp_path):
    path = tmp_path / "run.mat"
    content = {"t": TIME[:, None], "A": np.column_stack([THETA, VOLTAGE]), "gain": 35.0}
    scipy.io.savemat(path, content | {"log": {"theta": THETA, "note": "warm"}})
    form = {"time": {"column": "t"}, "inputs": {"amplifier.u": {"column": "A(:,2)"}}}
    for column in ("A(:,1)", "log.theta"):
        run = load(path, **form, outputs={"bearing.phi": {"column": column, "unit": "deg"}})
        np.testing.assert_allclose(np.degrees(run.outputs["bearing.phi"].values), THETA, rtol=1e-14)
        np.testing.assert_array_equal(run.inputs["amplifier.u"].values, VOLTAGE)
    with pytest.raises(StudyError, match=r"no column `A`\. The columns are: `t`, `A\(:,1\)`, `A\(:,2\)`, `log"):
        load(path, **form, outputs={"bearing.phi": {"column": "A"}})
    scipy.io.savemat(path, content | {"theta": THETA[:-1]})
    with pytest.raises(StudyError, match="the columns differ in length: `t` 20, `theta` 19"):
        load(path, time={"column": "t"})


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("run.mat", b"time,theta\n0,1\n", "the file is not a MATLAB file that can be read"),
        ("run.mat", b"", "the file is not a MATLAB file that can be read"),
        ("run.parquet", b"PAR1 no more", "the file is not a parquet file|reading parquet needs pyarrow"),
        ("run.csv", b"", r"the file holds no data\."),
        ("run.csv", b"time,theta\n", r"the file holds no data\."),
        ("run.csv", b"\x89HDF\0\0\0\0", "the file is not text; csv, txt, mat and parquet files can be read"),
        ("run.csv", b'time,theta\n0,1\n1,"2\n', "the file is not a table of 2 columns: .* inside string"),
        ("run.csv", b"0,1\n1,2\n", "the file has no header, but the rows have 2, such as"),
        ("run.csv", b"% theta\n0 1\n1 2\n", "the header names 1 columns, but the rows have 2"),
        ("run.csv", b"time,theta\n0,1\n1,2,3\n", "row 1 has 3 cells, the first row 2: '1,2,3'"),
    ],
)
def test_files_that_are_not_tables(tmp_path, name, content, sentence):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(StudyError, match=sentence) as caught:
        load(tmp_path / name)
    assert str(caught.value).startswith(f"{tmp_path / name}: experiment `run`: ")
    assert "\n" not in str(caught.value)


def test_matlab_7_3_without_h5py(tmp_path):
    # The version bytes 0x0200 of the header are what tells a 7.3 file.
    (tmp_path / "run.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400))
    with pytest.raises(StudyError, match=r"MATLAB 7\.3 \(HDF5\), which needs h5py|is not a MATLAB file"):
        load(tmp_path / "run.mat")


def altered(column, row, value):
    columns = {"time": TIME, "theta": THETA, "u": VOLTAGE}
    cells = columns[column].astype(object)
    cells[row] = value
    return {column: cells}


ANGLE_IN_METRES = {"bearing.phi": {"column": "theta", "unit": "m"}}
REFUSED = {
    "text": (
        altered("theta", 7, "n/a?"),
        {},
        r"column `theta` holds 'n/a\?' in row 7, which is not a number",
    ),
    "text after rows": (
        altered("theta", 12, "x"),
        {"rows": [5, 19]},
        "holds 'x' in row 12, which is not a number",
    ),
    "input hardly known": (
        {"u": np.where(np.arange(20) < 9, VOLTAGE, np.nan)},
        {"inputs": INPUT},
        "the input column `u` has 9 finite values; at least 10 are needed",
    ),
    "infinite input": (altered("u", 4, np.inf), {"inputs": INPUT}, "`u` has no finite value in row 4"),
    "nothing measured": ({"theta": np.nan}, {}, "`theta` has 0 finite values; at least 10 are needed"),
    "gap of time": (altered("time", 2, np.nan), {}, "the time column `time` is empty in row 2"),
    "time stands": (
        altered("time", 15, 0.14),
        {"rows": [3, 19]},
        r"the time does not increase at row 15: 0\.14 s after 0\.14 s \(1 such rows\); choose",
    ),
    "time goes back": (altered("time", 5, 0.0), {}, r"does not increase at row 5: 0 s after 0\.04 s"),
    "few": ({}, {"rows": [0, 8]}, "9 samples are too few; at least 10 are needed"),
    "window elsewhere": (
        {},
        {"window": [5.0, 9.0]},
        r"`window` = \[5, 9\] s holds no sample; the run was recorded from 0 s to 0\.19 s",
    ),
    "rows beyond": ({}, {"rows": [0, 20]}, "`rows` ends at 20, but the last row of the file is 19"),
    "no column": (
        {},
        {"time": {"column": "tme"}, "inputs": {"amplifier.u": {"column": "volts"}}},
        r"no column `tme`, `volts`; did you mean `time`\? The columns are: `time`, `theta`, `u`",
    ),
    "angle in metres": (
        {},
        {"outputs": ANGLE_IN_METRES},
        r'`outputs\."bearing\.phi"` is read in `m`, but the model has it in `rad`',
    ),
    "start in volts": (
        {},
        {"start": {"bearing.w": {"value": 1.0, "unit": "V"}}},
        r'`start\."bearing\.w"` is read in `V`, but the model has it in `rad/s`',
    ),
    "unknown variable": (
        {},
        {"outputs": {"bearing.phy": {"column": "theta"}}},
        r"`outputs`: the model has no `bearing\.phy`; did you mean `bearing\.phi`",
    ),
    "unknown start": (
        {},
        {"start": {"q": {"value": 1}}},
        r"`start`: the model has no `q`; there are: `amp",
    ),
}


@pytest.mark.parametrize(("columns", "more", "sentence"), REFUSED.values(), ids=REFUSED.keys())
def test_data_that_is_refused(tmp_path, columns, more, sentence):
    path = log(tmp_path, **columns)
    with pytest.raises(StudyError, match=sentence) as caught:
        load(path, **more)
    assert str(caught.value).startswith(f"{path}: experiment `run`: ")


def test_a_missing_file(tmp_path):
    with pytest.raises(StudyError, match=r"none\.csv: experiment `run`: there is no such data file\."):
        load(tmp_path / "none.csv")


NUMBERS = st.floats(-1e150, 1e150)
MATRICES = hnp.arrays(float, st.tuples(st.integers(10, 30), st.just(2)), elements=NUMBERS)


@settings(max_examples=30)
@given(values=MATRICES)
def test_a_trajectory_reads_back_exactly(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("csv") / "run.csv"
    time = np.arange(len(values)) / 3
    Trajectory(time, ("bearing.phi", "bearing.w"), values, ("rad", "rad/s")).to_csv(path)
    names = {name: {"column": name} for name in ("bearing.phi", "bearing.w")}
    run = load(path, outputs=names)
    np.testing.assert_array_equal(run.time, time)
    for j, name in enumerate(names):
        np.testing.assert_array_equal(run.outputs[name].values, values[:, j])
    assert [item.name for item in path.parent.iterdir()] == ["run.csv"]


def test_a_trajectory_is_read_by_name(tmp_path):
    values = np.column_stack([THETA, VOLTAGE])
    run = Trajectory(TIME, ("bearing.phi", "motor.u"), values, ("rad", "V"))
    np.testing.assert_array_equal(run["motor.u"], VOLTAGE)
    np.testing.assert_array_equal(run["time"], TIME)
    assert "bearing.phi" in run and "time" in run and "bearing.w" not in run
    frame = run.to_frame()
    assert (list(frame.columns), frame.index.name) == (["bearing.phi", "motor.u"], "time")
    with pytest.raises(KeyError, match=r"no variable `bearing\.phy`; did you mean `bearing\.phi`\?"):
        run["bearing.phy"]
    with pytest.raises(OSError, match="nowhere"):
        run.to_csv(tmp_path / "nowhere" / "run.csv")


def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "run.csv"
    path.write_text("old")
    monkeypatch.setattr(pd.DataFrame, "to_csv", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        Trajectory(TIME, ("a",), THETA[:, None], ("1",)).to_csv(path)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("sd", [1e-4, 1e-2])
def test_noise_of_a_smooth_signal(sd):
    time = np.arange(2000) * 0.01
    estimates = [
        noise_sd(np.cos(3 * time) * np.exp(-0.1 * time) + sd * np.random.default_rng(seed).normal(size=2000))
        for seed in range(40)
    ]
    # The median absolute 6th difference is unbiased to 1 %, and one estimate scatters by 4 to 7 %.
    assert np.mean(estimates) == pytest.approx(sd, rel=0.02)
    assert np.std(estimates) < 0.07 * sd


def test_noise_is_not_below_that_of_quantisation():
    slow = np.round(np.sin(np.linspace(0, 1, 500)) / 0.01) * 0.01
    assert noise_sd(slow) == pytest.approx(0.01 / math.sqrt(12), rel=1e-9)


def test_noise_skips_gaps_and_needs_seven_values():
    values = 0.1 * np.random.default_rng(1).normal(size=3000)
    values[::17] = np.nan
    # 0.07: the scatter of one estimate.
    assert noise_sd(values) == pytest.approx(0.1, rel=0.07)
    assert math.isnan(noise_sd(np.array([1.0, np.nan, 2.0])))


def test_gaps_do_not_make_noise_of_a_fast_signal():
    time = np.arange(3000) * 0.01
    values = np.sin(20 * time) + 1e-3 * np.random.default_rng(2).normal(size=3000)
    values[::10] = np.nan
    # 0.1: the scatter of one estimate from the third of the samples that stand in even steps.
    assert noise_sd(values) == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize("sd", [1e-3, 0.05])
def test_noise_of_a_signal_that_jumps_with_its_input_is_that_of_the_signal(sd):
    """The current of a motor follows each step of its voltage at once, which is no noise of the sensor."""
    generator = np.random.default_rng(3)
    voltage, speed, estimates = np.repeat(24 * generator.uniform(-1, 1, 200), 2), 0.0, []
    current = np.zeros(400)
    for k, u in enumerate(voltage):
        current[k] = (u - 14 * speed) / 0.7
        speed += 0.005 * (14 * current[k] / 12 - speed)
    for seed in range(20):
        noisy = current + sd * np.random.default_rng(seed).standard_normal(current.size)
        estimates.append(noise_sd(noisy, [voltage]))
        assert noise_sd(noisy) > 50 * sd or sd > 0.01
    # 0.1: the least of all sums is the more uncertain estimate
    assert np.mean(estimates) == pytest.approx(sd, rel=0.1)


def test_an_input_leaves_the_noise_of_a_smooth_signal_as_it_is():
    time = np.arange(2000) * 0.01
    values = np.cos(3 * time) + 1e-3 * np.random.default_rng(4).normal(size=time.size)
    assert noise_sd(values, [np.sin(2 * time)]) == noise_sd(values)


@given(
    step=st.sampled_from([1e-6, 2.9e-3, 0.1, math.pi / 180, 7.0]),
    offset=st.floats(-10, 10),
    seed=st.integers(0, 99),
)
def test_quantum_of_a_counter(step, offset, seed):
    counts = np.cumsum(np.random.default_rng(seed).integers(-3, 4, size=300))
    assert quantum(offset * step + counts * step) == pytest.approx(step, rel=1e-6)


def test_quantum_survives_a_tenth_of_wrong_values():
    counts = np.cumsum(np.random.default_rng(5).integers(-2, 3, size=1000)) * 0.25
    counts[::50] += 0.1
    assert quantum(counts) == pytest.approx(0.25, rel=1e-2)


@pytest.mark.parametrize("n", [12, 40, 1000, 20000])
def test_no_quantum_in_what_is_continuous(n):
    rng = np.random.default_rng(n)
    time = np.linspace(0, 10, n)
    for values in (rng.normal(size=n), np.sin(time), np.sin(time) + 1e-3 * rng.normal(size=n), 0.3 * time):
        assert quantum(values) == 0.0
    assert quantum(np.full(n, 2.0)) == 0.0


def test_von_neumann_z_of_white_noise_is_standard_normal():
    scores = [von_neumann_z(np.random.default_rng(seed).normal(size=400)) for seed in range(1000)]
    # Standard errors with 1000 seeds: 0.032 of the mean, 0.022 of the deviation; three of each.
    assert abs(np.mean(scores)) < 0.1
    assert abs(np.std(scores) - 1) < 0.07


def test_von_neumann_z_is_von_neumanns_ratio():
    residual = np.random.default_rng(3).normal(size=5000).cumsum() * 0.01
    residual -= residual.mean()
    ratio = np.mean(np.diff(residual) ** 2) / np.var(residual)
    # 1e-3: the two ends count half in the variance.
    assert von_neumann_z(residual) == pytest.approx((1 - ratio / 2) * math.sqrt(4999), rel=1e-3)


def test_von_neumann_z_finds_structure_and_skips_gaps():
    rng = np.random.default_rng(4)
    smooth = np.sin(np.linspace(0, 20, 500)) + rng.normal(size=500)
    # The correlation of neighbours is 0.5/1.5, so z is sqrt(500)/3 = 7.5, give or take 1.
    assert von_neumann_z(smooth) > 4
    assert von_neumann_z(np.full(400, 0.1)) == pytest.approx(math.sqrt(399))
    assert von_neumann_z(np.resize([1.0, -1.0], 400)) == pytest.approx(-math.sqrt(399))
    gaps = rng.normal(size=900)
    gaps[::3] = np.nan
    assert abs(von_neumann_z(gaps)) < 4
    assert von_neumann_z(np.zeros(20)) == 0.0


def test_emps_is_read_as_its_authors_describe_it(data_dir):
    for file, low, high in (("DATA_EMPS.mat", -4.33, 4.14), ("DATA_EMPS_PULSES.mat", -7.94, 9.03)):
        run = load_experiment(
            spec(
                data_dir / "emps" / file,
                time={"column": "t"},
                inputs={"drive.u": {"column": "vir", "unit": "V"}},
                outputs={"encoder.s": {"column": "qm", "unit": "m"}},
            ),
            {"drive.u": "V", "encoder.s": "m"},
        )
        voltage = run.inputs["drive.u"].values
        assert len(run.time) == 24841
        # 0.005: two decimals are published.
        assert voltage.min() == pytest.approx(low, abs=0.005)
        assert voltage.max() == pytest.approx(high, abs=0.005)
        assert run.time[-1] == pytest.approx(24.84, abs=1e-9)


def test_schmidt_lipson_and_silverbox_are_read(data_dir):
    pendulum = load(
        data_dir / "schmidt_lipson" / "real_pend_h_1.txt",
        outputs={"bearing.phi": {"column": "o", "unit": "rad"}},
        format={"columns": ["trial", "time", "o", "v"]},
    )
    assert (pendulum.time[0], pendulum.time[-1]) == (5.0, 99.5)
    assert np.isfinite(pendulum.outputs["bearing.phi"].values).sum() == 556
    # Steps of 0.333 and 0.5 s stand in the file; the latter are filled with times at which nothing was measured.
    assert np.diff(pendulum.time).max() < 0.334
    circuit = load(
        data_dir / "silverbox" / "SNLS80mV.csv",
        time=None,
        inputs={"amplifier.u": {"column": "V1", "subtract": "mean"}},
        outputs={"bearing.phi": {"column": "V2"}},
        rows=[100, 40575],
        format={"sample_rate": 1e7 / 2**14},
    )
    assert len(circuit.time) == 40476
    assert circuit.time[0] == pytest.approx(100 * 2**14 / 1e7, rel=1e-12)


def test_encoder_step_of_the_measured_pendulum(data_dir):
    runs = [
        load(data_dir / "dfki_pendulum" / f"{name}.csv", outputs={"bearing.phi": {"column": "position"}})
        for name in ("energy_shaping", "ilqr", "ddp")
    ]
    # The position is sent as 16 bits over 191 rad; one encoder, so one step in all runs.
    steps = [run.outputs["bearing.phi"].quantum for run in runs]
    np.testing.assert_allclose(steps, 191 / 65535, rtol=1e-6)
