"""The nonlinear programme of simultaneous collocation: the equations of one interval, and where all of them stand.

Between two samples the states are polynomials of degree three that fulfil the equations at Radau's points. Each
interval has a copy of the parameters, equal to that of the next one, so that all derivatives stand in blocks along the
diagonal, and the programme is made in a time that hardly grows with the data.

References
----------
L. T. Biegler, "Nonlinear Programming" (2010), chapter 10, doi:10.1137/1.9780898719383 (collocation, Radau's points).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae.dae import regularised
from cartpend_dae.problem import Problem
from cartpend_dae.programme import SETTINGS, Hessian, placed, prior_terms, summed
from cartpend_dae.system import System
from cartpend_dae.transcribe import Layout, corrected, parameter_function, weighed

DEGREE = 3


@dataclass(frozen=True, slots=True)
class Interval:
    """What belongs to a sample and the interval after it, over y = (theta, x, z, stages) and its column of data.

    ``value(y, data) -> cost, equations``; ``slope(y, data) -> gradient, nonzeros of the Jacobian``;
    ``bend(y, data, lam_f, lam) -> nonzeros of the upper triangle of the Hessian``. `end` are where in y the states
    stand that the interval ends with.
    """

    n_p: int
    n_x: int
    n_z: int
    n: int
    n_equations: int
    value: ca.Function
    slope: ca.Function
    bend: ca.Function
    slope_pattern: tuple[np.ndarray, np.ndarray]
    bend_pattern: tuple[np.ndarray, np.ndarray]

    @property
    def end(self) -> np.ndarray:
        """Radau's last point is the end."""
        return self.n - self.n_x - self.n_z + np.arange(self.n_x)


def interval_of(layout: Layout, hessian: Hessian) -> Interval:
    """Write down the equations of a sample and of the interval after it."""
    s, n_y = layout.system, len(layout.outputs)
    n_p, n_x, n_z, n_u = len(layout.slots), s.x.numel(), s.z.numel(), s.u.numel()
    data = ca.SX.sym("data", 2 + 2 * n_u + 2 * n_y + n_y + 1)
    ends = np.cumsum([0, 1, 1, n_u, n_u, n_y, n_y, n_y, 1]).tolist()
    time, length, u_a, u_b, measured, weight, w, width = ca.vertsplit(data, ends)
    equations, outputs = _smooth(s)
    theta, x, z = ca.SX.sym("theta", n_p), ca.SX.sym("x", n_x), ca.SX.sym("z", n_z)
    p = parameter_function(replace(layout, floors=()))(theta)
    _, alg = equations(time, x, z, u_a, p, width)
    error = measured - outputs(time, x, z, u_a, p, width)[list(layout.outputs)]
    now = corrected(layout, p, w, ca.vertcat(x, z), error, (length, weight))[:n_x, 0]
    stages, residuals = _stages(
        lambda t, x, z, u: equations(t, x, z, u, p, width), now, (time, length, u_a, u_b), (n_z, layout.substeps)
    )
    y, h = ca.vertcat(theta, x, z, stages), ca.vertcat(alg, residuals)
    cost, pull, curvature = weighed(weight * error, layout.huber)
    in_error, in_h = ca.jacobian(weight * error, y), ca.jacobian(h, y)
    lam_f, lam = ca.SX.sym("lam_f"), ca.SX.sym("lam", h.numel())
    if hessian == "exact":
        bend = ca.hessian(lam_f * cost + ca.dot(lam, h), y)[0]
    else:
        bend = lam_f * (in_error.T @ (in_error * ca.repmat(curvature, 1, y.numel())))
    bend = ca.triu(bend)
    cse = {"cse": True}
    return Interval(
        n_p,
        n_x,
        n_z,
        y.numel(),
        h.numel(),
        ca.Function("value", [y, data], [cost, h], cse),
        ca.Function("slope", [y, data], [ca.densify(in_error.T @ pull), _nonzeros(in_h)], cse),
        ca.Function("bend", [y, data, lam_f, lam], [_nonzeros(bend)], cse),
        _pattern(in_h),
        _pattern(bend),
    )


def _nonzeros(matrix: ca.SX) -> ca.SX:
    return ca.SX(matrix.nz[:])


def _pattern(matrix: ca.SX) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=int), np.array(columns, dtype=int)


def _smooth(s: System) -> tuple[ca.Function, ca.Function]:
    """Return (t, x, z, u, p, width) -> rates and equations of z, and -> all variables, with regularised friction."""
    parts, width = [s.ode, s.alg, s.outputs], ca.SX.sym("width")
    if s.frictions.places:
        parts = ca.substitute(parts, [s.frictions.force], [regularised(s, width)])
    ode, alg, outputs = parts
    arguments = [s.time, s.x, s.z, s.u, s.p, width]
    return ca.Function("equations", arguments, [ode, alg]), ca.Function("outputs", arguments, [outputs])


