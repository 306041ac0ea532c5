"""A spring that cannot push: the law beside it, what it takes from the spring, and its place of its own."""

import numpy as np
import pytest

from cartpend_dae import insert, places, simulate
from cartpend_dae.discover.unknown_input import KNOWN, likelihood
from cartpend_dae.effects import catalogue, fits
from cartpend_dae.effects.rebuild import rebuild
from models.linear_damp_mod import LinearDampMod


@pytest.mark.parametrize("again", [False, True])
def test_with_its_spring_it_is_a_spring_that_pulls_from_some_stretch_on(again):
    model = insert(LinearDampMod(a=0.06), "one_sided_spring", "spring_1", e=1.0, s_0=0.02)
    model.spring_1.c, model.rail.d = 900.0, 1.0  # the effect follows the spring that it stands beside
    model = rebuild(model) if again else model
    found = simulate(model, 2.0)
    stretch = found["spring_1.s_rel"] - 0.11
    together = found["spring_1.f"] + found["spring_1.one_sided_spring.f"]
    np.testing.assert_allclose(together, 900.0 * np.maximum(0.0, stretch - 0.02), atol=1e-9)
    assert stretch.min() < 0.02 < stretch.max()


def test_a_spring_at_rest_elsewhere_is_a_place_for_laws_that_begin_at_rest_only():
    found = {place.at: place for place in places(LinearDampMod()) if place.insertion == "parallel"}
    assert set(found) == {"rail", "spring_1", "spring_2"}
    for name in ("spring_1", "spring_2"):
        assert {card.id for card in catalogue() if fits(card, found[name])} == {"cubic_stiffness", "one_sided_spring"}
    assert "one_sided_spring" not in {card.id for card in catalogue() if fits(card, found["rail"])}


def test_noise_that_the_raw_data_do_not_show_costs():
    n = 1000
    inside, low, high = (float(likelihood(n, n * mean, 0.0)) for mean in (1.0, 0.01, 10.0))
    assert inside == 0.0
    assert low == pytest.approx(n * (np.log(KNOWN[0]) + 0.01 / KNOWN[0] - 1))
    assert high == pytest.approx(n * (np.log(KNOWN[1]) + 10.0 / KNOWN[1] - 1)) and high > n * np.log(10.0)
