"""Which forces of a model no mass enters: what is joined there follows at once, as a rotor without inertia."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.errors import CartpendError
from cartpend_dae.language import Component
from cartpend_dae.units import same_dimension

MASSES = ("kg", "kg.m2")
# a slope in SI units that is rounding
NOTHING = 1e-9


def without_mass(model: Component, forces: Sequence[str]) -> frozenset[str]:
    """Return those forces and torques that follow from positions, speeds and inputs, and from no mass or dry friction.

    The forces by which masses move together follow from their accelerations, and so from the masses. What a mass does
    to a force is its derivative, with the algebraic variables as the implicit function theorem has them, at some point.

    Parameters
    ----------
    model
        The whole model.
    forces
        Names of variables.

    Raises
    ------
    ModelError
        If there is no variable of a name.
    """
    try:
        system = assemble(model)
    except CartpendError:  # it is said where the model is used
        return frozenset()
    s, free = system, system.frictions.force
    masses = [i for i, q in enumerate(s.parameters) if any(same_dimension(q.declaration.unit, u) for u in MASSES)]
    told = ca.vertcat(s.p[masses], free)
    wanted = s.outputs[[s.index_of(name) for name in forces]]
    slope = ca.jacobian(wanted, told)
    if s.z.numel():
        slope -= ca.jacobian(wanted, s.z) @ ca.solve(ca.jacobian(s.alg, s.z), ca.jacobian(s.alg, told))
    arguments = [s.time, s.x, s.z, s.u, s.d, free, s.p]
    point = [np.random.default_rng(0).uniform(0.5, 1.5, each.numel()) for each in arguments[:-1]]
    values = np.array(ca.Function("slopes", arguments, [slope])(*point, system.parameter_values))
    return frozenset(name for name, row in zip(forces, values, strict=True) if np.all(np.abs(row) < NOTHING))
