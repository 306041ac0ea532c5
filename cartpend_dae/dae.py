"""System -> CasADi functions: right-hand side, outputs, and the laws of dry friction."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.along import AllTimes
from cartpend_dae.errors import ModelError
from cartpend_dae.prepared import once
from cartpend_dae.quantities import is_number
from cartpend_dae.system import System


@dataclass(frozen=True, slots=True)
class Friction:
    """Dry friction of a system in the form that sticking needs, all SX.

    The relative accelerations are ``free + influence @ force``; the speeds are `speed`, and each force
    lies in ``[-level_neg, level_pos]``, or in ``[-static_neg, static_pos]`` at rest. Shapes (n_f, 1); influence
    (n_f, n_f).
    """

    speed: ca.SX
    free: ca.SX
    influence: ca.SX
    level_pos: ca.SX
    level_neg: ca.SX
    static_pos: ca.SX
    static_neg: ca.SX


@dataclass(frozen=True, slots=True)
class Dae:
    """CasADi functions of a system; each takes (t, x, z, u, p, force) unless said otherwise.

    ``rhs`` gives (ode, alg); ``outputs`` all variables; ``jacobian_z`` the Jacobian of alg in z.
    """

    system: System
    rhs: ca.Function
    outputs: ca.Function
    arguments: tuple[ca.SX, ...]


def dae(system: System) -> Dae:
    """Make the functions of a system.

    Parameters
    ----------
    system
        The assembled system.
    """
    return once(system, "functions", None, lambda: _dae(system))


def _dae(s: System) -> Dae:
    arguments = (s.time, s.x, s.z, s.u, s.p, s.frictions.force)
    names = ["t", "x", "z", "u", "p", "force"]
    rhs = ca.Function("rhs", list(arguments), [s.ode, s.alg], names, ["ode", "alg"])
    outputs = ca.Function("outputs", list(arguments), [s.outputs], names, ["y"])
    return Dae(s, rhs, outputs, arguments)


def all_variables(
    system: System,
    times: np.ndarray,
    x: np.ndarray,
    z: np.ndarray,
    u: np.ndarray,
    p: np.ndarray,
    force: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return every variable of a system at some times: values (n_times, n), and the column of each variable.

    Parameters
    ----------
    system
        The system.
    times
        Times [s], shape (n_times,).
    x, z, u, force
        States, algebraic variables, inputs and friction forces, a column for each time.
    p
        Parameters (n_p,).
    """
    function = once(system, "all variables", None, lambda: AllTimes(dae(system).outputs))
    return function.distinct([times[None, :], x, z, u, p, force], times.size)


def friction_laws(system: System) -> Friction:
    """Return how the dry friction forces act on their own relative accelerations.

    The chain rule along the state equations gives d(speed)/dt; it is linear in the forces because
    forces enter the equations of motion linearly. Algebraic variables that depend on the forces are taken along
    their tangent.
    """
    s, f = system, system.frictions
    rate = ca.jtimes(f.speed, s.x, s.ode) + ca.jacobian(f.speed, s.time)
    influence = ca.jacobian(rate, f.force)
    if s.z.numel() and ca.depends_on(rate, s.z) and ca.depends_on(s.alg, f.force):
        through = ca.solve(ca.jacobian(s.alg, s.z), ca.densify(ca.jacobian(s.alg, f.force)))
        influence = influence - ca.jacobian(rate, s.z) @ through
    influence = ca.densify(influence)
    zero = ca.SX.zeros(f.force.numel())
    free = ca.substitute(rate, f.force, zero)
    return Friction(f.speed, free, influence, f.level_pos, f.level_neg, f.static_pos, f.static_neg)


def regularised(system: System, sharpness: ca.SX | float) -> ca.SX:
    """Return smooth friction forces, level * tanh(speed / sharpness), shape (n_f, 1).

    Parameters
    ----------
    system
        The system.
    sharpness
        Speed at which the force has 76 % of its level [m/s or rad/s].
    """
    f = system.frictions
    smooth = ca.tanh(f.speed / sharpness)
    return ca.if_else(f.speed >= 0, f.level_pos * smooth, f.level_neg * smooth)


def parameter_vector(system: System, changes: dict[str, float] | None = None) -> np.ndarray:
    """Return the values of the independent parameters, some replaced; shape (n_p,), SI units.

    Raises
    ------
    ModelError
        For a name that is no independent parameter, a value that is no number, or one other than 0 for a
        parameter whose part was left out of the model because it was 0.
    """
    values = system.parameter_values
    for name, value in (changes or {}).items():
        index = system.parameter_index(name)
        if not is_number(value):
            raise ModelError(f"Parameter `{name}` of {system.name} must be a number, not {value!r}.")
        if value != 0 and system.parameters[index].is_built_as_zero:
            raise ModelError(
                f"`{name}` was 0 when the model was built, so that the part it belongs to does not exist; "
                f"set it in the constructor."
            )
        values[index] = value
    return values
