"""What numbers of a law count besides those that correct it, and when a fit is far ahead of another."""

from dataclasses import replace

import numpy as np
import pytest
from test_discovery_choice import bench, fitted, plain_fit  # noqa: F401

from cartpend_dae.directions import unreached
from cartpend_dae.discover.evidence import bic, described, determined, leaves_clearly_less, plain_bic
from models.linear_damp_mod import LinearDampMod


@pytest.fixture
def spring(fitted):  # noqa: F811
    """A spring that hardens, with the fifth power as a correction, on a cart whose damping is free."""
    return fitted("cubic_stiffness", 0.0, 3000.0, LinearDampMod(), "rail", c3=2e4, c5=1e6)


def test_a_correction_is_no_number_of_its_law(spring):
    correction = f"{spring.insertion.prefix}.c5"
    assert spring.insertion.corrections == (correction,)
    assert described(spring.fit, spring.insertion) == determined(spring.fit) - 1
    assert described(None, spring.insertion) == 0
    # one that does not reach the outputs is none of those that the data determine, and is left out once
    blind = replace(spring.fit, blind=(unreached(correction),))
    assert determined(blind) == determined(spring.fit) - 1
    assert described(blind, spring.insertion) == described(spring.fit, spring.insertion)


def test_a_correction_has_no_price_unless_it_ends_on_a_bound(spring):
    fit = spring.fit
    price = float(np.log(fit.n_residuals))
    assert plain_bic(fit, spring.insertion) == pytest.approx(bic(fit) - price)
    assert plain_bic(fit) == bic(fit)
    assert plain_bic(None, spring.insertion) == np.inf
    held = replace(fit, parameters=(*fit.parameters[:-1], replace(fit.parameters[-1], status="at-bound")))
    assert bic(held) == pytest.approx(bic(fit) - price)
    assert plain_bic(held, spring.insertion) == bic(held)


def test_half_of_what_another_leaves_is_clearly_less(spring):
    fit = spring.fit
    assert leaves_clearly_less(replace(fit, chi2=0.49 * fit.chi2), fit)
    assert not leaves_clearly_less(replace(fit, chi2=0.51 * fit.chi2), fit)
    assert not leaves_clearly_less(fit, fit)
