"""Friction: dry laws as set-valued impulses, laws with memory as internal states."""

import numpy as np

from blind.laws.law import Law, linear_end
from blind.stepping import Array, Moment


class Dry(Law):
    """Friction of a level that may depend on the motion; `hold` is what it holds at rest."""

    def level(self, m: Moment) -> Array:
        raise NotImplementedError

    def hold(self, m: Moment) -> Array:
        return self.level(m)

    def load(self, m: Moment) -> None:
        level, hold = self.level(m), self.hold(m)
        m.rub(self.along, level, level, hold, hold)


class Coulomb(Dry):
    def level(self, m: Moment) -> Array:
        return self.p["f_c"]


class Creep(Law):
    """Dry friction rounded at low speed: it creeps and never sticks."""

    def load(self, m: Moment) -> None:
        m.push(self.along, -self.p["f_c"] * np.tanh(m.w(self.along) / self.p["v_creep"]))


class Stribeck(Dry):
    """Level from f_s down to f_c over the speed v_s, by one of three curves."""

    curve = "gauss"

    def level(self, m: Moment) -> Array:
        z = np.abs(m.w(self.along)) / self.p["v_s"]
        fall = {"gauss": np.exp(-z * z), "hess": 1 / (1 + z) ** 2, "line": np.clip(1 - 0.6 * z, 0, 1)}[self.curve]
        return self.p["f_c"] + (self.p["f_s"] - self.p["f_c"]) * fall

    def hold(self, m: Moment) -> Array:
        return self.p["f_s"]


class StribeckHess(Stribeck):
    curve = "hess"


class StribeckLine(Stribeck):
    curve = "line"


class Loaded(Dry):
    """Level in proportion to the load of the joint (or of the gears), with a power of it."""

    power = 1.0

    def level(self, m: Moment) -> Array:
        if self.along == "phi":
            p = self.plant.p
            axial = p["m_p"] * (p["g"] * np.cos(m.x("phi")) + p["l"] / 2 * m.w("phi") ** 2)
            load, nominal = np.abs(axial), p["m_p"] * p["g"]
        else:
            load, nominal = np.abs(self.plant.p["n"] * self.plant.p["k"] * m.i), self.p["f_n"]
        return self.p["mu0"] + self.p["mu1"] * nominal * (load / nominal) ** self.power


class LoadedQuadratic(Loaded):
    power = 2.0


class Asymmetric(Law):
    """Dry and viscous friction that depend on the direction."""

    power = 1.0

    def load(self, m: Moment) -> None:
        p, v = self.p, m.w(self.along)
        m.rub(self.along, p["f_c_pos"], p["f_c_neg"], p["f_c_pos"], p["f_c_neg"])
        speed = np.abs(v) / p["v_n"]
        viscous = p["v_n"] * speed**self.power * np.where(v > 0, p["d_pos"], p["d_neg"])
        m.push(self.along, -np.sign(v) * viscous)


class AsymmetricPower(Asymmetric):
    power = 1.5


class Placed(Dry):
    """Level that changes along the way: a wave, or a sticky spot."""

    def level(self, m: Moment) -> Array:
        p = self.p
        return p["f_c"] * (1 + p["a"] * np.cos(2 * np.pi * m.x(self.along) / p["period"] + p["phase"]))


class PlacedSpot(Dry):
    def level(self, m: Moment) -> Array:
        p = self.p
        z = (m.x(self.along) - p["x_spot"]) / p["width"]
        return p["f_c"] * (1 + 2 * p["a"] * np.exp(-z * z))


class Dahl(Law):
    """Elastic before it slides: der(z) = v (1 - c z sgn v / f_c), f = c z."""

    def begin(self, m: Moment) -> None:
        self.z = self.zero.copy()

    def advance(self, m: Moment, h: Array) -> None:
        v, p = m.w(self.along), self.p
        self.z = linear_end(self.z, np.sign(v) * p["f_c"] / p["c"], np.abs(v) * p["c"] / p["f_c"], h)

    def load(self, m: Moment) -> None:
        m.push(self.along, -self.p["c"] * self.z)


class DahlSquare(Dahl):
    """The same with the square of the bracket: it yields more gradually."""

    def advance(self, m: Moment, h: Array) -> None:
        v, p = m.w(self.along), self.p
        level = p["f_c"] / p["c"]
        # der(e) = -|v|/level e^2 with e = 1 - z sgn v / level has the solution e / (1 + e |v| h / level)
        e = 1 - self.z * np.sign(v) / level
        e = e / (1 + e * np.abs(v) * h / level)
        self.z = np.where(v == 0, self.z, np.sign(v) * level * (1 - e))


