"""The published numbers of the rig, and the data that the scripts of `models/studies` make from seeds."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cartpend_dae import assemble
from cartpend_dae.data import noise_sd
from cartpend_dae.pieces import load_experiments
from cartpend_dae.study import load_model, load_study

STUDIES = Path(__file__).resolve().parent.parent / "models" / "studies"


def script(name):
    """Import a script of `models/studies` under a name of its own."""
    spec = importlib.util.spec_from_file_location(f"study_{name}", STUDIES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


published = script("published_pendulum")
springs = script("springs")
make_demo = script("make_demo")


def units_of(study):
    system = assemble(load_model(study.model))
    return {variable.name: variable.declaration.unit for variable in system.variables}


def stored_trace():
    study = load_study(STUDIES / "published_pendulum.toml")
    return load_experiments(study.experiments[0], units_of(study))[0].outputs["bearing.phi"].values


def test_the_18_published_sums_of_squares_are_rebuilt():
    error = published.sums_of_squares(stored_trace()) / published.PUBLISHED_SSE - 1
    assert np.sqrt(np.mean(error**2)) < 0.012
    assert np.abs(error).max() < 0.03


def test_the_rebuilt_trace_leaves_the_floor_unexplained_and_nothing_of_the_sweep_in_it():
    truth = published.model_runs(np.array([published.TRUE_DAMPING]))[0]
    rest = stored_trace() - truth
    # The csv is rounded to 1e-6 rad: 501 roundings of 3e-7, against a sequence of length 0.6.
    assert rest @ rest == pytest.approx(published.FLOOR, abs=1e-5)
    np.testing.assert_allclose((published.model_runs(published.DAMPING) - truth) @ rest, 0.0, atol=1e-5)


def test_the_swept_curve_has_its_minimum_at_the_true_damping():
    sweep = np.arange(0.0370, 0.03781, 0.0001)
    curve = published.sums_of_squares(stored_trace(), sweep)
    assert sweep[np.argmin(curve)] == pytest.approx(published.TRUE_DAMPING, abs=1e-6)


def test_the_published_csv_is_regenerated_bit_for_bit(tmp_path):
    published.write_csv(published.rebuild(), tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == (STUDIES / "published_pendulum.csv").read_bytes()


def test_the_table_is_printed(capsys, monkeypatch, tmp_path):
    # `main` writes beside its file: let that be elsewhere.
    monkeypatch.setattr(published, "__file__", str(tmp_path / "published_pendulum.py"))
    published.main()
    assert "RMS 1.08 %, worst 2.68 %" in capsys.readouterr().out
    assert (tmp_path / "published_pendulum.csv").is_file()


def test_spring_2_agrees_with_the_published_stiffness_and_spring_1_does_not():
    found = springs.springs()
    assert round(found["K2"].value, 1) == springs.PUBLISHED["K2"]
    assert found["K1"].value == pytest.approx(1215, abs=1)
    assert springs.agrees("K2")
    assert not springs.agrees("K1")
    assert found["K1"].low < springs.PUBLISHED["K1"] < found["K1"].high


def test_the_interval_of_a_stiffness_is_the_textbook_one():
    """Slope of the stretch by the normal equations, its error with 3 degrees of freedom, t = 3.182446."""
    load, length = springs.MASS_LB * springs.NEWTON_PER_POUND, springs.LENGTH_2_M
    design = np.column_stack([np.ones(5), load])
    beta, rest, *_ = np.linalg.lstsq(design, length, rcond=None)
    error = np.sqrt(rest[0] / 3 * np.linalg.inv(design.T @ design)[1, 1])
    k = springs.springs()["K2"]
    assert k.length == pytest.approx(beta[0])
    # The quantile is quoted to seven digits.
    assert (1 / k.high, 1 / k.low) == pytest.approx((beta[1] - 3.182446 * error, beta[1] + 3.182446 * error), rel=1e-6)


def test_spring_table_is_printed(capsys):
    springs.main()
    lines = capsys.readouterr().out.splitlines()
    assert "1215.7" in lines[1] and "does not follow" in lines[1]
    assert "1320.1" in lines[2] and "agrees" in lines[2]


def test_the_demo_is_the_same_each_time_and_stands_alone(tmp_path):
    study = make_demo.make_demo(tmp_path / "one")
    again = subprocess.run(
        [sys.executable, STUDIES / "make_demo.py", tmp_path / "two"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(again.stdout.strip()) == tmp_path / "two" / study.name
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name
    moved = shutil.move(tmp_path / "one", tmp_path / "elsewhere")
    read = load_study(Path(moved) / study.name)
    runs = [load_experiments(entry, units_of(read))[0] for entry in read.experiments]
    assert [run.role for run in runs] == ["train", "train", "test"]
    for run in runs:
        assert run.time.size == 601
        # The estimate of a standard deviation from 601 samples, by a median, errs by some 7 %.
        assert noise_sd(run.outputs["bearing.phi"].values) == pytest.approx(make_demo.NOISE, rel=0.3)


def test_the_demo_pendulum_is_the_independent_one():
    import independent

    for degrees in make_demo.RELEASES.values():
        _, expected = independent.pendulum(
            duration=6.0, angle=np.radians(degrees), viscous=make_demo.VISCOUS, coulomb=make_demo.COULOMB
        )
        # Second-order stepping of 1e-4 s, and reversals felt up to a step late: far below the noise of 1e-3.
        np.testing.assert_allclose(make_demo.pendulum(np.radians(degrees)), expected, rtol=0, atol=5e-5)


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.toml")), ids=lambda path: path.stem)
def test_study_names_what_its_model_has(path):
    study = load_study(path)
    system = assemble(load_model(study.model))
    assert {parameter.name for parameter in study.parameters} <= {p.name for p in system.parameters}
    names = {variable.name for variable in system.variables}
    for run in study.experiments:
        assert {*run.outputs, *run.start} <= names
        assert set(run.inputs) == set(system.inputs)


def test_exchanged_study_is_the_other_one_with_its_roles_exchanged():
    one, two = (load_study(STUDIES / f"{name}.toml") for name in ("emps", "emps_exchanged"))
    other = {"train": "test", "test": "train"}
    assert [(run.file, other[run.role]) for run in one.experiments] == [(run.file, run.role) for run in two.experiments]
    assert (one.parameters, one.scores, one.discover) == (two.parameters, two.scores, two.discover)


@pytest.mark.parametrize("name", ["emps", "emps_exchanged"])
def test_emps_studies_read_the_measured_runs(data_dir, name):
    study = load_study(STUDIES / f"{name}.toml")
    for spec in study.experiments:
        (run,) = load_experiments(spec, units_of(study))
        assert run.time.size == 24841
        assert np.abs(run.inputs["drive.u"].values).max() < 10  # volts: the amplifier is limited to 10
        assert run.outputs["encoder.s"].values.max() == pytest.approx(0.2464, abs=2e-4)
