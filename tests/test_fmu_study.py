"""`cartpend identify` of a study whose model has a foreign FMU in it: parameters and starts of both sides are found."""

import json
from pathlib import Path

import foreign_fmus
import numpy as np
import pytest
from typer.testing import CliRunner

from cartpend_dae.cli import app
from cartpend_dae.fmi.joint import simulate_with_fmus
from cartpend_dae.study import load_model, model_reference

MODEL = '''
from pathlib import Path

from cartpend_dae import Component, Param, Statements, connect, der, param, signal, var
from cartpend_dae.fmi.component import fmu_component

Hopper = fmu_component(Path(__file__).parent / "hopper.fmu")


class Actuator(Component):
    """A force that lags behind its command, and falls with the length."""

    u = signal("in", unit="N")
    s = signal("in", unit="m")
    f = signal("out", unit="N")
    q = var(unit="N")
    T: Param = param(unit="s", min=0, default=0.2)
    k: Param = param(unit="N/m", default=1.0)

    def equations(self) -> Statements:
        yield self.T * der(self.q) == self.u - self.q
        yield self.f == self.q - self.k * self.s


class Rig(Component):
    u = signal("in", unit="N")

    def __post_init__(self) -> None:
        self.plant, self.actuator = Hopper(m=1.8), Actuator()

    def equations(self) -> Statements:
        yield connect(self.u, self.actuator.u)
        yield connect(self.plant.s, self.actuator.s)
        yield connect(self.actuator.f, self.plant.f)
'''

STUDY = """
[model]
path = "rig.py"
name = "Rig"

{free}

[[experiment]]
name = "push"
file = "push.csv"
role = "train"
time = {{ column = "t", unit = "s" }}
inputs = {{ "u" = {{ column = "u", unit = "N", hold = "zoh" }} }}
outputs = {{ "plant.s" = {{ column = "s", unit = "mm" }} }}
start = {{ "plant.s" = {{ guess = 480, unit = "mm" }}, "plant.v" = {{ value = {v} }} }}

[[experiment]]
name = "again"
file = "again.csv"
role = "test"
time = {{ column = "t", unit = "s" }}
inputs = {{ "u" = {{ column = "u", unit = "N", hold = "zoh" }} }}
outputs = {{ "plant.s" = {{ column = "s", unit = "mm" }} }}
start = {{ "plant.s" = {{ {again}, unit = "mm" }}, "plant.v" = {{ value = {v} }} }}
"""
FREE = """
[parameters."plant.k"]
guess = 8.0
min = 1.0
[parameters."plant.d"]
guess = 0.5
[parameters."actuator.T"]
guess = 0.2
"""
BOUNDED = """
[parameters."actuator.T"]
guess = 0.2
max = 0.29
"""
TRUTH = {"plant.k": 9.0, "plant.d": 0.35, "actuator.T": 0.3}
NOISE = 1e-4


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    foreign_fmus.build_hopper(folder)
    (folder / "rig.py").write_text(MODEL)
    return folder


def write_study(
    folder: Path, *, force: float, v: float = 0.0, free: str = FREE, again: str = "value = 500", more: str = ""
) -> Path:
    """Write two runs with a force that jumps about a level, and the study of both."""
    model = load_model(model_reference(f"{folder / 'rig.py'}:Rig"))
    generator = np.random.default_rng(4)
    times = np.linspace(0.0, 1.5, 61)
    for name, amplitude in (("push", 2.0), ("again", -1.5)):
        u = force + amplitude * np.sign(np.sin(6 * times + 0.1))
        inputs = {"u": (times, u, "zoh")}
        start = {"plant.s": 0.5, "plant.v": v}
        run = simulate_with_fmus(model, times=times, inputs=inputs, parameters=TRUTH, start=start)
        s = run["plant.s"] + generator.normal(0.0, NOISE, times.size)
        table = np.column_stack([times, u, 1e3 * s])
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header="t,u,s", comments="")
    path = folder / "study.toml"
    path.write_text(STUDY.format(v=v, free=free, again=again) + more)
    return path


def identified(path: Path, out: Path) -> dict:
    done = CliRunner().invoke(app, ["identify", str(path), "--out", str(out)])
    assert done.exit_code == 0, done.output
    return json.loads((out / "result.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("force, v", [(6.0, 0.0), (-1.0, -2.0)], ids=["smooth", "bounces"])
def test_parameters_of_the_fmu_and_of_native_parts_are_found(rig, tmp_path, force, v):
    """With the derivatives of the FMU where it does not bounce, by runs made anew where it does."""
    free = FREE if not v else FREE.replace("guess = 0.2", "guess = 0.3\nfixed = true")
    result = identified(write_study(rig, force=force, v=v, free=free), tmp_path / "out")
    assert result["command"] == "identify" and result["schema"] == 1
    found = result["final"]["parameters"]
    assert set(found) == set(TRUTH) and (found["actuator.T"]["status"] == "fixed") == bool(v)
    for name, entry in found.items():
        if entry["status"] == "fixed":
            continue
        assert entry["status"] == "ok" and abs(entry["value"] - TRUTH[name]) < 4 * entry["sd"], (name, entry)
        assert entry["sd"] < 0.1 * TRUTH[name]
    for name, role in (("push", "train"), ("again", "test")):
        run = result["final"]["experiments"][name]
        assert run["role"] == role
        assert run["outputs"]["plant.s"]["rmse"] == pytest.approx(NOISE, rel=0.4)  # 61 samples: 9 % of scatter, 3 sd
    assert ("directional" if not v else "differences") in " ".join(result["notes"])
    assert (tmp_path / "out" / "push.csv").exists() and "plant.k" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.slow
def test_what_stands_on_its_bound_is_said_to(rig, tmp_path):
    """A start of a run that is not fitted is found on its first samples alone."""
    path = write_study(rig, force=6.0, free=BOUNDED, again="guess = 480")
    result = identified(path, tmp_path / "out")
    found = result["final"]["parameters"]["actuator.T"]
    assert (found["status"], found["value"]) == ("at-bound", pytest.approx(0.29))
    again = np.genfromtxt(tmp_path / "out" / "again.csv", delimiter=",", names=True, deletechars="")
    assert again["plant.s.model"][0] == pytest.approx(0.5, abs=1e-2)  # by stiffness and damping that are wrong


@pytest.mark.parametrize(
    ("command", "more", "sentence"),
    [
        ("discover", "", "only `cartpend identify`"),
        ("data", "", "only `cartpend identify`"),
        ("identify", "[identify]\nstarts = 3\n", "several starts cannot be used"),
    ],
)
def test_what_cannot_be_done_with_fmus_is_a_sentence(rig, command, more, sentence):
    path = write_study(rig, force=6.0, more=more)
    done = CliRunner().invoke(app, [command, str(path)])
    assert done.exit_code == 2 and sentence in " ".join(done.output.split())
