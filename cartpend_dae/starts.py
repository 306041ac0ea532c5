"""How each run of an estimation starts: what is fixed, what is free, and the function from these to the first state."""

import casadi as ca
import numpy as np

from cartpend_dae.data import Experiment
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.initialize import initialize
from cartpend_dae.stepping import runge_kutta
from cartpend_dae.system import System
from cartpend_dae.timekeeping import is_rate
from cartpend_dae.transcribe import FreeStart, Layout, RunStart, interval_inputs, parameter_function, shown_state
from cartpend_dae.unknowns import Free, Prior

# iterations towards a steady state: without derivatives until it stands, then so many that the derivatives are right
SETTLING, POLISHING = 50, 3


def run_start(system: System, experiment: Experiment, p: np.ndarray) -> RunStart:
    """Fix the start states that the run or the model gives, and list those that are estimated.

    Parameters
    ----------
    system
        The system.
    experiment
        The run.
    p
        Parameters at the guesses, shape (n_p,).

    Raises
    ------
    ModelError
        If what is to be free is no state, or a multiple of one.
    """
    time = float(experiment.time[0])
    u = np.array([interval_inputs(experiment, system, name)[0][0] for name in system.inputs])
    given: dict[str, float] = {}
    for name, start in experiment.start.items():
        value = start.value if start.value is not None else _start_guess(experiment, system, name)
        if value is not None:
            given[name] = value
    begin = initialize(system, p, u, given, time, unknown={})
    x = np.concatenate([begin.x, begin.z])
    measure = runge_kutta(system).measure
    model_values = np.asarray(measure(time, 1e-9, x, u, p)).ravel()
    free = []
    for name, start in experiment.start.items():
        if not start.free:
            continue
        if name not in system.positions[0] or (shown := shown_state(system, name)) is None:
            states = ", ".join(f"`{state}`" for state in system.states)
            raise ModelError(
                f"The start of `{name}` in run `{experiment.name}` cannot be free: it is not a state of the model or "
                f"a multiple of one. The states are: {states}."
            )
        guess = float(given.get(name, model_values[system.index_of(name)]) or 0.0)
        scale = _start_scale(experiment, system, name, guess)
        label = f"{experiment.name}:{name}"
        rest = _rest(system, name, shown, begin.x, model_values, p)
        prior = None if start.sd is None else Prior(guess, start.sd)
        free.append(
            (FreeStart(*shown, rest), Free(label, guess, -np.inf, np.inf, scale, system.unit_of(name), prior=prior))
        )
    steady = tuple(_settling(system, experiment)) if experiment.steady else None
    return RunStart(x, tuple(free), steady, u, time)


def _rest(
    system: System, name: str, shown: tuple[int, ca.SX], x: np.ndarray, values: np.ndarray, p: np.ndarray
) -> ca.SX:
    """Return what a variable is beside its state: an expression of parameters, or else what it is at the start.

    The deflection of a shaft, say, stays where the model starts.
    """
    relation = system.state_relations.get(name)
    if relation is not None:
        return relation.offset
    factor = float(ca.Function("f", [system.p], [shown[1]])(p))
    return ca.SX(float(values[system.index_of(name)]) - factor * float(x[shown[0]]))


def _settling(system: System, experiment: Experiment) -> list[int]:
    """Return the states that a steady start leaves to the model: those that the run does not give."""
    named = {system.state_relations[name].state for name in experiment.start if name in system.state_relations}
    return [i for i in range(system.x.numel()) if i not in named]


def begin_function(layout: Layout, start: RunStart) -> ca.Function:
    """Return (theta, free starts) -> first state of a run, shape (n_state,); both arguments are scaled.

    Raises
    ------
    SolverError
        If the run is to start at rest and the model finds no rest near its start.
    """
    system = layout.system
    n_x = system.x.numel()
    theta, s = ca.SX.sym("theta", len(layout.slots)), ca.SX.sym("s", len(start.free))
    p = parameter_function(layout)(theta)
    state = ca.SX(ca.DM(start.x))
    for position, (shown, free) in enumerate(start.free):
        factor, rest = ca.substitute([shown.factor, shown.rest], [system.p], [p])
        state[shown.state] = (free.value(s[position]) - rest) / factor
    x, z = state[:n_x, 0], state[n_x:, 0]
    if start.steady is not None:
        x, z = _settled(layout, start, x, z, p, theta, s)
    return ca.Function("begin", [theta, s], [ca.vertcat(x, z)])


