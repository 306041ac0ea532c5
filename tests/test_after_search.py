"""What follows a search: closures until one leaves noise, repetitions as asked for, and what Ctrl-C leaves of it."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_discover_pendulum import COULOMB, clean_run, noisy_setup

from cartpend_dae.discover import Workbench, discover, localize, refit
from cartpend_dae.effects import insertion_at
from cartpend_dae.report.facts import summary
from cartpend_dae.report.text import CUT_AFTER, discovery_sentence

pytestmark = pytest.mark.xdist_group("after search")


def swing_with_cubic_drag(drag):
    """Return times and angles of the rod with a drag in the cube of the speed, by an integrator of its own."""
    m, length, g, viscous = 0.1719, 0.86, 9.81, 0.015
    inertia, times = m * length**2 / 3, np.linspace(0, 6, 601)

    def rates(_, y):
        return [y[1], -(viscous * y[1] + drag * y[1] ** 3 + m * g * length / 2 * np.sin(y[0])) / inertia]

    return times, solve_ivp(rates, (0, 6), [0.6, 0.0], t_eval=times, rtol=1e-10, atol=1e-12).y[0]


def after(monkeypatch, setup, outcome, **options):
    """Return what `discover` makes of the outcome of a search, and the arguments of each search that it asked for."""
    asked = []

    def search(bench, cards, places, *, max_steps, regime):
        asked.append((bench.setup, {place.at for place in places}))
        return outcome

    monkeypatch.setattr(sys.modules[discover.__module__], "search", search)
    return discover(setup, **options), asked


def unexplained(setup, **changes):
    return replace(refit(Workbench(setup), ()), **{"verdict": "unexplained"} | changes)


def test_the_ceiling_is_that_of_all_closures_where_forces_were_looked_for(monkeypatch):
    """Where the first closure leaves structure another one may not: these splines are no cube of the speed."""
    setup = noisy_setup(swing_with_cubic_drag(0.02), 0)
    found, _ = after(monkeypatch, setup, unexplained(setup, regime="forces"))
    left = found.beyond.open_set
    assert {closure.kind for closure in left.closures} == {"spline", "process", "network"}
    assert next(closure for closure in left.closures if closure.kind == "spline").gate.is_passed
    assert left.closures[0].kind == "network" and not left.closures[0].gate.is_passed
    assert "nothing but noise is left then" in left.sentence


def test_no_more_closures_are_trained_than_it_takes_where_forces_were_looked_for(monkeypatch):
    setup = noisy_setup(swing_with_cubic_drag(0.004), 0, noise=5e-3)
    found, _ = after(monkeypatch, setup, unexplained(setup, regime="forces"))
    assert [closure.kind for closure in found.beyond.open_set.closures] == ["spline"]
    assert not found.beyond.open_set.closures[0].gate.is_passed


@pytest.fixture(scope="module")
def dry():
    return noisy_setup(clean_run(COULOMB), 0)


def stop_at(stage, label):
    def report(at, what, error):
        if at.startswith(stage) and label in what:
            raise KeyboardInterrupt

    return report


def test_closures_that_were_trained_before_an_interruption_are_kept(monkeypatch, dry):
    found, _ = after(monkeypatch, dry, unexplained(dry), report=stop_at("closure", "process"))
    left = found.beyond.open_set
    assert [closure.kind for closure in left.closures] == ["spline"]
    assert left.explained > 0.9 and left.errors is not None
    assert found.interrupted and found.beyond.interrupted and not found.search.interrupted
    said = discovery_sentence(found)
    assert said.endswith(CUT_AFTER) and "before an effect was accepted" not in said


def test_where_it_acts_is_kept_where_no_closure_was_trained(monkeypatch, dry):
    found, _ = after(monkeypatch, dry, unexplained(dry), report=stop_at("closure", "spline"))
    assert found.beyond.open_set.at == "bearing"
    assert "No closure was trained there." in discovery_sentence(found)


@pytest.fixture(scope="module")
def named(dry):
    return refit(Workbench(dry), (insertion_at(dry.model, "coulomb_friction", "bearing"),))


def test_repetitions_that_were_done_before_an_interruption_are_kept(monkeypatch, dry, named):
    stop = stop_at("placebo and power", "2 of 5")
    found, _ = after(monkeypatch, dry, named, report=stop, placebo=3, power=2)
    (placebo,) = found.beyond.rates
    assert (placebo.removed, placebo.n) == (None, 2)
    assert (found.beyond.placebo, found.beyond.power, found.interrupted) == (3, 2, True)


def test_a_stored_result_says_what_was_cut():
    gate = {"limit": 4.0, "final": {"largest": 1.0, "is_more_than_noise": False}}
    result = {"command": "discover", "gate": gate, "steps": [{}], "final": {"parameters": {}}, "message": "Told."}
    cut = summary(result | {"interrupted": True, "beyond_interrupted": True})
    assert cut[0] == CUT_AFTER and "best so far" not in " ".join(cut)
    assert summary(result | {"interrupted": True})[0] == "The search was interrupted; this is the best so far."
    assert summary(result | {"interrupted": True, "beyond_interrupted": True, "steps": []}) == ["Told."]


def test_repetitions_look_where_the_search_looked(monkeypatch, dry, named):
    _, asked = after(monkeypatch, dry, named, only_at="bearing", placebo=1, power=1)
    assert [places for _, places in asked] == [{"bearing"}] * 3
    _, asked = after(monkeypatch, dry, named, placebo=1)
    assert all(places > {"bearing"} for _, places in asked)


def test_a_place_that_moved_behind_an_effect_is_still_looked_at(monkeypatch, dry):
    outcome = refit(Workbench(dry), (insertion_at(dry.model, "sensor_gain", "bearing.phi"),))
    outcome = replace(outcome, verdict="explained")
    _, asked = after(monkeypatch, dry, outcome, only_at=("bearing.phi",), placebo=1)
    assert [places for _, places in asked] == [{"bearing.phi"}, {"bearing.phi.sensor_gain.y"}]


def test_a_seed_is_that_of_the_data_made_anew(monkeypatch, dry, named):
    def made(**seed):
        _, asked = after(monkeypatch, dry, named, placebo=1, **seed)
        return asked[1][0].train[0].outputs["bearing.phi"].values

    np.testing.assert_array_equal(made(), made(seed=0))
    assert np.std(made() - made(seed=3)) > 5e-4  # the noise is 1 mrad


def test_a_seed_is_that_of_the_placebo_of_places(dry):
    bench = Workbench(dry)
    plain, same, other = localize(bench), localize(bench, seed=0), localize(bench, seed=1)
    assert plain.places == same.places
    assert [place.evidence for place in other.places] == [place.evidence for place in plain.places]
    assert all(a.placebo != b.placebo for a, b in zip(other.places, plain.places, strict=True))
