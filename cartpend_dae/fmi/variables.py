"""Equations -> the variables of an FMU: names, value references, causality, start values."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from cartpend_dae.errors import ModelError
from cartpend_dae.fmi.equations import Equations
from cartpend_dae.fmi.start import StartProblem
from cartpend_dae.quantities import Declaration
from cartpend_dae.system import System
from cartpend_dae.units import derivative, format_unit

Type = Literal["Real", "Integer", "Boolean"]
Role = Literal["time", "parameter", "value", "rate", "memory", "indicator"]
ROLES: tuple[Role, ...] = ("time", "parameter", "value", "rate", "memory", "indicator")
JOINED = "connection of "  # how the origin of an equation between signals begins
STRUCTURED = re.compile(r"(der\()?[A-Za-z_]\w*(\[\d+(,\d+)*\])?(\.[A-Za-z_]\w*(\[\d+(,\d+)*\])?)*\)?", re.ASCII)


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """A variable of an FMU; `role` and `index` say where its value is, `state` of which state it is the derivative."""

    name: str
    reference: int
    role: Role
    index: int
    type: Type
    causality: str
    variability: str
    initial: str
    start: float | None
    declaration: Declaration
    state: int = -1


@dataclass(frozen=True, slots=True)
class VariableTable:
    """All variables in the order of their value references, and where each group of them begins.

    `first` gives the first reference of a role. `state_of`, `algebraic_of`, `input_of`, `discrete_of` say for each of
    the values which state, algebraic variable, input or discrete variable it is, -1 where none.
    """

    variables: tuple[FmuVariable, ...]
    first: dict[Role, int]
    state_of: tuple[int, ...]
    algebraic_of: tuple[int, ...]
    input_of: tuple[int, ...]
    discrete_of: tuple[int, ...]

    @property
    def is_structured(self) -> bool:
        """Whether all names follow the structured convention of FMI."""
        return all(STRUCTURED.fullmatch(v.name) for v in self.variables)

    def of_role(self, role: Role) -> tuple[FmuVariable, ...]:
        """Return the variables of a role in their order."""
        return tuple(v for v in self.variables if v.role == role)


def outputs_of(system: System, names: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the outputs: those asked for, else output signals of the model itself and free ones of parts.

    Raises
    ------
    ModelError
        For a name that is no variable, or that of an input.
    """
    if names is not None:
        for name in names:
            system.index_of(name)
            if name in system.inputs:
                raise ModelError(f"`{name}` is an input of {system.name}; name outputs that the model computes.")
        return tuple(dict.fromkeys(names))
    joined = (origin.removeprefix(JOINED) for origin in system.flat.origins if origin.startswith(JOINED))
    connected = {name for names in joined for name in names.split(", ")}
    every = [v.name for v in system.variables if v.kind == "output"]
    return tuple(name for name in every if "." not in name or name not in connected)


def variable_table(e: Equations, start: StartProblem, outputs: tuple[str, ...]) -> VariableTable:
    """Make the variables of an FMU.

    Parameters
    ----------
    e, start
        The equations, and their start.
    outputs
        Names of the variables that are outputs.
    """
    s = e.system
    groups = {
        "time": [_time(s)],
        "parameter": _parameters(e, start),
        "value": _values(e, start, outputs),
        "rate": _rates(s),
        "memory": _memory(e),
        "indicator": _indicators(e),
    }
    taken = {v.name for v in (*s.variables, *s.flat.parameters)}
    found: list[FmuVariable] = []
    first: dict[Role, int] = {}
    for role in ROLES:
        first[role] = len(found)
        for index, (name, *facts) in enumerate(groups[role]):
            if role in ("time", "rate", "memory", "indicator"):
                while name in taken:
                    name = f"{name}_"
                taken.add(name)
            found.append(FmuVariable(name, len(found), role, index, *facts))
    n_more = len(groups["value"]) - len(s.variables)

    def positions(names: Sequence[str]) -> tuple[int, ...]:
        table = {name: k for k, name in enumerate(names)}
        return (*(table.get(v.name, -1) for v in s.variables), *[-1] * n_more)

    discretes = [s.variables[i].name for i in s.hybrid.discretes]
    return VariableTable(
        tuple(found), first, positions(s.states), positions(s.algebraics), positions(s.inputs), positions(discretes)
    )


def _time(s: System) -> tuple:
    return ("time", "Real", "independent", "continuous", "", None, Declaration("s", "time of the simulation"))


