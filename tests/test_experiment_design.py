"""Experiment design against closed forms: what an integrator's output says of its gain, and of a drift beside it."""

import inspect
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from cartpend_dae import Component, ModelError, Statements, assemble, cli, der, initial, param, signal, var
from cartpend_dae.experiment_design import Plan, candidates, nothing_known, rank
from cartpend_dae.language import Param
from cartpend_dae.problem import free_parameter

SD = 0.1


class Integrator(Component):
    """der(y) = k u + b."""

    u = signal("in", unit="1")
    y = var(unit="1")
    k: Param = param(unit="1/s", default=2.0)
    b: Param = param(unit="1/s", default=1.0)

    def equations(self) -> Statements:
        yield der(self.y) == self.k * self.u + self.b
        yield initial(self.y == 0)


def plan(**more):
    return Plan({"u": 4.0}, {"y": SD}, 5.0, 20.0, 0.4, 2.0, **more)


def known(*names):
    system = assemble(Integrator())
    free = tuple(free_parameter(system, name) for name in names)
    return system, nothing_known(free, {item.name: item.guess for item in free})


def regressor(run):
    """The output's slope in k: the integral of the held input."""
    values = run.inputs["u"].values
    return np.concatenate([[0.0], np.cumsum(values[:-1])]) / 20.0


def test_one_parameter_is_as_sure_as_the_energy_of_its_regressor_says():
    system, before = known("k")
    ranking = rank(system, before, plan())
    expected = {run.name: SD / np.linalg.norm(regressor(run)) / 2.0 for run in candidates(system, plan())}
    assert [c.name for c in ranking.candidates] == sorted(expected, key=lambda name: expected[name])
    for candidate in ranking.candidates:
        assert candidate.d == pytest.approx(expected[candidate.name], rel=1e-9)
        assert candidate.e == pytest.approx(candidate.d, rel=1e-12)
    # twice the amplitude is half the standard deviation
    by_name = {c.name: c.d for c in ranking.candidates}
    assert by_name["steps of u, 2 1"] == pytest.approx(2 * by_name["steps of u, 4 1"], rel=1e-9)
    assert np.isinf(ranking.before.d)


def test_two_parameters_have_the_axes_of_the_ellipse():
    system, before = known("k", "b")
    ranking = rank(system, before, plan())
    for run in candidates(system, plan()):
        x = np.column_stack([2.0 * regressor(run), run.time]) / SD
        axes = np.sqrt(np.linalg.eigvalsh(np.linalg.inv(x.T @ x)))
        found = next(c for c in ranking.candidates if c.name == run.name)
        assert found.d == pytest.approx(np.sqrt(axes[0] * axes[1]), rel=1e-8)
        assert found.e == pytest.approx(axes[1], rel=1e-8)
    assert ranking.best_by_e in {c.name for c in ranking.candidates}


def test_a_start_that_is_not_known_is_taken_out():
    system, before = known("k")
    ranking = rank(system, before, plan(free_starts=("y",)))
    for run in candidates(system, plan()):
        slope = regressor(run)
        found = next(c for c in ranking.candidates if c.name == run.name)
        assert found.d == pytest.approx(SD / np.linalg.norm(slope - slope.mean()) / 2.0, rel=1e-6)


def test_only_the_weak_parameters_count():
    system, before = known("k", "b")
    ranking = rank(system, before, plan(), weak=["b"])
    assert ranking.weak == ("b",)
    with pytest.raises(ModelError, match=r"`c` is not estimated.*`k`, `b`"):
        rank(system, before, plan(), weak=["c"])


def test_a_limit_of_what_is_no_input_is_refused():
    system, before = known("k")
    with pytest.raises(
        ModelError, match=r"`design\.max` names `x`; expected an input or a state of the model: `u`, `y`"
    ):
        rank(system, before, Plan({"x": 1.0}, {"y": SD}, 5.0, 20.0, 0.4, 2.0))


def test_inputs_stay_within_their_limits_and_follow_from_the_seed():
    system = assemble(Integrator())
    runs, same, other = (candidates(system, plan(seed=seed)) for seed in (0, 0, 1))
    assert len(runs) == 8
    for run in runs:
        assert np.abs(run.inputs["u"].values).max() <= 4.0 * (1 + 1e-12)
    assert all(np.array_equal(a.inputs["u"].values, b.inputs["u"].values) for a, b in zip(runs, same, strict=True))
    assert any(not np.array_equal(a.inputs["u"].values, b.inputs["u"].values) for a, b in zip(runs, other, strict=True))


STUDY = """
[model]
path = "model.py"
[parameters.k]
[parameters.b]
[design]
max = { u = 4.0 }
duration = 5.0
sample_rate = 20.0
noise = { y = 0.1 }
"""


def test_the_command_ranks_at_the_guesses_without_runs(tmp_path):
    source = "from cartpend_dae import Component, Param, Statements, der, initial, param, signal, var\n\n\n"
    (tmp_path / "model.py").write_text(source + inspect.getsource(Integrator))
    (tmp_path / "study.toml").write_text(STUDY)
    command = ["design", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(cli.app, command)
    assert done.exit_code == 0, done.output
    result = json.loads((tmp_path / "out" / "design.json").read_text())
    assert result["weak"] == ["k", "b"] and len(result["candidates"]) == 8
    assert f"best by the volume of confidence (D) is: {result['candidates'][0]['name']}" in done.output
    (tmp_path / "study.toml").write_text(STUDY.replace("noise = { y = 0.1 }", ""))
    done = CliRunner().invoke(cli.app, command)
    assert done.exit_code == 2 and "needs `noise" in done.output
