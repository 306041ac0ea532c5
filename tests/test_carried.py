"""What effects found on some runs explain of another one, on pendulums from a simulator that shares no code."""

from dataclasses import replace

import numpy as np
import pytest
from test_discover_pendulum import NOISE, clean_run, noisy_setup

from cartpend_dae.discover import Workbench
from cartpend_dae.discover.carried import carries_over
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.effects import insertion_at
from models.rota_damp import RotaDamp

RULES = Rules("noise", (0.0,), 0.0, np.array([NOISE]))


def two_runs(coulomb, *offsets):
    """Return a setup of runs of one pendulum, of which the sensor shows more by an offset [rad] each."""
    setups = [
        noisy_setup((times, angles + offset), seed)
        for seed, offset in enumerate(offsets)
        for times, angles in [clean_run(coulomb)]
    ]
    runs = [replace(setup.train[0], name=f"run{k}") for k, setup in enumerate(setups)]
    return replace(setups[0], train=tuple(runs))


def bases(bench, effect):
    """Return the models without an effect and with it."""
    insertion = insertion_at(RotaDamp(), effect, "bearing")
    fits = [bench.fit(taken, {}, (0.0,), RULES.sd) for taken in ((), (insertion,))]
    return Base((), {0.0: fits[0]}), Base((insertion,), {0.0: fits[1]})


@pytest.mark.parametrize(
    ("coulomb", "offsets", "effect", "is_told"),
    [
        (0.012, (0.0, 0.0), "coulomb_friction", True),
        (0.0, (0.03, 0.03), "constant_load", True),
        (0.0, (0.03, -0.01), "constant_load", False),
        (0.0, (0.03,), "constant_load", True),  # a single run tells nothing against it
    ],
)
def test_what_one_run_alone_asks_for_explains_nothing_of_another(coulomb, offsets, effect, is_told):
    bench = Workbench(two_runs(coulomb, *offsets))
    before, after = bases(bench, effect)
    assert after.fit.chi2 < 0.9 * before.fit.chi2
    assert carries_over(bench, before, after, RULES) is is_told
