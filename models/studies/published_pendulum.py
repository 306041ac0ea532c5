"""Rebuild experiment 1 of the published study: a reconstruction from its printed numbers, not a measurement.

``python models/studies/published_pendulum.py`` writes `published_pendulum.csv` beside this file and prints
the table of published and rebuilt errors.

The trace of the swinging pendulum was never published, but its sum of squared errors against the model was,
for 18 values of the damping. For a trace = model(d_true) + q the sum at damping d is

    |model(d) - model(d_true)|^2 - 2 (model(d) - model(d_true)) . q + |q|^2,

and the 18 printed values are met within 1.1 % RMS if q is orthogonal to the 18 differences and |q|^2 is the
floor of 0.3636 rad^2. So q is one white sequence, drawn with a fixed seed, made orthogonal and scaled to that
floor. What the pendulum did besides the model cannot be known from the table: nothing may be read into q.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartpend_dae import assemble, simulate
from cartpend_dae.study import load_model, load_study

FloatArray = NDArray[np.float64]

PUBLISHED = np.array(
    [
        (0.01, 4.619),
        (0.02, 1.546),
        (0.03, 0.515),
        (0.035, 0.3766),
        (0.037, 0.3632),
        (0.0373, 0.3628),
        (0.0375, 0.3628),
        (0.0377, 0.3629),
        (0.038, 0.3634),
        (0.04, 0.3758),
        (0.041, 0.3872),
        (0.042, 0.4018),
        (0.05, 0.6017),
        (0.06, 0.9673),
        (0.07, 1.3741),
        (0.1, 2.549),
        (0.15, 3.9557),
        (0.2, 4.962),
    ]
)
"""The published sweep: damping [N.m.s/rad] and sum of squared errors [rad^2]."""
DAMPING, PUBLISHED_SSE = PUBLISHED.T
TRUE_DAMPING = 0.0374
FLOOR = 0.3636
SAMPLES, STEP = 501, 0.01
SEED = 1
STUDY = Path(__file__).with_suffix(".toml")


def model_runs(damping: FloatArray) -> FloatArray:
    """Return the angle [rad] for each damping, shape (n, 501), as the study ran it: RK4 with h = 0.01 s."""
    system = assemble(load_model(load_study(STUDY).model))
    times = np.arange(SAMPLES) * STEP
    return np.array(
        [
            simulate(system, times=times, method="rk4", step=STEP, parameters={"bearing.d": d})["bearing.phi"]
            for d in damping
        ]
    )


def unexplained(differences: FloatArray) -> FloatArray:
    """Return a white sequence made orthogonal to each of `differences`, with FLOOR as its sum of squares."""
    _, sizes, directions = np.linalg.svd(differences, full_matrices=False)
    # Smaller directions are rounding: they would change from machine to machine, and change no sum by 1e-5.
    directions = directions[sizes > 1e-6 * sizes[0]]
    sequence = np.random.default_rng(SEED).standard_normal(differences.shape[1])
    sequence -= directions.T @ (directions @ sequence)
    return sequence * np.sqrt(FLOOR / (sequence @ sequence))


def rebuild() -> FloatArray:
    """Return the rebuilt trace [rad], shape (501,), rounded to 1e-6 rad so that it is the same everywhere."""
    truth = model_runs(np.array([TRUE_DAMPING]))[0]
    return np.round(truth + unexplained(model_runs(DAMPING) - truth), 6)


def sums_of_squares(trace: FloatArray, damping: FloatArray = DAMPING) -> FloatArray:
    """Return the sum of squared errors [rad^2] of the model at each damping."""
    return np.sum((model_runs(damping) - trace) ** 2, axis=1)


def write_csv(trace: FloatArray, path: Path) -> None:
    rows = "".join(f"{k * STEP:.2f},{angle:.6f}\n" for k, angle in enumerate(trace))
    path.write_text("time,theta\n" + rows, newline="\n")


def main() -> None:
    trace = rebuild()
    write_csv(trace, Path(__file__).with_suffix(".csv"))
    rebuilt = sums_of_squares(trace)
    error = rebuilt / PUBLISHED_SSE - 1
    print("d [N.m.s/rad]  published  rebuilt [rad^2]  error [%]")
    for row in zip(DAMPING, PUBLISHED_SSE, rebuilt, 100 * error, strict=True):
        print("{:13.4f}{:11.4f}{:17.4f}{:+11.2f}".format(*row))
    print(f"RMS {100 * np.sqrt(np.mean(error**2)):.2f} %, worst {100 * np.abs(error).max():.2f} %")


if __name__ == "__main__":
    main()
