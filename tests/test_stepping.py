"""Algebraic variables in the steps of estimation are those of the equations, wherever the step before left them."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from cartpend_dae import Component, Param, Statements, der, param, signal, var
from cartpend_dae.assemble import assemble
from cartpend_dae.stepping import runge_kutta


class Brushes(Component):
    """A resistor and brushes on a voltage that grows with the input: R i + V tanh(i/i_b) = v."""

    u = signal("in", unit="V/s")
    v = var(unit="V", start=0.0)
    i = var(unit="A", start=0.0)
    R: Param = param(unit="Ohm", default=0.86)
    V: Param = param(unit="V", default=0.5)
    i_b: Param = param(unit="A", default=0.25)

    def equations(self) -> Statements:
        yield der(self.v) == self.u
        yield self.R * self.i + self.V * ca.tanh(self.i / self.i_b) == self.v


def current(v):
    return brentq(lambda i: 0.86 * i + 0.5 * np.tanh(i / 0.25) - v, -20, 20, xtol=1e-14)


@pytest.mark.parametrize("v", [-0.9, -0.3, -0.05, 0.0, 0.1, 0.45, 0.55, 2.0])
@pytest.mark.parametrize("guess", [-4.0, -0.5, 0.0, 0.5, 4.0])
def test_a_current_that_passes_zero_in_a_sharp_law_is_found_with_its_slope(v, guess):
    system = assemble(Brushes())
    assert (system.x.numel(), system.z.numel()) == (1, 1)
    state, p = ca.SX.sym("state", 2), [q.value for q in system.parameters]
    z = runge_kutta(system).algebraic(0.0, 0.01, state, 0.0, p)
    both = ca.Function("both", [state], [z, ca.jacobian(z, state)])
    found, slope = (np.array(one).ravel() for one in both([v, guess]))
    exact = current(v)
    assert found[0] == pytest.approx(exact, rel=1e-9, abs=1e-9)
    assert slope == pytest.approx([1 / (0.86 + 0.5 / 0.25 / np.cosh(exact / 0.25) ** 2), 0.0], rel=1e-6, abs=1e-6)
