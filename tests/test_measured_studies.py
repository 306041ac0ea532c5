"""The studies of measured data: their baselines have the errors that others found for the same models.

The numbers are those of the data folder's ABOUT files, which were found by other programs.
"""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cartpend_dae.effects import catalogue
from cartpend_dae.pieces import load_experiments
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.report.result import identification_of
from cartpend_dae.session import identify_study, open_study
from cartpend_dae.shooting import predict

STUDIES = Path(__file__).resolve().parent.parent / "models" / "studies"

pytestmark = pytest.mark.slow


def changed(tmp_path, name, *changes, add=""):
    """Write a study with parts of its text replaced."""
    text = (STUDIES / f"{name}.toml").read_text()
    for old, new in (("../", f"{STUDIES.parent}/"), *changes):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / f"{name}.toml"
    path.write_text(text + add)
    return path


def errors(study):
    """Identify a study; return the fit and the rmse of each run's only output."""
    opened = open_study(study)
    fit = identify_study(opened)
    runs = identification_of(opened, fit).errors.runs
    return fit, {run.name: next(iter(run.outputs.values())).rmse for run in runs}


MEASURED = sorted(path for path in STUDIES.glob("*.toml") if "CARTPEND_DATA" in path.read_text())


@pytest.mark.parametrize("path", MEASURED, ids=lambda path: path.stem)
def test_study_passes_its_check_and_leaves_the_search_all_effects(data_dir, path):
    study = open_study(path)
    assert study.places is None and len(study.cards) == len(catalogue())
    assert study.setup.train and (study.setup.test or path.stem.endswith("_whole"))


def test_silverbox_is_as_wrong_as_any_linear_model(data_dir):
    fit, rmse = errors(STUDIES / "silverbox.toml")
    # to the last digit that is printed; both runs start from their first samples, elsewhere from the truth
    assert rmse["multisine_end"] == pytest.approx(7.02e-3, rel=0.01)
    assert rmse["arrow"] == pytest.approx(14.23e-3, rel=0.01)
    m, d, c = fit.values.values()
    # resonance and damping ratio of the small-signal circuit; a linear fit sees the spring stiffened by the amplitude
    assert np.sqrt(c / m) / (2 * np.pi) == pytest.approx(68.33, rel=0.03)
    assert d / (2 * np.sqrt(c * m)) == pytest.approx(0.0486, rel=0.05)


def test_gear_motor_as_a_lag_misses_the_whole_record_by_as_much_as_published(data_dir):
    _, rmse = errors(STUDIES / "dc_motor_deadzone_whole.toml")
    assert rmse["record"] * 30 / np.pi == pytest.approx(26.7, abs=0.1)


def test_gear_motor_fitted_forwards_misses_backwards(data_dir):
    fit, rmse = errors(STUDIES / "dc_motor_deadzone.toml")
    assert {name: run > 10 * np.pi / 30 for name, run in rmse.items()} == dict.fromkeys(rmse, True)
    assert all(estimate.status == "ok" for estimate in fit.parameters)


SETS = {
    "schmidt_lipson": ("track.d", (2.73e-3, 6.71e-3), (0.399e-3, 0.464e-3)),
    "schmidt_lipson_pend": ("bearing.d", (0.220, 0.762), (0.0163, 0.0172)),
}
"""Damping, and rmse of training rows and of the rows after them, without and with it."""


@pytest.mark.parametrize("name", SETS)
def test_schmidt_and_lipson_lack_viscous_friction(data_dir, tmp_path, name):
    damping, without, with_it = SETS[name]
    assert both_parts(STUDIES / f"{name}.toml") == pytest.approx(without, rel=0.05)
    damped = changed(tmp_path, name, add=f'\n[parameters."{damping}"]\nguess = 0.01\nmin = 0.0\n')
    assert both_parts(damped) == pytest.approx(with_it, rel=0.05)


