"""Make the data of the demonstration: a pendulum with a dry bearing, three releases, the encoder's noise.

``python models/studies/make_demo.py FOLDER`` writes to FOLDER what a user would have: three logs in degrees,
the study `rota_damp.toml` of them and its model `rota_damp.py`, which knows viscous friction only. Without
FOLDER it is `demo` beside this file, where the repository's own `rota_damp.toml` looks for the logs.

The pendulum is simulated here by itself, so that the package is not shown on its own simulations: by the
midpoint time stepping of J. J. Moreau (1988), doi:10.1007/978-3-7091-2624-0_1. The same seed gives the same
files.
"""

import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
MASS, LENGTH, GRAVITY = 0.1719, 0.86, 9.81
VISCOUS, COULOMB = 0.010, 0.015
"""What the bearing does [N.m.s/rad, N.m]; the study knows the first kind only."""
RELEASES = {"release1": 55.0, "release2": -40.0, "release3": 30.0}
"""The angle [deg] from which the rod of each log is let go, at rest."""
DURATION, SAMPLE, SUBSTEPS = 6.0, 0.01, 100
NOISE = 1e-3
SEED = 7


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
    """Write logs, model and study to `folder`, made if missing; return the path of the study."""
    folder.mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng(SEED)
    for name, degrees in RELEASES.items():
        clean = pendulum(math.radians(degrees))
        measured = np.degrees(clean + NOISE * generator.standard_normal(clean.size))
        rows = "".join(f"{k * SAMPLE:.2f},{angle:.5f}\n" for k, angle in enumerate(measured))
        (folder / f"{name}.csv").write_text("time,angle\n" + rows, newline="\n")
    (folder / "rota_damp.py").write_text((HERE.parent / "rota_damp.py").read_text("utf-8"), "utf-8")
    study = (HERE / "rota_damp.toml").read_text("utf-8")
    study = study.replace('"../rota_damp.py"', '"rota_damp.py"').replace('"demo/release', '"release')
    (folder / "rota_damp.toml").write_text(study, "utf-8")
    return folder / "rota_damp.toml"


if __name__ == "__main__":
    print(make_demo(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "demo"))
