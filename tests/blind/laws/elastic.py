"""Springs, stops, play and hysteresis."""

import numpy as np

from blind.laws.law import Law, linear_end
from blind.stepping import Array, Moment


class Linear(Law):
    def load(self, m: Moment) -> None:
        m.push(self.along, -self.p["c"] * (m.x(self.along) - self.p["x_0"]))


class LinearRounded(Law):
    """A spring that loses a little of its stiffness as it stretches."""

    def load(self, m: Moment) -> None:
        z = (m.x(self.along) - self.p["x_0"]) / self.p["x_n"]
        m.push(self.along, -self.p["c"] * self.p["x_n"] * np.arctan(0.5 * z) / 0.5)


class Cubic(Law):
    """Force c3 x^3 of the coordinate, or of the stretch of one of the two springs."""

    def force(self, x: Array) -> Array:
        return self.p["c3"] * x**3

    def load(self, m: Moment) -> None:
        x, a = m.x(self.along), self.plant.p.get("a", self.zero)
        if self.at == "spring_1":
            m.push(self.along, -self.force(x + a))
        elif self.at == "spring_2":
            m.push(self.along, self.force(a - x))
        else:
            m.push(self.along, -self.force(x))


class Hardening(Cubic):
    """A spring that hardens as a hyperbolic sine without its linear part."""

    def force(self, x: Array) -> Array:
        z = x / self.p["x_n"]
        return 6 * self.p["c3"] * self.p["x_n"] ** 3 * (np.sinh(2 * z) / 8 - z / 4)


class Slack(Law):
    """A spring that cannot push, from the stretch x_0 on."""

    width = 0.0

    def load(self, m: Moment) -> None:
        p, x = self.plant.p, m.x(self.along)
        sign, c = (1.0, p["K1"]) if self.at == "spring_1" else (-1.0, p["K2"])
        z = p["a"] + sign * x - self.p["x_0"]
        rounded = 0.5 * (z + np.sqrt(z * z + self.width**2))
        # what the plant has is c (a + sign x)
        m.push(self.along, sign * c * (z + self.p["x_0"] - rounded))


class SlackRounded(Slack):
    """A hook that lets go over some millimetres."""

    width = 0.006


class Stop(Law):
    """One-sided stop at x_m, f = c z^1.5 (1 + 0.3 der(z)) of the depth z."""

    power, loss = 1.5, 0.3

    def load(self, m: Moment) -> None:
        z = np.maximum(m.x(self.along) - self.p["x_m"], 0.0)
        damping = np.maximum(1 + self.loss * m.w(self.along) / self.p["v_n"], 0.0)
        m.push(self.along, -self.p["c"] * self.p["x_n"] * (z / self.p["x_n"]) ** self.power * damping)


class StopLinear(Stop):
    """A buffer with linear spring and more damping."""

    power, loss = 1.0, 0.8


class Cable(Law):
    """A hose: linear spring and elastic friction in one."""

    slips: tuple[float, ...] = (1.0,)

    def begin(self, m: Moment) -> None:
        self.z = [self.zero.copy() for _ in self.slips]

    def advance(self, m: Moment, h: Array) -> None:
        v, p = m.w(self.along), self.p
        self.z = [
            linear_end(z, np.sign(v) * p["x_slip"] * slip, np.abs(v) / (p["x_slip"] * slip), h)
            for z, slip in zip(self.z, self.slips, strict=True)
        ]

    def load(self, m: Moment) -> None:
        p = self.p
        memory = sum(z / slip for z, slip in zip(self.z, self.slips, strict=True))
        m.push(self.along, -p["c"] * (m.x(self.along) - p["x_0"]) - p["f_h"] * memory / p["x_slip"] / len(self.slips))


class CableLayers(Cable):
    """The same with three layers that slip at different lengths."""

    slips = (0.3, 1.0, 3.0)


class BoucWen(Law):
    """Hysteretic spring f = c_h z: der(z) = v - |v| |z/z_h|^(n-1) z/z_h (0.5 + 0.5 sgn(v z)) ..., n = 1."""

    def begin(self, m: Moment) -> None:
        self.z = self.zero.copy()

    def advance(self, m: Moment, h: Array) -> None:
        move, z_h = m.w(self.along) * h, self.p["z_h"]
        for _ in range(2):
            half = 0.5 * move
            loading = 0.7 * np.abs(half) * self.z / z_h + 0.3 * half * np.abs(self.z) / z_h
            trial = self.z + 0.5 * (half - loading)
            self.z = self.z + half - 0.7 * np.abs(half) * trial / z_h - 0.3 * half * np.abs(trial) / z_h

    def load(self, m: Moment) -> None:
        m.push(self.along, -self.p["c_h"] * self.z)


