"""How likely a fit is when small random forces move the rig besides the sensors' noise, and what it is sure of then."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.discover.sweep import Sweep, sweep
from cartpend_dae.discover.trail import Trail
from cartpend_dae.discover.unknown_input import Chain, left_over, likelihood, whitened
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion, Place, catalogue, fits
from cartpend_dae.errors import SolverError
from cartpend_dae.gauss_newton import bounds
from cartpend_dae.problem import Problem
from cartpend_dae.shooting import scaled_values

# what a random force may be: multiples of the size that would explain the whole residual, and correlation times [s];
# longer ones would pass for a load or a spring
SHARES = (1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
TIMES = (0.05, 0.2, 1.0)
# multiples of the random forces of a model that may be left with another effect in it
LEFT = (0.0, 0.01, 0.03, 0.1, 0.3, 0.6, 1.0)
# of forces that were nothing so much of that size is tried again
AGAIN = 0.01
# factors on sizes and times of a good set, tried one after the other
FINER = ((0.0, 1.0), (0.1, 1.0), (0.4, 1.0), (0.7, 1.0), (1.4, 1.0), (2.5, 1.0), (1.0, 0.4), (1.0, 2.5))
LONGEST = 1.0
# another round of them is worth it while -2 ln likelihood falls by so much
LITTLE = 0.5
BLOCKS = 30
# forces that move the data alike to this cosine are one
ALIKE = 0.98
TINY = 1e-150


@dataclass(frozen=True, slots=True)
class Forces:
    """Random forces: names, standard deviations [SI] and correlation times [s]."""

    names: tuple[str, ...]
    sizes: np.ndarray
    times: np.ndarray


@dataclass(frozen=True, slots=True)
class Weighed:
    """A fit against random forces whose sizes are estimated.

    Parameters
    ----------
    criterion
        -2 ln likelihood, the scale of the noise concentrated out; of a rig that rubs, along its likeliest course.
    linear
        The same to first order in steps of all variables, as `found` linearises it.
    validated
        The same with each block of time predicted from the others.
    forces
        The random forces.
    bandwidth
        Of the output injection with the gain of the filter [rad/s].
    sd
        Standard deviations of the parameters by the jackknife over blocks of time [SI].
    found
        The linearisation.
    next
        Where the likelihood is largest to first order: parameters and free starts by name [SI].
    trail
        The likeliest course, along which `found` is linear; None where it is the simulation that the injection leads.
    """

    criterion: float
    linear: float
    validated: float
    forces: Forces
    bandwidth: float
    sd: dict[str, float]
    found: Sweep
    next: dict[str, float]
    trail: Trail | None = None

    @property
    def chain(self) -> Chain:
        """The chain with the forces that count."""
        assert self.found.chain is not None
        return self.found.chain.only(self.forces.names)


def loads_at(places: tuple[Place, ...]) -> tuple[Insertion, ...]:
    """Return a load at each place where something can push, which stands for a random force there."""
    card = replace(next(card for card in catalogue() if card.id == "constant_load"), id="random_force")
    return tuple(Insertion(card, place) for place in places if fits(card, place))


def weigh(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    loads: tuple[Insertion, ...],
    point: Mapping[str, float],
    bandwidth: float,
    sd: np.ndarray,
    *,
    near: Forces | None = None,
    is_rough: bool = False,
    trail: Trail | None = None,
) -> Weighed:
    """Weigh a fit.

    Parameters
    ----------
    bench
        The workbench.
    taken
        Effects in the model.
    loads
        Where random forces may act.
    point
        The fit: parameters and free starts by name, SI.
    bandwidth
        Bandwidth of the output injection of that fit [rad/s].
    sd
        Noise used as weight, shape (n_y,).
    near
        Forces of a fit like this one, from which the search for them starts.
    is_rough
        Leave it at multiples of these.
    trail
        The likeliest course, along which to linearise.
    """
    is_fine = bench.weighing is not None and (trail is not None or not is_rough)
    found = sweep(bench, taken, loads, point, bandwidth, sd, is_fine=is_fine, trail=trail)
    assert found.chain is not None
    names = near.names if near is not None else _distinct(found)
    chain = found.chain.only(tuple(name for name in names if name in found.chain.names))
    rows = chain.spread(np.column_stack([found.residual, found.base]))
    rounds = 0 if is_rough else 2
    forces, criterion = most_likely(chain, rows, first_sets(found, chain, near), rounds)
    white = whitened(chain, rows, forces.sizes[None], forces.times[None])
    if not (np.isfinite(criterion) and np.all(np.isfinite(white.rows))):
        raise SolverError(f"{bench.problem(taken).system.name} cannot be weighed against random forces: it diverges.")
    free = bench.problem(taken).layout.free
    values = scaled_values(bench.problem(taken), point)
    most = np.array([abs(item.value(v) / item.slope(v)) for item, v in zip(free, values, strict=False)])
    validated, spread = jackknife(white.rows[0], white.determinant[0], chain, most)
    moved = np.clip(values + step_of(white.rows[0][chain.measured]), *bounds(bench.problem(taken)))
    ahead = point_at(bench.problem(taken), moved)
    sds = {item.name: item.slope(v) * float(s) for item, v, s in zip(free, values, spread, strict=False)}
    return Weighed(criterion, criterion, validated, forces, _bandwidth(white.gain[0], chain), sds, found, ahead, trail)


@np.errstate(over="ignore")
def step_of(white: np.ndarray) -> np.ndarray:
    """Return the step of Gauss and Newton on white rows (n, 1 + n_all), in scaled variables.

    A variable in which a row grows beyond all numbers stays as it is.
    """
    scale = np.linalg.norm(white[:, 1:], axis=0)
    scale = np.where(scale > 0, scale, np.inf)
    return np.linalg.lstsq(white[:, 1:] / scale, -white[:, 0], rcond=1e-8)[0] / scale


def point_at(problem: Problem, values: np.ndarray) -> dict[str, float]:
    """Return parameters and free starts by name, SI, of scaled variables (n_all,)."""
    return {item.name: float(item.value(v)) for item, v in zip(problem.variables, values, strict=True)}


def _distinct(found: Sweep) -> tuple[str, ...]:
    """Return the forces that the data can tell apart."""
    kept: dict[str, np.ndarray] = {}
    for name, column in found.sizes.items():
        size = np.linalg.norm(column)
        if size > 0 and np.isfinite(size) and all(abs(column @ other) < ALIKE * size for other in kept.values()):
            kept[name] = column / size
    return tuple(kept)


def first_sets(found: Sweep, chain: Chain, near: Forces | None) -> tuple[np.ndarray, np.ndarray]:
    """Return sets of sizes and times to begin with, (n_sets, n_d) each: multiples of those `near`, if there are any."""
    if near is not None:
        places = [near.names.index(name) for name in chain.names]
        sizes, times = near.sizes[places], near.times[places]
        sets = [(factor, time) for factor in LEFT for time in TIMES]
        # forces of another time are as strong at low frequencies
        scaled = [factor * sizes * np.sqrt(times / time) for factor, time in sets]
        # as they are, and with a little of those that were nothing, which no factor brings back
        some = np.where(sizes > 0, sizes, AGAIN * _units(found, chain))
        alike = [np.full(times.size, time) for _, time in sets]
        return np.array([sizes, some, *scaled]), np.array([times, times, *alike])
    unit = _units(found, chain)
    sets = [(0.0, TIMES[0]), *((share, time) for share in SHARES for time in TIMES)]
    return np.array([share * unit for share, _ in sets]), np.array([np.full(unit.size, t) for _, t in sets])


def _units(found: Sweep, chain: Chain) -> np.ndarray:
    """Return the sizes with which each force would explain the whole residual."""
    whole, columns = np.linalg.norm(found.residual), {**found.rough, **found.sizes}
    return np.array([whole / np.linalg.norm(columns[name]) for name in chain.names])


def most_likely(
    chain: Chain, rows: np.ndarray, sets: tuple[np.ndarray, np.ndarray], rounds: int
) -> tuple[Forces, float]:
    """Return the most likely of sets of forces, improved force by force."""
    sizes, times = sets
    best, criterion = _best(chain, rows, sizes, times)
    now = sizes[best], times[best]
    for _ in range(rounds):
        before = criterion
        for d in range(len(chain.names)):
            sizes, times = (np.tile(part, (len(FINER), 1)) for part in now)
            sizes[:, d] *= [factor for factor, _ in FINER]
            times[:, d] = np.minimum(times[:, d] * [factor for _, factor in FINER], LONGEST)
            best, found = _best(chain, rows, sizes, times)
            if found < criterion:
                now, criterion = (sizes[best], times[best]), found
        if before - criterion < LITTLE:
            break
    return Forces(chain.names, *now), criterion


def _best(chain: Chain, rows: np.ndarray, sizes: np.ndarray, times: np.ndarray) -> tuple[int, float]:
    white = whitened(chain, rows, sizes, times)
    n = int(chain.measured.sum())
    found = [
        float(likelihood(n, left_over(one[chain.measured]), determinant))
        for one, determinant in zip(white.rows, white.determinant, strict=True)
    ]
    best = int(np.argmin(found))
    return best, found[best]


def jackknife(white: np.ndarray, determinant: float, chain: Chain, most: np.ndarray) -> tuple[float, np.ndarray]:
    """Return -2 ln likelihood with each block predicted from the others, and the spread of the parameters.

    Start states, which only the first block of a run determines, are held. What is linear here holds no further than
    `most` of a parameter, all of it, and its standard deviation; there a shift ends.
    """
    n_free = most.size
    samples = np.flatnonzero(chain.measured.any(axis=1))
    scale = np.linalg.norm(white[:, :, 1:], axis=(0, 1))
    scale = np.where(scale > 0, scale, 1.0)
    whole = white[chain.measured]
    columns = whole[:, 1:] / scale
    left = white[:, :, 0] - (white[:, :, 1:] / scale) @ np.linalg.lstsq(columns, whole[:, 0], rcond=1e-10)[0]
    parts = np.array_split(samples, BLOCKS)
    free = [(white[part][:, :, 1 : 1 + n_free] / scale[:n_free]).reshape(-1, n_free) for part in parts]
    rests = [left[part].ravel() for part in parts]
    total = sum((block.T @ block for block in free), np.zeros((n_free, n_free)))
    noise = np.linalg.norm(left[samples]) / np.sqrt(chain.measured.sum())
    reach = most * scale[:n_free] + noise * np.sqrt(np.clip(np.diag(np.linalg.pinv(total, rcond=1e-10)), 0.0, None))
    squares, moved = 0.0, []
    for block, rest in zip(free, rests, strict=True):
        shift = np.linalg.lstsq(total - block.T @ block, block.T @ rest, rcond=1e-10)[0]
        shift /= max(1.0, float(np.max(np.abs(shift) / np.maximum(reach, TINY), initial=0.0)))
        squares += float(np.sum((rest + block @ shift) ** 2))
        moved.append(shift)
    spread = np.array(moved)
    sd = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((spread - spread.mean(axis=0)) ** 2, axis=0)) / scale[:n_free]
    return float(likelihood(int(chain.measured.sum()), squares, determinant)), sd


def _bandwidth(gain: np.ndarray, chain: Chain) -> float:
    """Return the bandwidth of the observer whose correction is that of the filter, seen in the outputs [rad/s].

    Where the gain of what is measured is g, the critically damped observer leaves rho^2 = 1 - g of an error.
    """
    seen = np.median(chain.error, axis=0) @ gain
    share = float(np.clip(np.diag(seen).max(initial=0.0), 0.0, 0.98))
    width = float(np.median(chain.width[chain.width > 0]))
    return -np.log(1 - share) / (2 * width)
