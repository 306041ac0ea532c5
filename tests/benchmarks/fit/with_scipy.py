"""Fit the two rigs by SciPy: `least_squares` around a simulation, with exact sticking or with tanh for the sign.

``python with_scipy.py CASE RUN.csv TRUTH...`` prints JSON. The equations are those of the rigs by hand, and the bounds
and guesses those of the studies. Exact sticking: the smooth pieces are solved by DOP853 from stop to stop, found as
events; at a stop the body stays if friction holds it. With tanh: `solve_ivp` by LSODA, sgn(v) = tanh(v/scale).
Differences are taken over 1e-4 of a parameter: over the default step the error of the simulation would drown them.
"""

import json
import sys
import time

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

TOLERANCE = {"rtol": 1e-8, "atol": 1e-10}
# speed at which tanh is three quarters of a sign [rad/s, m/s]: the smaller, the nearer to friction, and the slower
SMOOTH = {"pendulum": 1e-4, "cart": 1e-6}


def pendulum(parameters):
    """Return the acceleration without dry friction, and its level, of (d, tau_c)."""
    viscous, coulomb = parameters
    inertia = 0.1719 * 0.86**2 / 3
    weight = 0.1719 * 9.81 * 0.86 / 2 / inertia
    return lambda x, v: -weight * np.sin(x) - viscous / inertia * v, coulomb / inertia


def cart(parameters):
    """Return the acceleration without dry friction, and its level, of (d, f_c, m)."""
    viscous, coulomb, mass = parameters
    return lambda s, v: (1320.1 * (0.095 - s) - 1197.3 * (s + 0.095) - viscous * v) / mass, coulomb / mass


RIGS = {
    "pendulum": (pendulum, [0.02, 0.008], 1e-3),
    "cart": (cart, [40.0, 5.0, 10.0], 1e-4),
}


def sticking(acceleration, level, start, times):
    """Simulate with exact sticking."""
    out, x, begin = np.full(times.size, start), start, times[0]
    for _ in range(200):
        pull = acceleration(x, 0.0)
        if abs(pull) <= level:
            out[times >= begin] = x
            return out
        sign = np.sign(pull)

        def stop(t, y, begin=begin, sign=sign):
            return y[1] if t > begin + 1e-6 else sign

        stop.terminal, stop.direction = True, -sign
        piece = times[times >= begin]
        run = solve_ivp(
            lambda t, y, sign=sign: [y[1], acceleration(y[0], y[1]) - sign * level],
            (begin, times[-1] + 1e-9),
            [x, 0.0],
            method="DOP853",
            t_eval=piece,
            events=stop,
            **TOLERANCE,
        )
        out[times.size - piece.size :][: run.t.size] = run.y[0]
        if not run.t_events[0].size:
            return out
        x, begin = float(run.y_events[0][0, 0]), float(run.t_events[0][0])
    return out


def smooth(acceleration, level, start, times, scale):
    """Simulate with tanh for the sign."""
    run = solve_ivp(
        lambda t, y: [y[1], acceleration(y[0], y[1]) - level * np.tanh(y[1] / scale)],
        (times[0], times[-1]),
        [start, 0.0],
        method="LSODA",
        t_eval=times,
        **TOLERANCE,
    )
    return run.y[0]


def fit(case, times, values, is_exact, start):
    """Return estimates, their standard deviations, cost and times."""
    rig, guess, noise = RIGS[case]

    def residuals(unknown):
        acceleration, level = rig(unknown[:-1])
        if is_exact:
            model = sticking(acceleration, level, unknown[-1], times)
        else:
            model = smooth(acceleration, level, unknown[-1], times, SMOOTH[case])
        return (model - values) / noise

    wall, processor = time.perf_counter(), time.process_time()
    first = np.array([*(guess if start is None else start), values[0]])
    lower = np.array([0.0] * len(guess) + [-np.inf])
    found = least_squares(
        residuals, first, bounds=(lower, np.inf), x_scale=np.abs(first), diff_step=1e-4, xtol=1e-10, ftol=1e-12
    )
    covariance = np.linalg.inv(found.jac.T @ found.jac) * 2 * found.cost / (times.size - first.size)
    return {
        "estimates": found.x.tolist(),
        "sd": np.sqrt(np.diag(covariance)).tolist(),
        "chi2": 2 * float(found.cost),
        "wall": time.perf_counter() - wall,
        "processor": time.process_time() - processor,
    }


if __name__ == "__main__":
    log = np.loadtxt(sys.argv[2], delimiter=",", skiprows=1)
    near = [1.02 * float(value) for value in sys.argv[3:]]
    runs = {
        "exact sticking": (True, None),
        "tanh": (False, None),
        "exact sticking, from 2 % off the truth": (True, near),
        "tanh, from 2 % off the truth": (False, near),
    }
    print(json.dumps({name: fit(sys.argv[1], *log.T, *how) for name, how in runs.items()}))