class Prandtl(BoucWen):
    """Hysteresis of another kind: plays of seven widths in parallel (Prandtl and Ishlinskii)."""

    def begin(self, m: Moment) -> None:
        self.parts = [self.zero.copy() for _ in range(7)]
        self.z = self.zero.copy()

    def advance(self, m: Moment, h: Array) -> None:
        move, z_h = m.w(self.along) * h, self.p["z_h"]
        limits = [2 * (k + 0.5) / 7 * z_h for k in range(7)]
        self.parts = [np.clip(z + move, -limit, limit) for z, limit in zip(self.parts, limits, strict=True)]
        self.z = sum(self.parts, self.zero) / 7


class Torsion(Law):
    """Torsion of a cable or of grease: c phi and a slow part that relaxes over T."""

    def begin(self, m: Moment) -> None:
        self.z = self.zero.copy()

    def advance(self, m: Moment, h: Array) -> None:
        self.z = linear_end(self.z, m.x(self.along), 1 / self.p["T"], h)

    def load(self, m: Moment) -> None:
        x = m.x(self.along)
        m.push(self.along, -self.p["c"] * x - self.p["c_m"] * (x - self.z))


class TorsionSlip(Torsion):
    """Torsion whose memory is that of elastic friction."""

    def advance(self, m: Moment, h: Array) -> None:
        v, slip = m.w(self.along), 0.1
        self.z = linear_end(self.z, np.sign(v) * slip, np.abs(v) / slip, h)

    def load(self, m: Moment) -> None:
        m.push(self.along, -self.p["c"] * m.x(self.along) - 0.5 * self.p["c_m"] * self.z)


class Series(Law):
    """A spring-damper in series: in the chain, between motor and gears, or between bearing and rod.

    In the chain it adds the coordinate of the cart. The other two sides have no mass: their position p follows
    from the balance of their torques, d der(p) = spring + damper.
    """

    def __init__(self, at: str, p: dict[str, Array]) -> None:
        super().__init__(at, p)
        self.coordinates = ("c",) if at == "chain" else ()
        self.drives, self.is_node = at == "motor", at == "bearing"

    def spring(self, z: Array) -> tuple[Array, Array]:
        """Force at the stretch z, and whether the damper acts (0 to 1)."""
        return self.p["c"] * z, self.zero + 1.0

    def begin(self, m: Moment) -> None:
        self.place = m.x("phi").copy() if self.is_node else self.zero.copy()
        if self.at == "chain":
            m.q[m.index["c"]] = m.x("s")

    def load(self, m: Moment) -> None:
        if self.at == "chain":
            force, contact = self.spring(m.x("s") - m.x("c"))
            force = force + contact * self.p["d"] * (m.w("s") - m.w("c"))
            m.push("s", -force)
            m.push("c", force)
        elif self.is_node:
            m.push("phi", -self._transmitted(m, "phi")[0])

    def drive(self, m: Moment) -> None:
        force, speed = self._transmitted(m, "s")
        p = self.plant.p
        m.i = (m.u - p["k"] * p["n"] * speed) / p["R"]
        m.push("s", -force)

    def _transmitted(self, m: Moment, coordinate: str) -> tuple[Array, Array]:
        """Return the force on the far side and the speed of the near side, which has no mass."""
        p = self.plant.p
        spring, contact = self.spring(m.x(coordinate) - self.place)
        damper = contact * self.p["d"]
        if self.is_node:
            push, drag = self.zero, p["d_bearing"]
        else:
            push, drag = p["n"] * p["k"] * m.u / p["R"], (p["n"] * p["k"]) ** 2 / p["R"]
        speed = (push + spring + damper * m.w(coordinate)) / (drag + damper)
        return spring + damper * (m.w(coordinate) - speed), speed

    def advance(self, m: Moment, h: Array) -> None:
        if self.at != "chain":
            before = self.place
            coordinate = "phi" if self.is_node else "s"
            self.place = before + 0.5 * h * self._transmitted(m, coordinate)[1]
            self.place = before + h * self._transmitted(m, coordinate)[1]

    def angle(self, m: Moment) -> Array:
        return self.place


class SeriesHardening(Series):
    """A chain or shaft that gets stiffer with its load."""

    def spring(self, z: Array) -> tuple[Array, Array]:
        return self.p["c"] * z * (0.6 + (z / self.p["z_n"]) ** 2), self.zero + 1.0


class Backlash(Series):
    """Play of width b; in contact a spring-damper."""

    def spring(self, z: Array) -> tuple[Array, Array]:
        depth = np.maximum(np.abs(z) - self.p["b"] / 2, 0.0)
        return self.p["c"] * np.sign(z) * depth, np.where(depth > 0, 1.0, 0.0)


class BacklashRounded(Series):
    """Play without corners: the contact sets in gradually."""

    def spring(self, z: Array) -> tuple[Array, Array]:
        half = self.p["b"] / 2
        soft = 0.25 * half
        reach = np.abs(z) - half
        depth = 0.5 * (reach + np.sqrt(reach * reach + soft * soft))
        share = np.tanh(np.abs(z) / soft)
        return self.p["c"] * np.sign(z) * depth * share, 0.5 * (1 + reach / np.sqrt(reach * reach + soft * soft))
