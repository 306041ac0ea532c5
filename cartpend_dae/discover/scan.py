"""With which shape an effect explains most, such as its wave number: many are tried along one simulation.

At size 0 the simulation does not depend on the shape k of an effect without a memory. What the sizes change is linear,
so that the squares that each k explains, with what is fitted already left out, are the periodogram of what the model
lacks if k is a wave number, and find the place of a stop or the speed of a peak in the same way.

References
----------
J. D. Scargle, Astrophys. J. 263 (1982), 835-853, doi:10.1086/160554 (least squares at each frequency).
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from cartpend_dae.discover.grid import grid
from cartpend_dae.discover.slopes import Along, Growth, Local, Slopes, Table, slopes_of
from cartpend_dae.effects import Insertion
from cartpend_dae.effects.card import EffectParameter

# phase over the way [rad] of the longest wave, from one wave number to the next, and the most of them
LONGEST, FINE, MOST = 4.0, 1.2, 300
# other shapes are tried at so many values, from the least it starts from over this factor to the largest times it
VALUES, SPAN = 24, 8.0
# values that are followed at once, which bounds the memory; and that one function is made for
TOGETHER, ABREAST = 50, 8
# a step is beyond the one in which a record stands exactly if it is so many times that; and so short a share of what
# is read is no step
KNOWN, NO_STEP = 1.5, 1e-9
# directions that sizes move less than this share of the strongest are none
FLAT = 1e-8


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

    def across(self, columns: np.ndarray) -> np.ndarray:
        """Return columns without what is fitted already."""
        return columns - self.basis @ (self.basis.T @ columns)

    @cached_property
    def through(self) -> np.ndarray:
        """What comes through the algebraic equations, (n, n_own + n_y, n_z)."""
        return Table(self.along, slopes_of(self.along, ()).through).before()


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def best_shape(option: Insertion, scan: Scan) -> dict[str, float]:
    """Return the shape with which an effect promises most: its wave number, its instant or its only one, by name.

    Beside it is what the record itself says, such as the step in which it stands.

    It is empty if the effect has no shape, or several, or a memory, or is not at the first start of its shape.
    """
    item = _tried(option, scan.along)
    numbers = np.zeros(0) if item is None else _numbers(item, option, scan.along)
    if item is None or not numbers.size:
        return {}
    name = item.names[option.place.kind]
    first = item.starts_at(option.place.kind)[0]
    if option.values.get(name, first) != first:
        return {}
    law = _Law(option, name, scan)
    coarse = numbers[:: -(-numbers.size // MOST)]
    best, gain = _best(law, coarse, scan)
    if coarse.size < numbers.size:
        near = np.searchsorted(numbers, coarse[max(best - 1, 0) : best + 2])
        coarse = numbers[near[0] : near[-1] + 1]
        best, gain = _best(law, coarse, scan)
    return {name: float(coarse[best])} | _read(option, scan.along) if gain > 0 else {}


def _best(law: "_Law", numbers: np.ndarray, scan: Scan) -> tuple[int, float]:
    """Return which number explains most, and what it explains."""
    left, gains = scan.across(scan.residual), []
    for part in np.array_split(numbers, -(-numbers.size // TOGETHER)):
        columns = scan.across(_columns(law.growth(part), scan))
        gains += [_explained(one, left) for one in np.split(columns, part.size, axis=1)]
    best = int(np.argmax(gains))
    return best, gains[best]


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


def _tried(option: Insertion, along: Along) -> EffectParameter | None:
    items = option.card.parameters
    waves = [item for item in items if item.role in ("wave", "instant")]
    shapes = [item for item in items if item.role == "shape"]
    if waves:
        return waves[0]
    states = (along.system.states[i].removeprefix("der(") for i in along.inside)
    has_memory = any(name.startswith(option.prefix + ".") for name in states)
    is_scale = len(shapes) == 1 and min(shapes[0].starts_at(option.place.kind)) > 0
    return shapes[0] if is_scale and not has_memory else None


def _numbers(item: EffectParameter, option: Insertion, along: Along) -> np.ndarray:
    """Return what to try within the parameter's bounds: wave numbers that the way tells apart; empty if none moves."""
    kind = option.place.kind
    if item.role == "shape":
        starts = item.starts_at(kind)
        return np.clip(np.geomspace(min(starts) / SPAN, max(starts) * SPAN, VALUES), *item.bounds_at(kind))
    if item.role == "instant":
        instants = np.unique(along.data[0])
        return (instants[1:] + instants[:-1]) / 2
    position = along.of(f"{option.prefix}.{option.card.along[kind]}")
    layout = along.problem.layout
    begins = [first * layout.length for first in layout.first]
    way = max(float(np.ptp(part)) for part in np.split(position, begins[1:]))
    low, high = item.bounds_at(kind)
    if not (np.isfinite(way) and way > 0):
        return np.zeros(0)
    found = (LONGEST + FINE * np.arange(MOST)) / way
    return found[(found >= low) & (found <= high)]


