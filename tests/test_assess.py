"""Errors of a model on a run: those of the model, not of the steps with which it is simulated."""

import casadi as ca
from test_identify import experiment_of

from cartpend_dae import Component, Param, Statements, assemble, der, initial, param, simulate, var
from cartpend_dae.assess import assess
from cartpend_dae.cuts import shorter
from cartpend_dae.data import Start
from cartpend_dae.identify import estimate
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.shooting import predict


class Wall(Component):
    """A mass that runs with damping into a wall of which nothing shows at its start."""

    x = var(unit="m")
    v = var(unit="m/s")
    a: Param = param(unit="m/s2", default=2.0)
    x_w: Param = param(unit="m", default=1.0)
    r: Param = param(unit="m", default=0.01, doc="depth from which the damper acts in full")
    T: Param = param(unit="s", default=1.0)
    k: Param = param(unit="rad/s", default=300.0)

    def equations(self) -> Statements:
        depth = ca.fmax(self.x - self.x_w, 0)
        yield self.v == der(self.x)
        yield der(self.v) == self.a - self.v / self.T - self.k**2 * depth - self.k * ca.fmin(1, depth / self.r) * self.v
        yield initial(self.x == 0)
        yield initial(self.v == 0)


def assessed():
    run = simulate(Wall(), 4.0, points=201, rtol=1e-9, atol=1e-12)
    experiment = experiment_of(run, {"x": "m"}, {"x": Start(0.0, False), "v": Start(0.0, False)}, noise=1e-6)
    system = assemble(Wall())
    fit = estimate(make_problem(system, (free_parameter(system, "T"),), (shorter(experiment, slice(0, 50)),)))
    return assess(system, fit, (experiment,)).runs[0].outputs["x"]


def test_a_run_into_a_stiff_wall_is_simulated_on_steps_that_can_follow_it(monkeypatch):
    """Steps that suit the start of a run are too long for what moves in the wall, and the simulation diverges there."""
    found = assessed()
    assert found.rmse < 1e-3
    assert found.nrmse < 1e-3
    monkeypatch.setattr("cartpend_dae.assess.HALVINGS", 0)
    assert not assessed().rmse < 1e3


def test_a_run_at_rest_is_simulated_once(monkeypatch):
    """What does not move has no spread that an error could be compared with."""
    run = simulate(Wall(), 1.0, points=101, parameters={"a": 0.0})
    experiment = experiment_of(run, {"x": "m"}, {"x": Start(0.0, False), "v": Start(0.0, False)})
    system = assemble(Wall())
    fit = estimate(make_problem(system, (free_parameter(system, "T"),), (experiment,)))
    calls = []

    def counted(problem, *rest, **named):
        calls.append(problem)
        return predict(problem, *rest, **named)

    monkeypatch.setattr("cartpend_dae.assess.predict", counted)
    found = assess(system, fit, (experiment,)).runs[0].outputs["x"]
    assert len(calls) == 1 and found.rmse > 1e-3
