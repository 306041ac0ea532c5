"""Where fits begin: guesses off their bounds, several starts within them, and how many optima these reach."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.gauss_newton import bounds
from cartpend_dae.identify import Fit
from cartpend_dae.problem import Problem, dominant_frequency
from cartpend_dae.shooting import filtered_nodes, scaled_values, sensitivities
from cartpend_dae.transcribe import stack_data
from cartpend_dae.unknowns import Free

# how far inside its bounds a start value is moved [of its size, or of the range]
INSIDE = 0.01
# a range that ends nowhere ends at so many times the guess
DECADE = 10.0
# what a change of a parameter by its whole size does to no sample [noise sd]
UNSEEN = 1e-9
# shares of the guesses at which a parameter may reach an output
SMALLER = (1.0, 0.1, 0.01, 0.001)
# one in so many segments is looked at first
FEW = 10
# optima are the same where their costs and all parameters agree so far [noise sd, parameter sd]
SAME_COST, SAME_VALUE = 0.1, 0.1


@dataclass(frozen=True, slots=True)
class Starts:
    """What became of several starts: fits from `converged` of `tried` ended in `optima` different minima."""

    tried: int
    converged: int
    optima: int

    def __str__(self) -> str:
        ends = "one optimum" if self.optima == 1 else f"{self.optima} distinct optima"
        return f"{self.converged} of {self.tried} starts converged, to {ends}; the one with the lowest cost was taken."


def off_the_bounds(free: tuple[Free, ...]) -> tuple[tuple[Free, ...], tuple[str, ...]]:
    """Move guesses that lie on a bound inside, and say so in a sentence each."""
    moved, notes = [], []
    for item in free:
        step = INSIDE * min(item.scale, item.upper - item.lower)
        guess = min(max(item.guess, item.lower + step), item.upper - step)
        is_on = item.guess <= item.lower or item.guess >= item.upper
        moved.append(replace(item, guess=guess) if is_on else item)
        if is_on:
            notes.append(
                f"The start value {item.guess:g} {item.unit} of `{item.name}` lies on its bound; "
                f"the fit began at {guess:g} {item.unit} instead."
            )
    return tuple(moved), tuple(notes)


def check_reach(problem: Problem) -> None:
    """Refuse parameters that do not change any measured sample; those with prior knowledge are left alone.

    The sensitivities are those of predictions along the measured motion, so that a model that sticks at its guesses
    does not hide the others; and what nothing depends on at the guesses is tried at smaller ones, for dry friction that
    stops every motion within a sample reaches nothing, however large.

    Raises
    ------
    ModelError
        Naming all of them.
    """
    unseen, n = [item for item in problem.layout.free if item.prior is None], problem.layout.n_segments
    # what the first samples show needs no look at the others
    for factor, segments in ((1.0, 1 + n // FEW), *((factor, n) for factor in SMALLER)):
        if unseen:
            reach = _reach(problem, {item.name: factor * item.guess for item in problem.layout.free}, segments)
            unseen = [item for item in unseen if reach[item.name] < UNSEEN]
    if unseen:
        listing = ", ".join(f"`{item.name}`" for item in unseen)
        word, they = ("parameter", "it") if len(unseen) == 1 else ("parameters", "them")
        raise ModelError(
            f"The {word} {listing} of {problem.system.name} cannot be estimated: no measured sample depends on {they}. "
            f"Fix {they} (`fixed = true`), give a `prior`, or measure an output that depends on {they}."
        )


def _reach(problem: Problem, point: Mapping[str, float], segments: int) -> dict[str, float]:
    """Return by how many noise sds a change of each parameter by its size moves the sample that it moves most.

    Only the first `segments` are looked at.
    """
    data = stack_data(problem.layout, problem.experiments, 1.0 / problem.prior_sd)
    values = np.clip(scaled_values(problem, point), *bounds(problem))
    w = np.full(len(problem.outputs), 5 * dominant_frequency(problem.experiments))
    nodes = filtered_nodes(problem, values, w, data, segments)
    slopes = np.abs(sensitivities(problem, values, nodes, w, data).slopes)
    slopes[data[-len(problem.outputs) :, : slopes.shape[0]].T == 0] = 0.0
    largest = slopes.max(axis=(0, 1), initial=0.0)
    return {item.name: float(slope) for item, slope in zip(problem.layout.free, largest, strict=False)}


def start_points(free: tuple[Free, ...], number: int, seed: int) -> list[dict[str, float]]:
    """Return points within the bounds, evenly spread, by name in SI; the first are the guesses.

    They are those of a scrambled Sobol sequence. A parameter whose logarithm is estimated is spread evenly in that; an
    infinite bound is taken ten times as far out as the guess.

    Parameters
    ----------
    free
        The parameters.
    number
        How many points.
    seed
        Which scrambling.

    References
    ----------
    I. M. Sobol, USSR Comput. Math. Math. Phys. 7 (1967), 86-112, doi:10.1016/0041-5553(67)90144-9.
    A. B. Owen, J. Complexity 14 (1998), 466-489, doi:10.1006/jcom.1998.0487 (the scrambling).
    """
    first = {item.name: item.guess for item in free}
    if number <= 1 or not free:
        return [first]
    sobol = qmc.Sobol(len(free), rng=np.random.default_rng(seed))
    # a whole power of two points is what makes the sequence even
    shares = sobol.random_base2(int(np.ceil(np.log2(number))))[: number - 1]
    ranges = [_range(item) for item in free]
    return [first] + [
        {item.name: _between(item, *ends, share) for item, ends, share in zip(free, ranges, row, strict=True)}
        for row in shares
    ]


def _range(item: Free) -> tuple[float, float]:
    size = abs(item.guess) or item.scale
    lower, upper = item.lower, item.upper
    if not np.isfinite(upper):
        upper = max(DECADE * size, lower + size)
    if not np.isfinite(lower):
        lower = item.guess / DECADE if item.guess > 0 else min(-DECADE * size, upper - size)
    if item.is_log and not lower > 0:
        lower = min(item.guess, upper) / DECADE
    return lower, upper


def _between(item: Free, lower: float, upper: float, share: float) -> float:
    if item.is_log:
        return float(lower * (upper / lower) ** share)
    return float(lower + share * (upper - lower))


def distinct(fits: list[Fit]) -> list[Fit]:
    """Return one fit for each optimum, those with the lowest cost first."""
    found: list[Fit] = []
    for fit in sorted(fits, key=lambda fit: fit.cost):
        if not any(_same(fit, other) for other in found):
            found.append(fit)
    return found


def _same(fit: Fit, other: Fit) -> bool:
    if abs(fit.cost - other.cost) > SAME_COST:
        return False
    for one, two in zip(fit.parameters, other.parameters, strict=True):
        if one.status == two.status == "ok" and abs(one.value - two.value) > SAME_VALUE * max(one.sd, two.sd):
            return False
    return True


def best_of(fits: list[Fit | SolverError]) -> tuple[Fit | None, Starts]:
    """Return the converged fit with the lowest cost, and what became of all starts; a failed one is an error."""
    converged = [fit for fit in fits if isinstance(fit, Fit) and fit.success]
    ends = distinct(converged)
    return (ends[0] if ends else None), Starts(len(fits), len(converged), len(ends))


def shifted(free: tuple[Free, ...], point: Mapping[str, float]) -> dict[str, float]:
    """Return a point with the parameters of each run (`run:name`) set as the parameter they come from."""
    return {item.name: point.get(item.name, point.get(item.name.partition(":")[2], item.guess)) for item in free}
