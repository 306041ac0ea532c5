"""Slopes along the samples of runs: of the model's own step, and of its motion by the sizes of effects."""

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from cartpend_dae.along import AllTimes
from cartpend_dae.problem import Problem
from cartpend_dae.system import Frictions, System
from cartpend_dae.transcribe import sample_step

# sensitivities beyond this are those of an effect whose own states ran away
LOST = 1e30
# a push of which less than this share is left at the next sample is one against what sticks
STUCK = 0.1


@dataclass(frozen=True, slots=True)
class Local:
    """Derivatives from each sample to the next: in states, parameters, measured values; and those of the error."""

    transition: np.ndarray
    theta: np.ndarray
    measured: np.ndarray
    error: np.ndarray
    error_theta: np.ndarray


def local_slopes(
    problem: Problem,
    system: System,
    inside: list[int],
    carried: np.ndarray,
    data: np.ndarray,
    states: np.ndarray,
) -> Local:
    """Differentiate the step between samples, in which the sizes are the number 0 and states of the effects inputs.

    `carried` are parameters and bandwidths at each sample, shape (n_slots + n_y, n).
    """
    own = [i for i in range(system.x.numel()) if i not in inside]
    reduced = _reduced(system, own, inside)
    layout = replace(problem.layout, system=reduced)
    n_x, n_y, n_p = layout.n_state, len(layout.outputs), len(layout.slots)
    n_u, n_inner = system.u.numel(), len(inside)
    theta, gain, x = ca.SX.sym("theta", n_p), ca.SX.sym("w", n_y), ca.SX.sym("x", n_x)
    column = ca.SX.sym("data", 2 + 2 * (n_u + n_inner) + 2 * n_y)
    x_next, error = sample_step(layout, theta, gain, x, column)
    first = 2 + 2 * (n_u + n_inner)
    jacobian = ca.jacobian(ca.vertcat(x_next, error), ca.vertcat(x, theta, column[first : first + n_y]))
    function = ca.Function("local", [ca.vertcat(theta, gain), x, column], [ca.densify(jacobian)], {"cse": True})
    n = data.shape[1]
    inner = states[inside]
    after = np.hstack([inner[:, 1:], inner[:, -1:]])
    rows = np.vstack([data[: 2 + n_u], inner, data[2 + n_u : 2 + 2 * n_u], after, data[2 + 2 * n_u :]])
    kept = [*own, *range(system.x.numel(), states.shape[0])]
    found = np.asarray(function.map(n)(carried, states[kept], rows))
    found = found.reshape(n_x + n_y, n, n_x + n_p + n_y).transpose(1, 0, 2)
    parts = np.split(found, [n_x, n_x + n_p], axis=2)
    return Local(parts[0][:, :n_x], parts[1][:, :n_x], parts[2][:, :n_x], parts[0][:, n_x:], parts[1][:, n_x:])


def _reduced(system: System, own: list[int], inside: list[int]) -> System:
    """Return a system whose states inside effects are inputs after its own."""
    place = {state: position for position, state in enumerate(own)}
    relations = {
        name: replace(relation, state=place[relation.state])
        for name, relation in system.state_relations.items()
        if relation.state in place
    }
    return replace(
        system,
        states=tuple(system.states[i] for i in own),
        x=system.x[own, 0],
        ode=system.ode[own, 0],
        inputs=(*system.inputs, *(system.states[i] for i in inside)),
        u=ca.vertcat(system.u, system.x[inside, 0]),
        state_relations=relations,
    )


