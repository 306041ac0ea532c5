"""Dry frictions on one motion, which share what holds it: no rounding of a speed decides who takes what."""

import casadi as ca
import numpy as np
import pytest

from cartpend_dae import (
    Component,
    Param,
    Statements,
    der,
    discrete,
    dry_friction,
    initial,
    param,
    signal,
    simulate,
    var,
)


class Held(Component):
    """A mass that a strong friction and, over a ratio, one with another level each way keep from moving."""

    ratio: Param = param(unit="1", doc="speed of the second over that of the mass")
    m: Param = param(unit="kg", default=2.0, doc="mass")
    f_strong: Param = param(unit="N", default=5.0, doc="level of the first")
    f_weak: Param = param(unit="N", default=1.0, doc="level of the second")
    s = var(unit="m", doc="position")
    v = var(unit="m/s", doc="speed")
    strong, weak = var(unit="N", doc="force of the first"), var(unit="N", doc="force of the second")
    mode = discrete(unit="1", doc="mode of the second")
    push = signal("in", unit="N", doc="force")

    def equations(self) -> Statements:
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.push - self.strong - self.ratio * self.weak
        yield self.strong == dry_friction(self.v, self.f_strong)
        yield self.weak == dry_friction(self.ratio * self.v, self.f_weak, 0.6 * self.f_weak, mode=self.mode)
        yield initial(self.s == 0)
        yield initial(self.v == 0)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("ratio", [1.0, -2.0])
def test_each_takes_an_equal_share_up_to_its_level(ratio, compiled):
    """Power counts: both do half of the work until one is at its level, forth and back, whatever came before."""
    run = simulate(Held(ratio=ratio), 20.0, points=2001, inputs={"push": lambda t: 4.8 * ca.sin(t)}, compile=compiled)
    assert np.abs(run["v"]).max() < 1e-12  # it is held to the last digits
    total = 4.8 * np.sin(run.time)
    weak = np.clip(total / (2 * ratio), -0.6, 1.0)
    np.testing.assert_allclose(run["weak"], weak, atol=1e-12)
    np.testing.assert_allclose(run["strong"], total - ratio * weak, atol=1e-12)
    inside = np.abs(total / (2 * ratio) - weak) < 1e-12
    assert np.all((run["mode"] == 0) == inside)
