"""The pages that benchmarks write from recorded figures, and the answers that they are checked against."""

import importlib
import json

import casadi as ca
import numpy as np
import pytest
from benchmarks import page, scale_text, simulate_text

from cartpend_dae import assemble
from cartpend_dae.continuous import without_events


def run(n, assemble, status="right", **more):
    """A recorded run of n masses whose other stages take no time."""
    seconds = {"import": 5.0, "build": 0.0, "assemble": assemble, "simulate": 0.0}
    figures = {
        "n": n,
        "repeats": 1,
        "status": status,
        "seconds": seconds,
        "processor": seconds,
        "equations": 14 * n,
        "error": 1e-8,
    }
    return figures | {"memory": {"peak": 512.0, "imports": 100.0}} | more


def entry(*runs, version="1.0"):
    figures = {"version": version, "python": "3.11", "date": "2000-01-01", "load": 0.0, "limit": 120.0}
    return figures | {"memory_limit": 8, "runs": list(runs)}


def results(**tools):
    return {"scale": {"machine": "a machine", "tools": tools}}


def test_the_page_in_the_docs_is_what_was_recorded():
    written = (page.HERE.parents[1] / "docs" / "benchmarks.md").read_text("utf-8")
    assert written == page.text(page.recorded())


def test_results_survive_being_recorded(tmp_path, monkeypatch):
    monkeypatch.setattr(page, "RESULTS", tmp_path / "results")
    found = results(cartpend_dae=entry(run(10, 0.1)))
    page.record("scale", found["scale"])
    assert page.recorded() == found
    assert page.text(page.recorded()) == page.text(json.loads(json.dumps(found)))


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_the_slope_of_a_power_law_is_its_exponent(power):
    runs = [run(n, 1e-4 * n**power) for n in (100, 1000, 10_000)]
    # the imports are not part of the total, else 5 s of them would flatten it
    assert scale_text.slope(runs, scale_text.total) == pytest.approx(power, abs=1e-12)


def test_targets_that_are_met_and_missed():
    quick = entry(run(100, 0.05), run(1000, 0.5), run(10_000, 5.0))
    slow = entry(run(100, 0.05), run(1000, 0.8), run(10_000, 9.0, memory={"peak": 2048.0, "imports": 100.0}))
    assert [met for *_, met in scale_text.targets(quick)] == ["yes", "yes", "yes", "yes"]
    assert [met for *_, met in scale_text.targets(slow)] == ["**no**", "**no**", "**no**", "**no**"]


def test_a_wrong_answer_meets_no_target():
    found = entry(*(run(n, 1e-4 * n, status="wrong") for n in (100, 1000, 10_000)))
    assert {found for _, found, _ in scale_text.targets(found)} == {"not measured"}
    assert "**wrong** (1e-08)" in page.text(results(cartpend_dae=found))


def test_a_run_that_was_stopped_shows_the_limit_at_the_stage_it_was_in():
    stopped = {"n": 1000, "repeats": 1, "status": "time", "seconds": {"import": 1.0, "build": 0.5, "assemble": 30.0}}
    stopped |= {"processor": stopped["seconds"]}
    text = page.text(results(rumoca=entry(stopped)))
    assert "| rumoca | 1,000 | – | 0.5 s | 30 s | > 120 s | > 120 s | – | – | – | 1 | – |" in text


def test_a_peer_that_is_absent_is_said_to_be_absent():
    text = page.text(results(cartpend_dae=entry(run(10, 0.1)), jaxonomy=entry(version=None)))
    assert "jaxonomy: absent, because it is not installed" in text
    assert "| jaxonomy | – | – | – |" in text


def test_a_machine_that_was_busy_is_not_held_against_a_tool():
    waited = {"import": 5.0, "build": 0.0, "assemble": 1.0, "simulate": 0.0}
    text = page.text(results(cartpend_dae=entry(run(10, 1.0)), rumoca=entry(run(10, 2.0, processor=waited))))
    assert "the wall times of rumoca are too long" in text


# --- simulation --------------------------------------------------------------------------------------------


def loop(**seconds):
    """Recorded runs of the closed loop, each of which took so long."""
    return {name: {"tolerance": 1e-8, "error": 5e-7, "seconds": [2 * t, t]} for name, t in seconds.items()}


def test_targets_of_simulation_are_ratios_of_the_fastest_runs():
    names = {"whole": "simulate, cvodes", "small": "rosenbrock, compiled"}
    runs = loop(yardstick=10.0, cvodes=11.0) | {names["whole"]: loop(w=11.5)["w"], names["small"]: loop(c=4.0)["c"]}
    found = simulate_text.targets(runs)
    assert [(value, met) for _, value, met in found[:2]] == [("1.1", "yes"), ("0.4", "yes")]
    assert found[3][1:] == ("1.15", "**no**")
    assert [value for _, value, _ in (found[2], *found[4:])] == ["not measured"] * 7


def test_the_closed_loop_by_hand_and_of_components_are_the_same_equations(monkeypatch):
    monkeypatch.syspath_prepend(str(page.HERE / "loop"))
    hand, composed = importlib.import_module("hand"), importlib.import_module("composed")
    system = without_events(assemble(composed.ClosedLoop()), "The comparison")
    rates = ca.Function("rates", [system.time, system.x, system.p], [system.ode])
    rng = np.random.default_rng(4)
    for _ in range(5):
        state, time = rng.uniform(-2, 2, 6), rng.uniform(0, 10)
        values = dict(zip(composed.STATES, state, strict=True))
        found = rates(time, [values[name] for name in system.states], system.parameter_values).full()[:, 0]
        by_name = dict(zip(system.states, found, strict=True))
        expected = [float(rate) for rate in hand.rates(time, state, np)]
        # sums of some twenty terms in double precision
        np.testing.assert_allclose([by_name[name] for name in composed.STATES], expected, rtol=1e-11)


# --- FMUs --------------------------------------------------------------------------------------------------


def test_the_page_shows_both_targets_of_the_fmu():
    found = {"machine": "a machine", "version": "commit 1", "python": "3.11", "date": "2000-01-01", "load": 0.0}
    found |= {"export": 4.0, "fmu": 1.0, "native": 0.5, "ratio": 2.0, "deviation": 1e-9, "repeats": 5}
    text = page.text({"fmu": found})
    assert "| 60 s at most 1.5 times as long as the native simulation | 2 | **no** |" in text
    assert "| export under 5 s | 4 s | yes |" in text


def test_a_section_takes_the_place_of_the_one_before(tmp_path):
    path = tmp_path / "page.md"
    path.write_text("# Page\n\n## One\n\nold\n\n## Two\n\nkept\n")
    page.put_section(path, ["## One", "", "new", ""])
    assert path.read_text() == "# Page\n\n## One\n\nnew\n\n## Two\n\nkept\n"
    page.put_section(path, ["## Three", "", "more", ""])
    assert path.read_text() == "# Page\n\n## One\n\nnew\n\n## Two\n\nkept\n\n## Three\n\nmore\n"
