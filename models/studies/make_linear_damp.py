"""Make a run of the cart between springs where the studies are: ``python models/studies/make_linear_damp.py [FILE]``.

The rig is simulated by `tests/independent.py`, which shares no code with the package, with what the published study
found by hand: damping 48 N.s/m, inertial mass 6.8 kg, and the 10 N that a spring scale showed. The position is written
in inches, as it was logged, with the noise of an encoder of 0.25 mm.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
TRUTH = {"rail.d": 48.0, "rail.f_c": 10.0, "inertial.m": 6.8}
CART, START, DURATION, INCH = 4.609, 0.1146, 1.08, 0.0254
NOISE, SEED = 0.25e-3 / np.sqrt(12), 11
"""Standard deviation of the measured position [m], that of rounding to a count."""


def make_linear_damp(path: Path) -> Path:
    """Write time and position of the run to a csv file."""
    spec = importlib.util.spec_from_file_location("independent", HERE.parents[1] / "tests" / "independent.py")
    assert spec is not None and spec.loader is not None
    independent = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(independent)
    times, positions = independent.cart_between_springs(
        duration=DURATION,
        position=START,
        viscous=TRUTH["rail.d"],
        coulomb=TRUTH["rail.f_c"],
        mass=CART + TRUTH["inertial.m"],
        noise=NOISE,
        generator=np.random.default_rng(SEED),
    )
    rows = "".join(f"{t:.2f},{s / INCH:.5f}\n" for t, s in zip(times, positions, strict=True))
    path.write_text("time,position\n" + rows, newline="\n")
    return path


if __name__ == "__main__":
    print(make_linear_damp(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "linear_damp_mod.csv"))
