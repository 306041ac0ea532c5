"""The study of the rig in closed loop: its runs are those of the script, and its model lacks what the script says.

`cartpend discover` on it takes minutes: `tests/benchmarks/discovery.py closed_loop_rig` records what that finds.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from cartpend_dae.discover import Workbench
from cartpend_dae.discover.workbench import ROUGH
from cartpend_dae.effects import insertion_at
from cartpend_dae.session import open_study

STUDIES = Path(__file__).resolve().parent.parent / "models" / "studies"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def maker():
    spec = importlib.util.spec_from_file_location("make_closed_loop_rig", STUDIES / "make_closed_loop_rig.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up by name
    spec.loader.exec_module(module)
    return module


def test_a_run_is_what_the_script_makes(maker):
    """Feedback over counts forgets nothing: one count that falls otherwise moves all after it by some."""
    written = np.genfromtxt(STUDIES / "closed_loop_rig_swing_up_2.csv", delimiter=",", skip_header=1)
    made = maker.make_run(maker.RUNS["swing_up_2"], list(maker.RUNS).index("swing_up_2"))
    assert made.shape == written.shape
    np.testing.assert_allclose(made[:100], written[:100], atol=6e-5, rtol=0)


def test_a_rotor_a_chain_and_dry_friction_are_what_the_model_lacks(maker):
    opened = open_study(STUDIES / "closed_loop_rig.toml")
    bench, model = Workbench(opened.setup), opened.model
    sd = bench.problem(()).prior_sd
    names = (("added_inertia", "rail"), ("compliance", "wheels.flange_b"), ("coulomb_friction", "rail"))
    effects = [insertion_at(model, effect, at) for effect, at in names]
    point = {"rail.added_inertia.m": 0.5, "rail.coulomb_friction.f_c": 4.0}
    cost = []
    for n in range(4):
        fit = bench.fit(tuple(effects[:n]), point, (bench.last,), sd, patient=False, iterations=10, stride=ROUGH)
        cost.append(fit.chi2 / fit.n_residuals)
        point |= fit.point
    assert cost[1] < 0.4 * cost[0] and cost[2] < 0.6 * cost[1] and cost[3] < 0.6 * cost[2]
    # the peak of the friction at rest is all that the three do not have
    assert cost[3] < 1.5
    # what the rotor lacks, seen at the chain
    lacking = (maker.J_BRAKE - 1.0e-4) * (0.0252 / (0.0164 * 0.0181)) ** 2
    assert point["rail.added_inertia.m"] == pytest.approx(lacking, rel=0.02)