def _stages(
    equations: Callable[..., Any],
    now: ca.SX,
    sample: tuple[ca.SX, ca.SX, ca.SX, ca.SX],
    sizes: tuple[int, int],
) -> tuple[ca.SX, ca.SX]:
    """Return states and algebraic variables at all points of an interval, and the equations that hold there."""
    (time, length, u_a, u_b), (n_z, n_elements) = sample, sizes
    points = ca.collocation_points(DEGREE, "radau")
    rates_of = np.asarray(ca.collocation_coeff(points)[0])
    n_x, dt = now.numel(), length / n_elements
    symbols, residuals = list[ca.SX](), list[ca.SX]()
    for k in range(n_elements):
        x, z = ca.SX.sym(f"x_{k}", n_x, DEGREE), ca.SX.sym(f"z_{k}", n_z, DEGREE)
        slopes = ca.horzcat(now, x) @ ca.DM(rates_of)
        for j, point in enumerate(points):
            share = (k + point) / n_elements
            ode, alg = equations(time + share * length, x[:, j], z[:, j], u_a + share * (u_b - u_a))
            residuals += [slopes[:, j] - dt * ode, alg]
            symbols += [x[:, j], z[:, j]]
        now = x[:, DEGREE - 1]
    return ca.vertcat(*symbols), ca.vertcat(*residuals)


