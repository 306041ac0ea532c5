"""How likely a fit is against random forces, linearised along the motion that these forces make likeliest.

A rig that sticks and slips is not linear: along a simulation that the output injection leads it changes its direction
a little early or late, and so does the force of the contact, which the filter takes for random forces that no law can
explain. Here the forces enter the model, and what is linear is taken anew along their likeliest course, until that
stays as it is. Parameters and starts go along.

References
----------
B. M. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optim. 4 (1994), 626-636,
doi:10.1137/0804035.
"""

from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.discover.contact import is_dry
from cartpend_dae.discover.course import Course, Forced, Linear, led, smoothed
from cartpend_dae.discover.regime import sampling_rate
from cartpend_dae.discover.trail import Trail
from cartpend_dae.discover.unknown_input import whitened
from cartpend_dae.discover.weigh import (
    LONGEST,
    TIMES,
    Forces,
    Weighed,
    first_sets,
    in_all_runs,
    jackknife,
    most_likely,
    point_at,
    step_of,
    weigh,
)
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import SolverError
from cartpend_dae.gauss_newton import bounds
from cartpend_dae.identify import Fit

# the course is found anew so often at most, until -2 ln likelihood falls by less; where it rises, by shares of the way
ROUNDS, LITTLE = 10, 0.3
SHARES = (0.5, 0.25, 0.125)
# factors on size and time of each force that are tried along each course
NEARBY = ((0.6, 1.0), (1.6, 1.0), (1.0, 0.5), (1.0, 2.0))
# correlation times [s]; shorter ones are found first by what is linear along a course that is not the forces' own
ALLOWED = (0.04, LONGEST)
# factors on all sizes, of all forces with one time
TOGETHER = (0.4, 0.7, 1.0, 1.5)
# standard deviation of a step of the scaled variables
REACH = 0.3
# share of the sampling rate at which the injection may lead the first course
FAST = 1.6
# samples of all runs up to which courses are followed: each one takes 2 to 3 ms per sample
MOST = 10_000


@dataclass(frozen=True, slots=True)
class _Seen:
    """A course, linear along it, under its likeliest forces."""

    course: Course
    linear: Linear
    forces: Forces
    criterion: float


def can_follow(bench: Workbench) -> bool:
    """Return whether the runs are short enough for their likeliest courses to be followed."""
    return sum(len(run.time) for run in bench.setup.train) <= MOST


def refined(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    loads: tuple[Insertion, ...],
    found: tuple[Fit, Weighed],
    sd: np.ndarray,
) -> tuple[Fit, Weighed] | None:
    """Return a fit and its weighing along the likeliest course; None if nothing rubs, or it is not likelier."""
    fit, weighed = found
    rubs = bool(bench.problem(taken).system.frictions.places) or any(is_dry(one.card) for one in taken)
    if not rubs or not np.any(weighed.forces.sizes) or not can_follow(bench):
        return None
    acting = tuple(load for load in loads if load.size_names[0] in weighed.forces.names)
    bandwidth = float(fit.bandwidth[0])
    try:
        ends = [(model, _likeliest(model, seen)) for model, seen in _first(bench, taken, acting, found, sd)]
        model, seen = min(ends, key=lambda end: end[1].criterion)
        if not seen.criterion < weighed.criterion:
            return None
        point = point_at(model.problem, seen.course.values)
        ahead = bench.fit(taken, point, (bandwidth,), sd, patient=False, iterations=0)
        trail = _trail(model, seen, acting)
        after = weigh(bench, taken, loads, ahead.point, bandwidth, sd, near=seen.forces, is_rough=True, trail=trail)
    except SolverError:
        return None
    chain, rows = seen.linear.chain, seen.linear.rows
    white = whitened(chain, rows, seen.forces.sizes[None], seen.forces.times[None])
    variables = [(model.problem.variables[i], seen.course.values[i]) for i in model.fitted]
    free = [(item, v) for item, v in variables if item in model.problem.layout.free]
    most = np.array([abs(item.value(v) / item.slope(v)) for item, v in free])
    validated, spread = jackknife(white.rows[0], white.determinant[0].sum(), chain, most)
    sds = {item.name: item.slope(v) * float(s) for (item, v), s in zip(free, spread, strict=True)}
    return ahead, replace(after, criterion=seen.criterion, validated=validated, forces=seen.forces, sd=sds)


