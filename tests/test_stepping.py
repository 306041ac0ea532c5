"""Algebraic variables in the steps of estimation are those of the equations, wherever the step before left them."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from cartpend_dae import Component, Param, Statements, connect, der, dry_friction, param, signal, var
from cartpend_dae.assemble import assemble
from cartpend_dae.library.laws import breakaway_level
from cartpend_dae.library.rotational import Inertia, Torque
from cartpend_dae.library.rotational_links import GearLoss
from cartpend_dae.stepping import runge_kutta


class Brushes(Component):
    """A resistor and brushes on a voltage that grows with the input: R i + V tanh(i/i_b) = v."""

    u = signal("in", unit="V/s")
    v = var(unit="V", start=0.0)
    i = var(unit="A", start=0.0)
    R: Param = param(unit="Ohm", default=0.86)
    V: Param = param(unit="V", default=0.5)
    i_b: Param = param(unit="A", default=0.25)

    def equations(self) -> Statements:
        yield der(self.v) == self.u
        yield self.R * self.i + self.V * ca.tanh(self.i / self.i_b) == self.v


def current(v):
    return brentq(lambda i: 0.86 * i + 0.5 * np.tanh(i / 0.25) - v, -20, 20, xtol=1e-14)


@pytest.mark.parametrize("v", [-0.9, -0.3, -0.05, 0.0, 0.1, 0.45, 0.55, 2.0])
@pytest.mark.parametrize("guess", [-4.0, -0.5, 0.0, 0.5, 4.0])
def test_a_current_that_passes_zero_in_a_sharp_law_is_found_with_its_slope(v, guess):
    system = assemble(Brushes())
    assert (system.x.numel(), system.z.numel()) == (1, 1)
    state, p = ca.SX.sym("state", 2), [q.value for q in system.parameters]
    z = runge_kutta(system).algebraic(0.0, 0.01, state, 0.0, p)
    both = ca.Function("both", [state], [z, ca.jacobian(z, state)])
    found, slope = (np.array(one).ravel() for one in both([v, guess]))
    exact = current(v)
    assert found[0] == pytest.approx(exact, rel=1e-9, abs=1e-9)
    assert slope == pytest.approx([1 / (0.86 + 0.5 / 0.25 / np.cosh(exact / 0.25) ** 2), 0.0], rel=1e-6, abs=1e-6)


class Pulled(Component):
    """A block at rest on dry ground, pulled by a force: m v' = f - friction, f_c while it slides and f_s at rest."""

    f = signal("in", unit="N")
    v = var(unit="m/s", start=0.0)
    m: Param = param(unit="kg", default=2.0)
    f_c: Param = param(unit="N", default=1.0)
    f_s: Param = param(unit="N", default=3.0)
    v_s: Param = param(unit="m/s", default=1e-4)

    def equations(self) -> Statements:
        level = breakaway_level(self.v, self.f_c, self.f_s, self.v_s)
        yield self.m * der(self.v) == self.f - dry_friction(self.v, level, static=self.f_s)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("ends", [(0.0, 4.0), (2.5, 3.1), (0.0, 30.0)])
def test_a_block_breaks_away_at_the_moment_within_a_step_when_the_force_passes_its_peak(way, ends):
    """Its speed at the end of one step is that of the closed form, m v = int (f - f_c) dt from that moment on."""
    system, h = assemble(Pulled()), 0.1
    p = [q.value for q in system.parameters]
    found = float(runge_kutta(system).function(0.0, h, [0.0], way * ends[0], way * ends[1], p))
    begin = h * (3.0 - ends[0]) / (ends[1] - ends[0])
    exact = ((3.0 + ends[1]) / 2 - 1.0) * (h - begin) / 2.0
    assert found == pytest.approx(way * exact, rel=1e-6)


def test_a_block_that_is_pulled_with_less_than_its_peak_stays_at_rest():
    system = assemble(Pulled())
    step, p = runge_kutta(system).function, [q.value for q in system.parameters]
    assert [float(step(0.0, 0.1, [0.0], 2.9 * a, 2.9 * b, p)) for a, b in ((0, 1), (1, 0), (-1, 1))] == [0.0] * 3


class Wound(Component):
    """A wheel behind gears that lose a share of what drives them, J w' = tau - loss."""

    tau = signal("in", unit="N.m")

    def __post_init__(self) -> None:
        self.source, self.gears, self.wheel = Torque(), GearLoss(e=0.25), Inertia(J=2.0)

    def equations(self) -> Statements:
        yield connect(self.tau, self.source.tau)
        yield connect(self.source.flange, self.gears.flange_b)
        yield connect(self.gears.flange_a, self.wheel.flange_a)


def test_a_lossy_gear_that_turns_back_within_a_step_loses_what_it_loses_each_way():
    """Driven back it loses e/(1 - e) of the torque until it stops, and then e; it had lost the first to the end."""
    system, h, torque, speed = assemble(Wound()), 0.1, -6.0, 0.2
    start = [{"w": speed, "y": torque}.get(name.rpartition(".")[2], 0.0) for name in system.states]
    ends = runge_kutta(system).function(0.0, h, start, torque, torque, [q.value for q in system.parameters])
    found = dict(zip(system.states, np.array(ends).ravel(), strict=True))
    stop = speed / (6.0 / 0.75 / 2.0)
    assert 0 < stop < h
    assert found["gears.w"] == pytest.approx(-6.0 * 0.75 / 2.0 * (h - stop), rel=1e-6)
