"""An interrupted discovery goes on from its last finished stage, and ends with the same numbers to the last bit."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from test_discover_pendulum import COULOMB, clean_run, noisy_setup
from typer.testing import CliRunner

from cartpend_dae import assemble, cli, fleet
from cartpend_dae.demo import make_demo
from cartpend_dae.discover import discover, store_for
from cartpend_dae.discover.store import Store, digest, packed, unpacked
from cartpend_dae.effects import catalogue
from cartpend_dae.residual_noise import NoiseModel

pytestmark = pytest.mark.xdist_group("resume")

FEW = ("coulomb_friction", "constant_load", "quadratic_drag", "sensor_offset")
CARDS = tuple(card for card in catalogue() if card.id in FEW)


class KilledError(BaseException):
    """Ends a process wherever it is, as a signal does."""


def setup():
    return noisy_setup(clean_run(COULOMB), 4)


def numbers(found):
    """Everything of a search that is a number or a text, as a hash of its bits."""
    search = found.search
    tried = [(c.insertion.prefix, c.parameters, c.predicted, c.gain, c.t, c.why_not) for c in search.candidates]
    return digest((search.baseline, search.final, tried, search.verdict, found.before.runs[0].predicted))


@pytest.fixture(scope="module")
def whole():
    """The hash of a discovery that nothing interrupted and nothing was kept of, and how often it reported."""
    count = []
    found = discover(setup(), cards=CARDS, report=lambda *_: count.append(1))
    return numbers(found), len(count)


@pytest.mark.parametrize("share", [0.15, 0.5, 0.9])
def test_what_is_killed_goes_on_and_ends_the_same(whole, share, tmp_path):
    expected, n_reports = whole
    left = [int(share * n_reports)]

    def report(*_):
        left[0] -= 1
        if left[0] < 0:
            raise KilledError

    with pytest.raises(KilledError):
        discover(setup(), cards=CARDS, report=report, store=store_for(setup(), tmp_path))
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert kept
    (tmp_path / ".fit-half.npz").write_bytes(b"a stage that was being written")
    found = discover(setup(), cards=CARDS, store=store_for(setup(), tmp_path))
    assert numbers(found) == expected
    assert {path: path.stat().st_mtime_ns for path in kept} == kept  # nothing was done twice


def test_processes_share_the_stages(whole, tmp_path):
    found = discover(setup(), cards=CARDS, store=store_for(setup(), tmp_path), jobs=2)
    again = discover(setup(), cards=CARDS, store=store_for(setup(), tmp_path))
    assert numbers(found) == numbers(again) == whole[0]


def test_a_discovery_leaves_the_model_as_it_was():
    before = noisy_setup(clean_run(0.0), 4)
    values = [q.value for q in assemble(before.model).parameters]
    assert discover(before, cards=CARDS).search.verdict == "no-discrepancy"
    assert [q.value for q in assemble(before.model).parameters] == values


@dataclass(frozen=True)
class Foreign:
    x: float = 1.0


def test_records_and_numbers_come_back_to_the_last_bit():
    arrays = []
    order = np.asfortranarray(np.arange(6.0).reshape(2, 3) / 7)
    value = (NoiseModel((np.ones(1), order), np.array([[np.nan]])), [1 / 3, np.inf], {"a": None, 2: True}, "text")
    text = json.loads(json.dumps(packed(value, arrays)))
    back = unpacked(text, {f"a{k}": array for k, array in enumerate(arrays)})
    assert digest(back) == digest(value)
    assert back[0].filters[1].flags.f_contiguous and isinstance(back[1], list) and back[2] == {"a": None, 2: True}


def test_nothing_but_records_of_the_package_is_kept_or_made():
    with pytest.raises(TypeError, match="A Foreign cannot be kept"):
        packed(Foreign(), [])
    for name in ("subprocess:Popen", "cartpend_dae.discover.store:store_for"):
        with pytest.raises(TypeError, match="no record of this package"):
            unpacked({"record": name, "parts": {}}, {})


def test_another_study_or_guess_is_another_stage(tmp_path):
    one = store_for(setup(), tmp_path)
    other = store_for(noisy_setup(clean_run(COULOMB), 5), tmp_path)
    assert one.study != other.study
    assert one.recall("fit", (1.0,), lambda: 1) == 1
    assert one.recall("fit", (1.0,), lambda: 2) == 1
    assert other.recall("fit", (1.0,), lambda: 3) == 3
    assert one.recall("fit", (np.nextafter(1.0, 2),), lambda: 4) == 4
    assert Store().recall("fit", (1.0,), lambda: 5) == 5


def test_the_command_keeps_stages_while_it_is_interrupted_and_resumes(tmp_path, monkeypatch):
    study = make_demo(tmp_path)
    listing = ", ".join(f'"{name}"' for name in FEW)
    study.write_text(study.read_text("utf-8") + f"\n[discover]\ninclude = [{listing}]\n", "utf-8")
    real, asked = fleet.discover_study, []

    def interrupted(opened, *, report, **options):
        def late(stage, label, error):
            report(stage, label, error)
            if "fit at 0 " in f"{stage} ":
                raise KilledError

        return real(opened, report=late if not asked else report, **options)

    monkeypatch.setattr(fleet, "discover_study", interrupted)
    out = tmp_path / "out"
    with pytest.raises(KilledError):
        CliRunner().invoke(cli.app, ["discover", str(study), "--out", str(out)], catch_exceptions=False)
    asked.append(1)
    assert [path.name for path in out.iterdir()] == ["stages"]
    resumed = CliRunner().invoke(cli.app, ["discover", str(study), "--out", str(out), "--resume"])
    assert resumed.exit_code == 0, resumed.output
    assert not (out / "stages").exists()
    fresh = CliRunner().invoke(cli.app, ["discover", str(study), "--out", str(tmp_path / "fresh")])
    assert fresh.exit_code == 0, fresh.output
    one, other = (json.loads((folder / "result.json").read_text("utf-8")) for folder in (out, tmp_path / "fresh"))
    del one["seconds"], other["seconds"]
    assert one == other
