"""A recorder whose clock runs wrong: the time of the model passes at another rate than that of its simulation."""

import numpy as np
import pytest

from cartpend_dae import (
    Component,
    ModelError,
    Param,
    Statements,
    assemble,
    clock_rate,
    der,
    export_fmu,
    param,
    simulate,
    time,
    var,
)
from cartpend_dae.flatten import flatten
from cartpend_dae.transcribe import injection_targets

TIMES = np.linspace(0.0, 2.0, 41)


class Clocked(Component):
    """A mass on a spring with a played force and dry friction, in the time of a recorder."""

    e: Param = param(unit="1", default=0.0, doc="error of the clock")
    k: Param = param(unit="1/s2", default=9.0, doc="stiffness over mass")
    d: Param = param(unit="1/s", default=0.2, doc="damping over mass")
    a: Param = param(unit="m/s3", default=1.0, doc="rate of a force over mass")
    x = var(unit="m", doc="position")
    v = var(unit="m/s", doc="speed")

    def __init__(self, e: float = 0.0, factors: int = 1):
        super().__init__(e=e)
        self.factors = factors

    def equations(self) -> Statements:
        for _ in range(self.factors):
            clock_rate((1 + self.e) ** (1 / self.factors))
        yield self.v == der(self.x)
        yield der(der(self.x)) == -self.k * self.x - self.d * self.v + self.a * time()


@pytest.mark.parametrize("factors", [1, 2])
def test_derivatives_of_any_order_and_time_pass_at_the_rate(factors):
    start = {"x": 1.0, "v": 0.0}
    plain = simulate(Clocked(), times=1.2 * TIMES, start=start)
    run = simulate(Clocked(0.2, factors), times=TIMES, start=start)
    np.testing.assert_allclose(run["x"], plain["x"], atol=1e-7)
    np.testing.assert_allclose(run["v"], plain["v"], atol=1e-7)


def test_a_model_without_a_wrong_clock_stays_as_it_is():
    class Plain(Component):
        T: Param = param(unit="s", default=1.0, doc="time constant")
        x = var(unit="m", doc="position")

        def equations(self) -> Statements:
            yield self.T * der(self.x) == -self.x

    assert flatten(Plain()).groups
    run = simulate(Plain(), 1.0, start={"x": 1.0})
    assert abs(run["x"][-1] - np.exp(-1.0)) < 1e-7


def test_a_rate_follows_from_parameters_and_is_positive():
    class Moving(Component):
        x = var(unit="s", doc="state")

        def equations(self) -> Statements:
            clock_rate(self.x)
            yield der(self.x) == -1.0

    class Backward(Component):
        x = var(unit="s", doc="state")

        def equations(self) -> Statements:
            clock_rate(-1.0)
            yield der(self.x) == -1.0

    with pytest.raises(ModelError, match="make it a number or an expression of parameters"):
        flatten(Moving())
    with pytest.raises(ModelError, match="lets time stand or run backward"):
        flatten(Backward())
    with pytest.raises(ModelError, match="`clock_rate` has a meaning inside `equations` only"):
        clock_rate(1.0)


def test_an_fmu_has_the_clock_as_a_parameter(tmp_path):
    import fmpy

    file = export_fmu(Clocked(0.2), tmp_path / "clocked.fmu")
    start = {"x": 1.0}
    plain = simulate(Clocked(), times=1.2 * TIMES, start=start | {"v": 0.0})
    run = fmpy.simulate_fmu(str(file), stop_time=2.0, output_interval=0.05, start_values=start, output=["x"])
    np.testing.assert_allclose(np.interp(TIMES, run["time"], run["x"]), plain["x"], atol=1e-3)


@pytest.mark.parametrize("e", [0.0, 0.2])
def test_a_measured_position_still_corrects_its_speed(e):
    targets = injection_targets(assemble(Clocked(e)), (assemble(Clocked(e)).index_of("x"),))
    ((_, state, rate, _),) = targets
    assert rate is not None and rate != state
