"""Foreign FMUs as components, beside native ones: the same as the model composed of native components alone."""

import casadi as ca
import foreign_fmus
import numpy as np
import pytest

from cartpend_dae import (
    Component,
    Param,
    Statements,
    assign,
    connect,
    der,
    discrete,
    dry_friction,
    if_else,
    initial,
    param,
    reinit,
    sample,
    signal,
    simulate,
    var,
    when,
)
from cartpend_dae.errors import ModelError
from cartpend_dae.fmi.calibrate import MeasuredRun, identify_with_fmus
from cartpend_dae.fmi.component import fmu_component
from cartpend_dae.fmi.joint import simulate_with_fmus


class NativeHopper(Component):
    """The model of `foreign/hopper.c`, with signals."""

    s = signal("out", unit="m")
    x = var(unit="m")
    v = var(unit="m/s")
    f = signal("in", unit="N", default=0.0)
    m: Param = param(unit="kg", default=2.0)
    k: Param = param(unit="N/m", default=8.0)
    d: Param = param(unit="N.s/m", default=0.5)
    e: Param = param(unit="1", default=0.7)
    l: Param = param(unit="m", default=0.2)  # noqa: E741 (the name in the FMU)

    def equations(self) -> Statements:
        yield self.s == self.x
        yield der(self.x) == self.v
        yield self.m * der(self.v) == self.f - self.d * self.v - self.k * (self.x - self.l)
        yield initial(self.x == 1)
        yield initial(self.v == 0)
        yield when(self.x < 0, reinit(self.v, -self.e * self.v))


class NativeLag(Component):
    """The model of `foreign_fmus.build_lag`."""

    u = signal("in", unit="1")
    y = signal("out", unit="1")
    x = var(unit="1")
    T: Param = param(unit="s", default=0.4)
    k: Param = param(unit="1", default=2.0)

    def equations(self) -> Statements:
        yield self.T * der(self.x) == self.k * self.u - self.x
        yield self.y == self.x**2 + self.x
        yield initial(self.x == 0)


class Limited(Component):
    """A lag with a limit: events of the native side."""

    s = signal("in", unit="m")
    f = signal("out", unit="N")
    q = var(unit="N")
    k: Param = param(unit="N/m", default=3.0)
    T: Param = param(unit="s", default=0.2)
    lim: Param = param(unit="N", default=1.0)

    def equations(self) -> Statements:
        yield self.T * der(self.q) == -self.k * self.s - self.q
        yield self.f == if_else(self.q > self.lim, self.lim, if_else(self.q < -self.lim, -self.lim, self.q))


class Sampled(Component):
    """A sampled controller with a stuck part beside it: clocks, memory and dry friction on the native side."""

    s = signal("in", unit="m")
    f = signal("out", unit="N")
    held = discrete(unit="N")
    w = var(unit="m/s")
    k: Param = param(unit="N/m", default=3.0)
    m: Param = param(unit="kg", default=1.0)
    level: Param = param(unit="N", default=0.8)

    def equations(self) -> Statements:
        yield when(sample(0.13, 0.0537), assign(self.held, -self.k * self.s))
        yield self.m * der(self.w) == self.held - dry_friction(self.w, self.level)
        yield self.f == self.held
        yield initial(self.w == 0)


class Direct(Component):
    """An answer at once: with an FMU that answers at once it makes an algebraic loop."""

    s = signal("in", unit="1")
    f = signal("out", unit="1")

    def equations(self) -> Statements:
        yield self.f == 1 - 0.2 * self.s - 0.05 * ca.tanh(self.s)


def loop(plant, controller, output="s", command="f"):
    class Loop(Component):
        def __post_init__(self):
            self.plant, self.ctl = plant, controller

        def equations(self):
            yield connect(getattr(self.plant, output), self.ctl.s)
            yield connect(self.ctl.f, getattr(self.plant, command))

    return Loop()


@pytest.fixture(scope="module")
def hopper(tmp_path_factory):
    return fmu_component(foreign_fmus.build_hopper(tmp_path_factory.mktemp("hopper")))


@pytest.fixture(scope="module")
def lag(tmp_path_factory):
    return fmu_component(foreign_fmus.build_lag(tmp_path_factory.mktemp("lag")))


def test_a_component_has_the_names_and_values_of_its_fmu(hopper):
    part = hopper(d=0.3)
    assert isinstance(part, Component)
    assert type(part).s.declaration.unit == "m" and type(part).k.declaration.default == 8.0
    with pytest.raises(TypeError, match="stiffness"):
        hopper(stiffness=1.0)


