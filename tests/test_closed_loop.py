"""The whole rig under sampled control: it balances, recovers from a push, and swings up."""

import sys
from math import pi
from pathlib import Path

import numpy as np
import pytest

from cartpend_dae import assemble, simulate

MODELS = Path(__file__).resolve().parent.parent / "models"


@pytest.fixture(scope="module")
def rig():
    sys.path.insert(0, str(MODELS))
    try:
        import closed_loop
    finally:
        sys.path.remove(str(MODELS))
    return closed_loop


@pytest.mark.slow
def test_it_balances_from_ten_degrees_for_a_minute(rig):
    """Encoders of 0.25 mm and 1 mrad, dry friction of 6 N, 24 V: what remains is a limit cycle around the top."""
    result = simulate(rig.ClosedLoop(), 60.0, points=6001, rtol=1e-6, atol=1e-9)
    tilt = result["bearing.phi"] - pi
    assert result["controller.balances"].min() == 1.0
    assert np.abs(result["cart.s"]).max() < 0.5  # the rail ends there
    assert np.abs(tilt).max() < 0.3  # from 0.175, and what the first samples lose
    # A few counts of the encoders, and the travel that dry friction allows before the cart breaks away.
    assert np.abs(tilt[result.time > 10]).max() < 0.02
    assert np.abs(result["cart.s"][result.time > 10]).max() < 0.05
    assert np.abs(result["stage.pin.v"]).max() <= 24.0


@pytest.mark.slow
def test_it_swings_up_from_hanging_and_stays_up(rig):
    result = simulate(rig.ClosedLoop(start="hanging"), 12.0, points=1201, rtol=1e-6, atol=1e-9)
    balances = result["controller.balances"]
    caught = int(np.argmax(balances > 0.5))
    assert 1.0 < result.time[caught] < 10.0
    assert balances[caught:].min() == 1.0
    assert np.abs(result["cart.s"]).max() < 0.5
    assert abs(np.cos(result["bearing.phi"][-1]) + 1) < 1e-3


@pytest.mark.slow
def test_it_recovers_from_a_push_with_an_elastic_chain_and_a_loaded_brake_motor(rig):
    model = rig.ClosedLoop(elastic_chain=True, brake_load=1.0)
    push = {"hand.f": 80.0, "hand.t_0": 4.0, "hand.T": 0.1}
    result = simulate(model, 8.0, points=801, parameters=push, rtol=1e-6, atol=1e-9)
    moved = np.abs(result["cart.s"][(result.time > 4) & (result.time < 5)]).max()
    assert moved > 1.5 * np.abs(result["cart.s"][(result.time > 3.5) & (result.time < 4)]).max()
    assert result["controller.balances"].min() == 1.0
    assert np.abs(result["bearing.phi"][-100:] - pi).max() < 0.05


def test_speeds_of_the_controller_are_those_of_its_own_samples(rig):
    """Without resolution and friction the filter is v = (v + (s - s_last)/T)/2, by the samples of the result."""
    fine = {"controller.step_s": 1e-12, "controller.step_phi": 1e-12}
    times = np.arange(0.005, 0.5, 0.01)
    result = simulate(assemble(rig.ClosedLoop(f_c=0.0)), times=np.concatenate([[0.0], times]), parameters=fine)
    s, v = result["controller.s_m"][1:], result["controller.v_m"][1:]
    expected = 0.5 * v[:-1] + 0.5 * np.diff(s) / 0.01
    # The first sample gives no speed; after it, rounding to 1e-12 m over 0.01 s.
    np.testing.assert_allclose(v[1:], expected, atol=1e-9)
