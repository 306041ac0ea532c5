"""Why smoothed friction lies: ``python docs/smoothed_friction.py`` makes the picture and the table of that page.

A pendulum with a dry bearing is let go and comes to rest aside of its lowest point. Its angle, with the noise of an
encoder, is fitted with the friction that sticks and with tau_c tanh(w/w_s) for several widths w_s.
"""

from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

from cartpend_dae import Component, Param, assemble, connect, initial, param, simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.exact_form import finished
from cartpend_dae.identify import estimate
from cartpend_dae.library.rotational import BearingFriction, CompliantWithSpeed, Fixed, SlenderRod
from cartpend_dae.plots import AFTER, BEFORE, DPI, MEASURED
from cartpend_dae.problem import free_parameter, make_problem

HERE = Path(__file__).resolve().parent
TRUTH = {"bearing.d": 0.005, "bearing.tau_c": 0.030}
WIDTHS = (0.5, 0.2, 0.1, 0.05, 0.02)
TIMES = np.linspace(0.0, 10.0, 501)
NOISE = 1e-3


class SmoothBearing(CompliantWithSpeed):
    """Smoothed dry friction, tau = d w_rel + tau_c tanh(w_rel/w_s)."""

    d: Param = param(unit="N.m.s/rad", min=0, doc="viscous damping")
    tau_c: Param = param(unit="N.m", min=0, doc="Coulomb friction torque")
    w_s: Param = param(unit="rad/s", min=0, doc="speed at which it has three quarters of its level")

    def equations(self):
        yield from super().equations()
        yield self.tau == self.d * self.w_rel + self.tau_c * ca.tanh(self.w_rel / self.w_s)


class Pendulum(Component):
    """A rod let go at 0.5 rad; without a width its friction sticks."""

    width: float | None = None

    def __post_init__(self) -> None:
        self.ground, self.rod = Fixed(), SlenderRod(m=0.1719, l=0.86)
        d, tau_c = TRUTH.values()
        self.bearing = (
            BearingFriction(d=d, tau_c=tau_c) if self.width is None else SmoothBearing(d=d, tau_c=tau_c, w_s=self.width)
        )

    def equations(self):
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.flange)
        yield initial(self.bearing.flange_b.phi == 0.5)
        yield initial(self.rod.w == 0)


def angle(system, values, times=TIMES):
    """Return the angle of the rod [rad] for values of damping and dry friction."""
    return simulate(system, times=times, parameters=dict(zip(TRUTH, values, strict=True)), rtol=1e-8)["rod.phi"]


def fitted(system, measured):
    """Return the fit of the angle, with the estimation of this package for each kind of friction."""
    start = {"rod.phi": Start(0.5, False), "rod.w": Start(0.0, False)}
    channel = Channel(measured, "zoh", NOISE, "rad", 0.0)
    log = Experiment("release", "train", TIMES, {}, {"rod.phi": channel}, start, "free", None)
    free = (
        free_parameter(system, "bearing.d", guess=0.01, lower=0.0, upper=1.0),
        free_parameter(system, "bearing.tau_c", guess=0.02, lower=0.0, upper=1.0),
    )
    problem = make_problem(system, free, (log,))
    return finished(problem, estimate(problem))


def table(measured):
    """Print one row for each kind of friction."""
    print("| friction | `bearing.d` [N.m.s/rad] | `bearing.tau_c` [N.m] | rms error [mrad] |")
    print("|---|--:|--:|--:|")
    print(f"| truth | {TRUTH['bearing.d']:.5f} | {TRUTH['bearing.tau_c']:.5f} | {1e3 * NOISE:.2f} |")
    for width in (None, *WIDTHS):
        system = assemble(Pendulum(width=width))
        d, tau_c = fitted(system, measured).parameters
        rms = np.sqrt(np.mean((angle(system, (d.value, tau_c.value)) - measured) ** 2))
        name = "that sticks" if width is None else f"tanh, w_s = {width:g} rad/s"
        print(f"| {name} | {said(d)} | {said(tau_c)} | {1e3 * rms:.2f} |")


def said(estimate):
    """Return an estimate with its standard deviation, which one at its bound has not."""
    return f"{estimate.value:.5f} ± {estimate.sd:.5f}" if estimate.sd > 0 else f"{estimate.value:.5f}, at its bound"


def picture():
    """Draw the motion with each friction, at the same parameters, and the last part of it larger."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    whole, close = figure.subplots(1, 2)
    kinds = [(None, MEASURED, "sticks"), (0.5, BEFORE, "tanh, w_s = 0.5 rad/s"), (0.1, AFTER, "tanh, w_s = 0.1 rad/s")]
    long = np.linspace(0.0, 30.0, 3001)
    for width, colour, label in kinds:
        phi = angle(assemble(Pendulum(width=width)), TRUTH.values(), long)
        whole.plot(long, phi, color=colour, label=label)
        close.plot(long, 1e3 * phi, color=colour)
    whole.set(xlim=(0, 6), xlabel="time [s]", ylabel="angle [rad]", title="The same parameters")
    close.set(xlim=(3, 15), ylim=(-30, 45), xlabel="time [s]", ylabel="angle [mrad]", title="What holds the rod")
    whole.legend(edgecolor="none")
    return figure


def main():
    noise = NOISE * np.random.default_rng(3).standard_normal(TIMES.size)
    table(angle(assemble(Pendulum()), TRUTH.values()) + noise)
    picture().savefig(HERE / "explanation" / "smoothed-friction.png", dpi=DPI)


if __name__ == "__main__":
    main()