@pytest.mark.parametrize("controller", [Limited, Sampled])
def test_events_of_both_sides_are_located(hopper, controller):
    """FMI 2.0: bounces inside the FMU, limits, clocks and sticking outside."""
    joint = simulate_with_fmus(loop(hopper(d=0.3), controller()), 3.0, points=301)
    alone = simulate(loop(NativeHopper(d=0.3), controller()), 3.0, points=301)
    assert joint["plant.bounces"][-1] >= 1
    for name, limit in {"plant.s": 1e-6, "plant.v": 1e-5, "ctl.f": 1e-5}.items():
        assert np.abs(joint[name] - alone[name]).max() < limit, name


def test_an_fmu_3_beside_native_dynamics(lag):
    class Slow(Component):
        s = signal("in", unit="1")
        f = signal("out", unit="1")
        q = var(unit="1")
        T = param(unit="s", default=0.7)

        def equations(self):
            yield self.T * der(self.q) == 1 - self.s - self.q
            yield self.f == self.q

    joint = simulate_with_fmus(loop(lag(T=0.3), Slow(), "y", "u"), 3.0)
    alone = simulate(loop(NativeLag(T=0.3), Slow(), "y", "u"), 3.0, start={"plant.x": joint["plant.x"][0]})
    assert np.abs(joint["plant.y"] - alone["plant.y"]).max() < 1e-6
    assert np.abs(joint["ctl.q"] - alone["ctl.q"]).max() < 1e-6


def test_an_algebraic_equation_through_the_signals_is_solved(lag):
    joint = simulate_with_fmus(loop(lag(), Direct(), "y", "u"), 2.0)
    y = joint["plant.y"]
    assert np.abs(joint["plant.u"] - (1 - 0.2 * y - 0.05 * np.tanh(y))).max() < 1e-9
    alone = simulate(loop(NativeLag(), Direct(), "y", "u"), 2.0, start={"plant.x": joint["plant.x"][0]})
    assert np.abs(y - alone["plant.y"]).max() < 1e-6


def test_two_fmus_in_one_model(hopper, lag):
    class Two(Component):
        command = signal("in", unit="1")
        force = param(unit="N", default=2.0)

        def __post_init__(self):
            self.hop, self.lag, self.scale = hopper(), lag(), Scale(k=self.force)

        def equations(self):
            yield connect(self.command, self.lag.u)
            yield connect(self.lag.y, self.scale.u)
            yield connect(self.scale.y, self.hop.f)

    class Scale(Component):
        u = signal("in", unit="1")
        y = signal("out", unit="N")
        k: Param = param(unit="N")

        def equations(self):
            yield self.y == self.k * self.u

    inputs = {"command": ([0.0, 0.5, 1.0], [0.2, -0.3, 0.1], "zoh")}
    joint = simulate_with_fmus(Two(), 2.0, inputs=inputs, start={"hop.s": 0.8}, parameters={"hop.d": 0.9})
    lagged = joint["lag.y"]
    assert joint["hop.s"][0] == 0.8 and joint["hop.d"][-1] == 0.9
    alone = simulate(NativeHopper(d=0.9), 2.0, inputs={"f": (joint.time, 2 * lagged)}, start={"x": 0.8})
    assert np.abs(joint["hop.s"] - alone["s"]).max() < 1e-4  # the force is interpolated between 501 points


def test_a_model_without_fmu_and_one_with_it_in_simulate(hopper):
    with pytest.raises(ModelError, match="use `simulate`"):
        simulate_with_fmus(NativeHopper(), 1.0)
    with pytest.raises(ModelError, match="of the FMU"):
        simulate(loop(hopper(), Limited()), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("force", [0.0, 6.0], ids=["bounces", "smooth"])
def test_parameters_of_an_fmu_are_identified(hopper, force):
    """Of exact data the parameters come back, through bounces too; the fixed one by runs made anew."""
    model = loop(hopper(), Limited(lim=0.5))
    if force:
        model.ctl.lim = 1e6
    truth = {"plant.k": 9.0, "plant.d": 0.35, "plant.m": 1.8}
    start = {"plant.s": 0.3, "plant.v": -2.0} if not force else {"plant.s": 0.5}
    times = np.linspace(0.0, 0.8, 41)
    data = simulate_with_fmus(model, times=times, parameters=truth, start=start)
    noise = np.random.default_rng(1).normal(0.0, 1e-4, times.size)
    run = MeasuredRun(times, {"plant.s": data["plant.s"] + noise}, start=start)
    fit = identify_with_fmus(model, [run], {"plant.k": 8.0, "plant.d": 0.5}, parameters={"plant.m": 1.8})
    for name in ("plant.k", "plant.d"):
        assert abs(fit.values[name] - truth[name]) < 4 * fit.sd[name], (name, fit)
        assert fit.sd[name] < 0.02 * truth[name]
    assert fit.residual_sd["plant.s"] == pytest.approx(1e-4, rel=0.3)
    assert fit.derivatives == ("directional" if force else "differences")
