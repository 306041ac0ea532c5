"""Fit the two rigs by GEKKO: simultaneous collocation (IMODE 5), with tanh for the sign of dry friction.

``python with_gekko.py CASE RUN.csv TRUTH...`` prints JSON. The states start at the log. It solves with a wide tanh
first, and again from each solution with a narrower one, which halves or less: a larger step ends elsewhere. What the
narrowest that it solves gives counts. The solver on this machine (``remote=False``) is that of the wheel.
"""

import json
import sys
import time

import numpy as np
from gekko import GEKKO

# guesses, noise, widths of the tanh [rad/s, m/s]
RIGS = {
    "pendulum": ([0.02, 0.008], 1e-3, [1e-2, 5e-3, 2.5e-3, 1e-3]),
    "cart": ([40.0, 5.0, 10.0], 1e-4, [1e-2, 5e-3, 2.5e-3]),
}


def problem(case, times, values, guess):
    """Return the problem, its free parameters over their guesses, the measured state and the width."""
    _, noise, widths = RIGS[case]
    m = GEKKO(remote=False)
    m.time = times
    scaled = [m.FV(value=1.0, lb=1e-6, ub=10.0) for _ in guess]
    for item in scaled:
        item.STATUS = 1
    p, width = [first * item for first, item in zip(guess, scaled, strict=True)], m.Param(value=widths[0])
    speed = np.gradient(np.convolve(np.pad(values, 2, "edge"), np.ones(5) / 5, "valid"), times)
    speed[0] = 0.0
    x, v = m.CV(value=values, fixed_initial=False), m.Var(value=speed, fixed_initial=True)
    x.FSTATUS, x.WMEAS = 1, 1 / (values.size * noise**2)
    friction = p[0] * v + p[1] * m.tanh(v / width)
    if case == "pendulum":
        right = (-0.1719 * 9.81 * 0.86 / 2 * m.sin(x) - friction) / (0.1719 * 0.86**2 / 3)
    else:
        right = (1320.1 * (0.095 - x) - 1197.3 * (x + 0.095) - friction) / p[2]
    m.Equation(x.dt() == v)
    m.Equation(v.dt() == right)
    m.options.IMODE, m.options.EV_TYPE, m.options.NODES, m.options.SOLVER = 5, 2, 3, 3
    m.options.MAX_ITER, m.options.TIME_SHIFT, m.options.OTOL, m.options.RTOL = 100, 0, 1e-7, 1e-7
    return m, scaled, x, width


def fit(case, times, values, start):
    """Return estimates, cost and width of the narrowest tanh that is solved, and times."""
    wall, processor = time.perf_counter(), time.process_time()
    guess, noise, widths = RIGS[case]
    guess, found = guess if start is None else start, {}
    m, scaled, x, width = problem(case, times, values, guess)
    for width.value in widths:
        x.value = values  # the log: a solution takes its place
        try:
            m.solve(disp=False)
        except Exception:  # GEKKO raises this class itself where it finds no solution
            if not found:
                raise
            break
        found = {"estimates": [first * float(item.value[0]) for first, item in zip(guess, scaled, strict=True)]}
        found |= {"chi2": float(np.sum(((np.array(list(x.value)) - values) / noise) ** 2)), "width": width.value[0]}
    return found | {"wall": time.perf_counter() - wall, "processor": time.process_time() - processor}


if __name__ == "__main__":
    log = np.loadtxt(sys.argv[2], delimiter=",", skiprows=1)
    near = [1.02 * float(value) for value in sys.argv[3:]]
    runs = {"collocation, tanh": None, "collocation, tanh, from 2 % off the truth": near}
    print(json.dumps({name: fit(sys.argv[1], *log.T, start) for name, start in runs.items()}))
