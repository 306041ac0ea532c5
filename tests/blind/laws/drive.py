"""Amplifier, motor and gears."""

import numpy as np

from blind.laws.law import Law, linear_end
from blind.stepping import Array, Moment


class Offset(Law):
    def voltage(self, m: Moment, u: Array) -> Array:
        return u + self.p["u_0"]


class Gain(Law):
    def voltage(self, m: Moment, u: Array) -> Array:
        return u * (1 + self.p["e"])


class GainBend(Law):
    """A gain that falls with the voltage."""

    def voltage(self, m: Moment, u: Array) -> Array:
        return u * (1 + self.p["e"] * (1 - 0.5 * np.tanh((u / 12) ** 2)))


class DeadZone(Law):
    """No output between -u_neg and u_pos, and that much less outside."""

    def voltage(self, m: Moment, u: Array) -> Array:
        return np.maximum(u - self.p["u_pos"], 0.0) - np.maximum(-u - self.p["u_neg"], 0.0)


class DeadZoneRounded(Law):
    """A dead zone without corners (crossover of a class-B stage)."""

    def voltage(self, m: Moment, u: Array) -> Array:
        def late(x: Array, width: Array) -> Array:
            soft = 0.4 * width
            z = x - width
            return np.where(
                x > 0, 0.5 * (z + np.sqrt(z * z + soft * soft)) - 0.5 * (np.sqrt(width**2 + soft**2) - width), 0
            )

        return late(u, self.p["u_pos"]) - late(-u, self.p["u_neg"])


class Saturation(Law):
    def voltage(self, m: Moment, u: Array) -> Array:
        return np.clip(u, -self.p["u_max"], self.p["u_max"])


class SaturationSoft(Law):
    """A supply that gives way gradually."""

    def voltage(self, m: Moment, u: Array) -> Array:
        z = np.abs(u / self.p["u_max"])
        return u / (1 + z**6) ** (1 / 6)


class Sag(Law):
    """Output resistance."""

    is_implicit = True

    def drop(self, m: Moment, i: Array) -> tuple[Array, Array]:
        return self.p["R_s"] * i, self.p["R_s"]


class SagBent(Sag):
    """A supply whose voltage drops with the square of the current."""

    def drop(self, m: Moment, i: Array) -> tuple[Array, Array]:
        return self.p["R_s"] * i * np.abs(i) / 4, self.p["R_s"] * np.abs(i) / 2


class Delay(Law):
    shifts_time = True

    def late(self, t: Array) -> Array:
        return t - self.p["T_d"]


class DelayLag(Law):
    """A lag of two equal low passes with the same delay in all."""

    def begin(self, m: Moment) -> None:
        self.a, self.b, self.raw = self.zero.copy(), self.zero.copy(), self.zero

    def voltage(self, m: Moment, u: Array) -> Array:
        self.raw = u
        return self.b

    def advance(self, m: Moment, h: Array) -> None:
        rate = 2 / self.p["T_d"]
        self.a = linear_end(self.a, self.raw, rate, h)
        self.b = linear_end(self.b, self.a, rate, h)


class Rate(Law):
    """The voltage changes by r a second at most."""

    def begin(self, m: Moment) -> None:
        self.out, self.raw = self.zero.copy(), self.zero

    def voltage(self, m: Moment, u: Array) -> Array:
        self.raw = u
        return self.out

    def advance(self, m: Moment, h: Array) -> None:
        self.out = self.out + self.change(self.raw - self.out, self.p["r"] * h)

    def change(self, gap: Array, most: Array) -> Array:
        return np.clip(gap, -most, most)


class RateSoft(Rate):
    """A slew rate that sets in gradually."""

    def change(self, gap: Array, most: Array) -> Array:
        return most * gap / (most + np.abs(gap))


class Brush(Law):
    """Drop of the brushes, v = V_b tanh(i / i_b)."""

    is_implicit = True

    def drop(self, m: Moment, i: Array) -> tuple[Array, Array]:
        z = np.tanh(i / self.p["i_b"])
        return self.p["V_b"] * z, self.p["V_b"] * (1 - z * z) / self.p["i_b"]


class BrushRoot(Brush):
    """Drop of the brushes by another curve, v = V_b i / (|i| + i_b)."""

    def drop(self, m: Moment, i: Array) -> tuple[Array, Array]:
        size = np.abs(i) + self.p["i_b"]
        return self.p["V_b"] * i / size, self.p["V_b"] * self.p["i_b"] / size**2


