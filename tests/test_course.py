"""The likeliest course under random forces is generalised least squares, and laws are weighed along it as they act."""

import numpy as np
import pytest
from test_unknown_input import WIDTH, N, chain_of

from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover import iterated
from cartpend_dae.discover.course import led, smoothed
from cartpend_dae.discover.disturbed import fitted
from cartpend_dae.discover.iterated import _at
from cartpend_dae.discover.records import FreeSpec, Setup
from cartpend_dae.discover.unknown_input import whitened
from cartpend_dae.discover.weigh import Forces, loads_at, weigh
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import catalogue, insertion_at, places
from cartpend_dae.errors import SolverError
from models.linear_damp_mod import LinearDampMod

NOISE, STEP, FRICTION = 5e-5, 0.01, 30.0


def cart(f_c: float, seed: int) -> Workbench:
    """Two decays of the cart between its springs, pushed by random forces; stepped here, friction and all."""
    generator, runs = np.random.default_rng(seed), []
    mass, damping, keep, substeps = 4.609 + 6.8, 48.0 - f_c, np.exp(-STEP / 0.3), 100
    for number, x in enumerate((0.12, -0.11)):
        v, force, seen, h = 0.0, generator.standard_normal(), [], STEP / substeps
        for _ in range(401):
            seen.append(x)
            for _ in range(substeps):
                v += h * (force - (1197.3 + 1320.1) * x + (1320.1 - 1197.3) * 0.095 - damping * v) / mass
                v = np.sign(v) * max(abs(v) - h * f_c / mass, 0.0)
                x += h * v
            force = keep * force + np.sqrt(1 - keep**2) * generator.standard_normal()
        values = np.array(seen) + NOISE * generator.standard_normal(401)
        channels = {"encoder.s": Channel(values, "zoh", NOISE, "m", 0.0)}
        start = {"encoder.s": Start(seen[0], False), "inertial.v": Start(0.0, False)}
        runs.append(Experiment(f"run{number}", "train", STEP * np.arange(401), {}, channels, start, "free", None))
    setup = Setup(LinearDampMod(), (FreeSpec("rail.d"), FreeSpec("inertial.m")), tuple(runs), (), ())
    return Workbench(setup, lambda *_: None)


def loads_of(bench: Workbench) -> tuple:
    found = places(bench.setup.model, ("encoder.s",), catalogue())
    return tuple(load for load in loads_at(found) if load.place.at == "rail")


@pytest.mark.parametrize("n_y", [1, 2])
def test_the_smoother_is_least_squares_over_all_forces(n_y):
    chain = chain_of(n_y)
    chain.noise[:] = 0.0
    sizes, times = np.array([[3.0, 40.0], [6.0, 10.0]]), np.array([[0.1, 0.5], [0.5, 0.2]])
    generator = np.random.default_rng(4)
    rows = chain.spread(generator.standard_normal((int(chain.measured.sum()), 3)))
    white, states, forces = smoothed(chain, rows, sizes, times)
    expected = whitened(chain, rows, sizes[None], times[None]).rows[0]
    np.testing.assert_allclose(white[chain.measured], expected[chain.measured], atol=1e-9)
    # every force at every sample is unknown: what each would do to the states, and to what is measured
    n_x, keep = chain.error.shape[2], np.exp(-WIDTH / times)
    moved = np.zeros((N, 2, N, n_x))
    prior = np.zeros((2, N, N))
    for run, (begin, end) in enumerate(((0, 70), (70, N))):
        lags = np.abs(np.subtract.outer(np.arange(begin, end), np.arange(begin, end)))
        prior[:, begin:end, begin:end] = sizes[run, :, None, None] ** 2 * keep[run, :, None, None] ** lags
        for k in range(begin, end):
            for d in range(2):
                x = np.zeros(n_x)
                for i in range(k, end):
                    moved[k, d, i] = x
                    x = chain.transition[i] @ x + (chain.pushes[i][:, d] if i == k else 0.0)
    seen = np.einsum("iyx,kdix->iykd", chain.error, moved)[chain.measured].reshape(-1, 2 * N)
    covariance = np.zeros((N, 2, N, 2))
    covariance[:, 0, :, 0], covariance[:, 1, :, 1] = prior
    covariance = covariance.reshape(2 * N, 2 * N)
    gain = covariance @ seen.T @ np.linalg.inv(seen @ covariance @ seen.T + np.eye(len(seen)))
    likeliest = (gain @ rows[chain.measured]).reshape(N, 2, -1)
    np.testing.assert_allclose(forces, likeliest, atol=1e-8 * np.abs(likeliest).max())
    motion = np.einsum("kdix,kdm->ixm", moved, likeliest)
    np.testing.assert_allclose(states, motion, atol=1e-8 * np.abs(motion).max())


