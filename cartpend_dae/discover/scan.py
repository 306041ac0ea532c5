"""With which shape an effect explains most, such as its wave number: many are tried along one simulation.

At size 0 the simulation does not depend on the shape k of an effect without a memory. What the sizes change is linear,
so that the squares that each k explains, with what is fitted already left out, are the periodogram of what the model
lacks if k is a wave number, and find the place of a stop or the speed of a peak in the same way.

References
----------
J. D. Scargle, Astrophys. J. 263 (1982), 835-853, doi:10.1086/160554 (least squares at each frequency).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from cartpend_dae.discover.grid import grid
from cartpend_dae.discover.slopes import Along, Local, Slopes, Table, slopes_of, without_lost
from cartpend_dae.effects import Insertion
from cartpend_dae.effects.card import EffectParameter

# phase over the way [rad] of the longest wave, and from one wave number to the next, which is a third of what makes a
# wave orthogonal to another; how many of them, and so many parts of a step are tried about the best one
LONGEST, COARSE, WAVES, PARTS = 4.0, 2.0, 180, 4
# waves are tried up to so many times the shortest that an effect begins from, those beyond the first ones at phases
# [rad] that are two thirds of such a third, and so many of them
BEYOND, SPARSE, FURTHER = 1.25, 4.0, 800
# so many instants are tried at first, and then all those about the best one
MOST = 300
# the most teeth; so many numbers of them, and of waves, are promising, waves that explain this share of the best one
TEETH, PROMISING, ALIKE = 72, 2, 0.8
# phase [rad] of a whole period, which a run must pass for a number of teeth to be told; of a wave it must pass so much,
# as shorter parts pass for any polynomial
PERIOD, PART = 2 * np.pi, 1.0
# a spring about a shaft that turns so far [rad] would be wound up
WOUND = 10 * PERIOD
UNPASSED, TURNS = "no run passes one of its periods", "the shaft turns on and on, which would wind it up"
# other shapes are tried at so many values, from the least it starts from over this factor to the largest times it
VALUES, SPAN = 24, 8.0
# values that are followed at once, which bounds the memory; and that one function is made for
TOGETHER, ABREAST = 50, 8
# a step is beyond the one in which a record stands exactly if it is so many times that; and so short a share of what
# is read is no step
KNOWN, NO_STEP = 1.5, 1e-9
# directions that sizes move less than this share of the strongest are none
FLAT = 1e-8
# squares that are left of a column beside what is fitted already are rounding below this share of its own
ROUNDED = 1e-12


@dataclass(frozen=True)
class Scan:
    """What all shapes are tried on.

    Parameters
    ----------
    along
        A simulation with the effects in it, at size 0.
    local
        Slopes of the model's own step.
    residual
        Weighted residuals of what was measured, shape (n_measured,).
    basis
        Orthonormal basis of what is fitted already, shape (n_measured, n_basis).
    """

    along: Along
    local: Local
    residual: np.ndarray
    basis: np.ndarray

    @cached_property
    def left(self) -> np.ndarray:
        """What is fitted already leaves so much of the residual, (n_measured,)."""
        return self.residual - self.basis @ (self.basis.T @ self.residual)

    @cached_property
    def through(self) -> np.ndarray:
        """What comes through the algebraic equations, (n, n_own + n_y, n_z)."""
        return Table(self.along, slopes_of(self.along, ()).through).before()


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def best_shapes(option: Insertion, scan: Scan) -> tuple[dict[str, float], ...]:
    """Return the shapes with which an effect promises most, the best first: by name its wave number, instant or such.

    There is one, or up to `PROMISING` waves that explain about as much, or so many numbers of teeth, of which one may
    be a multiple of another. Of two waves each is looked for beside the other, and the first one again beside the
    second. Beside it is what the record itself says, such as the step in which it stands. There is none if the effect
    has no shape, or several of several starts, or a memory, or is not at the first start of its shape.
    """
    kind, items = option.place.kind, _tried(option, scan.along)
    firsts = {item.names[kind]: item.starts_at(kind)[0] for item in items}
    if not items or any(option.values.get(name, first) != first for name, first in firsts.items()):
        return ()
    found: list[dict[str, float]] = []
    for item in items if len(items) == 1 else (*items, items[0]):
        name, others = item.names[kind], found[0] if found else firsts
        others = {other: value for other, value in others.items() if other != name}
        found = [others | {name: number} for number in _promising(item, _Law(option, name, scan, others), scan)]
        if not found:
            return ()
    return tuple(shape | _read(option, scan.along) for shape in found)


def _promising(item: EffectParameter, law: "_Law", scan: Scan) -> list[float]:
    """Return the numbers in the place of a shape with which a law explains most, the best first."""
    numbers = _numbers(item, law.option, scan.along)
    if not numbers.size:
        return []
    if item.role == "teeth":
        gains = _gains(law, numbers, scan)
        return [float(numbers[k]) for k in np.argsort(-gains, kind="stable")[:PROMISING] if gains[k] > 0]
    tried = numbers if item.role == "wave" else numbers[:: -(-numbers.size // MOST)]
    gains = _gains(law, tried, scan)
    found: dict[float, float] = {}
    for peak in _peaks(gains)[: PROMISING if item.role == "wave" else 1]:
        near = _between(tried, peak, numbers, item)
        about, explained = (near, _gains(law, near, scan)) if near.size else (tried, gains)
        best = int(np.argmax(explained))
        found[float(about[best])] = float(explained[best])
    return [number for number in sorted(found, key=lambda n: -found[n]) if found[number] > 0]


def _peaks(gains: np.ndarray) -> list[int]:
    """Return where numbers explain more than those beside them and about as much as the best, the best first."""
    padded = np.pad(gains, 1, constant_values=-np.inf)
    is_peak = (padded[1:-1] > padded[:-2]) & (padded[1:-1] >= padded[2:]) & (gains >= ALIKE * gains.max())
    return sorted(np.flatnonzero(is_peak).tolist(), key=lambda k: -gains[k])


def _between(coarse: np.ndarray, best: int, numbers: np.ndarray, item: EffectParameter) -> np.ndarray:
    """Return what to try about the best of the numbers that were tried, with that one; empty if that was all."""
    about = coarse[max(best - 1, 0) : best + 2]
    if item.role == "wave" and about.size > 1:
        return np.interp(np.arange(PARTS * (about.size - 1) + 1) / PARTS, np.arange(about.size), about)
    if coarse.size == numbers.size:
        return np.zeros(0)
    first, last = np.searchsorted(numbers, about[[0, -1]])
    return numbers[first : last + 1]


def _gains(law: "_Law", numbers: np.ndarray, scan: Scan) -> np.ndarray:
    """Return what each number explains."""
    gains: list[float] = []
    for part in np.array_split(numbers, -(-numbers.size // TOGETHER)):
        columns = _columns(law.rows, law.growth(part), scan)
        gains += _explained(columns, part.size, scan)
    return np.array(gains)


def _read(option: Insertion, along: Along) -> dict[str, float]:
    """Return what the record of a sensor itself says of an effect, its step, by name of the parameter.

    A step in which the record stands exactly is noise to every fit, and none is seen where noise is larger: then only
    a step too short to matter is left to the effect.
    """
    names = [item.names[option.place.kind] for item in option.card.parameters if item.role == "step"]
    at, n_y = option.place.at, len(along.problem.outputs)
    found = [k for k, name in enumerate(along.problem.outputs) if name == at or name.startswith(f"{at}.")]
    if not names or not found:
        return {}
    values, weight = along.data[-2 * n_y + found[0]], along.data[-n_y + found[0]]
    step = grid(values[weight > 0])
    is_told = step > KNOWN * along.problem.quanta[found[0]]
    return dict.fromkeys(names, step if is_told else NO_STEP * float(np.ptp(values[weight > 0])))


def _tried(option: Insertion, along: Along) -> tuple[EffectParameter, ...]:
    items = option.card.parameters
    waves = tuple(item for item in items if item.role in ("wave", "instant", "teeth"))
    if waves:
        return waves
    shapes = [item for item in items if item.role == "shape"]
    if len(shapes) > 1:  # one that has a single start only refines the law
        shapes = [item for item in shapes if len(item.starts_at(option.place.kind)) > 1]
    states = (along.system.states[i].removeprefix("der(") for i in along.inside)
    has_memory = any(name.startswith(option.prefix + ".") for name in states)
    is_scale = len(shapes) == 1 and min(shapes[0].starts_at(option.place.kind)) > 0
    return (shapes[0],) if is_scale and not has_memory else ()


def _numbers(item: EffectParameter, option: Insertion, along: Along) -> np.ndarray:
    """Return what to try within the parameter's bounds: wave numbers that the way tells apart; empty if none moves."""
    kind = option.place.kind
    if item.role == "teeth":
        numbers = np.arange(item.lower, TEETH + 1)
        return numbers[numbers * _way(option, along) >= PERIOD]
    if item.role == "shape":
        starts = item.starts_at(kind)
        return np.clip(np.geomspace(min(starts) / SPAN, max(starts) * SPAN, VALUES), *item.bounds_at(kind))
    if item.role == "instant":
        instants = np.unique(along.data[0])
        return (instants[1:] + instants[:-1]) / 2
    way = _way(option, along)
    low, high = item.bounds_at(kind)
    if not way > 0:
        return np.zeros(0)
    first = (LONGEST + COARSE * np.arange(WAVES)) / way
    high = min(high, max(first[-1], BEYOND * max(item.starts_at(kind))))
    found = np.concatenate([first, first[-1] + SPARSE / way * np.arange(1, FURTHER + 1)])
    return found[(found >= low) & (found <= high)]