class Saturated(Law):
    """Torque constant k / (1 + (i / i_s)^2)."""

    is_implicit = True

    def flux(self, m: Moment, i: Array) -> tuple[Array, Array]:
        z = i / self.p["i_s"]
        factor = 1 / (1 + z * z)
        return factor, -2 * z / self.p["i_s"] * factor**2


class SaturatedTanh(Saturated):
    """Torque constant that falls as tanh(x)/x."""

    def flux(self, m: Moment, i: Array) -> tuple[Array, Array]:
        z = np.maximum(np.abs(i) / self.p["i_s"] * 1.7, 1e-4)
        th = np.tanh(z)
        slope = ((1 - th * th) * z - th) / (z * z) * 1.7 / self.p["i_s"] * np.sign(i)
        return th / z, slope


class Heating(Law):
    """Winding that warms: R (1 + alpha T), C der(T) = R i^2 - T / R_th."""

    weakens = 0.0

    def begin(self, m: Moment) -> None:
        self.T = self.zero.copy()

    def advance(self, m: Moment, h: Array) -> None:
        heat = self.plant.p["R"] * (1 + self.p["alpha"] * self.T) * m.i**2
        self.T = linear_end(self.T, heat * self.p["R_th"], 1 / (self.p["C_th"] * self.p["R_th"]), h)

    def motor(self, m: Moment, ratio: Array, k: Array, R: Array) -> tuple[Array, Array, Array]:
        return ratio, k * (1 - self.weakens * self.T), R * (1 + self.p["alpha"] * self.T)


class HeatingMagnet(Heating):
    """The same, and the magnets weaken by 0.2 % a kelvin."""

    weakens = 0.002


class Cogging(Law):
    """Detent torque of the motor by harmonics of n_teeth, independent of the current."""

    def wave(self, z: Array) -> Array:
        return np.sin(z + self.p["phase"]) + 0.4 * np.sin(2 * z + 2.3 * self.p["phase"])

    def load(self, m: Moment) -> None:
        n = self.plant.p["n"]
        m.push("s", n * self.p["tau_k"] * self.wave(self.p["n_teeth"] * n * m.x("s")))


class CoggingSharp(Cogging):
    """Detents with steep flanks."""

    def wave(self, z: Array) -> Array:
        return np.tanh(3 * np.sin(z + self.p["phase"])) * np.cos(z / 2) ** 2 * 1.5


class Ripple(Law):
    """Torque constant that changes with the angle, in torque and back-EMF alike."""

    def wave(self, z: Array) -> Array:
        return np.cos(z + self.p["phase"])

    def motor(self, m: Moment, ratio: Array, k: Array, R: Array) -> tuple[Array, Array, Array]:
        angle = self.plant.p["n"] * m.x("s")
        return ratio, k * (1 + self.p["a"] * self.wave(self.p["n_teeth"] * angle)), R


class RippleSharp(Ripple):
    """A ripple with cusps, as a commutator of few segments makes it."""

    def wave(self, z: Array) -> Array:
        return 1.6 * np.abs(np.sin((z + self.p["phase"]) / 2)) - 1.02


class Eccentric(Law):
    """Ratio of the gears n / (1 + e cos(turns n s + phase)), in speed and force alike."""

    def factor(self, z: Array) -> Array:
        return 1 + self.p["e"] * np.cos(z + self.p["phase"])

    def motor(self, m: Moment, ratio: Array, k: Array, R: Array) -> tuple[Array, Array, Array]:
        return ratio / self.factor(self.plant.p["n"] * m.x("s") * self.p["turns"]), k, R


class EccentricOval(Eccentric):
    """An oval wheel: the second harmonic as well."""

    def factor(self, z: Array) -> Array:
        return 1 + self.p["e"] * (np.cos(z + self.p["phase"]) + 0.6 * np.cos(2 * z))


class Polygon(Law):
    """Sprocket of n_teeth: radius r cos(mod(angle, pitch) - pitch/2), of which the model has the mean."""

    def motor(self, m: Moment, ratio: Array, k: Array, R: Array) -> tuple[Array, Array, Array]:
        half = np.pi / self.p["n_teeth"]
        z = np.mod(m.x("s") / self.p["radius"] + self.p["phase"], 2 * half) - half
        return ratio / (np.cos(z) * half / np.sin(half)), k, R