def _trail(model: Forced, seen: _Seen, acting: tuple[Insertion, ...]) -> Trail | None:
    """Return the course to screen along; None where nothing sticks, as the injection leads a smooth rig as well.

    Along a course that forces explain whole, all forces and inertias made smaller together would pass for an effect.
    """
    system = model.problem.system
    if not system.frictions.places:
        return None
    return Trail(system.states, seen.course.states[: len(system.states)], acting, seen.course.forces)


def _first(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    acting: tuple[Insertion, ...],
    found: tuple[Fit, Weighed],
    sd: np.ndarray,
) -> list[tuple[Forced, _Seen]]:
    """Return the model with each of two courses: along the fit's own injection, and along a fast one.

    The fast one has the reversals where they were measured; from the other one the likelihood may end lower by 40.
    """
    fit, weighed = found
    courses: list[tuple[Forced, _Seen]] = []
    names = tuple(load.size_names[0] for load in acting)
    order = [weighed.forces.names.index(name) for name in names]
    sizes, times = weighed.forces.sizes[:, order], weighed.forces.times[:, order]
    allowed = np.clip(times, *ALLOWED)
    near = Forces(names, sizes * np.sqrt(times / allowed), allowed)
    for bandwidth in (float(fit.bandwidth[0]), FAST * sampling_rate(bench)):
        try:
            model, course = led(bench, taken, acting, fit.point, bandwidth, sd)
            linear = model.along(course)
        except SolverError:
            continue
        forces, criterion = most_likely(linear.chain, linear.rows, first_sets(weighed.found, linear.chain, near), 0)
        courses.append((model, _Seen(course, linear, forces, criterion)))
    if not courses:
        raise SolverError("The model diverges however the output injection leads it.")
    return courses


@np.errstate(over="ignore", invalid="ignore")
def _likeliest(model: Forced, seen: _Seen) -> _Seen:
    """Go on to the likeliest course, as long as the likelihood rises; the first step may lower it."""
    for number in range(ROUNDS):
        try:
            ahead = _target(model, seen)
            trial = _at(model, ahead, seen.forces)
            for share in SHARES if number else ():
                if trial.criterion < seen.criterion:
                    break
                trial = _at(model, seen.course.towards(ahead, share), seen.forces)
        except SolverError:  # it diverges there
            break
        gain = seen.criterion - trial.criterion
        if number and not gain > 0:
            break
        seen = trial
        if number and gain < LITTLE:
            break
    return seen


def _at(model: Forced, course: Course, near: Forces) -> _Seen:
    """Linearise along a course, and look for likelier forces near those of the course before.

    The variables are those of the course: what a step of theirs would change to first order may be far off.
    """
    linear = model.along(course)
    sizes, times = _near(near)
    forces, criterion = most_likely(linear.chain, linear.rows[:, :, :1], (sizes, times), 0)
    return _Seen(course, linear, forces, criterion)


def _near(forces: Forces) -> tuple[np.ndarray, np.ndarray]:
    """Return sizes and times (n_sets, n_runs, n_d) to try: as they are, each force otherwise, and all with one time."""
    sets = [(forces.sizes, forces.times), in_all_runs(forces.sizes, forces.times)]
    for d in range(len(forces.names)):
        for factor, time in NEARBY:
            size, width = forces.sizes.copy(), forces.times.copy()
            size[:, d], width[:, d] = factor * size[:, d], np.clip(time * width[:, d], *ALLOWED)
            sets.append((size, width))
    for time in TIMES:  # as strong at low frequencies
        alike = forces.sizes * np.sqrt(forces.times / time)
        sets += [(factor * alike, np.full(alike.shape, time)) for factor in TOGETHER]
    return np.array([size for size, _ in sets]), np.array([width for _, width in sets])


def _target(model: Forced, seen: _Seen) -> Course:
    """Return the likeliest course to first order, its variables within their bounds."""
    linear, forces = seen.linear, seen.forces
    white, states, pushes = smoothed(linear.chain, linear.rows, forces.sizes, forces.times)
    values, fitted = seen.course.values.copy(), model.fitted
    lower, upper = (side[fitted] for side in bounds(model.problem))
    rows = white[linear.chain.measured]
    # what the data do not tell stays where it is
    held = np.hstack([np.zeros((len(fitted), 1)), np.eye(len(fitted)) / REACH])
    values[fitted] = np.clip(values[fitted] + step_of(np.vstack([rows, held])), lower, upper)
    shift = (values - seen.course.values)[fitted]
    # the filter follows what takes the residual away, which is the motion itself with the other sign
    found, forced = (part[:, :, 0] + part[:, :, 1:] @ shift for part in (states, pushes))
    return Course(values, (seen.course.states.T + linear.offset + linear.slopes @ shift - found).T, -forced.T)
