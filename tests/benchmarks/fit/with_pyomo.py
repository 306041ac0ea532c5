"""Fit the two rigs by Pyomo: simultaneous collocation (pyomo.dae), with a smooth sign of dry friction.

``python with_pyomo.py CASE RUN.csv TRUTH...`` prints JSON. The collocation is Radau's with three points, its
elements no longer than a sample: shorter ones follow a stop better, and solve harder. The states start at
the log. IPOPT solves with a wide sign first, and again from each solution with a narrower one; the narrowest that it
solves counts. sgn(v) is v / sqrt(v^2 + width^2), for the AMPL library cannot differentiate tanh(v / width) beyond
some 700 widths. The solver is Pyomo's `cyipopt`, which needs the library that ``pyomo build-extensions`` makes.
"""

import json
import sys
import time

import numpy as np
import pyomo.environ as pyo
from pyomo.dae import ContinuousSet, DerivativeVar

# guesses, noise, elements from sample to sample, widths of the sign [rad/s, m/s]
RIGS = {
    "pendulum": ([0.02, 0.008], 1e-3, 2, [1e-2, 1e-3, 1e-4]),
    "cart": ([40.0, 5.0, 10.0], 1e-4, 1, [1e-3, 3e-4, 1e-4, 3e-5, 1e-5]),
}
FIRST = {"tol": 1e-8, "max_iter": 200, "print_level": 0, "sb": "yes"}
NEXT = FIRST | {"mu_init": 1e-6}


def acceleration(case, p, x, v, width):
    """Return the acceleration of a rig; `p` is viscous friction, dry friction and, of the cart, the mass."""
    friction = p[0] * v + p[1] * v / pyo.sqrt(v**2 + width**2)
    if case == "pendulum":
        return (-0.1719 * 9.81 * 0.86 / 2 * pyo.sin(x) - friction) / (0.1719 * 0.86**2 / 3)
    return (1320.1 * (0.095 - x) - 1197.3 * (x + 0.095) - friction) / p[2]


def problem(case, times, values, guess):
    """Return the collocated problem, its states on the log."""
    _, noise, elements, widths = RIGS[case]
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(initialize=times.tolist())
    m.scaled = pyo.Var(range(len(guess)), initialize=1.0, bounds=(0.0, None))
    m.p = pyo.Expression(range(len(guess)), rule=lambda m, i: guess[i] * m.scaled[i])
    m.width = pyo.Param(initialize=widths[0], mutable=True)
    m.x, m.v = pyo.Var(m.t), pyo.Var(m.t)
    m.dx, m.dv = DerivativeVar(m.x), DerivativeVar(m.v)
    m.speed = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.v[t])
    m.law = pyo.Constraint(m.t, rule=lambda m, t: m.dv[t] == acceleration(case, m.p, m.x[t], m.v[t], m.width))
    collocation, n_elements = pyo.TransformationFactory("dae.collocation"), elements * (times.size - 1)
    collocation.apply_to(m, nfe=n_elements, ncp=3, scheme="LAGRANGE-RADAU")
    m.v[times[0]].fix(0.0)
    m.cost = pyo.Objective(expr=sum(((m.x[t] - y) / noise) ** 2 for t, y in zip(times.tolist(), values, strict=True)))
    speed = np.gradient(np.convolve(np.pad(values, 2, "edge"), np.ones(5) / 5, "valid"), times)
    for t in m.t:
        m.x[t].value, m.dx[t].value = float(np.interp(t, times, values)), float(np.interp(t, times, speed))
        if not m.v[t].fixed:
            m.v[t].value = m.dx[t].value
        m.dv[t].value = pyo.value(acceleration(case, m.p, m.x[t], m.v[t], m.width))
    return m


def fit(case, times, values, start):
    """Return estimates, cost and width of the narrowest sign that is solved, and times."""
    wall, processor = time.perf_counter(), time.process_time()
    guess, _, _, widths = RIGS[case]
    m, found = problem(case, times, values, guess if start is None else start), {}
    for width in widths:
        m.width.value = width
        done = pyo.SolverFactory("cyipopt", options=NEXT if found else FIRST).solve(m)
        if not pyo.check_optimal_termination(done):
            break
        found = {"estimates": [float(pyo.value(p)) for p in m.p.values()], "chi2": float(pyo.value(m.cost))}
        found["width"] = width
    if not found:
        raise SystemExit(f"IPOPT does not solve the widest sign, {widths[0]:g}.")
    return found | {"wall": time.perf_counter() - wall, "processor": time.process_time() - processor}


if __name__ == "__main__":
    log = np.loadtxt(sys.argv[2], delimiter=",", skiprows=1)
    near = [1.02 * float(value) for value in sys.argv[3:]]
    runs = {"collocation, smooth sign": None, "collocation, smooth sign, from 2 % off the truth": near}
    print(json.dumps({name: fit(sys.argv[1], *log.T, start) for name, start in runs.items()}))
