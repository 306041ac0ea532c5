"""Make the runs of the rig in closed loop where the studies are: ``python models/studies/make_closed_loop_rig.py``.

`models/closed_loop.py` swings its rod up and balances it. Its chain gives way, its rail has the friction of Stribeck,
and the rotor of its brake motor is that of the rig; `closed_loop_rig.toml` knows of none of the three. What is logged
is what such a rig has: the voltage, the counts of both encoders twice in a period of the controller, and the current in
the middle of each period, when it has settled, by a Hall sensor. (Voltage and encoders alone cannot tell a mass from a
resistance.)
"""

import sys
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from closed_loop import ClosedLoop  # noqa: E402

from cartpend_dae import insert, simulate  # noqa: E402

FRICTION = {"f_c": 5.0, "f_s": 9.0, "v_s": 0.05}
"""Of the rail, beside its viscous friction of 12 N.s/m [N, N, m/s]."""
CHAIN = {"chain.c": 4e5, "chain.d": 100.0}
"""Stiffness and damping of the chain [N/m, N.s/m]."""
WINDING = 1e-6
"""Inductance [H] of the motor's winding, which the study leaves out: with the 245e-6 of the rig a voltage that jumps
acts a third of a millisecond late, and the current shows it as clearly as the chain, a fourth effect."""
J_BRAKE = 2.19e-4
"""Rotor of the brake motor [kg.m2]; the study has 1.0e-4."""
STEPS = (0.25e-3, 1e-3, 0.02)
"""What one count of the encoders and of the current is [m, rad, A]."""
HALL = 0.1
"""Noise of the current [A], white, that of a Hall sensor for 40 A; its seed is the number of the run."""
SAMPLE = 0.005
"""Half a period of the controller [s]."""


@dataclass(frozen=True, slots=True)
class Run:
    """A run: where the rod is at rest at first [rad, 0 = hanging], how far the cart may go [m], how long it is [s]."""

    angle: float
    reach: float
    duration: float


RUNS = {
    "swing_up_1": Run(0.0, 0.40, 3.5),
    "swing_up_2": Run(0.6, 0.30, 3.5),
    "swing_up_3": Run(-0.3, 0.35, 3.5),
    "balance": Run(pi + 0.17, 0.40, 3.0),
    "balance_2": Run(pi - 0.12, 0.40, 3.0),
}


def rig() -> ClosedLoop:
    """Return the rig under its controller, with all three effects."""
    plain = ClosedLoop(f_c=0.0, start="hanging", elastic_chain=True)
    return insert(plain, "stribeck_friction", "rail", **FRICTION)  # type: ignore[return-value]


def make_run(run: Run, seed: int) -> np.ndarray:
    """Return time, voltage, counted position, angle and current, shape (n, 5); no current at the ticks themselves."""
    n = round(run.duration / SAMPLE) + 1
    parameters = {**CHAIN, "drive.J_brake": J_BRAKE, "drive.motor.L": WINDING, "controller.reach": run.reach}
    found = simulate(
        rig(), run.duration, points=n, start={"bearing.phi": run.angle}, parameters=parameters, rtol=1e-6, atol=1e-9
    )
    names = ("encoder.s", "bearing.phi", "drive.motor.i")
    noise = {"drive.motor.i": HALL * np.random.default_rng(seed).standard_normal(n)}
    s, phi, i = (
        np.round((found[name] + noise.get(name, 0.0)) / step) * step for name, step in zip(names, STEPS, strict=True)
    )
    i[::2] = np.nan
    return np.column_stack([found.time, found["stage.pin.v"], s, phi, i])


def line(t: float, u: float, s: float, phi: float, i: float) -> str:
    """Return a row of the file."""
    return f"{t:.3f},{u:.4f},{s:.5f},{phi:.3f},{'' if np.isnan(i) else f'{i:.2f}'}\n"


def make_all(folder: Path) -> list[Path]:
    """Write one csv file for each run."""
    paths = []
    for seed, (name, run) in enumerate(RUNS.items()):
        path = folder / f"closed_loop_rig_{name}.csv"
        rows = "".join(line(*row) for row in make_run(run, seed).tolist())
        path.write_text("time,voltage,position,angle,current\n" + rows, newline="\n")
        paths.append(path)
    return paths


if __name__ == "__main__":
    for made in make_all(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE):
        print(made)
