"""Steps through the transients of held values, against CasADi's integrators with tight tolerances."""

import shutil

import casadi as ca
import numpy as np
import pytest

from cartpend_dae import (
    Component,
    Param,
    assemble,
    assign,
    der,
    discrete,
    dry_friction,
    initial,
    param,
    sample,
    simulate,
    time,
    var,
    when,
)
from cartpend_dae.native.run import Engine

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="There is no C compiler here."
)
PERIOD, STOP = 0.01, 2.0
STATES = ("i", "phi", "w", "e")


class Servo(Component):
    """A motor with a fast current moves a rod; its voltage is held between samples of a controller.

    L i' = u - R i - k w,  J w' = k i cos(phi) - d w - m sin(phi) - friction,  e' = phi - sin(omega t)
    """

    L: Param = param(unit="H", default=3e-4)
    R: Param = param(unit="Ohm", default=1.0)
    k: Param = param(unit="N.m/A", default=0.5)
    J: Param = param(unit="kg.m2", default=0.02)
    d: Param = param(unit="N.m.s/rad", default=0.02)
    m: Param = param(unit="N.m", default=0.8)
    tau_c: Param = param(unit="N.m", default=0.0)
    omega: Param = param(unit="rad/s", default=3.0, doc="of the set point")
    k_phi: Param = param(unit="V/rad", default=10.0)
    k_w: Param = param(unit="V.s/rad", default=0.5)
    k_e: Param = param(unit="V/(rad.s)", default=1.0)
    i = var(unit="A")
    phi = var(unit="rad")
    w = var(unit="rad/s")
    e = var(unit="rad.s")
    u = discrete(unit="V")

    def equations(self):
        error = self.phi - ca.sin(self.omega * time())
        control = -self.k_phi * error - self.k_w * self.w - self.k_e * self.e
        friction = dry_friction(self.w, self.tau_c) if self.rubs else 0
        yield self.L * der(self.i) == self.u - self.R * self.i - self.k * self.w
        yield der(self.phi) == self.w
        torque = self.k * self.i * ca.cos(self.phi) - self.d * self.w - self.m * ca.sin(self.phi)
        yield self.J * der(self.w) == torque - friction
        yield der(self.e) == error
        yield when(sample(PERIOD), assign(self.u, control))
        yield initial(self.phi == 0.5)
        yield initial(self.w == 0)
        yield initial(self.i == 0)
        yield initial(self.e == 0)

    rubs: bool = False


def states_of(result):
    return np.array([result[name] for name in STATES])


def grid(kind):
    """Output times at ticks, at ticks and between them, and at times that share none with them."""
    return {"ticks": np.linspace(0, STOP, 201), "tenths": np.linspace(0, STOP, 2001)}.get(
        kind, np.linspace(0, STOP, 287)
    )


@pytest.fixture
def runs(monkeypatch):
    """Return a list that all runs of the engine are added to."""
    found, run = [], Engine.run

    def kept(*arguments):
        found.append(run(*arguments))
        return found[-1]

    monkeypatch.setattr(Engine, "run", kept)
    return found


@pytest.mark.parametrize("kind", ["ticks", "tenths", "odd"])
@pytest.mark.parametrize("rubs", [False, True])
def test_leaps_are_as_right_as_steps(kind, rubs, runs):
    system = assemble(Servo(rubs=rubs, tau_c=0.05 if rubs else 0.0))
    times = grid(kind)
    truth = states_of(simulate(system, times=times, method="rosenbrock", rtol=1e-11, atol=1e-13))
    assert not runs
    for rtol in (1e-4, 1e-6, 1e-8):
        result = states_of(simulate(system, times=times, rtol=rtol, atol=rtol / 100, compile=True))
        scale = np.abs(truth).max(axis=1)
        assert (np.abs(result - truth).max(axis=1) <= 30 * rtol * scale).all()
        assert runs[-1].n_events >= STOP / PERIOD
    if kind == "ticks" and not rubs:
        assert runs[0].n_steps < 4 * STOP / PERIOD  # three leaps in a period, for the longest step is 4 ms


@pytest.mark.parametrize("seed", range(8))
def test_leaps_of_any_servo_are_right(seed, runs):
    rng = np.random.default_rng(seed)
    factors = {name: float(10 ** rng.uniform(-0.4, 0.4)) for name in ("L", "R", "k", "J", "d", "m")}
    defaults = {"L": 3e-4, "R": 1.0, "k": 0.5, "J": 0.02, "d": 0.02, "m": 0.8}
    system = assemble(Servo(**{name: defaults[name] * factor for name, factor in factors.items()}))
    times = grid("ticks")
    truth = states_of(simulate(system, times=times, method="rosenbrock", rtol=1e-11, atol=1e-13))
    result = states_of(simulate(system, times=times, rtol=1e-6, atol=1e-8, compile=True))
    assert (np.abs(result - truth).max(axis=1) <= 1e-5 * np.abs(truth).max(axis=1)).all()


def test_outputs_may_be_anywhere(runs):
    """What leaps reach does not depend on where outputs are."""
    system = assemble(Servo())
    coarse, fine = (
        simulate(system, times=np.linspace(0, STOP, n), rtol=1e-8, atol=1e-10, compile=True) for n in (3, 20001)
    )
    for name in STATES:
        np.testing.assert_allclose(coarse[name][-1], fine[name][-1], rtol=1e-6, atol=1e-7)
