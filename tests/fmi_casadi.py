"""CasADi's DaeBuilder as an importer of FMUs that nobody here wrote: how far it is from the model."""

from pathlib import Path

import casadi as ca
import numpy as np

from cartpend_dae import simulate
from cartpend_dae.fmi.equations import equations_of, functions_of
from cartpend_dae.simulate import Asked, prepared_run
from cartpend_dae.system import System

POINTS = 3
RTOL, ATOL = 1e-10, 1e-12


def has_no_events(system: System) -> bool:
    return system.hybrid.is_empty and not system.frictions.places


def imported(folder: Path, system: System, stop: float) -> dict[str, float]:
    """Import an unpacked FMU for model exchange, and return how far it is from the model.

    `rates`, `state slopes` and `input slopes` are the largest errors over their largest value, at random points;
    `run` is that of the states by cvodes, over their ranges. Inputs are 0.25 in the run.
    """
    builder = ca.DaeBuilder("imported", str(folder), {"debug": False})
    states, inputs = list(builder.x()), list(builder.u())
    assert sorted(states) == sorted(system.states) and sorted(inputs) == sorted(system.inputs)
    function = builder.create("rates", ["x", "u"], ["ode"])
    slopes = function.factory("slopes", ["x", "u"], ["jac:ode:x", "jac:ode:u"])
    rhs, *_ = functions_of(equations_of(system, stop))
    exact = ca.Function("J", [system.time, system.x, system.u, system.p], _slopes(system))
    x_of, u_of = [system.states.index(name) for name in states], [system.inputs.index(name) for name in inputs]
    generator = np.random.default_rng(5)
    asked = Asked(dict.fromkeys(inputs, 0.0))
    p = prepared_run(system, np.linspace(0, stop, 2), asked).begin.p  # also what the start finds
    errors = {"rates": 0.0, "state slopes": 0.0, "input slopes": 0.0}
    for _ in range(POINTS):
        x, u = generator.uniform(-0.5, 0.5, len(states)), generator.uniform(-0.5, 0.5, len(inputs))
        x_own, u_own = np.zeros(len(states)), np.zeros(len(inputs))
        x_own[x_of], u_own[u_of] = x, u
        in_x, in_u = (np.asarray(v) for v in exact(0, x_own, u_own, p))
        pairs = {
            "rates": (function(x, u), np.asarray(rhs(0, x_own, [], [], u_own, p)).ravel()[x_of, None]),
            "state slopes": (slopes(x, u)[0], in_x[np.ix_(x_of, x_of)]),
            "input slopes": (slopes(x, u)[1], in_u[np.ix_(x_of, u_of)]),
        }
        errors |= {name: max(errors[name], _error(*pair)) for name, pair in pairs.items()}
    return errors | {"run": _run_error(function, states, inputs, system, stop)}


def _slopes(system: System) -> list[ca.SX]:
    return [ca.jacobian(system.ode, system.x), ca.jacobian(system.ode, system.u)]


def _error(found: ca.DM, exact: np.ndarray) -> float:
    if not exact.size:
        return 0.0
    return float(np.abs(np.asarray(found) - exact).max() / max(np.abs(exact).max(), 1.0))


def _run_error(function: ca.Function, states: list[str], inputs: list[str], system: System, stop: float) -> float:
    times = np.linspace(0, stop, 11)
    given = dict.fromkeys(inputs, 0.25)
    own = simulate(system, times=times, inputs=given, rtol=RTOL, atol=ATOL)
    symbol = ca.MX.sym("x", len(states))
    dae = {"x": symbol, "ode": function(symbol, ca.DM([given[name] for name in inputs]))}
    options = {"reltol": RTOL, "abstol": ATOL}
    run = ca.integrator("run", "cvodes", dae, 0, times[1:].tolist(), options)
    found = np.asarray(run(x0=[own[name][0] for name in states])["xf"])
    errors = [
        np.abs(row - own[name][1:]).max() / max(np.ptp(own[name]), np.abs(own[name]).max(), 1e-3)
        for row, name in zip(found, states, strict=True)
    ]
    return float(max(errors))