def both_parts(study):
    """Return the rmse of the training rows, and of the rows after them simulated on from the same start."""
    opened = open_study(study)
    fit = identify_study(opened)
    units = {variable.name: variable.declaration.unit for variable in opened.system.variables}
    first, last = opened.study.experiments
    (whole,) = load_experiments(replace(first, rows=(first.rows[0], last.rows[1])), units)
    problem = make_problem(opened.system, opened_free(opened), (whole,))
    (measured,) = (channel.values for channel in whole.outputs.values())
    error = (measured - predict(problem, fit.point, 0.0)[:, 0])[np.isfinite(measured)]  # rows between samples
    n = first.rows[1] + 1
    return np.sqrt(np.mean(error[:n] ** 2)), np.sqrt(np.mean(error[n:] ** 2))


def opened_free(opened):
    return tuple(free_parameter(opened.system, spec.name, guess=spec.guess) for spec in opened.setup.free)


@pytest.fixture(scope="module")
def dfki():
    spec = importlib.util.spec_from_file_location("study_dfki_report", STUDIES / "dfki_report.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up by name
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def swing_ups(data_dir, dfki):
    """Fits of the complete model on the study's own segmentation and on the others."""
    study = dfki.opened("dfki_pendulum_complete")
    return [dfki.fitted(study, parts) for parts in (dfki.Segmentation(), *dfki.OTHERS)]


def test_windows_of_the_swing_ups_follow_from_the_rule(data_dir, dfki):
    for name in ("dfki_pendulum", "dfki_pendulum_complete"):
        for spec in dfki.opened(name).study.experiments:
            (run,) = load_experiments(
                replace(spec, window=None), {"bearing.phi": "rad", "motor.tau": "N.m", "bearing.w": ""}
            )
            end = dfki.swing_up_end(run.time, run.outputs["bearing.phi"].values)
            assert spec.window == pytest.approx((0.0, end), abs=2e-4), spec.name


def test_weight_over_inertia_of_the_swing_up_hardly_depends_on_the_cuts(dfki, swing_ups):
    for fit in swing_ups:
        assert dfki.ratio(fit)[0] == pytest.approx(19.3, rel=0.03)


@pytest.mark.parametrize("name", ["arm.J", "weight.tau_g"])
def test_intervals_of_the_swing_up_cover_what_other_cuts_find(swing_ups, name):
    estimates = [next(e for e in fit.parameters if e.name == name) for fit in swing_ups]
    for one in estimates:
        for other in estimates:
            assert one.interval[0] < other.value < one.interval[1]


def test_intervals_of_weight_over_inertia_cover_what_other_cuts_find(dfki, swing_ups):
    """With five pieces their scatter along this combination alone is smaller by chance than the cuts show."""
    ratios = [dfki.ratio(fit) for fit in swing_ups]
    for value, sd in ratios:
        assert all(abs(other - value) < 1.96 * sd for other, _ in ratios)
        assert 1.96 * sd < 0.04 * value


def test_without_coulomb_friction_and_offset_the_swing_up_is_biased_and_misfits(dfki, swing_ups):
    whole, plain = swing_ups[0], dfki.fitted(dfki.opened("dfki_pendulum"), dfki.Segmentation())
    assert plain.values["arm.J"] > 1.25 * whole.values["arm.J"]
    assert plain.values["weight.tau_g"] > 1.25 * whole.values["weight.tau_g"]
    assert plain.noise_sd[0] > 1.5 * whole.noise_sd[0]


def test_report_of_the_swing_up_is_printed(data_dir, dfki, monkeypatch, capsys):
    monkeypatch.setattr(dfki, "OTHERS", ())
    dfki.main()
    lines = capsys.readouterr().out.splitlines()
    rows = [line for line in lines if line.startswith("0, 0.3, 0.8")]
    assert len(rows) == 2
    whole, plain = (float(row.split()[-1]) for row in rows)
    assert (whole, plain) == pytest.approx((2.9, 5.0), abs=0.1)
