"""The start on the command line: what determines it, a rest, and parameters that it determines."""

import pandas as pd
import pytest
from typer.testing import CliRunner

from cartpend_dae.cli import app

MODEL = """
from cartpend_dae import Component, Param, der, param, var


class Hung(Component):
    s = var(unit="m", start=0.1)
    v = var(unit="m/s")
    m: Param = param(unit="kg", default=2.0)
    c: Param = param(unit="N/m", default=50.0)
    g: Param = param(unit="m/s2", default=10.0)

    def equations(self):
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.m * self.g - self.c * self.s
"""


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "hung.py"
    path.write_text(MODEL, encoding="utf-8")
    return path


def run(*arguments) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.output


def test_check_says_what_the_start_assumes(model):
    lines = run("check", model).splitlines()
    at = lines.index("start, with inputs at rest (3):")
    assert lines[at + 1 : at + 4] == [
        "  `s` = 0.1 m: start of `s` (guess)",
        "  `v` = 0 m/s: zero by default",
        "  2 fixed initial equations are missing for full determination; assumed instead: start of `s` (guess), `v` "
        "zero by default",
    ]


def test_simulate_starts_at_rest(model, tmp_path):
    run("simulate", model, "--steady", "--stop", 1, "--out", tmp_path / "rest.csv")
    # m g / c, held to the default tolerances of the integrator
    assert pd.read_csv(tmp_path / "rest.csv")["s"].to_numpy() == pytest.approx(2.0 * 10.0 / 50.0, rel=1e-8)


def test_simulate_finds_a_parameter(model, tmp_path):
    out = tmp_path / "found.csv"
    run("simulate", model, "--steady", "--start", "s=0.5", "--unknown", "c=1", "--stop", 1, "--out", out)
    assert pd.read_csv(out)["c"].to_numpy() == pytest.approx(40.0, rel=1e-12)
