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

from cartpend_dae.discover.slopes import Along, Growth, Local, at_both_ends, slopes_of
from cartpend_dae.effects import Insertion
from cartpend_dae.effects.card import EffectParameter

# phase over the way [rad] of the longest wave, from one wave number to the next, and the most of them
LONGEST, FINE, MOST = 4.0, 1.2, 300
# other shapes are tried at so many values, from the least it starts from over this factor to the largest times it
VALUES, SPAN = 24, 8.0
# values that are followed at once, which bounds the memory
TOGETHER = 50
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
    def through(self) -> tuple[np.ndarray, np.ndarray]:
        """What comes through the algebraic equations at both ends, (n, n_own + n_y, n_z)."""
        return at_both_ends(self.along, slopes_of(self.along, ()).through)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def best_shape(option: Insertion, scan: Scan) -> dict[str, float]:
    """Return the wave number of an effect, or its only shape, by name of the parameter, with which it promises most.

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
    left = scan.across(scan.residual)
    gains = []
    for part in np.array_split(numbers, -(-numbers.size // TOGETHER)):
        columns = scan.across(_columns(_growth(option, name, scan, part), scan))
        gains += [_explained(one, left) for one in np.split(columns, part.size, axis=1)]
    best = int(np.argmax(gains))
    return {name: float(numbers[best])} if gains[best] > 0 else {}


def _tried(option: Insertion, along: Along) -> EffectParameter | None:
    items = option.card.parameters
    waves = [item for item in items if item.role == "wave"]
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
    position = along.of(f"{option.prefix}.{option.card.along[kind]}")
    layout = along.problem.layout
    begins = [first * layout.length for first in layout.first]
    way = max(float(np.ptp(part)) for part in np.split(position, begins[1:]))
    low, high = item.bounds_at(kind)
    if not (np.isfinite(way) and way > 0):
        return np.zeros(0)
    found = (LONGEST + FINE * np.arange(MOST)) / way
    return found[(found >= low) & (found <= high)]


def _growth(option: Insertion, name: str, scan: Scan, numbers: np.ndarray) -> Growth:
    """Return the growth by the sizes of an effect, with one number after the other in the place of its shape."""
    along, s = scan.along, scan.along.system
    found = slopes_of(along, option.size_names)
    hidden = sorted({row for row, _ in zip(*found.hidden.sparsity().get_triplet(), strict=True)})
    whole = ca.vertcat(found.direct, found.hidden[hidden, :])
    shape, index = ca.SX.sym("shape", numbers.size), s.parameter_index(f"{option.prefix}.{name}")
    each = [ca.substitute(whole, s.p[index], shape[k]) for k in range(numbers.size)]
    ends = at_both_ends(along, ca.horzcat(*each), (shape, numbers))
    n_rows, n_own = found.direct.shape[0], len(along.own)
    left, right = (
        end[:, :n_rows] - through[:, :, hidden] @ end[:, n_rows:]
        for end, through in zip(ends, scan.through, strict=True)
    )
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