class LuGre(Dahl):
    """Bristles: der(z) = v - c |v| z / g(v), f = c z + d1 der(z), g a Stribeck curve."""

    curve = "gauss"

    def _g(self, v: Array) -> Array:
        p, z = self.p, np.abs(v) / self.p["v_s"]
        return p["f_c"] + (p["f_s"] - p["f_c"]) * (np.exp(-z * z) if self.curve == "gauss" else 1 / (1 + z))

    def advance(self, m: Moment, h: Array) -> None:
        v, c = m.w(self.along), self.p["c"]
        g = self._g(v)
        self.z = linear_end(self.z, np.sign(v) * g / c, np.abs(v) * c / g, h)

    def load(self, m: Moment) -> None:
        v, p = m.w(self.along), self.p
        rate = v - p["c"] * np.abs(v) * self.z / self._g(v)
        m.push(self.along, -p["c"] * self.z - p["d1"] * rate)


class LuGreHess(LuGre):
    curve = "hess"


class MaxwellSlip(Law):
    """Springs in parallel that slip one after the other: a quarter of f_c each, at 1, 2, 3 and 4 parts of x_slip."""

    shares: tuple[float, ...] = (0.25, 0.25, 0.25, 0.25)
    slips: tuple[float, ...] = (0.4, 0.8, 1.2, 1.6)

    def begin(self, m: Moment) -> None:
        self.z = [self.zero.copy() for _ in self.shares]

    def advance(self, m: Moment, h: Array) -> None:
        move = m.w(self.along) * h
        limits = [slip * self.p["x_slip"] for slip in self.slips]
        self.z = [np.clip(z + move, -limit, limit) for z, limit in zip(self.z, limits, strict=True)]

    def load(self, m: Moment) -> None:
        stretched = sum(s * z / slip for s, z, slip in zip(self.shares, self.z, self.slips, strict=True))
        m.push(self.along, -self.p["f_c"] * stretched / self.p["x_slip"])


class MaxwellSlipMany(MaxwellSlip):
    """Eight elements whose limits grow geometrically and whose shares fall."""

    shares = tuple(np.array([8, 7, 6, 5, 4, 3, 2, 1]) / 36)
    slips = tuple(0.1 * 1.6 ** np.arange(8))


class Breakaway(Dry):
    """Level f_c while it slides, a higher one f_s that holds it at rest."""

    def level(self, m: Moment) -> Array:
        return self.p["f_c"]

    def hold(self, m: Moment) -> Array:
        return self.p["f_s"]


class BreakawayDwell(Breakaway):
    """What holds it at rest grows from f_c to f_s with the time of rest."""

    def begin(self, m: Moment) -> None:
        self.rest = self.zero.copy()

    def advance(self, m: Moment, h: Array) -> None:
        self.rest = np.where(m.w(self.along) == 0, self.rest + h, 0.0)

    def hold(self, m: Moment) -> Array:
        return self.p["f_c"] + (self.p["f_s"] - self.p["f_c"]) * (1 - np.exp(-self.rest / 0.1))


class ChainTension(Dry):
    """Rails pressed by the chain: level f_c + mu |chain force|, the force of the last step."""

    power = 1.0

    def level(self, m: Moment) -> Array:
        p = self.plant.p
        drive = p["n"] * p["k"] * m.i if "k" in p else 0.0
        force = np.abs(drive - p["m_in"] * m.a[m.index["s"]])
        return self.p["f_c"] + self.p["mu"] * self.p["f_n"] * (force / self.p["f_n"]) ** self.power


class ChainTensionPower(ChainTension):
    power = 1.5


class GearLoss(Dry):
    """Efficiency eta of the gears, in both quadrants: part of the load torque becomes dry friction."""

    floor = 0.0

    def level(self, m: Moment) -> Array:
        force, eta = self.plant.p["n"] * self.plant.p["k"] * m.i, 1 - self.p["loss"]
        share = np.where(force * m.w(self.along) >= 0, 1 - eta, 1 / eta - 1)
        return share * (np.abs(force) + self.floor * self.p["f_n"])


class GearLossPreload(GearLoss):
    """The same with a preload of the teeth."""

    floor = 0.3


class IronLoss(Dry):
    """Eddy currents and hysteresis of the iron at the motor: tau = d w + tau_c sgn w."""

    def level(self, m: Moment) -> Array:
        return self.plant.p["n"] * self.p["tau_c"]

    def load(self, m: Moment) -> None:
        super().load(m)
        n = self.plant.p["n"]
        m.push(self.along, -n * n * self.p["d"] * m.w(self.along))


class IronLossPower(IronLoss):
    """Losses of the iron that grow with the power 0.5 of the speed."""

    def level(self, m: Moment) -> Array:
        n = self.plant.p["n"]
        return n * self.p["tau_c"] * (0.4 + np.sqrt(np.abs(m.w(self.along)) * n / 20))

    def hold(self, m: Moment) -> Array:
        return 0.4 * self.plant.p["n"] * self.p["tau_c"]
