"""What no effect of the catalogue explains: where it acts, and what a law without a name explains there."""

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import casadi as ca
import independent
import numpy as np
import pytest
from test_discover_pendulum import COULOMB, clean_run, noisy_setup

from cartpend_dae import ModelError, assemble, simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover import FreeSpec, Setup, Workbench, closure_at, discover, localize
from cartpend_dae.discover.closure import KINDS, Reach, weights
from cartpend_dae.discover.localize import LIMIT
from cartpend_dae.discover.open_set import OpenSet
from cartpend_dae.effects import catalogue, insert_all, places
from cartpend_dae.errors import SolverError
from cartpend_dae.library import closures
from models.driven_cart import DrivenCart
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp

pytestmark = pytest.mark.xdist_group("open")

PLAIN = tuple(card for card in catalogue() if card.id in ("constant_load", "sensor_gain", "quadratic_drag"))
REACH = Reach(middle=0.02, half=0.3, speed=1.0, force=0.5)


def load_place(model):
    return next(place for place in places(model) if place.insertion == "parallel")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("model", [RotaDamp(), LinearDampMod()], ids=["turning", "sliding"])
def test_a_closure_is_absent_where_its_weights_are_zero_and_acts_where_not(model, kind):
    closure = closure_at(load_place(model), kind, REACH)
    more = insert_all(model, (closure,))
    free = weights(assemble(more), closure.prefix)
    plain, same = simulate(model, 1.0, points=51), simulate(more, 1.0, points=51)
    name = assemble(model).states[0]
    np.testing.assert_allclose(same[name], plain[name], rtol=0, atol=1e-12)
    outer = {item.name: 1.0 for item in free if item.name.endswith(".a")}
    felt = simulate(more, 1.0, points=51, parameters=outer)
    assert np.abs(felt[name] - plain[name]).max() > 1e-4
    assert all(item.prior is not None and item.prior.sd == 1.0 for item in free)


def test_a_closure_does_not_stand_in_series():
    series = next(place for place in places(LinearDampMod()) if place.insertion == "series")
    with pytest.raises(ModelError, match=r"is no place for a closure, which stands between two flanges, before an inp"):
        closure_at(series, "spline", REACH)


def test_a_closure_is_of_a_kind_that_there_is():
    with pytest.raises(
        ModelError, match=r"no closure of the kind `neural`; the kinds are: `spline`, `process`, `netwo"
    ):
        closure_at(load_place(LinearDampMod()), "neural", REACH)
    with pytest.raises(ModelError, match=r"no closure of the kind `splines`; did you mean `spline`\?"):
        closure_at(load_place(LinearDampMod()), "splines", REACH)


@pytest.mark.parametrize("kind", KINDS)
def test_a_closure_before_an_input_or_behind_a_sensor_is_absent_at_first_and_then_felt(kind):
    reach = Reach(middle=0.0, half=6.0, speed=1.0, force=1.0)
    model = DrivenCart()
    found = {place.insertion: place for place in places(model, ("encoder.s",)) if place.kind is None}
    both = tuple(closure_at(found[manner], kind, reach) for manner in ("input", "sensor"))
    more = insert_all(model, both)
    names = {"u": f"amplifier.u.{kind}_closure.u", "y": f"encoder.s.{kind}_closure.y"}
    plain = simulate(model, 0.5, points=51, inputs={"amplifier.u": 4.0})
    same = simulate(more, 0.5, points=51, inputs={names["u"]: 4.0})
    np.testing.assert_allclose(same[names["y"]], plain["encoder.s"], rtol=0, atol=1e-12)
    outer = {item.name: 1.0 for item in weights(assemble(more), both[0].prefix) if item.name.endswith(".a")}
    felt = simulate(more, 0.5, points=51, inputs={names["u"]: 4.0}, parameters=outer)
    assert np.abs(felt["encoder.s"] - plain["encoder.s"]).max() > 1e-4


def test_the_pieces_of_a_spline_are_one_together_and_smooth():
    z = ca.SX.sym("z")
    pieces = closures.bumps()
    whole = ca.substitute(closures.spline(pieces, z), ca.vertcat(*(p.a for p in pieces)), ca.SX.ones(len(pieces)))
    value = ca.Function("value", [z], [whole])
    for at in np.linspace(-1.5, 1.5, 31):
        assert float(value(at)) == pytest.approx(1.0, abs=1e-12)
    u = ca.SX.sym("u")
    slope = ca.Function("slope", [u], [ca.jacobian(closures.b_spline(u), u)])
    for knot in (-2.0, -1.0, 1.0, 2.0):
        assert float(slope(knot - 1e-9)) == pytest.approx(float(slope(knot + 1e-9)), abs=1e-7)