def _way(option: Insertion, along: Along) -> float:
    """Return from where to where the run that goes farthest goes along what an effect repeats; 0 if that is lost."""
    return _farthest(option, along, option.card.along[option.place.kind])


def _farthest(option: Insertion, along: Along, name: str) -> float:
    """Return from where to where a variable of an effect goes in the run in which it goes farthest; 0 if it is lost."""
    position = along.of(f"{option.prefix}.{name}")
    layout = along.problem.layout
    begins = [first * layout.length for first in layout.first]
    way = max(float(np.ptp(part)) for part in np.split(position, begins[1:]))
    return way if np.isfinite(way) else 0.0


def out_of_range(option: Insertion, along: Along) -> str:
    """Return why the runs go too short a way, or too far, for an effect to be tried; empty if they do not.

    Of less than one period of what has whole numbers of them a turn a part is seen, which passes for any law that is as
    curved there; of a wave, whose number is free, a smaller part tells. A spring is no part of a shaft that turns on.
    """
    kind, values = option.place.kind, option.values
    least = [
        (values.get(item.names[kind], item.lower if item.role == "teeth" else item.starts_at(kind)[0]), needed)
        for item in option.card.parameters
        for role, needed in (("teeth", PERIOD), ("wave", PART))
        if item.role == role
    ]
    if any(number * _way(option, along) < needed for number, needed in least):
        return UNPASSED
    name = option.card.winds.get(kind)
    return TURNS if name is not None and _farthest(option, along, name) > WOUND else ""


