"""System -> LinearModel: the slopes of a model at an operating point, in as many states as it has freedom.

With w the algebraic variables and the dry friction forces, h(x, w, u) = 0 what gives them, and c(x, w) = 0 the
constraints between the states, the implicit function theorem eliminates dw = -h_w^-1 (h_x dx + h_u du). What is left of
c says which deviations dx are possible, c_x dx = 0. So some states follow from the others, dx = T dx_kept. The rows of
the kept states are x_kept' = (A T) x_kept + B u, also along a motion, because every motion stays on the constraints.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, cast, get_args

import casadi as ca
import numpy as np
from scipy.linalg import qr

from cartpend_dae.assemble import assemble
from cartpend_dae.continuous import before_events
from cartpend_dae.dae import dae
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.language import Component
from cartpend_dae.linear_model import FloatArray, LinearModel
from cartpend_dae.operating_point import Place, Point, operating_point, without_discretes
from cartpend_dae.quantities import is_number
from cartpend_dae.start_conditions import Steady
from cartpend_dae.system import System
from cartpend_dae.units import derivative, format_unit

DryFriction = Literal["sliding", "stuck", "ignored"]
STILL = 1e-9
"""Speed below which a dry friction can stick [m/s or rad/s]: what the search for a start leaves of zero."""
LOST = 1e-10
"""A slope this small against the largest is one that rounding left of zero."""


def linearize(
    model: Component | System,
    *,
    at: Place | None = None,
    steady: Steady = False,
    inputs: Mapping[str, float | None] | Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    parameters: Mapping[str, float] | None = None,
    time: float = 0.0,
    friction: DryFriction = "sliding",
) -> LinearModel:
    """Linearise a model about an operating point.

    Algebraic variables are eliminated. Where constraints tie states to each other, or `friction="stuck"` holds
    speeds at zero, the model keeps as many states as there is freedom, those that the others follow from best. Where
    the model has branches, the slopes are those of the branch in which the point lies. Discrete variables hold what
    they have there, and clocks do not tick: of a sampled controller nothing is left but the value it holds.

    Parameters
    ----------
    model
        A component, or the system that `assemble` made of it.
    at
        Where: start values by variable name, in SI units, as in `simulate`; ``"steady"`` for a rest; or a pair of a
        trajectory and a time [s] in it (between two output times it is joined linearly). By default the start of
        the model.
    steady
        As in `simulate`: True demands a rest, and `at` says which one; names demand that of these variables.
    inputs
        Names of the inputs that become columns of B, by default all; as a dictionary with their values at the
        operating point, SI units, None where it is left open. Such an input, and one that is not named, has the value
        in the trajectory, else its default, else 0.
    outputs
        Names of variables that become rows of C; by default all states of the model.
    parameters
        Other values of parameters, by name, in SI units.
    time
        Time [s] at which a model with sources is meant; of a trajectory its own time counts.
    friction
        ``"sliding"``: dry friction has its level, against the speed at the operating point, and changes as the level
        does; where the speed is zero it has no direction and is left out. ``"stuck"``: where the speed is zero it
        stays zero, whatever that takes; elsewhere as before. ``"ignored"``: there is none.

    Raises
    ------
    ModelError
        For an unknown name or option, or a value that is no finite number.
    SolverError
        If there is no such operating point, or no finite slopes at it.
    """
    whole = assemble(model)
    at, held = without_discretes(whole, at)
    system = before_events(whole, held)
    if friction not in get_args(DryFriction):
        raise ModelError(f"`friction` is `sliding`, `stuck` or `ignored`, not {friction!r}.")
    columns, given = _columns(system, inputs)
    names, expressions = _rows(system, outputs)
    point = operating_point(system, at, steady, given, dict(parameters or {}), time)
    held, laws = _friction_laws(system, point, friction)
    point = _settled(system, point, laws)
    constraints = ca.vertcat(system.invariants, system.frictions.speed[held, 0])
    slopes = _slopes(system, point, laws, expressions, constraints)
    kept, T = _free_states(system, slopes.constraint_x)
    return LinearModel(
        name=system.name,
        states=tuple(system.states[i] for i in kept),
        inputs=tuple(system.inputs[j] for j in columns),
        outputs=names,
        state_units=tuple(_unit(system, system.states[i]) for i in kept),
        input_units=tuple(system.unit_of(system.inputs[j]) for j in columns),
        output_units=tuple(_unit(system, name) for name in names),
        A=(slopes.rate_x @ T)[kept],
        B=slopes.rate_u[np.ix_(kept, columns)],
        C=slopes.output_x @ T,
        D=slopes.output_u[:, columns],
        x=point.x[kept],
        u=point.u[columns],
        y=slopes.output,
        rate=slopes.rate[kept],
    )


def _columns(
    system: System, inputs: Mapping[str, float | None] | Sequence[str] | None
) -> tuple[list[int], dict[str, float]]:
    """Return which inputs become columns, and the values that were given."""
    if isinstance(inputs, str):
        raise ModelError(f"`inputs` is a list of names, such as [{inputs!r}], or a dictionary with values, not a text.")
    for name in inputs or ():
        if name not in system.inputs:
            listing = ", ".join(f"`{other}`" for other in system.inputs) or "none"
            raise ModelError(f"{system.name} has no input `{name}`; its inputs are: {listing}.")
    values = inputs if isinstance(inputs, Mapping) else {}
    given = {name: value for name, value in values.items() if value is not None}
    for name, value in given.items():
        if not is_number(value) or not math.isfinite(value):
            raise ModelError(f"The value of input `{name}` at the operating point must be a number, not {value!r}.")
    return [system.inputs.index(name) for name in (system.inputs if inputs is None else inputs)], given


def _rows(system: System, outputs: Sequence[str] | None) -> tuple[tuple[str, ...], ca.SX]:
    """Return names and expressions of the outputs."""
    if isinstance(outputs, str):
        raise ModelError(f"`outputs` is a list of names, such as [{outputs!r}], not a text.")
    names = tuple(system.states if outputs is None else outputs)
    own = {name: i for i, name in enumerate(system.states)}
    found = [system.x[own[name]] if name in own else system.outputs[system.index_of(name)] for name in names]
    return names, ca.vertcat(ca.SX(0, 1), *found)


def _unit(system: System, name: str) -> str:
    """Return the unit of a variable, or of a state that has no name but that of a derivative."""
    if name.startswith("der("):
        return format_unit(derivative(_unit(system, name.removeprefix("der(").removesuffix(")"))))
    return system.unit_of(name)


def _friction_laws(system: System, point: Point, friction: DryFriction) -> tuple[list[int], ca.SX]:
    """Return which frictions stick, and what is zero with the friction forces, shape (n_f, 1)."""
    f = system.frictions
    if friction == "ignored" or not f.places:
        return [], f.force
    speed = ca.Function("speed", list(dae(system).arguments), [f.speed])
    speeds = np.asarray(speed(*point.arguments)).ravel()
    rate = ca.jtimes(f.speed, system.x, system.ode) + ca.jacobian(f.speed, system.time)
    held: list[int] = []
    laws = []
    for i, value in enumerate(speeds):
        if abs(value) > STILL:
            laws.append(f.force[i] - (f.level_pos[i] if value > 0 else -f.level_neg[i]))
        elif friction == "stuck":
            held.append(i)
            laws.append(rate[i])
        else:
            laws.append(f.force[i])
    return held, ca.vertcat(*laws)


def _settled(system: System, point: Point, laws: ca.SX) -> Point:
    """Return the point with the algebraic variables and friction forces that belong to it, by Newton steps."""
    n_z, n_w = system.z.numel(), system.z.numel() + laws.numel()
    if not n_w:
        return point
    w = ca.vertcat(system.z, system.frictions.force)
    residual = ca.vertcat(system.alg, laws)
    arguments = list(dae(system).arguments)
    function = ca.Function("settle", arguments, [ca.densify(residual), ca.densify(ca.jacobian(residual, w))])
    for _ in range(30):
        value, slopes = (np.asarray(part) for part in function(*point.arguments))
        if not (np.all(np.isfinite(value)) and np.all(np.isfinite(slopes))):
            break
        # several elements that hold one body share its load in many ways; the smallest forces are taken
        step = np.linalg.lstsq(slopes, value.ravel(), rcond=None)[0]
        z, force = point.z - step[:n_z], point.force - step[n_z:]
        point = Point(point.time, point.x, z, point.u, point.p, force)
        if np.all(np.abs(step) <= 1e-10 * (1.0 + np.abs(np.concatenate([z, force])))):
            return point
    raise SolverError(
        f"{system.name}: no algebraic variables were found at the operating point; check that a simulation can start "
        f"there, and give start values nearer to it."
    )


@dataclass(frozen=True, slots=True)
class _Slopes:
    """Slopes in the states and inputs of the state derivatives, outputs and constraints; values of the first two."""

    rate_x: FloatArray
    rate_u: FloatArray
    output_x: FloatArray
    output_u: FloatArray
    constraint_x: FloatArray
    rate: FloatArray
    output: FloatArray


def _slopes(system: System, point: Point, laws: ca.SX, outputs: ca.SX, constraints: ca.SX) -> _Slopes:
    """Return the slopes with algebraic variables and friction forces eliminated."""
    n_x, n_u, n_y = system.x.numel(), system.u.numel(), outputs.numel()
    w = ca.vertcat(system.z, system.frictions.force)
    implicit = ca.vertcat(system.alg, laws)
    values = ca.vertcat(system.ode, outputs, constraints, implicit)
    jacobian = ca.jacobian(values, ca.vertcat(system.x, system.u, w))
    function = ca.Function("slopes", list(dae(system).arguments), [ca.densify(values), ca.densify(jacobian)])
    value, slopes = (np.asarray(part, dtype=float) for part in function(*point.arguments))
    slopes = slopes.reshape(values.numel(), n_x + n_u + w.numel())
    _check_finite(system, slopes, n_x)
    n_explicit = values.numel() - w.numel()
    direct, through = slopes[:n_explicit, : n_x + n_u], slopes[:n_explicit, n_x + n_u :]
    if w.numel():
        hidden = slopes[n_explicit:]
        direct = direct - through @ _solve_implicit(system, hidden[:, n_x + n_u :], hidden[:, : n_x + n_u])
    of_rate, of_output, of_constraint = np.split(direct, [n_x, n_x + n_y])
    rate, output, _ = np.split(value.ravel(), [n_x, n_x + n_y])
    return _Slopes(
        of_rate[:, :n_x],
        of_rate[:, n_x:],
        of_output[:, :n_x],
        of_output[:, n_x:],
        of_constraint[:, :n_x],
        rate,
        output,
    )


def _check_finite(system: System, slopes: FloatArray, n_x: int) -> None:
    if np.all(np.isfinite(slopes)):
        return
    rows = zip(system.states, slopes[:n_x], strict=True)
    bad = [f"the derivative of `{name}`" for name, row in rows if not np.all(np.isfinite(row))]
    raise SolverError(
        f"{system.name}: {', '.join(bad) or 'an output or an algebraic equation'} has no finite slope at the operating "
        f"point, such as a square root at zero or a division by zero; move the point a little, or check the parameters."
    )


def _solve_implicit(system: System, slopes: FloatArray, right: FloatArray) -> FloatArray:
    """Solve for the slopes of what is eliminated; friction forces that hold one body together may be many."""
    found, _, n_solved, _ = np.linalg.lstsq(slopes, right, rcond=LOST)
    n_z = system.z.numel()
    misses = np.abs(slopes @ found - right).max(initial=0.0) > 1e-6 * (1.0 + np.abs(right).max(initial=0.0))
    if misses or np.linalg.matrix_rank(slopes[:, :n_z], tol=LOST * np.abs(slopes).max(initial=1e-300)) < n_z:
        names = ", ".join(f"`{name}`" for name in (*system.algebraics, *system.frictions.places))
        raise SolverError(
            f"{system.name}: at the operating point its equations do not determine {names} "
            f"({n_solved} of {slopes.shape[1]} independent): two solutions meet there. Move the point a little."
        )
    return np.asarray(found, dtype=float)


def _free_states(system: System, slopes: FloatArray) -> tuple[list[int], FloatArray]:
    """Return which states stay free under c_x dx = 0, and T with dx = T dx_kept, shape (n_x, n_kept).

    The constraints take out the highest derivatives first, by elimination with column pivoting: a constraint of
    positions and its derivative have the same slopes, so that a position goes together with its speed.
    """
    n_x, given = slopes.shape[1], []
    order_of = {name: order for (_, order), name in system.names.items()}
    orders = np.array([order_of[name] for name in system.states], dtype=int)
    rows = slopes / np.maximum(np.abs(slopes).max(axis=1, keepdims=True, initial=0.0), 1e-300)
    for order in sorted(set(orders.tolist()), reverse=True):
        columns = np.flatnonzero(orders == order)
        if not rows.size:
            break
        q, r, pivots = cast(tuple[FloatArray, FloatArray, np.ndarray], qr(rows[:, columns], pivoting=True))
        rank = int(np.sum(np.abs(np.diag(r)) > LOST))
        given += columns[pivots[:rank]].tolist()
        rows = q[:, rank:].T @ rows
    free = [j for j in range(n_x) if j not in set(given)]
    T = np.zeros((n_x, len(free)))
    T[free, range(len(free))] = 1.0
    if given:
        T[given] = -np.linalg.lstsq(slopes[:, given], slopes[:, free], rcond=None)[0]
    return free, T
