"""Two rigs that stick, what is unknown of them, and their logs by the independent simulator."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import independent
import numpy as np

HERE = Path(__file__).resolve().parent
SAMPLES, FINE = 1000, 2e-4


@dataclass(frozen=True)
class Case:
    """A run: `measured` is sampled 1,000 times at 100 Hz with `noise`; `truth` holds what is estimated, from `guess`.

    `held` are further start states, known; the measured one starts at `start`, and is estimated.
    """

    name: str
    model: str
    measured: str
    unit: str
    start: float
    held: str
    noise: float
    truth: Mapping[str, float]
    guess: Mapping[str, float]
    simulate: Callable[..., tuple[np.ndarray, np.ndarray]]
    arguments: Mapping[str, str]

    def clean(self):
        """Return times and what the sensor would read without noise, shapes (1000,)."""
        known = {argument: self.truth[name] for name, argument in self.arguments.items()}
        return self.simulate(duration=(SAMPLES - 1) / 100, step=FINE, **known, **{self._where: self.start})

    @property
    def _where(self):
        return "angle" if self.unit == "rad" else "position"

    def write(self, folder, time, values, **identify):
        """Write the log and the study into a folder; return the path of the study."""
        lines = [f"{t:.2f},{y:.17g}" for t, y in zip(time, values, strict=True)]
        (folder / "run.csv").write_text("\n".join(["time,measured", *lines]) + "\n")
        text = ["[model]", f'path = "{HERE / "rigs.py"}"', f'name = "{self.model}"']
        for name, guess in self.guess.items():
            text += [f'[parameters."{name}"]', f"guess = {guess}", "min = 0.0"]
        text += ["[identify]", *(f"{key} = {value}" for key, value in identify.items())]
        text += ["[[experiment]]", 'name = "run"', 'file = "run.csv"', 'time = { column = "time", unit = "s" }']
        column = f'{{ column = "measured", unit = "{self.unit}", sd = {self.noise} }}'
        text += [f'outputs = {{ "{self.measured}" = {column} }}']
        text += [f'start = {{ "{self.measured}" = {{ guess = {values[0]} }}, "{self.held}" = {{ value = 0.0 }} }}']
        (folder / "study.toml").write_text("\n".join(text) + "\n")
        return folder / "study.toml"


PENDULUM = Case(
    name="pendulum",
    model="Pendulum",
    measured="bearing.phi",
    unit="rad",
    start=-0.7,
    held="bearing.w",
    noise=1e-3,
    truth={"bearing.d": 0.01, "bearing.tau_c": 0.015},
    guess={"bearing.d": 0.02, "bearing.tau_c": 0.008},
    simulate=independent.pendulum,
    arguments={"bearing.d": "viscous", "bearing.tau_c": "coulomb"},
)
CART = Case(
    name="cart",
    model="CartBetweenSprings",
    measured="cart.s",
    unit="m",
    start=0.1146,
    held="cart.v",
    noise=1e-4,
    truth={"rail.d": 20.0, "rail.f_c": 10.0, "cart.m": 11.409},
    guess={"rail.d": 40.0, "rail.f_c": 5.0, "cart.m": 10.0},
    simulate=independent.cart_between_springs,
    arguments={"rail.d": "viscous", "rail.f_c": "coulomb", "cart.m": "mass"},
)
CASES = (PENDULUM, CART)
