"""Parts joined to small models, and the closed forms that rotation and translation share."""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipj

from cartpend_dae import simulate
from cartpend_dae.language import Component, Port, connect

RTOL = 1e-9
CLOSE = 1e-6
"""Tolerance against closed forms: local errors of RTOL, a few hundred steps of them, and a margin."""


class Bench(Component):
    """Parts and connections that a test puts together."""

    def __post_init__(self):
        self.joints = []

    def equations(self):
        yield from self.joints


def joined(*joints, **parts: Component) -> Bench:
    bench = Bench()
    for name, part in parts.items():
        setattr(bench, name, part)
    bench.joints = [connect(*ends) for ends in joints]
    return bench


def held(domain: ModuleType, body: Component, **elements: Component) -> Bench:
    """A body, and elements side by side between the ground (flange a) and its flange b."""
    ground = domain.Fixed()
    joints: list[tuple[Port, Port]] = []
    for element in elements.values():
        joints += [(ground.flange, element.flange_a), (body.flange_b, element.flange_b)]
    return joined(*joints, body=body, ground=ground, **elements)


def run(model: Component, duration: float, **options: Any):
    return simulate(model, duration, **({"points": 201, "rtol": RTOL} | options))


@dataclass(frozen=True)
class Motion:
    """A body of inertia m, started at x0 with v0, under one element: closed(m, x0, v0, t, **parameters)."""

    element: str
    closed: Callable[..., np.ndarray]
    parameters: dict[str, float]
    x0: float = 0.0
    v0: float = 0.0
    stored: Callable[..., np.ndarray] | None = field(default=None)
    """Energy stored at the relative position x, by the element's parameters; None if it dissipates."""

    def __str__(self):
        return f"{self.element}({', '.join(f'{k}={v:g}' for k, v in self.parameters.items())})"


def oscillation(m, x0, v0, t, c, x_rel0=0.0):
    w = np.sqrt(c / m)
    return x_rel0 + (x0 - x_rel0) * np.cos(w * t) + v0 / w * np.sin(w * t)


def hyperbolic_escape(m, x0, v0, t, c):
    w = np.sqrt(-c / m)
    return x0 * np.cosh(w * t) + v0 / w * np.sinh(w * t)


def exponential_decay(m, x0, v0, t, d):
    return x0 - v0 * m / d * np.expm1(-d * t / m)


def damped_oscillation(m, x0, v0, t, c, d, x_rel0):
    delta = d / (2 * m)
    w = np.sqrt(c / m - delta**2)
    x = x0 - x_rel0
    return x_rel0 + np.exp(-delta * t) * (x * np.cos(w * t) + (v0 + delta * x) / w * np.sin(w * t))


def thrown_against_load(m, x0, v0, t, f_0):
    return x0 + v0 * t - f_0 / (2 * m) * t**2


def coasting_in_air(m, x0, v0, t, d2):
    return x0 + np.sign(v0) * m / d2 * np.log1p(d2 * abs(v0) * t / m)


def coasting_under_power(m, x0, v0, t, d2, q, v_1):
    """dv/dt = -k v^(2 + q) with k = d2/(m v_1^q), so that v^-(1 + q) grows by (1 + q) k each second."""
    k, way = d2 / (m * v_1**q), np.sign(v0)
    v = (abs(v0) ** -(1 + q) + (1 + q) * k * t) ** (-1 / (1 + q))
    return x0 + way * (v**-q - abs(v0) ** -q) / (q * k)


def softening_oscillation(m, x0, v0, t, c, k, f_0=0.0):
    """Integrated by another code to 1e-11."""
    middle = softest(c, k, f_0)

    def change(_, state):
        x, v = state
        return v, -(c * x - f_0) / np.sqrt(1 + k * (x - middle) ** 2) / m

    return solve_ivp(change, (0, t[-1]), [x0, v0], "DOP853", t, rtol=1e-11, atol=1e-13).y[0]


def softest(c, k, f_0):
    return f_0 / c / (1 + k * (f_0 / c / 100) ** 2)


def softening_energy(x, c, k, f_0=0.0):
    middle = softest(c, k, f_0)
    z = x - middle
    return c / k * np.sqrt(1 + k * z**2) + (c * middle - f_0) / np.sqrt(k) * np.arcsinh(np.sqrt(k) * z)


def cubic_oscillation(m, x0, v0, t, c3):
    return x0 * ellipj(x0 * np.sqrt(c3 / m) * t, 0.5)[1]


def quintic_escape(m, x0, v0, t, c5):
    """Its energy is zero: m v^2/2 = -c5 x^6/6, so that x^-2 falls by the same amount in each second."""
    assert np.isclose(m * v0**2, -c5 * x0**6 / 3)
    return x0 / np.sqrt(1 - 2 * v0 / x0 * t)