def _settled(
    layout: Layout, start: RunStart, x: ca.SX, z: ca.SX, p: ca.SX, theta: ca.SX, s: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return the state with zero rates in the least squares sense, by Gauss and Newton; dry friction is left out."""
    system = layout.system
    assert start.steady is not None
    n_x = x.numel()
    step = _towards_rest(system, list(start.steady))
    now = ca.vertcat(x, z)
    guesses = [np.array([free.scaled(free.guess) for free in group]) for group in _guesses(layout, start)]
    point = np.asarray(ca.Function("x", [theta, s], [now])(*guesses)).ravel()
    numbers = np.asarray(ca.Function("p", [theta], [p])(guesses[0])).ravel()
    for _ in range(SETTLING):
        moved = np.asarray(step(start.time, point, start.u, numbers)).ravel()
        if not np.all(np.isfinite(moved)):
            raise SolverError(f"{system.name} finds no steady state to start from near its start values.")
        done = np.abs(moved - point).max(initial=0.0) < 1e-13 * max(1.0, np.abs(point).max(initial=0.0))
        point = moved
        if done:
            break
    # the parts that the run gives come from its variables, the others start from the rest at the guesses
    left = [*start.steady, *range(n_x, now.numel())]
    now[left] = ca.DM(point[left])
    for _ in range(POLISHING):
        now = step(start.time, now, start.u, p)
    return now[:n_x, 0], now[n_x:, 0]


def _guesses(layout: Layout, start: RunStart) -> tuple[list[Free], list[Free]]:
    return [layout.free[slot.owners[0]] for slot in layout.slots], [free for _, free in start.free]


def _towards_rest(system: System, unknown: list[int]) -> ca.Function:
    """Return (t, state, u, p) -> state after one step of Gauss and Newton for zero rates in the unknown states."""
    s = system
    residual = ca.vertcat(s.ode, s.alg)
    residual = ca.substitute(residual, s.frictions.force, ca.SX.zeros(s.frictions.force.numel()))
    everything = ca.vertcat(s.x, s.z)
    left = [*unknown, *range(s.x.numel(), everything.numel())]
    jacobian = ca.densify(ca.jacobian(residual, everything)[:, left])
    gram = jacobian.T @ jacobian
    scale = 1 / ca.sqrt(ca.fmax(ca.diag(gram), 1e-300))
    matrix = gram * (scale @ scale.T) + 1e-12 * ca.SX.eye(len(left))
    change = scale * ca.solve(matrix, scale * (jacobian.T @ residual))
    now = ca.SX(everything)
    now[left] = everything[left] - change
    return ca.Function("rest", [s.time, everything, s.u, s.p], [now])


def _start_guess(experiment: Experiment, system: System, name: str) -> float | None:
    """Guess a start value from the first samples of a measured position or of the position it is the rate of."""
    if name in experiment.outputs:
        known = experiment.outputs[name].values
        return float(known[np.isfinite(known)][0])
    relation = system.state_relations.get(name)
    if relation is None:
        return None
    for measured, channel in experiment.outputs.items():
        other = system.state_relations.get(measured)
        if other is None or not is_rate(system, relation.state, other.state):
            continue
        known = np.isfinite(channel.values)
        times, values = experiment.time[known][:20], channel.values[known][:20]
        p = system.parameter_values
        ratio = float(ca.Function("f", [system.p], [relation.factor / other.factor])(p))
        return float(np.polyfit(times - times[0], values, min(2, len(times) - 1))[-2]) * ratio
    return None


def _start_scale(experiment: Experiment, system: System, name: str, guess: float) -> float:
    if name in experiment.outputs:
        return max(abs(guess), float(np.nanstd(experiment.outputs[name].values)), 1e-9)
    return max(abs(guess), 1e-2)
