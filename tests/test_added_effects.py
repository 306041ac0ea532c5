"""Effects that a study adds to its model: a sensor with an offset and a wrong gain, calibrated with the rest."""

import re

import numpy as np
import pytest

from cartpend_dae import StudyError, simulate
from cartpend_dae.session import identify_study, open_study
from models.rota_damp import RotaDamp

STUDY = """
[model]
path = "{model}"
add = [{{ effect = "sensor_offset", at = "bearing.phi" }}, {{ effect = "sensor_gain", at = "bearing.phi" }}]
[parameters."bearing.d"]
guess = 0.02
[parameters."bearing.phi.sensor_offset.y_0"]
guess = 0.0
[parameters."bearing.phi.sensor_gain.e"]
guess = 0.0
[[experiment]]
name = "run"
file = "run.csv"
time = {{ column = "t" }}
outputs = {{ "bearing.phi" = {{ column = "phi", unit = "deg" }} }}
start = {{ "bearing.phi" = {{ guess = 60.0, unit = "deg" }}, "bearing.w" = {{ value = 0.0 }} }}
"""


def study(folder, **changes):
    run = simulate(RotaDamp(), 10.0, points=1001, start={"bearing.phi": 1.2, "bearing.w": 0.0})
    noise = 1e-3 * np.random.default_rng(0).standard_normal(run.time.size)
    shown = np.degrees(1.05 * (run["bearing.phi"] + 0.03) + noise)
    np.savetxt(folder / "run.csv", np.column_stack([run.time, shown]), delimiter=",", header="t,phi", comments="")
    import models.rota_damp as module

    text = STUDY.format(model=module.__file__)
    for old, new in changes.items():
        text = text.replace(old, new)
    path = folder / "study.toml"
    path.write_text(text)
    return path


def test_offset_and_gain_of_a_sensor_are_estimated_with_the_friction(tmp_path):
    """At large angles the period tells the amplitude, so that the scale of the sensor shows."""
    fit = identify_study(study(tmp_path))
    found = {e.name: e for e in fit.parameters}
    truth = {"bearing.d": 0.0375, "bearing.phi.sensor_offset.y_0": 0.03, "bearing.phi.sensor_gain.e": 0.05}
    assert set(found) == set(truth)
    for name, value in truth.items():
        assert found[name].value == pytest.approx(value, abs=4 * found[name].sd)
        assert found[name].sd < 0.05 * value
    assert fit.noise_sd[0] == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("sensor_gain", "sensor_gian", r"no effect `sensor_gian`; did you mean `sensor_gain`"),
        ('at = "bearing.phi" }}]', 'at = "bearing.psi" }}]', r"`bearing\.psi` is no place for `sensor_gain`"),
        ('"sensor_gain", at', '"sensor_offset", at', r"has `sensor_offset` at `bearing\.phi` twice"),
    ],
)
def test_what_cannot_be_added_is_said(tmp_path, old, new, why):
    path = study(tmp_path)
    path.write_text(path.read_text().replace(old.replace("}}", "}"), new.replace("}}", "}"), 1))
    with pytest.raises(StudyError, match=why) as error:
        open_study(path)
    assert re.search(r"`model\.add`", str(error.value))
