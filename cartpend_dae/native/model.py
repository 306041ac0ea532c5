"""A system -> the functions and sizes that the engine in C asks for, and the whole source."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files

import casadi as ca

from cartpend_dae.events import CHATTER, ROUNDS, Machine
from cartpend_dae.hybrid_problem import replaced, watched
from cartpend_dae.memory import N_NOTE
from cartpend_dae.system import System

# the parts of the engine, in the order in which they are read
ENGINE = ("engine.h", "methods.c", "events.c", "engine.c")
SHARED = {"cse": True}  # what stands in several expressions is computed once
NEVER = 1e300  # the next tick of a model without clocks [s]


@dataclass(frozen=True, slots=True)
class NativeModel:
    """What the engine runs; sizes as in `engine.h`.

    `functions` are `model_rates`, `model_slopes`, `model_indicators`, `model_decisions` and `model_ticks`. The last
    `n_shadow` of the `n_x` states follow conditions, lest a step pass over them.
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
    n_u = s.u.numel()
    w = ca.SX.sym("w", 2 * n_u + 1)
    u = ca.SX(w[:n_u, 0] + w[n_u : 2 * n_u, 0] * (s.time - w[2 * n_u]))
    for row, expression in (expressions or {}).items():
        u[row] = ca.SX(expression(s.time))
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
    return NativeModel(functions, *sizes, shadows.numel(), is_timed)


def _laws(s: System, made: Machine | None, u: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return the state and algebraic equations, indicators and differences of conditions in the arguments."""
    if made is None:
        ode, alg = replaced([s.ode, s.alg], [(s.u, u)])
        return ode, alg, ca.SX(0, 1), ca.SX(0, 1)
    pulses, whole = s.hybrid.pulses, made.memory.whole
    old = [(s.frictions.force, made.force), (pulses, ca.SX.zeros(pulses.numel()))]
    old += [(s.hybrid.relations, whole.relations), (s.u, u)]
    # the engine steps to ticks, so that the indicators of clocks, which stand last, are not needed
    indicators = made.indicators[: made.indicators.numel() - pulses.numel(), 0]
    laws = [s.ode, s.alg, s.hybrid.differences]
    for pair in old:
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


def native_source(model: NativeModel, more: str = "") -> str:
    """Return the C of a model with the engine, as one source; `more` stands at its end.

    Raises
    ------
    RuntimeError
        If CasADi cannot write a function.
    """
    generator = ca.CodeGenerator("model.c")
    for function in model.functions:
        generator.add(function)
    return "\n".join([generator.dump(), engine_macros(model), *map(engine_part, ENGINE), more])


def engine_part(name: str) -> str:
    """Return a file of the engine."""
    return (files("cartpend_dae.native") / name).read_text(encoding="utf-8")


def engine_macros(model: NativeModel) -> str:
    """Return the sizes that the engine asks for, as macros."""
    sizes = {name.upper(): getattr(model, name) for name in ("n_x", "n_z", "n_m", "n_w", "n_p", "n_g")}
    # a model without events is never asked why it stopped, but the engine names the place
    sizes |= {"STOP": max(model.n_m - N_NOTE, 0), "CHATTER": CHATTER, "ROUNDS": ROUNDS}
    for function in model.functions:
        name = function.name()
        sizes |= {f"ARGUMENTS_{name}": function.sz_arg(), f"RESULTS_{name}": function.sz_res()}
        sizes |= {f"WORK_{name}": function.sz_w(), f"NUMBERS_{name}": function.sz_iw()}
    return "\n".join(f"#define {name} ({value})" for name, value in sizes.items()) + "\n"
