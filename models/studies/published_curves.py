"""The published curves of the sum of squared errors, by sweep and by estimation.

``python models/studies/published_curves.py [FOLDER]`` writes pendulum.png and cart.png, by default to
`published-curves` where it is called. The published study found its parameters by sweeping one after the other by hand
and looking for the lowest sum; the estimation finds all at once, and must end where each swept curve through its point
is lowest.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))

from published_pendulum import PUBLISHED

from cartpend_dae import simulate
from cartpend_dae.identify import Fit
from cartpend_dae.plots import AFTER, BEFORE, DPI, MEASURED
from cartpend_dae.session import Opened, identify_study, open_study

FloatArray = NDArray[np.float64]
HERE = Path(__file__).resolve().parent
POINTS, WIDTH = 21, 8.0
"""Number of values of a sweep, and how far it goes to either side [standard deviations of the estimate]."""
NAMES = {
    "bearing.d": "damping [N m s/rad]",
    "bearing.tau_c": "Coulomb torque [N m]",
    "rail.d": "damping [N s/m]",
    "rail.f_c": "Coulomb friction [N]",
    "inertial.m": "inertial mass [kg]",
}


@dataclass(frozen=True, slots=True)
class Curve:
    """Sums of squared errors [rad2 or m2] for values of one parameter, the others as estimated."""

    name: str
    values: FloatArray
    sums: FloatArray

    @property
    def lowest(self) -> float:
        """Where the curve is lowest, between the values of the sweep by the parabola through three of them."""
        k = int(np.clip(np.argmin(self.sums), 1, len(self.sums) - 2))
        a, b, _ = np.polyfit(self.values[k - 1 : k + 2] - self.values[k], self.sums[k - 1 : k + 2], 2)
        return float(self.values[k] - b / (2 * a))


def sweep(study: Opened, fit: Fit, name: str, values: FloatArray) -> Curve:
    """Simulate the only run of a study for each value of a parameter, exact in its events."""
    (run,) = study.setup.train
    ((output, channel),) = run.outputs.items()
    start = {variable: begin.value for variable, begin in run.start.items() if begin.value is not None}
    errors = [
        simulate(
            study.system,
            times=run.time,
            start=start,
            parameters=fit.values | {name: float(value)},
            rtol=1e-9,
            atol=1e-11,
        )[output]
        - channel.values
        for value in values
    ]
    return Curve(name, values, np.sum(np.square(errors), axis=1))


def curves(study: Opened, fit: Fit) -> tuple[Curve, ...]:
    """Return the curve of each parameter about its estimate."""
    found = []
    for estimate in fit.parameters:
        low, high = (estimate.value + side * WIDTH * estimate.sd for side in (-1, 1))
        found.append(sweep(study, fit, estimate.name, np.linspace(max(low, 0.0), high, POINTS)))
    return tuple(found)


def draw(study: Opened, fit: Fit, swept: tuple[Curve, ...], title: str) -> Figure:
    """Draw the swept curves and the estimates with their 95 % intervals."""
    figure = Figure(figsize=(4.2 * len(swept) + 0.6, 3.9), layout="constrained")
    axes = figure.subplots(1, len(swept), squeeze=False, sharey=len(swept) > 1)[0]
    unit = "rad²" if study.system.unit_of(fit.outputs[0]) == "rad" else "m²"
    for axis, curve, estimate in zip(axes, swept, fit.parameters, strict=True):
        axis.plot(curve.values, curve.sums, color=AFTER, marker=".", label="sweep")
        axis.axvspan(*estimate.interval, color=BEFORE, alpha=0.15, lw=0)
        axis.axvline(estimate.value, color=BEFORE, label="estimate, 95 %")
        axis.set_xlabel(NAMES[curve.name])
    axes[0].set_ylabel(f"sum of squared errors [{unit}]")
    axes[0].legend(loc="upper center", edgecolor="none")
    figure.suptitle(title, x=0.02, ha="left", weight="bold")
    return figure


def pendulum_figure() -> tuple[Figure, Curve, Fit]:
    """Draw the published 18 sums of the pendulum, the sweep of the rebuilt trace, and its estimate."""
    study = open_study(HERE / "published_pendulum.toml")
    fit = identify_study(study)
    (curve,) = curves(study, fit)
    wide = sweep(study, fit, curve.name, np.geomspace(0.01, 0.2, 60))
    figure = draw(study, fit, (wide,), "Pendulum on the held cart")
    (axis,) = figure.axes
    axis.plot(*PUBLISHED.T, ls="", marker="o", mfc="none", color=MEASURED, label="published")
    axis.set_xscale("log")
    axis.legend(loc="upper center", edgecolor="none")
    return figure, curve, fit


def cart_figure() -> tuple[Figure, tuple[Curve, ...], Fit]:
    """Draw the sweeps of the cart between springs, and its estimates."""
    study = open_study(HERE / "linear_damp_mod.toml")
    fit = identify_study(study)
    swept = curves(study, fit)
    return draw(study, fit, swept, "Cart between two springs (simulated run)"), swept, fit


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("published-curves")
    folder.mkdir(parents=True, exist_ok=True)
    pendulum, curve, fit = pendulum_figure()
    cart, swept, cart_fit = cart_figure()
    for name, figure in (("pendulum", pendulum), ("cart", cart)):
        figure.savefig(folder / f"{name}.png", dpi=DPI)
        print(folder / f"{name}.png")
    print(f"{'parameter':14}{'lowest of the sweep':>21}{'estimate':>12}{'sd':>11}")
    for one, estimate in zip((curve, *swept), (*fit.parameters, *cart_fit.parameters), strict=True):
        print(f"{one.name:14}{one.lowest:21.6g}{estimate.value:12.6g}{estimate.sd:11.2g}")


if __name__ == "__main__":
    main()
