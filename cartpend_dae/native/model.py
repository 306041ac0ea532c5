"""A system -> the functions and sizes that the engine in C asks for, and the whole source."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files

import casadi as ca
import numpy as np

from cartpend_dae.along import AllTimes
from cartpend_dae.events import CHATTER, ROUNDS, Machine
from cartpend_dae.hybrid_problem import replaced, watched
from cartpend_dae.memory import N_NOTE
from cartpend_dae.system import System

# the parts of the engine, in the order in which they are read
ENGINE = ("engine.h", "methods.c", "events.c", "exponential.c", "engine.c")
SHARED = {"cse": True}  # what stands in several expressions is computed once
MOST_LEAPING = 12  # so many states at most, where dense matrices of all are cheap
NEVER = 1e300  # the next tick of a model without clocks [s]


@dataclass(frozen=True, slots=True)
class NativeModel:
    """What the engine runs; sizes as in `engine.h`.

    `functions` are `model_rates`, `model_slopes`, `model_indicators`, `model_decisions` and `model_ticks`. The last
    `n_shadow` of the `n_x` states follow conditions, lest a step pass over them. With `is_leaping` steps through the
    transients that held values start are tried.
    """

    functions: tuple[ca.Function, ...]
    n_x: int
    n_z: int
    n_m: int
    n_w: int
    n_p: int
    n_g: int
    n_shadow: int
    depends_on_time: bool
    is_leaping: bool

    @property
    def n_y(self) -> int:
        """Number of states and algebraic variables."""
        return self.n_x + self.n_z


def native_model(
    system: System, made: Machine | None, expressions: Mapping[int, Callable[[ca.SX], ca.SX]] | None = None
) -> NativeModel:
    """Return the functions of a system.

    Parameters
    ----------
    system, made
        The system, and its machine where it has events.
    expressions
        Inputs that are functions of time, by their number.

    Notes
    -----
    The inputs w of shape (2 n_u + 1,) are values at a time `begin`, slopes, and `begin`.
    """
    s, memory = system, ca.SX(0, 1) if made is None else made.memory.vector
    w, u = _inputs(s, expressions or {})
    ode, alg, indicators, differences = _laws(s, made, u)
    shadow = watched(differences, s, ode)
    shadows = ca.SX.sym("shadow", shadow.numel())
    y = ca.vertcat(s.x, shadows, s.z)
    given = [s.time, y, memory, w, s.p]
    rates = ca.densify(ca.vertcat(ode, shadow, alg))
    slopes = [ca.densify(ca.jacobian(rates, y)), ca.densify(ca.jacobian(rates, s.time))]
    functions = (
        ca.Function("model_rates", given, [rates], SHARED),
        ca.Function("model_slopes", given, slopes, SHARED),
        ca.Function("model_indicators", given, [ca.densify(indicators)], SHARED),
        ca.Function("model_decisions", *_decisions(s, made, u, given, shadows), SHARED),
        ca.Function("model_ticks", given, [_next_tick(s, made)]),
    )
    is_timed = bool(expressions) or ca.depends_on(ca.vertcat(s.ode, s.alg), s.time)
    sizes = (s.x.numel() + shadows.numel(), s.z.numel(), memory.numel(), w.numel(), s.p.numel(), indicators.numel())
    n_x, n_z, *_ = sizes
    is_leaping = s.hybrid.pulses.numel() > 0 and n_z == 0 and 0 < n_x <= MOST_LEAPING
    return NativeModel(functions, *sizes, shadows.numel(), is_timed, is_leaping)


def native_outputs(
    system: System, made: Machine | None, expressions: Mapping[int, Callable[[ca.SX], ca.SX]] | None = None
) -> tuple[ca.Function, np.ndarray]:
    """Return the distinct ones of all variables with the indicators, and which of them each variable is (n_variables,).

    Parameters
    ----------
    system, made, expressions
        As `native_model` takes them; the function, `model_outputs`, has the arguments of its functions.
    """
    s, memory = system, ca.SX(0, 1) if made is None else made.memory.vector
    w, u = _inputs(s, expressions or {})
    outputs = s.outputs
    for pair in _decided(s, made, u):
        (outputs,) = replaced([outputs], [pair])
    given = [s.time, ca.vertcat(s.x, s.z), memory, w, s.p]
    columns = AllTimes(ca.Function("outputs", given, [outputs], SHARED)).columns()
    first = np.unique(columns, return_index=True)[1].tolist()
    results = [ca.densify(outputs[first, 0]), ca.densify(_laws(s, made, u)[2])]
    return ca.Function("model_outputs", given, results, SHARED), columns


def _inputs(s: System, expressions: Mapping[int, Callable[[ca.SX], ca.SX]]) -> tuple[ca.SX, ca.SX]:
    """Return the symbols w of the inputs, and the inputs in them."""
    n_u = s.u.numel()
    w = ca.SX.sym("w", 2 * n_u + 1)
    u = ca.SX(w[:n_u, 0] + w[n_u : 2 * n_u, 0] * (s.time - w[2 * n_u]))
    for row, expression in expressions.items():
        u[row] = ca.SX(expression(s.time))
    return w, u


def _decided(s: System, made: Machine | None, u: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    """Return what stands for friction forces, pulses, relations and inputs, to be replaced one after the other."""
    if made is None:
        return [(s.u, u)]
    pulses = s.hybrid.pulses
    old = [(s.frictions.force, made.force), (pulses, ca.SX.zeros(pulses.numel()))]
    return [*old, (s.hybrid.relations, made.memory.whole.relations), (s.u, u)]


def _laws(s: System, made: Machine | None, u: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return the state and algebraic equations, indicators and differences of conditions in the arguments."""
    if made is None:
        ode, alg = replaced([s.ode, s.alg], [(s.u, u)])
        return ode, alg, ca.SX(0, 1), ca.SX(0, 1)
    pulses = s.hybrid.pulses
    # the engine steps to ticks, so that the indicators of clocks, which stand last, are not needed
    indicators = made.indicators[: made.indicators.numel() - pulses.numel(), 0]
    laws = [s.ode, s.alg, s.hybrid.differences]
    for pair in _decided(s, made, u):
        laws = replaced(laws, [pair])
    (indicators,) = replaced([indicators], [(s.u, u)])
    ode, alg, differences = laws
    return ode, alg, indicators, differences


