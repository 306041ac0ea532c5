"""The search for a start: from the guess, by other ways where that fails, and with the modes of dry friction."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.sparse import csr_array

from cartpend_dae.events import settled_modes
from cartpend_dae.start_conditions import Conditions, Rank, Request, conditions_of
from cartpend_dae.start_paths import followed, relaxed
from cartpend_dae.start_solver import Outcome, Ranked, finite_rows, first_guess, independent, is_met, newton, shifted
from cartpend_dae.system import System


def ranked(conditions: Conditions, request: Request, mode: np.ndarray, without: tuple[int, ...] = ()) -> Ranked:
    """Return the conditions in numbers, but for the rows `without`."""
    known = np.delete(np.asarray(request.p, dtype=float), list(conditions.unknown))
    kept = np.delete(np.arange(conditions.ranks.size), list(without))

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, csr_array]:
        residual, slopes = conditions.function(point, request.u, known, request.time, mode)
        values, entries = np.asarray(residual).ravel(), np.asarray(slopes).ravel()
        jacobian = csr_array((entries, *conditions.structure), shape=(values.size, point.size))
        return (values[kept], jacobian[kept]) if without else (values, jacobian)

    return Ranked(evaluate, conditions.ranks[kept], conditions.scale, Rank.FIXED)


@np.errstate(over="ignore", invalid="ignore")  # a trial too far is shortened
def search(conditions: Conditions, problem: Ranked, base: np.ndarray, tried: list[str]) -> Outcome:
    """Try one way after another until the conditions hold; of failures return the first that says most."""
    guess = first_guess(problem, base, Rank.CALLER)
    first = outcome = newton(problem, guess)
    tried.append("damped Newton steps from the start values")
    if first.is_solved:
        return _with_defaults(conditions, problem, guess, first)
    for way, begin in _other_ways(conditions, problem, guess):
        if way not in tried:
            tried.append(way)
        point = begin()
        if point is None:
            continue
        outcome = newton(problem, point)
        if outcome.is_solved:
            return outcome
        if outcome.has_converged > first.has_converged or outcome.is_finite > first.is_finite:
            first = outcome
    return first


def _with_defaults(conditions: Conditions, problem: Ranked, guess: np.ndarray, found: Outcome) -> Outcome:
    """Return a start that keeps more of the guesses, where these gave way only because slopes vanish at the guess.

    With y^2 = x and the guesses x = 4, y = 0 the equation seems to determine x, as its slope in y is zero there.
    """
    given = (problem.ranks <= Rank.ZERO) & ~is_met(found)
    if not np.any(given):
        return found
    near = next(shifted(guess, conditions.scale))
    residual, jacobian = problem.evaluate(near)
    if np.array_equal(jacobian.data, found.jacobian.data):
        return found
    chosen = independent(jacobian, finite_rows(residual, jacobian))
    wanted = chosen[given[chosen]]
    if not wanted.size:
        return found
    other = newton(problem, near)
    is_better = other.is_solved and np.sum(~is_met(other)[chosen]) < np.sum(given[chosen])
    return other if is_better else found


def _other_ways(
    conditions: Conditions, problem: Ranked, guess: np.ndarray
) -> Iterator[tuple[str, Callable[[], np.ndarray | None]]]:
    """Yield where else Newton's method may begin, and the words for it."""
    n_x, _, n_f, _ = conditions.sizes
    resting = np.flatnonzero(problem.ranks == Rank.STEADY)
    n_equations = int(np.sum(problem.ranks == Rank.EQUATION))
    others = np.concatenate([np.arange(conditions.n_alg), np.arange(n_equations - n_f, n_equations)])
    is_whole = n_x > 0 and resting.size == n_x
    points = [guess]
    residual, jacobian = problem.evaluate(guess)
    if not np.all(finite_rows(residual, jacobian)[problem.ranks <= Rank.FIXED]):
        points += [next(shifted(guess, conditions.scale))]
    for point in points:
        if is_whole:
            yield "implicit Euler steps to a rest", lambda point=point: relaxed(problem, point, resting, others)
        for direction in (1.0, -1.0):
            yield (
                "a path along r(v) = (1 - s) r(v_0)",
                lambda point=point, direction=direction: followed(problem, point, direction),
            )
    for point in shifted(guess, conditions.scale):
        yield "shifted guesses", lambda point=point: point


def with_friction(system: System, request: Request, conditions: Conditions, tried: list[str]) -> Outcome:
    """Find modes of dry friction (backward, stuck, forward) and a start that agree, beginning with those of the guess.

    Where they do not settle the friction is smoothed, less and less, and the modes are taken from there.
    """
    n_f = len(system.frictions.places)
    free = ranked(conditions, request, np.zeros(n_f))
    done = _agreed(system, request, conditions, (first_guess(free, conditions.base, Rank.CALLER), 1e-9), tried)
    if done.is_solved:
        return done
    tried.append("smoothed dry friction")
    smooth, point = conditions_of(system, request, "smooth"), conditions.base
    for sharpness in 10.0 ** np.arange(0, -7, -1):
        outcome = search(smooth, ranked(smooth, request, np.full(n_f, sharpness)), point, tried)
        if not outcome.is_solved:
            return done
        point = outcome.point
    return _agreed(system, request, conditions, (point, 1e-5), tried)


def _agreed(
    system: System, request: Request, conditions: Conditions, begin: tuple[np.ndarray, float], tried: list[str]
) -> Outcome:
    """Repeat a search with the modes of its last outcome until they stay; `begin` is a point and a speed of rest."""
    mode = _modes(system, request, conditions, *begin)
    found = search(conditions, ranked(conditions, request, mode), begin[0], tried)
    for _ in range(2 * mode.size + 3):
        if not found.is_solved:
            return found
        settled = _modes(system, request, conditions, found.point, 1e-9)
        if np.array_equal(settled, mode):
            return found
        mode = settled
        found = search(conditions, ranked(conditions, request, mode), found.point, tried)
    return replace(found, has_converged=False)


def _modes(system: System, request: Request, conditions: Conditions, point: np.ndarray, near: float) -> np.ndarray:
    """Return the modes of dry friction at a point, those slower than `near` at rest."""
    n_x, n_z, n_f, _ = conditions.sizes
    x, z, p = point[:n_x], point[n_x : n_x + n_z], np.array(request.p, dtype=float)
    p[list(conditions.unknown)] = point[n_x + n_z + n_f :]
    arguments = [system.time, system.x, system.z, system.u, system.p]
    speed = ca.Function("speed", arguments, [system.frictions.speed])
    speeds = np.asarray(speed(request.time, x, z, request.u, p)).ravel()
    signs = np.where(np.abs(speeds) > near, np.sign(speeds), 0.0)
    return settled_modes(system, request.time, x, signs, z, request.u, p)
