"""The three rigs as one mechanism: cart between springs or driven by a motor, with a rod, or a rod alone.

Coordinates: `s` motor side of the chain, which the encoder reads; `c` cart, where the chain gives; `phi` rod,
0 = hanging, tip towards +s; `b` base under the rail, where it gives; `q` bending of the rod. Positions of cart and
motor are against the base. A law (see `laws`) is something that the model of the study does not have.
"""

from collections.abc import Sequence

import numpy as np

from blind.laws.law import Law
from blind.stepping import Array, Moment, inverse_of, velocities

SAMPLE = 0.01


class Plant:
    """A rig with parameters (n_sets,) each, and the laws that its model lacks."""

    def __init__(self, coordinates: tuple[str, ...], p: dict[str, Array], laws: Sequence[Law]) -> None:
        extra = dict.fromkeys(name for law in laws for name in law.coordinates)
        names = (*coordinates, *extra)
        self.p, self.laws, self.size = p, tuple(laws), next(iter(p.values())).size
        self.index = {name: k for k, name in enumerate(names)}
        cart = "c" if "c" in names else "s" if "s" in names else None
        self.cart = cart
        self.carriers = [self.index[name] for name in (cart, "b") if name in self.index]
        self.zero = np.zeros(self.size)
        for law in self.laws:
            law.join(self)
        self.shaft = next((law for law in self.laws if law.drives), None)
        self.implicit = [law for law in self.laws if law.is_implicit]
        self.node = next((law for law in self.laws if law.is_node), None)
        self.constant_mass = self._constant_mass()

    def coordinate(self, place: str) -> str:
        """Coordinate along which friction or load of a place acts."""
        return {"rail": self.cart or "", "bearing": "phi"}.get(place, "s")

    def _constant_mass(self) -> Array:
        n, p = len(self.index), self.p
        mass = np.zeros((n, n, self.size))
        if "s" in self.index:
            mass[0, 0] += p["m_in"]
        carried = p.get("m_c", self.zero) + (p["m_p"] if "phi" in self.index else 0.0)
        for a in self.carriers:
            for b in self.carriers:
                mass[a, b] += carried
        if "phi" in self.index:
            k = self.index["phi"]
            mass[k, k] += p["m_p"] * p["l"] ** 2 / 3
        for law in self.laws:
            law.mass(mass, self.index)
        return mass

    def mass(self, q: Array) -> Array:
        """Mass matrix (n, n, n_sets) at positions q (n, n_sets)."""
        if "phi" not in self.index or not self.carriers:
            return self.constant_mass
        mass, k = self.constant_mass.copy(), self.index["phi"]
        coupling = self.p["m_p"] * self.p["l"] / 2 * np.cos(q[k])
        for a in self.carriers:
            mass[a, k] += coupling
            mass[k, a] += coupling
        return mass

    def load(self, m: Moment) -> None:
        """Put all forces and dry friction of a moment into it."""
        p = self.p
        if self.cart:
            m.push(self.cart, -p["d_rail"] * m.w(self.cart))
        if "K1" in p:
            x = m.x("c" if "c" in m.index else "s")
            m.push(self.cart or "", p["K2"] * (p["a"] - x) - p["K1"] * (x + p["a"]))
        if "phi" in m.index:
            moment, phi, w = p["m_p"] * p["l"] / 2, m.x("phi"), m.w("phi")
            damping = 0.0 if self.node and self.node.at == "bearing" else p["d_bearing"]
            m.push("phi", -moment * p["g"] * np.sin(phi) - damping * w)
            for k in self.carriers:
                m.force[k] += moment * np.sin(phi) * w * w
        if "k" in p:
            self.drive(m)
        for law in self.laws:
            law.load(m)

    def drive(self, m: Moment) -> None:
        """Current of the motor and its force on the chain."""
        if self.shaft is not None:
            self.shaft.drive(m)
            return
        ratio, k, R = self.p["n"], self.p["k"], self.p["R"]
        for law in self.laws:
            ratio, k, R = law.motor(m, ratio, k, R)
        speed = ratio * m.w("s")
        if not self.implicit:
            m.i = (m.u - k * speed) / R
            m.push("s", ratio * k * m.i)
            return
        i = self._current(m, k * speed, R)
        flux = 1.0
        for law in self.implicit:
            flux = flux * law.flux(m, i)[0]
        m.i = i
        m.push("s", ratio * k * flux * i)

    def _current(self, m: Moment, emf: Array, R: Array) -> Array:
        """Solve R i + drops(i) + flux(i) emf = u by Newton's method, kept between bounds that close in."""
        i, low, high = m.i, self.zero - 1e3, self.zero + 1e3
        for _ in range(60):
            drop, slope, flux, bend = R * i, R, self.zero + 1.0, self.zero
            for law in self.implicit:
                more, steeper = law.drop(m, i)
                factor, change = law.flux(m, i)
                drop, slope, flux, bend = drop + more, slope + steeper, flux * factor, bend + change
            rest = drop + flux * emf - m.u
            wrong = np.abs(rest) > 1e-9
            if not wrong.any():
                break
            low, high = np.where(rest < 0, i, low), np.where(rest > 0, i, high)
            trial = i - rest / (slope + bend * emf)
            i = np.where(wrong, np.where((trial > low) & (trial < high), trial, 0.5 * (low + high)), i)
        return i