@dataclass(frozen=True)
class _Law:
    """How the sizes of an effect move the states and outputs at an instant, by the number in the place of its shape."""

    option: Insertion
    name: str
    scan: Scan

    @cached_property
    def slopes(self) -> Slopes:
        """What the sizes do."""
        return slopes_of(self.scan.along, self.option.size_names)

    @cached_property
    def hidden(self) -> list[int]:
        """The algebraic equations in which they are."""
        return sorted({row for row, _ in zip(*self.slopes.hidden.sparsity().get_triplet(), strict=True)})

    @cached_property
    def table(self) -> Table:
        """The slopes for some numbers, side by side."""
        along = self.scan.along
        whole = ca.vertcat(self.slopes.direct, self.slopes.hidden[self.hidden, :])
        shapes = ca.SX.sym("shapes", ABREAST)
        place = along.system.p[along.system.parameter_index(f"{self.option.prefix}.{self.name}")]
        each = [ca.substitute(whole, place, shapes[k]) for k in range(ABREAST)]
        return Table(along, ca.horzcat(*each), (shapes,))

    def growth(self, numbers: np.ndarray) -> Growth:
        """Return the growth by the sizes, with one number after the other; both ends of an interval are samples."""
        n_rows, n_own, width = self.slopes.direct.shape[0], len(self.scan.along.own), self.slopes.direct.shape[1]
        full = np.pad(numbers, (0, -numbers.size % ABREAST), mode="edge")
        values = [self.table.before(part) for part in np.split(full, full.size // ABREAST)]
        found = np.concatenate(values, axis=2)[:, :, : numbers.size * width]
        left = found[:, :n_rows] - self.scan.through[:, :, self.hidden] @ found[:, n_rows:]
        right = np.concatenate([left[1:], left[-1:]])
        return Growth(left[:, :n_own], right[:, :n_own], left[:, n_own:]).where_finite()


def _columns(growth: Growth, scan: Scan) -> np.ndarray:
    """Return what is changed of the residuals, carried along the samples, (n_measured, n_columns)."""
    along, local = scan.along, scan.local
    layout, data, n_y = along.problem.layout, along.data, len(along.problem.outputs)
    weight = data[-n_y:].T
    moved = growth.moved(local, data[1]) - local.measured @ growth.outputs
    begins = {segment * layout.length for segment in layout.first}
    n, n_state, m = moved.shape
    columns, eta = np.empty((n, n_y, m)), np.zeros((n_state, m))
    for k in range(n):
        if k in begins:
            eta = np.zeros((n_state, m))
        columns[k] = local.error[k] @ eta
        eta = local.transition[k] @ eta + moved[k]
    columns -= growth.outputs * weight[:, :, None]
    return columns[weight > 0]


def _explained(columns: np.ndarray, left: np.ndarray) -> float:
    """Return the squares of a residual that columns explain; 0 where they are lost."""
    if not np.all(np.isfinite(columns)):
        return 0.0
    values, vectors = np.linalg.eigh(columns.T @ columns)
    good = values > FLAT * values.max(initial=0.0)
    return float(np.sum((vectors[:, good].T @ (columns.T @ left)) ** 2 / values[good])) if good.any() else 0.0
