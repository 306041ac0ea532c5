"""Make the bench run of the motor where the studies are: ``python models/studies/make_motor.py [FILE]``.

The motor is simulated by `tests/independent.py`, which shares no code with the package. Winding, constant and rotor are
the rig's; its bearings got more drag than the 2e-6 N.m.s/rad of the data sheet, of which no run could tell anything,
and dry friction. The voltage is switched between random levels after 3 to 30 ms and is zero now and then.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
TRUTH = {
    "motor.R": 0.739,
    "motor.L": 245e-6,
    "motor.k": 0.170,
    "motor.J": 1.20e-4,
    "bearing.d": 5e-4,
    "bearing.tau_c": 0.01,
}
NOISE = (0.005, 0.03)
"""Standard deviations of the measured current and speed [A, rad/s]."""
SAMPLE, SAMPLES, SEED = 5e-4, 1000, 3


def voltage(generator: np.random.Generator) -> np.ndarray:
    """Return the voltage of each sample [V], multiples of 0.5 V between -12 V and 12 V."""
    levels = list[float]()
    while len(levels) < SAMPLES:
        level = 0.0 if generator.random() < 0.15 else 0.5 * float(generator.integers(-24, 25))
        levels += [level] * int(generator.integers(6, 61))
    return np.array(levels[:SAMPLES])


def make_motor(path: Path) -> Path:
    """Write time, voltage, current and speed of the run to a csv file."""
    spec = importlib.util.spec_from_file_location("independent", HERE.parents[1] / "tests" / "independent.py")
    assert spec is not None and spec.loader is not None
    independent = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(independent)
    generator = np.random.default_rng(SEED)
    u = voltage(generator)
    names = ("resistance", "inductance", "constant", "inertia", "viscous", "coulomb")
    motor = dict(zip(names, TRUTH.values(), strict=True))
    times, i, w = independent.dc_motor(voltage=u, sample=SAMPLE, noise=NOISE, generator=generator, **motor)
    rows = "".join("{:.4f},{:.1f},{:.4f},{:.3f}\n".format(*row) for row in zip(times, u, i, w, strict=True))
    path.write_text("time,voltage,current,speed\n" + rows, newline="\n")
    return path


if __name__ == "__main__":
    print(make_motor(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "motor.csv"))
