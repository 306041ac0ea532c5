"""The demonstration: a pendulum with a dry bearing, three recorded releases, a model that lacks the friction.

The pendulum is simulated here by itself, so that the package is not shown on its own simulations: by the
midpoint time stepping of J. J. Moreau (1988), doi:10.1007/978-3-7091-2624-0_1. The same seed gives the same
files.
"""

import math
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MASS, LENGTH, GRAVITY = 0.1719, 0.86, 9.81
VISCOUS, COULOMB = 0.010, 0.015
"""What the bearing does [N.m.s/rad, N.m]; the study knows the first kind only."""
RELEASES = {"release1": 55.0, "release2": -40.0, "release3": 30.0}
"""The angle [deg] from which the rod of each log is let go, at rest."""
DURATION, SAMPLE, SUBSTEPS = 6.0, 0.01, 100
NOISE = 1e-3
SEED = 7
MODEL, STUDY = "rota_damp.py", "rota_damp.toml"


def pendulum(angle: float) -> NDArray[np.float64]:
    """Return the angle [rad] every 0.01 s for 6 s, released at rest at `angle` [rad], shape (601,)."""
    inertia = MASS * LENGTH**2 / 3
    weight, damping = MASS * GRAVITY * LENGTH / 2 / inertia, VISCOUS / inertia
    h = SAMPLE / SUBSTEPS
    stop = h * COULOMB / inertia  # what dry friction can take from the speed in one step
    phi, w = angle, 0.0
    samples = [phi]
    for _ in range(round(DURATION / SAMPLE)):
        for _ in range(SUBSTEPS):
            phi += h / 2 * w
            sliding = (w * (1 - h * damping / 2) - h * weight * math.sin(phi)) / (1 + h * damping / 2)
            w = math.copysign(max(abs(sliding) - stop, 0.0), sliding)
            phi += h / 2 * w
        samples.append(phi)
    return np.array(samples)


def make_demo(folder: Path) -> Path:
    """Write logs in degrees, model and study to `folder`, made if missing; return the path of the study."""
    folder.mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng(SEED)
    for name, degrees in RELEASES.items():
        clean = pendulum(math.radians(degrees))
        measured = np.degrees(clean + NOISE * generator.standard_normal(clean.size))
        rows = "".join(f"{k * SAMPLE:.2f},{angle:.5f}\n" for k, angle in enumerate(measured))
        (folder / f"{name}.csv").write_text("time,angle\n" + rows, newline="\n")
    # the model is no .py file here, because nobody should import it from the package
    for resource, name in ((f"{MODEL}-tpl", MODEL), (STUDY, STUDY)):
        (folder / name).write_text((files(__name__) / resource).read_text("utf-8"), "utf-8", newline="\n")
    return folder / STUDY
