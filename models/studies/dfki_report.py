"""What the measured swing-up of the DFKI pendulum tells, and what cutting it otherwise changes.

``python models/studies/dfki_report.py`` prints the table. Nominal values of the rig's authors: weight torque over
inertia 19.6 1/s^2 with all mass at the tip, J = 0.169 kg.m2 and tau_g = 3.32 N.m; these are no weighed truth.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartpend_dae.data import Experiment
from cartpend_dae.identify import Fit
from cartpend_dae.pieces import load_experiments
from cartpend_dae.session import Opened, identify_study, open_study

FloatArray = NDArray[np.float64]
FOLDER = Path(__file__).resolve().parent
NEAR = 0.3
"""The arm is up when it is within so many radians of upright; see `swing_up_end`."""


@dataclass(frozen=True, slots=True)
class Segmentation:
    """A part of the swing-up: from `begin` [s] until the arm is up within `near` [rad], in pieces [s]."""

    begin: float = 0.0
    near: float = NEAR
    piece: float = 0.8


OTHERS = (
    Segmentation(piece=0.6),
    Segmentation(piece=1.0),
    Segmentation(piece=1.4),
    Segmentation(near=0.5),
    Segmentation(near=0.2),
    Segmentation(begin=0.4),
)


def swing_up_end(time: FloatArray, angle: FloatArray, near: float = NEAR) -> float:
    """Return when the arm first comes within `near` [rad] of upright (angle pi, any number of turns away) [s]."""
    away = np.abs(np.mod(angle, 2 * np.pi) - np.pi)
    return float(time[np.argmax(away < near)])


def opened(study: str) -> Opened:
    return open_study(FOLDER / f"{study}.toml")


def cut(study: Opened, parts: Segmentation) -> Experiment:
    """Return the training run of a study cut in another way."""
    spec = replace(study.study.experiments[0], window=None)
    units = {variable.name: variable.declaration.unit for variable in study.system.variables}
    (whole,) = load_experiments(spec, units)
    end = swing_up_end(whole.time, whole.outputs["bearing.phi"].values, parts.near)
    (found,) = load_experiments(replace(spec, window=(parts.begin, end), piece=parts.piece), units)
    return found


def fitted(study: Opened, parts: Segmentation) -> Fit:
    """Fit a study to its training run, cut in another way."""
    return identify_study(replace(study, setup=replace(study.setup, train=(cut(study, parts),))))


def ratio(fit: Fit) -> tuple[float, float]:
    """Return weight torque over inertia [1/s2] and its standard deviation."""
    names = [estimate.name for estimate in fit.parameters]
    places = [names.index("weight.tau_g"), names.index("arm.J")]
    torque, inertia = (fit.parameters[i].value for i in places)
    slope = np.array([1 / inertia, -torque / inertia**2])
    return torque / inertia, float(np.sqrt(slope @ fit.covariance[np.ix_(places, places)] @ slope))


def _row(what: str, fit: Fit) -> str:
    value, sd = ratio(fit)
    numbers = "".join(
        f"{e.value:9.4g} [{e.interval[0]:6.4g}, {e.interval[1]:6.4g}]"
        for e in fit.parameters
        if e.name in ("arm.J", "weight.tau_g")
    )
    return f"{what:34}{value:8.2f} ± {1.96 * sd:4.2f}{numbers}{1e3 * fit.noise_sd[0]:9.2f}"


def main() -> None:
    """Print the report."""
    complete, plain = opened("dfki_pendulum_complete"), opened("dfki_pendulum")
    print("Swing-up of the DFKI pendulum, with 95 % intervals; rms of the residuals over the pieces\n")
    head = f"{'from [s], near [rad], piece [s]':34}{'tau_g/J [1/s2]':>15}"
    print(f"{head}{'J [kg.m2]':>18}{'tau_g [N.m]':>23}{'rms [mrad]':>20}")
    for parts in (Segmentation(), *OTHERS):
        fit = fitted(complete, parts)
        print(_row(f"{parts.begin:g}, {parts.near:g}, {parts.piece:g}", fit))
    print("\nWithout Coulomb friction and torque offset:\n")
    print(_row("0, 0.3, 0.8", fitted(plain, Segmentation())))


if __name__ == "__main__":
    main()
