"""Where fits begin, and what several starts find."""

from dataclasses import replace

import numpy as np
import pytest
from linear_runs import pushed, stuck_pendulum

from cartpend_dae import Component, ModelError, SolverError, Statements, assemble, der, initial, param, var
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover import FreeSpec, Setup
from cartpend_dae.identify import estimate
from cartpend_dae.language import Param
from cartpend_dae.multistart import Route, fit_study
from cartpend_dae.parallel import in_parallel
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.starting import best_of, check_reach, off_the_bounds, start_points
from cartpend_dae.unknowns import Free


def free(name, guess, lower, upper, **more):
    return Free(name, guess, lower, upper, abs(guess) or 1.0, "1", **more)


def test_starts_fill_the_bounds_evenly_the_guesses_first():
    items = (free("a", 2.0, 1.0, 9.0), free("b", 1.0, 0.01, 100.0, is_log=True))
    points = start_points(items, 65, 3)
    assert points[0] == {"a": 2.0, "b": 1.0}
    a, b = (np.array([point[name] for point in points[1:]]) for name in "ab")
    # a scrambled Sobol sequence of 2^6 points has one in each of 64 equal parts of either axis
    for shares in ((a - 1) / 8, np.log(b / 0.01) / np.log(1e4)):
        assert sorted(np.floor(64 * shares).astype(int)) == list(range(64))
    assert points == start_points(items, 65, 3) != start_points(items, 65, 4)


def test_a_bound_at_infinity_is_a_decade_from_the_guess():
    points = start_points((free("a", 2.0, 0.0, np.inf), free("b", -3.0, -np.inf, np.inf)), 257, 0)
    a, b = (np.array([point[name] for point in points]) for name in "ab")
    assert 0 <= a.min() < 0.2 and 19 < a.max() <= 20
    assert -30 <= b.min() < -28 and 28 < b.max() <= 30


def test_a_guess_on_its_bound_is_moved_inside_with_a_sentence():
    moved, notes = off_the_bounds((free("a", 0.0, 0.0, 0.5), free("b", 1.0, 0.0, 2.0)))
    assert moved[0].guess == 0.005 and moved[1].guess == 1.0
    assert notes == ("The start value 0 1 of `a` lies on its bound; the fit began at 0.005 1 instead.",)


def test_parameters_that_reach_no_output_are_named_before_the_solve():
    problem, _ = pushed(1e-2 * np.random.default_rng(0).standard_normal(200))
    check_reach(problem)
    system = problem.system
    items = (*problem.free, free_parameter(system, "mass.L"))
    with pytest.raises(ModelError, match=r"parameter `mass\.L` of Pushed cannot be estimated: no measured sample"):
        check_reach(make_problem(system, items, problem.experiments))


def test_a_guess_of_friction_that_would_hold_the_model_hides_nothing():
    problem = stuck_pendulum()
    check_reach(replace(problem, free=(problem.free[0], replace(problem.free[1], guess=5.0))))


class Wave(Component):
    """s = sin(w t): samples of it are fitted by several w."""

    s = var(unit="1")
    c = var(unit="1")
    w: Param = param(unit="rad/s", default=5.0, min=0)

    def equations(self) -> Statements:
        yield der(self.s) == self.w * self.c
        yield der(self.c) == -self.w * self.s
        yield initial(self.s == 0)
        yield initial(self.c == 1)


def wave(starts):
    time = np.arange(200) / 50
    values = np.sin(5.0 * time) + 0.01 * np.random.default_rng(0).standard_normal(time.size)
    outputs = {"s": Channel(values, "zoh", 0.01, "1", 0.0)}
    run = Experiment("run", "train", time, {}, outputs, {"s": Start(0.0, False)}, "free", None)
    setup = Setup(Wave(), (FreeSpec("w", 12.0, 0.5, 20.0),), (run,), (), ())
    return fit_study(setup, Route(starts, 0, 1), lambda *_: None)[1]


def test_several_starts_find_the_lowest_of_many_optima():
    fit = wave(8)
    assert fit.values["w"] == pytest.approx(5.0, abs=4 * fit.parameters[0].sd)
    assert "of 8 starts converged, to" in fit.notes[-1]


def test_the_number_of_processes_changes_nothing():
    problem = stuck_pendulum()
    points = start_points(problem.free, 4, 1)
    one, two = (list(in_parallel(lambda p: estimate(problem, guess=p).values, points, jobs=jobs)) for jobs in (1, 2))
    assert one == two


def test_a_fit_that_fails_ends_nothing():
    problem = stuck_pendulum()
    fit = estimate(problem)
    worse = replace(fit, cost=fit.cost + 1)
    best, outcome = best_of([SolverError("it diverges."), worse, fit, replace(fit, success=False, cost=0.0)])
    assert best is fit
    assert str(outcome) == "2 of 4 starts converged, to 2 distinct optima; the one with the lowest cost was taken."
    assert best_of([SolverError("no")])[0] is None


def test_an_error_in_a_process_is_that_of_the_caller():
    def fail(k):
        raise ModelError(f"no {k}")

    with pytest.raises(ModelError, match="no 1"):
        list(in_parallel(fail, [1, 2], jobs=2))
    assert assemble(Wave()).states