@dataclass(frozen=True)
class _Law:
    """How the sizes of an effect move the states and outputs at an instant, by the number in the place of its shape.

    `others` are shapes that stay, by name.
    """

    option: Insertion
    name: str
    scan: Scan
    others: Mapping[str, float]

    @cached_property
    def slopes(self) -> Slopes:
        """What the sizes do."""
        return slopes_of(self.scan.along, self.option.size_names)

    @cached_property
    def hidden(self) -> list[int]:
        """The algebraic equations in which they are."""
        return sorted({row for row, _ in zip(*self.slopes.hidden.sparsity().get_triplet(), strict=True)})

    @cached_property
    def rows(self) -> list[int]:
        """The states of the model's own, and the outputs after them, that they move at once; the others never."""
        direct = {row for row, _ in zip(*self.slopes.direct.sparsity().get_triplet(), strict=True)}
        through = zip(*self.slopes.through.sparsity().get_triplet(), strict=True)
        return sorted(direct | {row for row, equation in through if equation in self.hidden})

    @cached_property
    def table(self) -> Table:
        """The slopes for some numbers, side by side."""
        along = self.scan.along
        whole = ca.vertcat(self.slopes.direct[self.rows, :], self.slopes.hidden[self.hidden, :])
        shapes = ca.SX.sym("shapes", ABREAST)
        for name, value in self.others.items():
            whole = ca.substitute(whole, self._place(name), ca.SX(value))
        place = self._place(self.name)
        each = [ca.substitute(whole, place, shapes[k]) for k in range(ABREAST)]
        return Table(along, ca.horzcat(*each), (shapes,))

    def _place(self, name: str) -> ca.SX:
        system = self.scan.along.system
        return system.p[system.parameter_index(f"{self.option.prefix}.{name}")]

    def growth(self, numbers: np.ndarray) -> np.ndarray:
        """Return how the sizes move each row at each sample, one number after the other, (n, n_rows, n_columns)."""
        n_rows, width = len(self.rows), self.slopes.direct.shape[1]
        full = np.pad(numbers, (0, -numbers.size % ABREAST), mode="edge")
        values = [self.table.before(part) for part in np.split(full, full.size // ABREAST)]
        found = np.concatenate(values, axis=2)[:, :, : numbers.size * width]
        moved = found[:, :n_rows]
        for k, equation in enumerate(self.hidden):  # one product after the other: numpy is slow at many small matrices
            moved = moved - self.scan.through[:, self.rows, equation, None] * found[:, n_rows + k, None, :]
        return without_lost(moved)[0]


def _columns(rows: list[int], growth: np.ndarray, scan: Scan) -> np.ndarray:
    """Return what is changed of the residuals, carried along the samples, (n_columns, n_measured).

    `growth` (n, n_rows, n_columns) is that of some rows only; both ends of an interval are samples.
    """
    along, local = scan.along, scan.local
    layout, data, n_y, n_own = along.problem.layout, along.data, len(along.problem.outputs), len(along.own)
    weight = data[-n_y:].T
    own, shown = [row for row in rows if row < n_own], [row - n_own for row in rows if row >= n_own]
    left, seen = growth[:, : len(own)], growth[:, len(own) :]
    h = data[1][:, None, None] / 2
    pushes = (h * local.transition[:, :, own]) @ left - local.measured[:, :, shown] @ seen
    pushes[:-1, own] += h[:-1] * left[1:]
    pushes[-1:, own] += h[-1:] * left[-1:]
    begins = {segment * layout.length for segment in layout.first}
    states = np.empty_like(pushes)
    for k in range(states.shape[0]):
        if k in begins:
            states[k] = 0.0
        else:
            np.matmul(local.transition[k - 1], states[k - 1], out=states[k])
            states[k] += pushes[k - 1]
    columns = local.error @ states
    columns[:, shown] -= seen * weight[:, shown, None]
    return np.ascontiguousarray(columns[weight > 0].T)


@np.errstate(over="ignore", invalid="ignore")
def _explained(columns: np.ndarray, n_numbers: int, scan: Scan) -> list[float]:
    """Return the squares of the residual that the columns of each number explain besides what is fitted; 0 if lost."""
    each = columns.reshape(n_numbers, columns.shape[0] // n_numbers, -1)
    seen, pulls = each @ scan.basis, each @ scan.left
    own = each @ each.transpose(0, 2, 1)
    gram = own - seen @ seen.transpose(0, 2, 1)
    gains = np.zeros(n_numbers)
    for k in np.flatnonzero(np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(pulls).all(axis=1)):
        values, vectors = np.linalg.eigh(gram[k])
        good = values > max(FLAT * values.max(), ROUNDED * float(np.trace(own[k])))
        gains[k] = np.sum((vectors[:, good].T @ pulls[k]) ** 2 / values[good])
    return gains.tolist()
