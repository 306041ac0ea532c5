"""Fit the two rigs by GEKKO: simultaneous collocation (IMODE 5), with tanh for the sign of dry friction.

``python with_gekko.py CASE RUN.csv`` prints JSON. The solver on this machine (``remote=False``) is that of the wheel.
"""

import json
import sys
import time

import numpy as np
from gekko import GEKKO

GUESS = {"pendulum": [0.02, 0.008], "cart": [40.0, 5.0, 10.0]}
NOISE = {"pendulum": 1e-3, "cart": 1e-4}
SMOOTH = {"pendulum": 1e-2, "cart": 1e-2}


def fit(case, times, values):
    """Return estimates, cost and times."""
    wall, processor = time.perf_counter(), time.process_time()
    m = GEKKO(remote=False)
    m.time = times
    free = [m.FV(value=guess, lb=1e-9, ub=10 * guess) for guess in GUESS[case]]
    for item in free:
        item.STATUS = 1
    x, v = m.CV(value=values[0], fixed_initial=False), m.Var(value=0.0)
    speed = np.gradient(np.convolve(values, np.ones(5) / 5, "same"), times)
    x.value, v.value = values, speed
    v.value[0] = 0.0
    m.fix_initial(v, 0.0)
    x.value = values
    x.FSTATUS = 1
    x.MEAS_GAP = NOISE[case] * 1e-3
    sign = m.Intermediate(m.tanh(v / SMOOTH[case]))
    if case == "pendulum":
        inertia = 0.1719 * 0.86**2 / 3
        right = (-0.1719 * 9.81 * 0.86 / 2 * m.sin(x) - free[0] * v - free[1] * sign) / inertia
    else:
        right = (1320.1 * (0.095 - x) - 1197.3 * (x + 0.095) - free[0] * v - free[1] * sign) / free[2]
    m.Equation(x.dt() == v)
    m.Equation(v.dt() == right)
    m.options.IMODE, m.options.EV_TYPE, m.options.NODES, m.options.SOLVER = 5, 2, 3, 3
    m.options.MAX_ITER = 300
    m.solve(disp=False)
    residual = (np.array(list(x.value)) - values) / NOISE[case]
    return {
        "estimates": [float(item.value[0]) for item in free],
        "chi2": float(np.sum(residual**2)),
        "wall": time.perf_counter() - wall,
        "processor": time.process_time() - processor,
    }


if __name__ == "__main__":
    log = np.loadtxt(sys.argv[2], delimiter=",", skiprows=1)
    print(json.dumps({"collocation, tanh": fit(sys.argv[1], *log.T)}))