def collocation_programme(problem: Problem, interval: Interval, hessian: Hessian) -> ca.Function:
    """Return the solver: its variables are those of the problem (scaled), then y of each sample, run after run.

    Its parameters are for each sample its column of data, the bandwidths, and the width of regularised friction.
    """
    at = Places(problem, interval)
    v = ca.MX.sym("v", at.n)
    y = ca.reshape(v[at.n_v :], interval.n, at.n_samples)
    data = ca.MX.sym("data", interval.value.size1_in(1) * at.n_samples)
    columns = ca.reshape(data, interval.value.size1_in(1), at.n_samples)
    cost, h = interval.value.map(at.n_samples)(y, columns)
    gradient, slopes = interval.slope.map(at.n_samples)(y, columns)
    starts, start_slopes = at.start_defects(v, y)
    prior, prior_slope, prior_curvature = prior_terms(problem.variables, v, is_exact=hessian == "exact")
    f, g = ca.sum2(cost) + prior, ca.vertcat(*starts, ca.vec(h), at.joints(y))
    grad_f = summed(gradient, at.local, at.n) + prior_slope
    jac_g = at.jacobian(start_slopes, slopes, g.numel())
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    n_starts = len(problem.begins) * (interval.n_p + interval.n_x)
    lam = ca.reshape(lam_g[n_starts : n_starts + h.numel()], interval.n_equations, at.n_samples)
    bends = interval.bend.map(at.n_samples)(y, columns, ca.repmat(lam_f, 1, at.n_samples), lam)
    more = at.start_bends(v, lam_g) if hessian == "exact" else []
    curvature = at.hessian(bends, {i: lam_f * value for i, value in prior_curvature.items()}, more)
    names = ["x", "p", "lam_f", "lam_g"]
    hooks: dict[str, Any] = {
        "grad_f": ca.Function("nlp_grad_f", [v, data], [f, grad_f], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [v, data], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("nlp_hess_l", [v, data, lam_f, lam_g], [curvature], names, ["triu_hess_gamma_x_x"]),
    }
    return ca.nlpsol("fit", "ipopt", {"x": v, "p": data, "f": f, "g": g}, hooks | SETTINGS)


@dataclass(frozen=True)
class Places:
    """Where variables and equations of the programme stand."""

    problem: Problem
    interval: Interval

    @property
    def n_v(self) -> int:
        """Number of variables of the problem."""
        return len(self.problem.variables)

    @property
    def n_samples(self) -> int:
        """Number of samples of all runs."""
        return sum(self.problem.layout.run_lengths)

    @property
    def n(self) -> int:
        """Number of variables of the programme."""
        return self.n_v + self.interval.n * self.n_samples

    @property
    def local(self) -> np.ndarray:
        """The variables of each sample, shape (n of the interval, n_samples)."""
        return self.n_v + np.arange(self.interval.n * self.n_samples).reshape(self.interval.n, -1, order="F")

    @property
    def firsts(self) -> np.ndarray:
        """The first sample of each run."""
        return np.cumsum([0, *self.problem.layout.run_lengths[:-1]])

    @property
    def inner(self) -> np.ndarray:
        """The samples that another one of the same run follows."""
        return np.setdiff1d(np.arange(self.n_samples), np.append(self.firsts - 1, self.n_samples - 1))

    def start_defects(self, v: ca.MX, y: ca.MX) -> tuple[list[ca.MX], list[ca.MX]]:
        """Return for each run how its first parameters and states differ from the given ones, and d(begin)."""
        n_p, n_x, layout = self.interval.n_p, self.interval.n_x, self.problem.layout
        defects, slopes = [], []
        for run, first in enumerate(self.firsts.tolist()):
            theta, s = v[layout.owners[run].tolist()], v[self.problem.start_places[run].tolist()]
            begin = self.problem.begins[run]
            defects.append(y[: n_p + n_x, first] - ca.vertcat(theta, begin(theta, s)[:n_x]))
            jacobians = begin.jacobian()(theta, s, ca.MX(*begin.size_out(0)))
            slopes.append(ca.densify(ca.horzcat(*jacobians))[:n_x, :])
        return defects, slopes

    def start_bends(self, v: ca.MX, lam_g: ca.MX) -> list[tuple[np.ndarray, ca.MX]]:
        """Return for each run which variables its start depends on, and their part of the Hessian."""
        n_p, n_x, layout = self.interval.n_p, self.interval.n_x, self.problem.layout
        found = []
        for run, begin in enumerate(self.problem.begins):
            theta, s = ca.SX.sym("theta", begin.size1_in(0)), ca.SX.sym("s", begin.size1_in(1))
            lam = ca.SX.sym("lam", n_x)
            bent = ca.hessian(-ca.dot(lam, begin(theta, s)[:n_x, 0]), ca.vertcat(theta, s))[0]
            function = ca.Function("bent", [theta, s, lam], [ca.densify(bent)])
            places = layout.owners[run], self.problem.start_places[run]
            row = run * (n_p + n_x) + n_p
            value = function(v[places[0].tolist()], v[places[1].tolist()], lam_g[row : row + n_x])
            found.append((np.concatenate(places), value))
        return found

    def joints(self, y: ca.MX) -> ca.MX:
        """Return by how much each interval starts away from where the one before it ends, parameters first."""
        inner = self.inner.tolist()
        ends = y[: self.interval.n_p, inner], y[self.interval.end.tolist(), inner]
        begins = y[: self.interval.n_p + self.interval.n_x, (self.inner + 1).tolist()]
        return ca.vec(begins - ca.vertcat(*ends))

    def jacobian(self, start_slopes: list[ca.MX], slopes: ca.MX, n_rows: int) -> ca.MX:
        """Return the Jacobian of starts, equations of all intervals, and joints, in this order."""
        n_p, n_x, layout, local = self.interval.n_p, self.interval.n_x, self.problem.layout, self.local
        each = np.arange(n_p + n_x)
        rows, columns, values = list[np.ndarray](), list[np.ndarray](), list[ca.MX]()
        for run, (first, slope) in enumerate(zip(self.firsts, start_slopes, strict=True)):
            base = run * each.size
            into = np.concatenate([layout.owners[run], self.problem.start_places[run]])
            rows += [base + each, base + each[:n_p], np.tile(base + each[n_p:], into.size)]
            columns += [local[: n_p + n_x, first], layout.owners[run], np.repeat(into, n_x)]
            values += [ca.MX.ones(n_p + n_x), -ca.MX.ones(n_p), -ca.vec(slope)]
        base = each.size * len(start_slopes)
        pattern = self.interval.slope_pattern
        rows.append((base + pattern[0][:, None] + self.interval.n_equations * np.arange(self.n_samples)).ravel("F"))
        columns.append(local[pattern[1]].ravel("F"))
        values.append(ca.vec(slopes))
        base += self.interval.n_equations * self.n_samples
        joint = (base + each[:, None] + each.size * np.arange(self.inner.size)).ravel("F")
        ends = np.concatenate([np.arange(n_p), self.interval.end])
        rows += [joint, joint]
        columns += [local[: n_p + n_x, self.inner + 1].ravel("F"), local[np.ix_(ends, self.inner)].ravel("F")]
        values += [ca.MX.ones(joint.size), -ca.MX.ones(joint.size)]
        return placed(np.concatenate(rows), np.concatenate(columns), ca.vertcat(*values), (n_rows, self.n))

    def hessian(self, bends: ca.MX, prior: dict[int, ca.MX], starts: list[tuple[np.ndarray, ca.MX]]) -> ca.MX:
        """Return the upper triangle of the Hessian of the Lagrangian."""
        pattern, known = self.interval.bend_pattern, np.array(list(prior), dtype=int)
        rows, columns = [self.local[pattern[0]].ravel("F"), known], [self.local[pattern[1]].ravel("F"), known]
        values = [ca.vec(bends), *prior.values()]
        for places, value in starts:
            first, second = np.meshgrid(places, places, indexing="ij")
            is_upper = (first <= second).ravel("F")
            rows.append(first.ravel("F")[is_upper])
            columns.append(second.ravel("F")[is_upper])
            values.append(ca.vec(value)[np.flatnonzero(is_upper).tolist()])
        return placed(np.concatenate(rows), np.concatenate(columns), ca.vertcat(*values), (self.n, self.n))