def sliding_to_rest(m, x0, v0, t, f_c):
    t = np.minimum(t, m * abs(v0) / f_c)
    return x0 + v0 * t - np.sign(v0) * f_c / (2 * m) * t**2


def sliding_to_rest_in_oil(m, x0, v0, t, d, f_c):
    t = np.minimum(t, m / d * np.log1p(d * abs(v0) / f_c))
    return x0 - (v0 + np.sign(v0) * f_c / d) * m / d * np.expm1(-d * t / m) - np.sign(v0) * f_c / d * t


def spring_energy(x, c, x_rel0=0.0):
    return c / 2 * (x - x_rel0) ** 2


MOTIONS = [
    Motion("Spring", oscillation, {"c": 50.0, "x_rel0": 0.02}, 0.1, 0.3, spring_energy),
    Motion("LinearStiffness", oscillation, {"c": 50.0}, 0.1, 0.0, spring_energy),
    Motion("LinearStiffness", hyperbolic_escape, {"c": -8.0}, 0.001, 0.002, spring_energy),
    Motion("LinearStiffness", softening_oscillation, {"c": 50.0, "k": 40.0}, 0.3, 0.5, softening_energy),
    Motion("LinearStiffness", softening_oscillation, {"c": 50.0, "k": 40.0, "f_0": 4.0}, 0.3, 0.5, softening_energy),
    Motion("CubicStiffness", cubic_oscillation, {"c3": 300.0}, 0.4, 0.0, lambda x, c3: c3 / 4 * x**4),
    Motion("CubicStiffness", quintic_escape, {"c5": -0.06}, 0.4, 0.0064, lambda x, c5: c5 / 6 * x**6),
    Motion("ConstantLoad", thrown_against_load, {"f_0": 1.5}, 0.1, 2.0, lambda x, f_0: f_0 * x),
    Motion("SpringDamper", damped_oscillation, {"c": 50.0, "d": 3.0, "x_rel0": -0.05}, 0.1, -0.4),
    Motion("Damper", exponential_decay, {"d": 3.0}, 0.2, 1.0),
    Motion("ViscousFriction", exponential_decay, {"d": 3.0}, 0.2, -1.0),
    Motion("QuadraticDrag", coasting_in_air, {"d2": 2.5}, 0.2, 1.0),
    Motion("QuadraticDrag", coasting_in_air, {"d2": 2.5}, 0.2, -1.0),
    Motion("QuadraticDrag", coasting_under_power, {"d2": 2.5, "q": 0.6, "v_1": 0.7}, 0.2, 1.0),
    Motion("QuadraticDrag", coasting_under_power, {"d2": 2.5, "q": -0.4, "v_1": 2.0}, 0.2, -1.0),
    Motion("CoulombFriction", sliding_to_rest, {"f_c": 2.0}, 0.2, 1.0),
    Motion("CoulombFriction", sliding_to_rest, {"f_c": 2.0}, 0.2, -1.0),
    Motion("Friction", exponential_decay, {"d": 3.0}, 0.2, 1.0),
    Motion("Friction", sliding_to_rest, {"f_c": 2.0}, 0.2, 1.0),
    Motion("Friction", sliding_to_rest_in_oil, {"d": 3.0, "f_c": 2.0}, 0.2, -1.0),
]
EFFECTS = (
    "CoulombFriction",
    "ViscousFriction",
    "ConstantLoad",
    "QuadraticDrag",
    "CubicStiffness",
    "LinearStiffness",
)


@dataclass(frozen=True)
class Domain:
    """The names of one domain: its body with inertia, position, speed, effort, and its friction element."""

    module: ModuleType
    body: str
    inertia: str
    x: str
    v: str
    f: str
    friction: str

    def make_body(self, inertia: float) -> Component:
        return getattr(self.module, self.body)(**{self.inertia: inertia})

    def make(self, motion: Motion) -> Component:
        name = self.friction if motion.element == "Friction" else motion.element
        names = {"x_rel0": f"{self.x}_rel0", "f_0": f"{self.f}_0", "f_c": f"{self.f}_c", "v_1": f"{self.v}_1"}
        return getattr(self.module, name)(**{names.get(k, k): value for k, value in motion.parameters.items()})

    def relative(self, name: str, motion: Motion) -> str:
        """The name of the relative position or speed of the element."""
        return name if motion.element == "Friction" else f"{name}_rel"


def check_motion_under_one_element(domain: Domain, motion: Motion):
    m = 2.0
    model = held(domain.module, domain.make_body(m), element=domain.make(motion))
    x, v, f = domain.x, domain.v, domain.f
    result = run(model, 2.0, start={f"body.{x}": motion.x0, f"body.{v}": motion.v0})
    expected = motion.closed(m, motion.x0, motion.v0, result.time, **motion.parameters)
    np.testing.assert_allclose(result[f"body.{x}"], expected, rtol=0, atol=CLOSE)
    np.testing.assert_allclose(result[f"element.{domain.relative(x, motion)}"], expected, rtol=0, atol=CLOSE)
    # The element alone moves the body: rounding only.
    np.testing.assert_allclose(m * result["body.a"], -result[f"element.{f}"], rtol=1e-12, atol=1e-12)