def _parameters(e: Equations, start: StartProblem) -> list[tuple]:
    s = e.system
    during = [e.ode, e.alg, e.values, e.indicators, s.hybrid.values, s.hybrid.conditions, s.hybrid.differences]
    clocks = ca.vertcat(s.hybrid.periods, s.hybrid.offsets)
    found = []
    tunable = ca.which_depends(ca.vertcat(*during), s.p, 1, False) if s.p.numel() else []
    is_clock = ca.which_depends(clocks, s.p, 1, False) if s.p.numel() and clocks.numel() else [False] * s.p.numel()
    n = s.x.numel() + s.z.numel() + start.n_forces
    for k, q in enumerate(s.parameters):
        value = None if q.value is None else float(q.value)
        if k in start.unknown:
            solved = float(start.point[n + start.unknown.index(k)])
            facts = ("calculatedParameter", "fixed", "approx", solved)
        elif q.is_built_as_zero:
            facts = ("local", "constant", "exact", 0.0)
        else:
            facts = ("parameter", "tunable" if tunable[k] and not is_clock[k] else "fixed", "exact", value)
        found.append((q.name, "Real", *facts, q.declaration))
    return found


def _values(e: Equations, start: StartProblem, outputs: tuple[str, ...]) -> list[tuple]:
    s, n_x = e.system, e.system.x.numel()
    discretes = {s.variables[i].name: k for k, i in enumerate(s.hybrid.discretes)}
    shown = {s.variables[i].name for i in s.hybrid.modes if i >= 0}
    states = {name: k for k, name in enumerate(s.states)}
    algebraics = {name: k for k, name in enumerate(s.algebraics)}
    inputs = {name: k for k, name in enumerate(s.inputs)}
    found = []
    for v in s.variables:
        causality = "output" if v.name in outputs else "local"
        variability, initial, value = "continuous", "calculated", None
        if v.name in inputs:
            causality, initial, value = "input", "exact", float(start.u[inputs[v.name]])
        elif v.name in states and start.settable[k := states[v.name]]:
            initial, value = "exact" if start.is_free[k] else "approx", float(start.point[k])
        elif v.name in algebraics:
            initial, value = "approx", float(start.point[n_x + algebraics[v.name]])
        elif v.name in discretes:
            variability = "discrete"
            if v.name not in shown:
                initial, value = "exact", float(v.declaration.start or 0.0)
        found.append((v.name, "Real", causality, variability, initial, value, v.declaration))
    for q in s.flat.parameters:
        if q.value is None:
            found.append((q.name, "Real", "calculatedParameter", "tunable", "calculated", None, q.declaration))
    return found


def _rates(s: System) -> list[tuple]:
    found = []
    for k, name in enumerate(s.states):
        unit = format_unit(derivative(s.unit_of(name)))
        facts = (f"der({name})", "Real", "local", "continuous", "calculated", None)
        found.append((*facts, Declaration(unit, f"time derivative of {name}"), k))
    return found


def _memory(e: Equations) -> list[tuple]:
    """Return what is decided at events and is no variable of the model: modes, relations, clocks, count of events."""
    if e.made is None:
        return []
    s, h = e.system, e.system.hybrid
    found: list[tuple] = []

    def add(name: str, kind: Type, doc: str, low: float | None = None, high: float | None = None) -> None:
        found.append((name, kind, "local", "discrete", "calculated", None, Declaration("1", doc, low, high)))

    for k, place in enumerate(s.frictions.places):
        doc = f"mode of the dry friction at {place}: -1 backward, 0 stuck, 1 forward, 2 free"
        add(f"friction_mode[{k + 1}]", "Integer", doc, -1, 2)
    for k, place in enumerate(h.relation_places):
        add(f"relation[{k + 1}]", "Boolean", f"condition in {place}")
    for k, place in enumerate(h.clock_places(s.name)):
        add(f"clock_tick[{k + 1}]", "Integer", f"number of the next tick of the clock of {place}, from 0", 0)
    add("event_count", "Integer", "number of events decided so far", 0)
    return found


def _indicators(e: Equations) -> list[tuple]:
    return [
        (
            f"event_indicator[{k + 1}]",
            "Real",
            "local",
            "continuous",
            "calculated",
            None,
            Declaration("", f"falls through zero at an event of {place}"),
        )
        for k, place in enumerate(e.places)
    ]


def memory_positions(e: Equations) -> tuple[int, ...]:
    """Return where the memory variables of an FMU stand in the memory vector."""
    if e.made is None:
        return ()
    parts = e.made.memory
    n_f, n_d, n_r = parts.modes.numel(), parts.discretes.numel(), parts.relations.numel()
    n_h, n_c = parts.held.numel(), parts.next.numel()
    relations, clocks, note = n_f + n_d, n_f + n_d + n_r + n_h, n_f + n_d + n_r + n_h + n_c
    return (*range(n_f), *range(relations, relations + n_r), *range(clocks, clocks + n_c), note + 4)
