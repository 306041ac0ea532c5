"""Estimation problems whose answers are known: a mass pushed by a constant force, and a pendulum that sticks."""

import independent
import numpy as np

from cartpend_dae import Component, Statements, assemble, connect, initial
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.library import rotational, translational, translational_sources
from cartpend_dae.problem import free_parameter, make_problem

FORCE, SD = 0.8, 0.01


class Pushed(Component):
    """A mass of 2 kg pushed by a constant force, s = s_0 + f t^2/4: linear in what is estimated."""

    def __post_init__(self) -> None:
        self.push, self.mass = translational_sources.ConstantForce(f_constant=FORCE), translational.Mass(m=2.0, L=0.1)

    def equations(self) -> Statements:
        yield connect(self.push.flange, self.mass.flange_a)
        yield initial(self.mass.s == 0.0)
        yield initial(self.mass.v == 0.0)


def pushed(noise, *, free_start=True, **options):
    """Return the problem of force and start position, and its exact regressors, shape (n, 2)."""
    time = np.arange(noise.size) / 100
    regressors = np.column_stack([time**2 / 4, np.ones(time.size)])
    values = regressors @ [FORCE, 0.3] + noise
    start = {"mass.s": Start(0.3, free_start), "mass.v": Start(0.0, False)}
    run = Experiment("run", "train", time, {}, {"mass.s": Channel(values, "zoh", SD, "m", 0.0)}, start, "free", None)
    system = assemble(Pushed())
    free = (free_parameter(system, "push.f_constant", guess=0.5, **options),)
    return make_problem(system, free, (run,)), regressors


class Dry(Component):
    """A rod in a bearing with dry and viscous friction."""

    def __post_init__(self) -> None:
        self.ground, self.bearing = rotational.Fixed(), rotational.BearingFriction(d=0.01, tau_c=0.015)
        self.rod = rotational.SlenderRod(m=0.1719, l=0.86, g=9.81)

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.flange)


def stuck_pendulum(seed=0):
    """Return the problem of a pendulum that comes to rest after 7 s of 9, with noise of 1 mrad."""
    time, angle = independent.pendulum(
        duration=9.0,
        angle=-0.7,
        viscous=0.01,
        coulomb=0.015,
        noise=1e-3,
        generator=np.random.default_rng(seed),
        step=1e-3,
    )
    start = {"bearing.phi": Start(-0.7, True), "bearing.w": Start(0.0, False)}
    channel = Channel(angle, "zoh", 1e-3, "rad", 0.0)
    run = Experiment("run", "train", time, {}, {"bearing.phi": channel}, start, "free", None)
    system = assemble(Dry())
    free = (
        free_parameter(system, "bearing.d", guess=0.02, lower=0.0),
        free_parameter(system, "bearing.tau_c", guess=0.008, lower=0.0),
    )
    return make_problem(system, free, (run,))
