"""How likely a fit is when small random forces move the rig besides the sensors' noise, and what it is sure of then."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.discover.sweep import Sweep, sweep
from cartpend_dae.discover.trail import Trail
from cartpend_dae.discover.unknown_input import Chain, White, left_over, likelihood, whitened
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
# share by which numbers of runs differ that are not the same
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Forces:
    """Random forces: names, and in each run standard deviations [SI] and correlation times [s], (n_runs, n_d)."""

    names: tuple[str, ...]
    sizes: np.ndarray
    times: np.ndarray

    @property
    def strengths(self) -> np.ndarray:
        """How strong each is at low frequencies, the mean square of all runs, shape (n_d,)."""
        return np.sqrt(np.mean(self.sizes**2 * self.times, axis=0))


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


@np.errstate(over="ignore", invalid="ignore")
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
    validated, spread = jackknife(white.rows[0], white.determinant[0].sum(), chain, most)
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
    """Return sets of sizes and times to begin with, (n_sets, n_runs, n_d) each: multiples of those `near`, if any."""
    if near is not None:
        places = [near.names.index(name) for name in chain.names]
        sizes, times = near.sizes[:, places], near.times[:, places]
        sets = [(factor, time) for factor in LEFT for time in TIMES]
        # forces of another time are as strong at low frequencies
        scaled = [factor * sizes * np.sqrt(times / time) for factor, time in sets]
        # as they are, and with a little of those that were nothing, which no factor brings back
        some = np.where(sizes > 0, sizes, AGAIN * _units(found, chain))
        alike = [np.full(times.shape, time) for _, time in sets]
        both = in_all_runs(sizes, times)
        return np.array([sizes, some, both[0], *scaled]), np.array([times, times, both[1], *alike])
    unit = np.tile(_units(found, chain), (len(chain.first), 1))
    sets = [(0.0, TIMES[0]), *((share, time) for share in SHARES for time in TIMES)]
    return np.array([share * unit for share, _ in sets]), np.array([np.full(unit.shape, t) for _, t in sets])


def _units(found: Sweep, chain: Chain) -> np.ndarray:
    """Return the sizes with which each force would explain the whole residual."""
    whole, columns = np.linalg.norm(found.residual), {**found.rough, **found.sizes}
    return np.array([whole / np.linalg.norm(columns[name]) for name in chain.names])


_Set = tuple[np.ndarray, np.ndarray]
"""Sizes and times of forces, (n_runs, n_d) each."""


def most_likely(
    chain: Chain, rows: np.ndarray, sets: tuple[np.ndarray, np.ndarray], rounds: int
) -> tuple[Forces, float]:
    """Return the most likely of sets of forces, improved force by force, in all runs alike and in each of its own.

    What differs from run to run costs ln n of n values each (BIC), as it fits those of short runs by chance; and it is
    there, as with one correlation time for runs with 0.2 and 0.6 s, springs gained 96 of -2 ln likelihood where
    nothing was missing, and 23 with those of each run (blind set 1187 of the driven cart).

    References
    ----------
    G. Schwarz, Ann. Statist. 6 (1978), 461-464, doi:10.1214/aos/1176344136 (the cost of a number).
    """
    now, criterion = _best(chain, rows, *sets)
    for _ in range(rounds):
        before = criterion
        for d in range(len(chain.names)):
            sizes, times = (np.tile(part, (len(FINER) + 2, 1, 1)) for part in now)
            factors, slower = np.array([(1.0, 1.0), *FINER]).T[:, :, None]
            sizes[:-1, :, d] *= factors
            times[:-1, :, d] = np.minimum(times[:-1, :, d] * slower, LONGEST)
            sizes[-1, :, d], times[-1, :, d] = (part[:, d] for part in in_all_runs(*now))
            end, left = _best(chain, rows, sizes, times)
            if left < criterion:
                now, criterion = end, left
        if before - criterion < LITTLE:
            break
    return Forces(chain.names, *now), criterion


def in_all_runs(sizes: np.ndarray, times: np.ndarray) -> _Set:
    """Return sizes and times (n_runs, n_d) that are one in all runs: as large, and as strong at low frequencies."""
    size, strength = (np.sqrt(np.mean(part, axis=0)) for part in (sizes**2, sizes**2 * times))
    time = np.where(size > 0, (strength / np.where(size > 0, size, 1.0)) ** 2, times.mean(axis=0))
    return np.tile(size, (len(sizes), 1)), np.tile(time, (len(sizes), 1))


def _best(chain: Chain, rows: np.ndarray, sizes: np.ndarray, times: np.ndarray) -> tuple[_Set, float]:
    """Return the best of sets of forces, or what suits each run best of them, and its criterion."""
    white, found = _tried(chain, rows, sizes, times)
    best = int(np.argmin(found))
    each = _best_of_runs(chain, white, best)
    if np.any(each != best):
        runs = np.arange(each.size)
        _, (left,) = _tried(chain, rows, sizes[None, each, runs], times[None, each, runs])
        if left < found[best]:
            return (sizes[each, runs], times[each, runs]), left
    return (sizes[best], times[best]), found[best]


def _tried(chain: Chain, rows: np.ndarray, sizes: np.ndarray, times: np.ndarray) -> tuple[White, list[float]]:
    """Return innovations under sets of forces, and -2 ln likelihood of each with the cost of numbers for each run."""
    white = whitened(chain, rows, sizes, times)
    n, left = int(chain.measured.sum()), [left_over(one[chain.measured]) for one in white.rows]
    costs = np.log(n) * (_own(sizes) + _own(times))
    return white, (likelihood(n, np.array(left), white.determinant.sum(axis=1)) + costs).tolist()


def _own(numbers: np.ndarray) -> np.ndarray:
    """Return how many numbers there are besides one for all runs, (n_sets,), of sets (n_sets, n_runs, n_d)."""
    return np.sum(
        np.abs(np.diff(np.sort(numbers, axis=1), axis=1)) > ROUNDING * numbers.max(axis=1, keepdims=True), axis=(1, 2)
    )


@np.errstate(over="ignore", invalid="ignore")
def _best_of_runs(chain: Chain, white: White, best: int) -> np.ndarray:
    """Return which set suits each run best, with what is fitted as the best one has it, shape (n_runs,).

    All pieces of a run have one set: the same forces moved them.
    """
    known = white.rows[best][chain.measured]
    if not np.all(np.isfinite(known)):
        return np.full(len(chain.first), best)
    left = white.rows @ np.r_[1.0, step_of(known)]
    squares = np.where(chain.measured, left, 0.0) ** 2
    by_piece = np.add.reduceat(squares.sum(axis=2), list(chain.first), axis=1) + white.determinant
    owners = np.array(chain.owners or range(len(chain.first)))
    by_run = np.add.reduceat(by_piece, np.flatnonzero(np.diff(owners, prepend=-1)), axis=1)
    return np.argmin(np.where(np.isfinite(by_run), by_run, np.inf), axis=0)[owners]


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