def test_what_grows_beyond_all_numbers_is_no_course(monkeypatch):
    """The smoother had ended a whole search with "Matrix is not positive definite"."""

    chain = chain_of(1)
    chain.noise[:], chain.transition[30:] = 0.0, 1e200
    with pytest.raises(SolverError, match="grows beyond all numbers"):
        smoothed(chain, np.ones((N, 1, 2)), np.array([[3.0, 40.0]] * 2), np.array([[0.1, 0.5]] * 2))
    bench, sd = cart(FRICTION, 0), np.array([NOISE])
    effect, loads = (insertion_at(bench.setup.model, "coulomb_friction", "rail"),), loads_of(bench)
    guess = {"rail.coulomb_friction.f_c": 30.0}
    fit = bench.fit(effect, guess, (5.0,), sd, patient=False)
    weighed = weigh(bench, effect, loads, fit.point, 5.0, sd)

    def diverges(*_):
        raise SolverError("it diverges")

    monkeypatch.setattr(iterated, "_target", diverges)
    found = iterated.refined(bench, effect, loads, (fit, weighed), sd)
    assert found is None or found[1].criterion < weighed.criterion  # the first course stands


def test_what_is_linear_is_as_likely_along_any_course():
    bench = cart(0.0, 1)
    loads, sd, found = loads_of(bench), np.array([NOISE]), []
    for bandwidth in (2.0, 50.0):
        model, course = led(bench, (), loads, {}, bandwidth, sd)
        found.append(_at(model, course, Forces(model.names, np.full((2, 1), 1.0), np.full((2, 1), 0.3))))
    assert np.abs(found[0].course.states - found[1].course.states).max() > 1e-3
    assert found[0].criterion == pytest.approx(found[1].criterion, abs=1e-3)


def test_a_contact_whose_levels_are_equal_is_not_taken_for_one_whose_levels_differ():
    """Along the motion that the injection led, two levels for one explained 104 more of -2 ln likelihood."""
    bench, sd = cart(FRICTION, 4), np.array([NOISE])
    fits = {}
    for name in ("coulomb_friction", "asymmetric_friction"):
        effect = insertion_at(bench.setup.model, name, "rail")
        guess = dict.fromkeys(effect.size_names, FRICTION) if name == "coulomb_friction" else {}
        guess |= {f"rail.{name}.f_c_pos": FRICTION, f"rail.{name}.f_c_neg": FRICTION} if not guess else {}
        fits[name] = fitted(bench, (effect,), loads_of(bench), guess, 5.0, sd)
    fit, plain = fits["coulomb_friction"]
    rich = fits["asymmetric_friction"][1]
    assert fit.values["rail.coulomb_friction.f_c"] == pytest.approx(FRICTION, abs=1.0)
    # one level more and a damping of each direction: chi-squared of three
    assert -1.0 < plain.criterion - rich.criterion < 12.0


def test_a_sweep_along_a_trail_is_linear_as_the_course_is():
    bench, sd = cart(FRICTION, 0), np.array([NOISE])
    effect, loads = (insertion_at(bench.setup.model, "coulomb_friction", "rail"),), loads_of(bench)
    fit, found = fitted(bench, effect, loads, {"rail.coulomb_friction.f_c": 30.0}, 5.0, sd)
    assert found.trail is not None
    # one sweeps all effects along what the other one found sample by sample, where 600 of 1,000 samples stick
    assert found.linear == pytest.approx(found.criterion, abs=1.0)
    free = weigh(bench, effect, loads, fit.point, float(fit.bandwidth[0]), sd, near=found.forces)
    assert free.linear > found.linear + 20