def without_lost(*parts: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return arrays (n, n_rows, n_columns) with zeros in each column that is lost in one of them somewhere."""
    with np.errstate(invalid="ignore"):
        # not a number is not less than anything
        kept = np.all([(np.abs(part) < LOST).all(axis=(0, 1)) for part in parts], axis=0)
    return parts if kept.all() else tuple(np.where(kept, part, 0.0) for part in parts)


@dataclass(frozen=True, slots=True)
class Growth:
    """df/ds at both ends of the interval after each sample, (n, n_own, n_sizes), and dh/ds, (n, n_y, n_sizes)."""

    left: np.ndarray
    right: np.ndarray
    outputs: np.ndarray

    def moved(self, local: Local, width: np.ndarray) -> np.ndarray:
        """Return what each size adds to the states until the next sample, (n, n_state, n_sizes); `width` is (n,)."""
        n_own, h = self.left.shape[1], width[:, None, None] / 2
        pushes = h * (local.transition[:, :, :n_own] @ self.left)
        pushes[:, :n_own] += h * self.right
        return pushes

    def where_finite(self) -> "Growth":
        """Return the same with zeros for the sizes whose effects are lost somewhere."""
        return Growth(*without_lost(self.left, self.right, self.outputs))


@dataclass(frozen=True)
class Along:
    """A simulation with effects in it that are not felt: the states, whose own are `inside` effects, at the samples.

    `theta` are the scaled parameters there, shape (n_slots, n).
    """

    problem: Problem
    system: System
    inside: list[int]
    theta: np.ndarray
    data: np.ndarray
    states: np.ndarray

    @property
    def own(self) -> list[int]:
        """States of the model without the effects."""
        return [i for i in range(self.system.x.numel()) if i not in self.inside]

    @cached_property
    def parameters(self) -> np.ndarray:
        """The parameters at all samples, shape (n_p, n)."""
        changes = np.flatnonzero(np.any(np.diff(self.theta, axis=1) != 0, axis=0)) + 1
        firsts = np.array([0, *changes])
        each = [np.asarray(self.problem.functions.parameters(self.theta[:, k])) for k in firsts]
        return np.repeat(np.hstack(each), np.diff([*firsts, self.theta.shape[1]]), axis=1)

    def of(self, name: str) -> np.ndarray:
        """Return a variable at all samples (n,)."""
        s = self.system
        shown = ca.substitute(s.outputs[s.index_of(name), 0], s.frictions.force, sliding_force(s.frictions))
        return Table(self, shown).before().ravel()


@dataclass(frozen=True, slots=True)
class Slopes:
    """What sizes do at once, (n_own + n_y, n_sizes) and in the algebraic equations, and how much of that comes through.

    The whole is `direct` - `through` @ `hidden`; `through` (n_own + n_y, n_z) does not depend on the sizes' shapes.
    """

    direct: ca.SX
    hidden: ca.SX
    through: ca.SX


def slopes_of(along: Along, names: tuple[str, ...]) -> Slopes:
    """Return how fast each size would move the states, and how it would change the outputs, at one instant."""
    s = along.system
    return _slopes_in(along, s.p[[s.parameter_index(name) for name in names], 0])


def _slopes_in(along: Along, sizes: ca.SX, force: ca.SX | None = None) -> Slopes:
    """Return the slopes in symbols; a `force` is what is added to each dry friction, nothing."""
    s = along.system
    # a friction of the model that is one with those of effects slides at a level that their sizes change
    ode, alg, outputs = ca.substitute(
        [s.ode[along.own, 0], s.alg, s.outputs[list(along.problem.layout.outputs), 0]],
        [s.frictions.force],
        [sliding_force(s.frictions) if force is None else sliding_force(s.frictions) + force],
    )
    both = ca.vertcat(ode, outputs)
    turned = ca.solve(ca.jacobian(alg, s.z).T, ca.densify(ca.jacobian(both, s.z)).T).T if s.z.numel() else ca.SX()
    through = turned if s.z.numel() else ca.SX.zeros(both.numel(), 0)
    return Slopes(ca.jacobian(both, sizes), ca.jacobian(alg, sizes), through)


@dataclass(frozen=True)
class Table:
    """What holds at an instant, to be evaluated at the samples; `further` are other symbols in it."""

    along: Along
    expression: ca.SX
    further: tuple[ca.SX, ...] = ()

    @cached_property
    def _evaluate(self) -> AllTimes:
        s = self.along.system
        symbols = [s.time, s.x, s.z, s.u, s.p, *self.further]
        return AllTimes(ca.Function("table", symbols, [ca.vec(ca.densify(self.expression))], {"cse": True}))

    def before(self, *values: np.ndarray) -> np.ndarray:
        """Return it where the interval after each sample begins, (n, *shape); `values` are those of `further`."""
        data, n_u = self.along.data, self.along.system.u.numel()
        return self._at(data[0], self.along.states, data[2 : 2 + n_u], values)

    def after(self, *values: np.ndarray) -> np.ndarray:
        """Return it where the interval after each sample ends."""
        data, states, n_u = self.along.data, self.along.states, self.along.system.u.numel()
        return self._at(
            data[0] + data[1], np.hstack([states[:, 1:], states[:, -1:]]), data[2 + n_u : 2 + 2 * n_u], values
        )

    def _at(self, time: np.ndarray, x: np.ndarray, u: np.ndarray, values: tuple[np.ndarray, ...]) -> np.ndarray:
        n, n_x = time.size, self.along.system.x.numel()
        found = self._evaluate((time[None], x[:n_x], x[n_x:], u, self.along.parameters, *values), n)
        return found.reshape(n, *self.expression.shape[::-1]).transpose(0, 2, 1)


def growth_of(along: Along, names: tuple[str, ...]) -> Growth:
    """Evaluate the slopes in sizes at all samples."""
    return _growth(along, slopes_of(along, names))


def _growth(along: Along, found: Slopes) -> Growth:
    whole = found.direct - found.through @ found.hidden if along.system.z.numel() else found.direct
    table = Table(along, whole)
    left, right = table.before(), table.after()
    n_own = len(along.own)
    return Growth(left[:, :n_own], right[:, :n_own], left[:, n_own:])


def held(along: Along, growth: Growth, local: Local, loose: Local) -> Growth:
    """Return what sizes do where dry frictions that stick hold against them.

    Parameters
    ----------
    along
        The simulation.
    growth
        What sizes would do if all slid.
    local, loose
        Derivatives of a step as the model takes it, and if all slid: a push that the next sample hardly knows of is
        one against what sticks.
    """
    s, n_own = along.system, len(along.own)
    forces = ca.SX.sym("force", len(s.frictions.places))
    found = _slopes_in(along, forces, forces)
    # the level of one may depend on the force of another
    parts = ca.substitute([found.direct, found.hidden, found.through], [forces], [ca.SX.zeros(forces.numel())])
    by_force = _growth(along, Slopes(*parts))
    table = Table(along, ca.jacobian(s.frictions.speed, s.x[along.own, 0]))
    ways = [table.before(), table.after()]
    left_over = [
        np.abs(np.einsum("kfi,kij,kjf->kf", ways[1], each.transition[:, :n_own, :n_own], by_force.left))
        for each in (local, loose)
    ]
    sticks = left_over[0] < STUCK * left_over[1]

    def against(way: np.ndarray, pushes: np.ndarray, moved: np.ndarray) -> np.ndarray:
        way = np.where(sticks[:, :, None], way, 0.0)
        return np.linalg.pinv(way @ pushes, rcond=1e-10) @ (way @ moved)

    first, last = against(ways[0], by_force.left, growth.left), against(ways[1], by_force.right, growth.right)
    return Growth(
        growth.left - by_force.left @ first,
        growth.right - by_force.right @ last,
        growth.outputs - by_force.outputs @ first,
    )


def roughness(growth: "Growth") -> np.ndarray:
    """Return by how much df/ds changes between samples, relative to itself, for each size; infinite if it is lost."""
    with np.errstate(over="ignore", invalid="ignore"):
        change = np.sqrt(np.mean((growth.right - growth.left) ** 2, axis=0))
        whole = np.sqrt(np.mean(growth.left**2, axis=0))
        ratio = np.where(whole > 0, change / np.maximum(whole, 1e-300), 0.0).max(axis=0)
        size = np.abs(growth.left).max(axis=(0, 1)) + np.abs(growth.outputs).max(axis=(0, 1))
    return np.where(np.isfinite(ratio) & (size < LOST), ratio, np.inf)


def sliding_force(f: Frictions) -> ca.SX:
    """Return the force of each dry friction while it slides."""
    return ca.if_else(f.speed > 0, f.level_pos, -f.level_neg) * ca.fabs(ca.sign(f.speed))


def basis_of(columns: np.ndarray, least: float = 1e-10) -> np.ndarray:
    """Return an orthonormal basis of what the parameters fitted already can move; directions below `least` are none."""
    size = np.linalg.norm(columns, axis=0)
    vectors, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return vectors[:, values > least * values.max(initial=0.0)]