def run(
    plant: Plant, start: dict[str, Array], n_samples: int, substeps: int, u: Array | None = None,
    pushes: dict[str, Array] | None = None,
) -> dict[str, Array]:  # fmt: skip
    """Simulate all data sets of a plant; return outputs without noise, shape (n_samples, n_sets) each.

    Parameters
    ----------
    plant
        The rig.
    start
        Positions by coordinate; everything starts at rest.
    n_samples, substeps
        Samples at 100 Hz, steps between them.
    u
        Voltage held from each sample to the next, shape (n_samples, n_sets).
    pushes
        Disturbing forces by coordinate at the samples, joined by lines, shape (n_samples, n_sets).
    """
    n, h = len(plant.index), np.full(plant.size, SAMPLE / substeps)
    for law in plant.laws:
        h = law.clock(h)
    q, v = np.zeros((n, plant.size)), np.zeros((n, plant.size))
    for name, value in start.items():
        q[plant.index[name]] = value
    m = Moment(plant.zero, q, v, plant.zero, plant.zero, np.zeros_like(q), plant.index, np.zeros_like(q))
    feed = Feed(plant, u, h)
    for law in plant.laws:
        law.begin(m)
    rows: dict[str, list[Array]] = {}
    for sample in range(n_samples):
        measured(plant, m, feed, sample, rows)
        if sample == n_samples - 1:
            break
        for k in range(substeps):
            extra = between(pushes, sample, (k + 0.5) / substeps, plant) if pushes else None
            step(plant, m, feed, h, sample * substeps + k, extra)
    return {name: np.array(values) for name, values in rows.items()}


def step(plant: Plant, m: Moment, feed: "Feed", h: Array, number: int, extra: Array | None) -> None:
    """Advance a moment by one step."""
    v_0, middle = m.v, m.q + 0.5 * h * m.v
    m.t, m.q = (number + 0.5) * h, middle
    for law in plant.laws:
        law.advance(m, 0.5 * h)
    m.u = feed.mean(m, number)
    inverse = inverse_of(plant.mass(middle))
    for stage in range(2):
        m.force = np.zeros_like(middle) if extra is None else extra.copy()
        m.levels = {}
        plant.load(m)
        end = velocities(v_0, m.force, inverse, h, m.levels)
        m.v = 0.5 * (v_0 + end) if stage == 0 else end
    m.a, m.v = (end - v_0) / h, end
    for law in plant.laws:
        law.advance(m, 0.5 * h)
    m.q, m.t = middle + 0.5 * h * end, (number + 1) * h


class Feed:
    """The voltage that reaches the motor: held samples through the laws before the amplifier."""

    def __init__(self, plant: Plant, u: Array | None, h: Array) -> None:
        self.plant, self.u, self.h = plant, u, h
        self.is_plain = not any(law.shifts_time for law in plant.laws)
        self.substeps = round(SAMPLE / h[0]) if self.is_plain else 0
        self.columns = np.arange(plant.size)
        self.sums = None if u is None else np.vstack((np.zeros(plant.size), np.cumsum(u, axis=0) * SAMPLE))

    def mean(self, m: Moment, number: int) -> Array:
        """Mean voltage of a step."""
        if self.u is None:
            return self.plant.zero
        if self.is_plain:
            u = self.u[number // self.substeps]
        else:
            begin = self._late(number * self.h)
            u = (self._sum(begin + self.h) - self._sum(begin)) / self.h
        return self._changed(m, u)

    def at(self, m: Moment, sample: int) -> Array:
        """Voltage right after a sample."""
        if self.u is None:
            return self.plant.zero
        u = self.u[sample]
        if not self.is_plain:
            begin = self._late(m.t)
            u = np.where(begin < -1e-9, 0.0, self.u[self._row(begin), self.columns])
        return self._changed(m, u)

    def _late(self, t: Array) -> Array:
        for law in self.plant.laws:
            t = law.late(t)
        return t

    def _row(self, t: Array) -> np.ndarray:
        return np.clip(np.floor(t / SAMPLE + 1e-9).astype(int), 0, len(self.u) - 1)  # type: ignore[arg-type]

    def _sum(self, t: Array) -> Array:
        row = self._row(t)
        inside = self.sums[row, self.columns] + (t - row * SAMPLE) * self.u[row, self.columns]  # type: ignore[index]
        return np.where(t < 0, 0.0, inside)

    def _changed(self, m: Moment, u: Array) -> Array:
        for law in self.plant.laws:
            u = law.voltage(m, u)
        return u


def between(pushes: dict[str, Array], sample: int, share: float, plant: Plant) -> Array:
    extra = np.zeros((len(plant.index), plant.size))
    for name, series in pushes.items():
        extra[plant.index[name]] = (1 - share) * series[sample] + share * series[sample + 1]
    return extra


def measured(plant: Plant, m: Moment, feed: Feed, sample: int, rows: dict[str, list[Array]]) -> None:
    """Append what the sensors show."""
    m.u = feed.at(m, sample)
    m.force, m.levels = np.zeros_like(m.q), {}
    plant.load(m)
    shown = {}
    if "s" in plant.index:
        shown["encoder.s"] = m.x("s")
    if "phi" in plant.index:
        shown["bearing.phi"] = m.x("phi") if plant.node is None else plant.node.angle(m)
    if "k" in plant.p:
        shown["motor.i"] = m.i
    for law in plant.laws:
        shown = law.show(m, shown, sample)
    for name, value in shown.items():
        rows.setdefault(name, []).append(np.array(value))
