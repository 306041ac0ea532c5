"""The bandwidth with which a model predicts best, and which effects are in it then."""

import numpy as np
import pytest

from cartpend_dae import simulate
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.records import Candidate, FreeSpec, Setup
from cartpend_dae.discover.regime import LADDER, best_bandwidth
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import insertion_at
from models.rota_damp import RotaDamp


def bench():
    run = simulate(RotaDamp(tau_c=0.01), 4.0, points=401, start={"bearing.phi": 0.8})
    noisy = run["bearing.phi"] + 1e-3 * np.random.default_rng(0).standard_normal(401)
    start = {"bearing.phi": Start(0.8, False), "bearing.w": Start(0.0, False)}
    channel = Channel(noisy, "zoh", 1e-3, "rad", 0.0)
    experiment = Experiment("run", "train", run.time, {}, {"bearing.phi": channel}, start, "free", None)
    return Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d", 0.02),), (experiment,), (), ()))


def candidate(effect, **parameters):
    insertion = insertion_at(RotaDamp(), effect, "bearing")
    values = {f"{insertion.prefix}.{name}": value for name, value in parameters.items()}
    return Candidate(insertion, insertion.starts | values, 0.0, 0.0, 0.0, None, "")


def test_without_disturbances_the_right_effect_predicts_best_with_least_injection():
    found = best_bandwidth(bench(), [candidate("coulomb_friction", tau_c=0.01)], {}, np.array([1e-3]))
    assert found == pytest.approx(LADDER[-1] * 100)


def test_what_a_model_lacks_asks_for_injection():
    assert best_bandwidth(bench(), [], {}, np.array([1e-3])) > 2 * LADDER[-1] * 100


def test_effects_that_no_simulation_stands_together_leave_the_best_alone():
    lost = candidate("linear_stiffness", c=-1e9)
    found = best_bandwidth(bench(), [candidate("coulomb_friction", tau_c=0.01), lost], {}, np.array([1e-3]))
    assert found == pytest.approx(LADDER[-1] * 100)


def test_a_contact_has_one_law_of_dry_friction():
    one, other = candidate("coulomb_friction"), candidate("asymmetric_friction")
    assert is_other_law(one, other)
    assert not is_other_law(one, candidate("quadratic_drag"))
