"""A first project of one's own: a model, a study and logs that run at once, to be replaced piece by piece.

The logs are made here by a simulation that shares nothing with the package: a cart on a spring, pushed by a force, on a
rail with dry friction, by the midpoint time stepping of J. J. Moreau (1988), doi:10.1007/978-3-7091-2624-0_1. The
study's model knows no dry friction. The same seed gives the same files.
"""

import math
import tempfile
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartpend_dae.errors import StudyError

MASS, STIFFNESS, VISCOUS, COULOMB = 2.1, 150.0, 3.2, 1.5
"""The cart of the logs [kg, N/m, N.s/m, N]; the study starts from other values, and knows the first three only."""
RUNS = {"train1": (6.0, 0.35), "train2": (10.0, 0.6), "test": (8.0, 0.45)}
"""Amplitude [N] and lowest frequency [Hz] of the force of each log."""
DURATION, SAMPLE, SUBSTEPS = 12.0, 0.01, 50
NOISE, STEP = 2e-5, 1e-6
"""Noise of the position and the last digit that is written [m]."""
SEED = 11
NAMES = ("rig.py", "study.toml", "README.md")


def force(times: NDArray[np.floating], amplitude: float, frequency: float) -> NDArray[np.floating]:
    """Return the force [N] at some times [s]: three sines that do not repeat, held between samples."""
    tones = ((1.0, 1.0), (0.6, math.sqrt(5)), (0.4, math.sqrt(23)))
    waves = np.array([share * np.sin(2 * math.pi * frequency * ratio * times) for share, ratio in tones])
    return amplitude * waves.sum(axis=0)


def position(pushes: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the position of the cart [m] at each sample, from rest at 0, under held forces [N], shape (n,) each."""
    h = SAMPLE / SUBSTEPS
    stop = h * COULOMB / MASS  # what dry friction can take from the speed in one step
    s = v = 0.0
    samples = [s]
    for push in pushes[:-1].tolist():
        for _ in range(SUBSTEPS):
            s += h / 2 * v
            damped = h * VISCOUS / (2 * MASS)
            sliding = (v * (1 - damped) + h * (push - STIFFNESS * s) / MASS) / (1 + damped)
            v = math.copysign(max(abs(sliding) - stop, 0.0), sliding)
            s += h / 2 * v
        samples.append(s)
    return np.array(samples)


def make_project(folder: Path) -> Path:
    """Write model, study, logs and a README to a new folder; return the path of the study.

    Raises
    ------
    StudyError
        If the folder holds anything, or cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise StudyError(f"{folder}: is there already; name a folder that is new or empty.")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".new-", dir=folder.parent) as name:
            _fill(made := Path(name) / "project")
            made.replace(folder)
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error.strerror or error}).") from None
    return folder / "study.toml"


def _fill(folder: Path) -> None:
    folder.mkdir()
    generator = np.random.default_rng(SEED)
    times = np.arange(round(DURATION / SAMPLE) + 1) * SAMPLE
    for name, (amplitude, frequency) in RUNS.items():
        pushes = np.round(force(times, amplitude, frequency), 4)
        measured = position(pushes) + NOISE * generator.standard_normal(times.size)
        lines = [f"{t:.2f},{f:.4f},{s / STEP * STEP:.6f}\n" for t, f, s in zip(times, pushes, measured, strict=True)]
        (folder / f"{name}.csv").write_text("time,force,position\n" + "".join(lines), "utf-8", newline="\n")
    # the model is no .py file here, because nobody should import it from the package
    for name in NAMES:
        text = (files(__name__) / f"{name}-tpl").read_text("utf-8")
        (folder / name).write_text(text, "utf-8", newline="\n")