def check_power_and_momentum_between_two_bodies(domain: Domain, motion: Motion):
    """What an element takes from two free bodies is stored or dissipated, and their momentum stays."""
    m1, m2 = 2.0, 3.0
    one, two, element = domain.make_body(m1), domain.make_body(m2), domain.make(motion)
    model = joined(
        (one.flange_b, element.flange_a), (element.flange_b, two.flange_a), one=one, two=two, element=element
    )
    x, v, f = domain.x, domain.v, domain.f
    start = {f"one.{x}": -0.1, f"one.{v}": 0.4, f"two.{x}": 0.2, f"two.{v}": -0.7}
    result = run(model, 2.0, start=start)
    v1, v2 = result[f"one.{v}"], result[f"two.{v}"]
    np.testing.assert_allclose(m1 * v1 + m2 * v2, m1 * 0.4 - m2 * 0.7, rtol=0, atol=CLOSE)
    v_rel = v2 - v1
    if motion.stored is None:
        # An algebraic identity: rounding only.
        np.testing.assert_allclose(result[f"element.{domain.relative(v, motion)}"], v_rel, rtol=0, atol=1e-12)
    loss = result[f"element.{f}"] * v_rel
    change = m1 * v1 * result["one.a"] + m2 * v2 * result["two.a"]
    # An identity of the equations at each instant: rounding only, of powers up to some tens of watts.
    np.testing.assert_allclose(change, -loss, rtol=0, atol=1e-10)
    energy = m1 / 2 * v1**2 + m2 / 2 * v2**2
    if motion.stored is not None:
        energy = energy + motion.stored(result[f"element.{domain.relative(x, motion)}"], **motion.parameters)
        np.testing.assert_allclose(energy, energy[0], rtol=CLOSE)
    elif "c" not in motion.parameters:
        # No work is given back; a residual speed in stuck phases may cost the tolerance of the integrator.
        assert loss.min() > -CLOSE
        assert np.diff(energy).max() < CLOSE
        assert energy[-1] < 0.9 * energy[0]
    else:
        # A spring and damper: what is not stored is lost in the damper.
        rel = result[f"element.{x}_rel"] - motion.parameters["x_rel0"]
        spring = motion.parameters["c"] * rel * v_rel
        np.testing.assert_allclose(loss - spring, motion.parameters["d"] * v_rel**2, rtol=0, atol=1e-10)
        assert np.diff(energy + motion.parameters["c"] / 2 * rel**2).max() < CLOSE


def check_effect_of_parameter_zero_is_none(domain: Domain, effect: str):
    model = held(
        domain.module,
        domain.make_body(2.0),
        spring=domain.module.Spring(c=50.0),
        effect=getattr(domain.module, effect)(),
    )
    result = run(model, 2.0, start={f"body.{domain.x}": 0.1, f"body.{domain.v}": 0.0})
    np.testing.assert_allclose(
        result[f"body.{domain.x}"], oscillation(2.0, 0.1, 0.0, result.time, 50.0), rtol=0, atol=CLOSE
    )


def check_coulomb_damped_oscillation(domain: Domain, element: Component):
    """The amplitude falls by 4 f_c/c in each full cycle; at rest the spring is held within f_c/c."""
    m, c, f_c, x0 = 2.0, 50.0, 0.75, 0.2
    period = 2 * np.pi * np.sqrt(m / c)
    model = held(domain.module, domain.make_body(m), spring=domain.module.Spring(c=c), element=element)
    start = {f"body.{domain.x}": x0, f"body.{domain.v}": 0.0}
    result = run(model, 6 * period, points=6 * 8 + 1, start=start)
    x, v = result[f"body.{domain.x}"], result[f"body.{domain.v}"]
    # 0.2, 0.14, 0.08 and 0.02; there the spring pulls with 1, slips by half a cycle to 0.01 and stays.
    np.testing.assert_allclose(x[:25:8], x0 - 4 * f_c / c * np.arange(4), rtol=0, atol=CLOSE)
    half_cycles = (-1.0) ** np.arange(8) * (x0 - 2 * f_c / c * np.arange(8))
    np.testing.assert_allclose(x[:29:4], half_cycles, rtol=0, atol=CLOSE)
    np.testing.assert_allclose(x[29:], x[29], rtol=0, atol=CLOSE)
    np.testing.assert_allclose(v[29:], 0.0, atol=CLOSE)
    assert abs(x[-1]) <= f_c / c
    # While it sticks, friction carries the spring force exactly.
    np.testing.assert_allclose(result[f"element.{domain.f}"][30:], -c * x[30:], rtol=0, atol=c * CLOSE)
