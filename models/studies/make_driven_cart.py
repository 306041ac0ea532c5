"""Make the run of the driven rig where the studies are: ``python models/studies/make_driven_cart.py [FILE]``.

The rig is simulated by `tests/independent.py`, which shares no code with the package. The voltage is a sum of five
sines, small enough that the cart stays on its rail; the encoders count steps of 0.25 mm and 1 mrad.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
TRUTH = {
    "inertial.m": 11.372,
    "rail.d": 12.0,
    "bearing.d": 0.0375,
    "rod.m": 0.1719,
    "motor.R": 0.739,
}
STEPS = (0.25e-3, 1e-3)
"""What one count of the encoders is [m, rad]."""
NOISE = 0.02
"""Standard deviation of the measured current [A]."""
SAMPLES, SEED = 801, 5
SINES = ((0.3, 1.5), (0.55, 1.2), (0.9, 2.0), (1.6, 2.5), (2.7, 3.0))
"""Frequency [Hz] and amplitude [V] of each sine."""


def voltage() -> np.ndarray:
    """Return the voltage of each sample [V], rounded to 0.01 V."""
    times, phases = 0.01 * np.arange(SAMPLES), np.random.default_rng(SEED).uniform(0, 2 * np.pi, len(SINES))
    parts = [a * np.sin(2 * np.pi * f * times + p) for (f, a), p in zip(SINES, phases, strict=True)]
    return np.round(np.sum(parts, axis=0), 2)


def make_driven_cart(path: Path) -> Path:
    """Write time, voltage, position, angle and current of the run to a csv file."""
    spec = importlib.util.spec_from_file_location("independent", HERE.parents[1] / "tests" / "independent.py")
    assert spec is not None and spec.loader is not None
    independent = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(independent)
    u = voltage()
    names = ("mass", "viscous", "bearing", "rod", "resistance")
    rig = dict(zip(names, TRUTH.values(), strict=True))
    times, s, phi, i = independent.driven_cart(voltage=u, **rig)
    s, phi = (np.round(x / step) * step for x, step in zip((s, phi), STEPS, strict=True))
    i = i + NOISE * np.random.default_rng(SEED + 1).standard_normal(SAMPLES)
    rows = "".join("{:.2f},{:.2f},{:.5f},{:.3f},{:.3f}\n".format(*row) for row in zip(times, u, s, phi, i, strict=True))
    path.write_text("time,voltage,position,angle,current\n" + rows, newline="\n")
    return path


if __name__ == "__main__":
    print(make_driven_cart(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "driven_cart.csv"))