def _decisions(
    s: System, made: Machine | None, u: ca.SX, given: list[ca.SX], shadows: ca.SX
) -> tuple[list[ca.SX], list[ca.SX]]:
    """Return arguments and results of one round of decisions."""
    is_first = ca.SX.sym("is_first")
    time, y, memory, _, p = given
    if made is None:
        return [*given, is_first], [y, memory, ca.SX(0)]
    x, new, changed = made.round(time, s.x, memory, s.z, u, p, is_first)
    return [*given, is_first], [ca.densify(ca.vertcat(x, shadows, s.z)), ca.densify(new), ca.densify(changed)]


def _next_tick(s: System, made: Machine | None) -> ca.SX:
    h = s.hybrid
    if made is None or not h.pulses.numel():
        return ca.SX(NEVER)
    ticks = h.offsets + made.memory.whole.next * h.periods
    return ca.if_else(made.memory.note[0] == 0, ca.mmin(ticks), NEVER)


def native_source(model: NativeModel, outputs: ca.Function, more: str = "") -> str:
    """Return the C of a model with the engine and outputs, as one source; `more` stands at its end.

    Raises
    ------
    RuntimeError
        If CasADi cannot write a function.
    """
    generator = ca.CodeGenerator("model.c")
    for function in (*model.functions, outputs):
        generator.add(function)
    macros = engine_macros(model) + _sizes(outputs)
    macros += f"#define N_V ({outputs.numel_out(0)})\n"
    return "\n".join([_unasked(generator.dump()), macros, *map(engine_part, ENGINE), more])


def _unasked(code: str) -> str:
    """Return C of CasADi that does not ask whether an argument or a result is there: the engine gives all of them."""
    code = re.sub(r"arg\[(\d+)\]\? arg\[\1\]\[(\d+)\] : 0", r"arg[\1][\2]", code)
    return re.sub(r"if \(res\[\d+\]!=0\) res", "res", code)


def engine_part(name: str) -> str:
    """Return a file of the engine."""
    return (files("cartpend_dae.native") / name).read_text(encoding="utf-8")


def engine_macros(model: NativeModel) -> str:
    """Return the sizes that the engine asks for, as macros."""
    sizes = {name.upper(): getattr(model, name) for name in ("n_x", "n_z", "n_m", "n_w", "n_p", "n_g", "n_shadow")}
    # a model without events is never asked why it stopped, but the engine names the place
    sizes |= {"IS_LEAPING": int(model.is_leaping)}
    sizes |= {"STOP": max(model.n_m - N_NOTE, 0), "CHATTER": CHATTER, "ROUNDS": ROUNDS}
    return _macros(sizes) + "".join(map(_sizes, model.functions))


def _sizes(function: ca.Function) -> str:
    """Return the sizes of what a function works with."""
    name = function.name()
    sizes = {f"ARGUMENTS_{name}": function.sz_arg(), f"RESULTS_{name}": function.sz_res()}
    return _macros(sizes | {f"WORK_{name}": function.sz_w(), f"NUMBERS_{name}": function.sz_iw()})


def _macros(sizes: Mapping[str, int]) -> str:
    return "".join(f"#define {name} ({value})\n" for name, value in sizes.items())