def test_the_waves_have_the_covariance_of_the_process():
    """Within the box the sum over waves is the squared exponential kernel, up to the waves that are left out."""
    orders = [(wave.i, wave.j) for wave in closures.waves()]

    def row(x, v):
        sines = [np.sin(np.pi * np.array([i * (x + 1.5), j * (v + 1.5)]) / 3).prod() for i, j in orders]
        return np.array(sines) * [closures.wave_sd(i, j) for i, j in orders]

    points = [(0.0, 0.0), (0.3, -0.2), (0.5, 0.5), (-0.6, 0.4)]
    for a in points:
        for b in points:
            kernel = np.exp(-((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) / (2 * closures.LENGTH**2))
            assert row(*a) @ row(*b) == pytest.approx(kernel, abs=0.08)  # 18 waves leave out 5 % of the variance


@pytest.fixture(scope="module")
def coulomb_setup():
    return noisy_setup(clean_run(COULOMB), 0)


@pytest.fixture(scope="module")
def found(coulomb_setup):
    times, angles = independent.pendulum(duration=4.0, angle=0.4, viscous=0.015, coulomb=COULOMB)
    (run,) = coulomb_setup.train
    channel = replace(run.outputs["bearing.phi"], values=angles + 1e-3 * np.random.default_rng(9).standard_normal(401))
    test = replace(run, name="test", role="test", time=times, outputs={"bearing.phi": channel})
    return discover(replace(coulomb_setup, test=(test,)), cards=PLAIN)


def test_dry_friction_outside_the_catalogue_is_left_open_and_placed(found):
    assert found.search.verdict == "unexplained" and not found.search.steps
    left = found.beyond.open_set
    assert left.where.places[0].at == left.at == "bearing"
    assert left.where.places[0].evidence > 10 * LIMIT
    assert left.portrait.shares["sign v"] > 0.7  # beside the viscous friction that is free
    assert "not in the catalogue. It acts at `bearing`" in left.sentence
    assert "the direction of motion" in left.sentence


def test_a_law_without_a_name_explains_it_on_the_test_run_too(found):
    left = found.beyond.open_set
    assert left.is_a_law and left.explained > 0.95
    before = found.before.runs[-1].outputs["bearing.phi"].rmse
    after = left.errors.runs[-1].outputs["bearing.phi"].rmse
    assert left.errors.runs[-1].role == "test"
    # the noise is 1 mrad; the model without friction is 10 times as far off
    assert before > 5e-3 and after < 0.4 * before


def test_a_closure_whose_numbers_grow_beyond_all_bounds_leaves_the_others(coulomb_setup, found, monkeypatch):
    """The whole record of a measured motor ended with a fault: the eigenvalues of one closure did not converge."""
    module = import_module("cartpend_dae.discover.open_set")
    trained = found.beyond.open_set.closures[0]

    def train(bench, taken, before, closure, stages, sd):
        if closure == KINDS[0]:
            raise SolverError("The fit ended where the sensitivities grow beyond all bounds.")
        return trained

    monkeypatch.setattr(module, "closure_at", lambda place, kind, reach: kind)
    monkeypatch.setattr(module, "train", train)
    left = module.open_set(Workbench(coulomb_setup), found.search)
    assert left.closures == (trained,) * (len(KINDS) - 1)


def test_where_nothing_is_missing_no_place_counts():
    where = localize(Workbench(noisy_setup(clean_run(0.0), 3)))
    assert [place.at for place in where.places if place.evidence > LIMIT] == []
    assert not where.portraits


def test_one_sensor_cannot_tell_a_load_from_its_own_error_by_shape(coulomb_setup):
    where = localize(Workbench(coulomb_setup))
    assert {place.at: place.alike for place in where.places} == {
        "bearing": ("bearing.phi",),
        "bearing.phi": ("bearing",),
    }
    assert "cannot be told apart, only by how small and slow" in where.statement
    bearing = where.places[0]
    assert bearing.rms > 3 * bearing.placebo and bearing.unit == "N.m"


def test_the_estimated_load_is_the_one_that_acted():
    """A cart on springs is pushed for a second by a force that the model knows nothing of."""
    times = np.linspace(0, 6, 601)
    push = np.where((times > 2) & (times < 3), 4.0, 0.0)
    m, k, d = 11.409, 1197.3 + 1320.1, 48.0
    offset = 0.095 * (1320.1 - 1197.3)
    state, found = np.array([0.05, 0.0]), []
    for force in push:  # exact between samples, the force being constant there
        found.append(state[0])
        for _ in range(50):
            v = state[1] + 1e-4 * (offset - k * state[0] - d * state[1] + force) / m
            state = np.array([state[0] + 2e-4 * v, state[1] + 2e-4 * (offset - k * state[0] - d * v + force) / m])
    measured = np.array(found) + 2e-5 * np.random.default_rng(1).standard_normal(times.size)
    channel = Channel(measured, "zoh", None, "m", 0.0)
    start = {"encoder.s": Start(None, True), "inertial.v": Start(0.0, False)}
    run = Experiment("push", "train", times, {}, {"encoder.s": channel}, start, "free", None)
    bench = Workbench(Setup(LinearDampMod(), (FreeSpec("rail.d", guess=40.0, lower=0.0),), (run,), (), ()))
    where = localize(bench)
    assert where.places[0].at == "rail" and where.places[0].evidence > LIMIT
    series = where.series["push"]
    during = (series["time"] > 2.15) & (series["time"] < 2.85)
    # positive opposes motion to the positive side: the push is -4 N of it
    assert series["rail"][during].mean() == pytest.approx(-4.0, abs=0.4)
    after = series["time"] > 3.5
    assert abs(series["rail"][after].mean()) < 0.4


@pytest.mark.parametrize(("share", "words"), [(0.27, "explains 27 % of it"), (-55.0, "explains nothing of it")])
def test_a_law_that_leaves_more_than_there_was_explains_nothing(share, words):
    place = SimpleNamespace(at="bearing", evidence=2 * LIMIT, alike=(), kind="load")
    where = SimpleNamespace(places=(place,), portraits=(SimpleNamespace(at="bearing", sentence="Seen."),))
    found = OpenSet(where, "bearing", (SimpleNamespace(gain=-np.inf, gate=None),), share)
    assert words in found.sentence
