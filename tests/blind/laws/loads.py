"""Drag, loads, inertias, and what bends or gives."""

import numpy as np

from blind.laws.law import Law
from blind.stepping import Array, Moment


class Viscous(Law):
    def load(self, m: Moment) -> None:
        m.push(self.along, -self.p["d"] * m.w(self.along))


class Drag(Law):
    """Air: f = d2 v_n^2 |v/v_n|^power sgn v."""

    power = 2.0

    def load(self, m: Moment) -> None:
        z = m.w(self.along) / self.p["v_n"]
        m.push(self.along, -self.p["d2"] * self.p["v_n"] ** 2 * np.sign(z) * np.abs(z) ** self.power)


class DragPower(Drag):
    power = 2.6


class Constant(Law):
    def load(self, m: Moment) -> None:
        m.push(self.along, self.p["f_0"])


class Inertia(Law):
    """A body that turns with the rod, without weight."""

    def mass(self, mass: Array, index: dict[str, int]) -> None:
        k = index["phi"]
        mass[k, k] += self.p["J"]


class Uneven(Law):
    """A rail of the height y(s), f = -(m_c + m_p) g y'(s): three waves, or a dip."""

    def slope(self, x: Array) -> Array:
        k = 2 * np.pi / self.p["period"]
        return self.p["slope"] * (np.sin(k * x + self.p["phase"]) + 0.5 * np.sin(1.7 * k * x + 2 * self.p["phase"]))

    def load(self, m: Moment) -> None:
        p = self.plant.p
        m.push(self.along, -(p["m_c"] + p.get("m_p", 0.0)) * p["g"] * self.slope(m.x(self.along)))


class UnevenDip(Uneven):
    def slope(self, x: Array) -> Array:
        z = (x - self.p["x_dip"]) / (0.3 * self.p["period"])
        return 2 * self.p["slope"] * z * np.exp(-z * z)


class Imbalance(Law):
    """A weight off the axis, tau = -tau_s sin phi - tau_c cos phi."""

    def load(self, m: Moment) -> None:
        m.push("phi", -self.p["tau_s"] * np.sin(m.x("phi")) - self.p["tau_k"] * np.cos(m.x("phi")))


class Base(Law):
    """The base on a spring and a damper; all the rig stands on it."""

    coordinates = ("b",)

    def mass(self, mass: Array, index: dict[str, int]) -> None:
        mass[index["b"], index["b"]] += self.p["m_b"]

    def load(self, m: Moment) -> None:
        x = m.x("b")
        m.push("b", -self.spring(x) - self.p["d_b"] * m.w("b"))

    def spring(self, x: Array) -> Array:
        return self.p["c_b"] * x


class BaseSoft(Base):
    """A base on rubber, which hardens."""

    def spring(self, x: Array) -> Array:
        return self.p["c_b"] * x * (1 + (x / self.p["x_n"]) ** 2)


class Bending(Law):
    """First bending mode of the rod: der2(q) + 2 zeta w der(q) + w^2 q = -gamma der2(phi)."""

    coordinates = ("q",)

    def mass(self, mass: Array, index: dict[str, int]) -> None:
        k, q = index["phi"], index["q"]
        mass[q, q] += 1.0
        mass[k, q] += self.p["gamma"]
        mass[q, k] += self.p["gamma"]

    def load(self, m: Moment) -> None:
        w = 2 * np.pi * self.p["frequency"]
        m.push("q", -w * w * self.stiff(m.x("q")) - 2 * self.p["zeta"] * w * m.w("q"))

    def stiff(self, q: Array) -> Array:
        return q


class BendingHard(Bending):
    """A rod that bends less and less."""

    def stiff(self, q: Array) -> Array:
        return q * (1 + (q / self.p["q_n"]) ** 2)
