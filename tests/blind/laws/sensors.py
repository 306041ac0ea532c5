"""Errors of the sensors; `at` is the name of an output."""

import numpy as np

from blind.laws.law import Law, linear_end
from blind.stepping import Array, Moment

Shown = dict[str, Array]


class Sensor(Law):
    def show(self, m: Moment, shown: Shown, sample: int) -> Shown:
        return shown | {self.at: self.read(shown[self.at], sample)}

    def read(self, y: Array, sample: int) -> Array:
        return y


class Bias(Sensor):
    def read(self, y: Array, sample: int) -> Array:
        return y + self.p["y_0"]


class Scale(Sensor):
    def read(self, y: Array, sample: int) -> Array:
        return y * (1 + self.p["e"])


class ScaleBent(Sensor):
    """A gain error that shrinks with the amplitude."""

    def read(self, y: Array, sample: int) -> Array:
        return y * (1 + self.p["e"] / (1 + (y / self.p["y_n"]) ** 2))


class BiasAndScale(Sensor):
    """Current sensor y = (1 + e) i + y_0."""

    def read(self, y: Array, sample: int) -> Array:
        return y * (1 + self.p["e"]) + self.p["y_0"]


class BiasAndSides(Sensor):
    """Current sensor that reads positive and negative currents with different gains."""

    def read(self, y: Array, sample: int) -> Array:
        return y * (1 + self.p["e"] * np.where(y > 0, 1.3, 0.5)) + self.p["y_0"]


class Wave(Sensor):
    """Error with the turns of the encoder, first and second harmonic."""

    def wave(self, z: Array) -> Array:
        return np.sin(z + self.p["phase"]) + 0.5 * np.sin(2 * z + 2 * self.p["phase"])

    def read(self, y: Array, sample: int) -> Array:
        return y + self.p["a"] * self.wave(self.p["turns"] * y)


class WaveTriangle(Wave):
    """Error of an interpolator: a triangle."""

    def wave(self, z: Array) -> Array:
        return 2 / np.pi * np.arcsin(np.sin(z + self.p["phase"]))


class LowPass(Sensor):
    """First-order low pass with the time constant T_d."""

    def begin(self, m: Moment) -> None:
        self.z: Array | None = None

    def _true(self, m: Moment) -> Array:
        return {"encoder.s": lambda: m.x("s"), "bearing.phi": lambda: m.x("phi"), "motor.i": lambda: m.i}[self.at]()

    def advance(self, m: Moment, h: Array) -> None:
        if self.z is None:
            self.z = self._true(m).copy()
        self.z = linear_end(self.z, self._true(m), 1 / self.p["T_d"], h)

    def show(self, m: Moment, shown: Shown, sample: int) -> Shown:
        return shown if self.z is None else shown | {self.at: self.z}


class DeadTime(LowPass):
    """A pure delay: a chain of twelve low passes that takes T_d in all."""

    order = 12

    def begin(self, m: Moment) -> None:
        self.chain: list[Array] | None = None

    def advance(self, m: Moment, h: Array) -> None:
        true = self._true(m)
        if self.chain is None:
            self.chain = [true.copy() for _ in range(self.order)]
        for k in range(self.order):
            self.chain[k] = linear_end(self.chain[k], true, self.order / self.p["T_d"], h)
            true = self.chain[k]

    def show(self, m: Moment, shown: Shown, sample: int) -> Shown:
        return shown if self.chain is None else shown | {self.at: self.chain[-1]}


class Steps(Sensor):
    """Readings in steps of q, and counts lost at one instant."""

    def read(self, y: Array, sample: int) -> Array:
        lost = np.where(sample * 0.01 > self.p["t_lost"], self.p["q"] * np.round(self.p["n_lost"]), 0.0)
        return self.p["q"] * np.round(y / self.p["q"]) - lost


class StepsDown(Steps):
    """Readings cut off, not rounded."""

    def read(self, y: Array, sample: int) -> Array:
        lost = np.where(sample * 0.01 > self.p["t_lost"], self.p["q"] * np.round(self.p["n_lost"]), 0.0)
        return self.p["q"] * np.trunc(y / self.p["q"]) - lost


class Clock(Law):
    """The logger's clock: t_m = t / (1 + e)."""

    shifts_time = True

    def clock(self, h: Array) -> Array:
        return h * (1 + self.p["e"])
