"""The three rigs: nominal numbers, how truths and runs are drawn, and what a study of them says.

The fixed numbers are those of the models of the repository: what a study does not free, the model has right.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from blind.plant import SAMPLE
from blind.stepping import Array

NOISE = {"bearing.phi": 3e-4, "encoder.s": 5e-5, "motor.i": 5e-3}
STEPS = {"bearing.phi": 1e-3, "encoder.s": 2.5e-4}
UNITS = {"bearing.phi": "rad", "encoder.s": "m", "motor.i": "A"}
ROLES = ("train", "train", "test")


@dataclass(frozen=True, slots=True)
class Scale:
    """Typical force (or torque), speed, length and mass along a coordinate."""

    force: float
    speed: float
    length: float
    mass: float


@dataclass(frozen=True, slots=True)
class Free:
    """A free parameter: its name in the study, here, nominal value, range of the truth as factors, bounds."""

    name: str
    key: str
    nominal: float
    low: float
    high: float
    bounds: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Run:
    """One run: start positions by coordinate, and the voltage at the samples."""

    start: dict[str, float]
    u: Array | None


@dataclass(frozen=True, slots=True)
class Rig:
    """A rig; `release` is the output whose start is estimated, None where it starts at rest at zero."""

    name: str
    model: str
    coordinates: tuple[str, ...]
    fixed: dict[str, float]
    free: tuple[Free, ...]
    outputs: tuple[str, ...]
    scales: dict[str, Scale]
    n_samples: int
    release: str | None
    runs: Callable[[np.random.Generator, int], tuple[Run, ...]]

    def draw(self, generator: np.random.Generator) -> dict[str, float]:
        """True parameters: the fixed ones as in the model, the free ones anywhere in their ranges."""
        drawn = {f.key: f.nominal * float(np.exp(generator.uniform(np.log(f.low), np.log(f.high)))) for f in self.free}
        return self.fixed | drawn


def pendulum_releases(generator: np.random.Generator, n: int) -> tuple[Run, ...]:
    side = generator.choice((-1.0, 1.0))
    angles = (
        side * generator.uniform(0.9, 1.3),
        -side * generator.uniform(0.4, 0.7),
        side * generator.uniform(0.6, 1.1),
    )
    return tuple(Run({"phi": float(angle)}, None) for angle in angles)


def cart_releases(generator: np.random.Generator, n: int) -> tuple[Run, ...]:
    side = generator.choice((-1.0, 1.0))
    far, back, test = generator.uniform((0.105, 0.105, 0.08), (0.135, 0.135, 0.13))
    return tuple(Run({"s": float(side * s)}, None) for s in (far, -back, test))


def drives(generator: np.random.Generator, n: int) -> tuple[Run, ...]:
    """Return a multisine, steps with slow ramps, and a mixture of all as the test."""
    half = n // 2
    first = multisine(generator, n)
    second = np.concatenate((steps(generator, half), ramps(generator, n - half)))
    third = np.concatenate(
        (multisine(generator, half), steps(generator, half // 2), ramps(generator, n - half - half // 2))
    )
    return tuple(Run({}, np.clip(u, -20.0, 20.0)) for u in (first, second, third))


def multisine(generator: np.random.Generator, n: int) -> Array:
    """Twelve lines between 0.13 and 6 Hz, amplitude 2 V each; it starts and ends gently."""
    t, duration = SAMPLE * np.arange(n), SAMPLE * n
    lines = np.unique(np.round(np.geomspace(0.13, 6.0, 12) * duration))
    phases = generator.uniform(0, 2 * np.pi, lines.size)
    u = sum(2.0 * np.sin(2 * np.pi * k * t / duration + phase) for k, phase in zip(lines, phases, strict=True))
    return np.asarray(u) * np.clip(np.minimum(t, t[::-1]) / 0.3, 0, 1)


def steps(generator: np.random.Generator, n: int) -> Array:
    """Levels up to 8 V for 0.2 to 0.6 s each, that bring the cart back sooner or later."""
    u, filled, place = np.zeros(n), 0, 0.0
    while filled < n:
        dwell, level = int(generator.uniform(20, 60)), generator.uniform(1.0, 8.0)
        back = -np.sign(place) if abs(place) > 0.03 and generator.random() < 0.85 else generator.choice((-1.0, 1.0))
        u[filled : filled + dwell] = back * level
        place += 0.066 * back * level * dwell * SAMPLE
        filled += dwell
    return u


def ramps(generator: np.random.Generator, n: int) -> Array:
    """Slow triangles up to 1 to 3 V, two periods, and rest for the last tenth."""
    moving = round(0.9 * n)
    z = 2 * np.arange(moving) / moving
    triangle = 1 - 4 * np.abs(np.mod(z + 0.25, 1.0) - 0.5)
    sizes = np.where(z < 1, generator.uniform(1.0, 1.8), generator.uniform(1.8, 3.0))
    return np.concatenate((sizes * triangle, np.zeros(n - moving)))


_ROD = {"m_p": 0.1719, "l": 0.86, "g": 9.81}

ROTA_DAMP = Rig(
    name="rota_damp",
    model="RotaDamp",
    coordinates=("phi",),
    fixed=_ROD,
    free=(Free("bearing.d", "d_bearing", 0.0375, 0.2, 0.9, (0.0, 1.0)),),
    outputs=("bearing.phi",),
    scales={"bearing": Scale(0.4, 2.0, 0.6, 0.042)},
    n_samples=1501,
    release="bearing.phi",
    runs=pendulum_releases,
)
LINEAR_DAMP_MOD = Rig(
    name="linear_damp_mod",
    model="LinearDampMod",
    coordinates=("s",),
    fixed={"m_c": 4.609, "K1": 1197.3, "K2": 1320.1, "a": 0.095, "g": 9.81},
    free=(
        Free("rail.d", "d_rail", 48.0, 0.1, 0.7, (0.0, 1000.0)),
        Free("inertial.m", "m_in", 6.8, 0.8, 1.25, (0.1, 200.0)),
    ),
    outputs=("encoder.s",),
    scales={"rail": Scale(200.0, 1.0, 0.1, 11.4)},
    n_samples=801,
    release="encoder.s",
    runs=cart_releases,
)
DRIVEN_CART = Rig(
    name="driven_cart",
    model="DrivenCart",
    coordinates=("s", "phi"),
    fixed=_ROD | {"m_c": 4.609, "R": 0.739, "k": 0.170, "n": 84.9},
    free=(
        Free("rail.d", "d_rail", 12.0, 0.5, 2.0, (0.0, 1000.0)),
        Free("bearing.d", "d_bearing", 0.0375, 0.1, 0.6, (0.0, 1.0)),
        Free("inertial.m", "m_in", 6.763, 0.8, 1.25, (0.1, 200.0)),
    ),
    outputs=("encoder.s", "bearing.phi", "motor.i"),
    scales={"rail": Scale(60.0, 0.4, 0.25, 11.5), "bearing": Scale(0.25, 1.5, 0.4, 0.042)},
    n_samples=1501,
    release=None,
    runs=drives,
)
RIGS = {rig.name: rig for rig in (ROTA_DAMP, LINEAR_DAMP_MOD, DRIVEN_CART)}
