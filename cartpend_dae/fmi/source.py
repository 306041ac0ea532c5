"""The C of an FMU: what CasADi writes of the functions, and a header with the sizes and numbers of the model."""

import contextlib
import io
import json
from collections.abc import Iterable, Mapping, Sequence

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError
from cartpend_dae.events import ROUNDS
from cartpend_dae.fmi.description import Facts
from cartpend_dae.fmi.equations import Equations
from cartpend_dae.fmi.start import StartProblem
from cartpend_dae.fmi.variables import VariableTable, memory_positions
from cartpend_dae.memory import N_NOTE

PARAMETER_KINDS = {"fixed": 0, "tunable": 1, "constant": 2}
GUESS = 3


def functions_source(functions: Sequence[ca.Function]) -> str:
    """Return the C of functions.

    Raises
    ------
    ModelError
        If CasADi cannot write one of them.
    """
    generator = ca.CodeGenerator("functions.c", {"include_math": True})
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        for function in functions:
            generator.add(function)
        source = generator.dump()
    refusals = [line.strip() for line in source.splitlines() if line.lstrip().startswith("#error")]
    if refusals:
        raise ModelError(f"CasADi writes no C of a function of the model ({refusals[0].removeprefix('#error ')}).")
    return source


def model_header(
    facts: Facts,
    e: Equations,
    start: StartProblem,
    table: VariableTable,
    functions: Sequence[ca.Function],
    solver: Mapping[str, str],
) -> str:
    """Return model.h: names, sizes, start values and tables of the model.

    Parameters
    ----------
    facts, e, start, table
        What is said of the model, its equations, its start and its variables.
    functions
        All functions that the C calls.
    solver
        Macros of the solver, for co-simulation.
    """
    s = e.system
    sizes = {
        "N_X": s.x.numel(),
        "N_Z": s.z.numel(),
        "N_M": e.memory.numel(),
        "N_U": s.u.numel(),
        "N_P": s.p.numel(),
        "N_Y": e.values.numel(),
        "N_I": e.indicators.numel(),
        "N_V": start.point.size,
        "N_UNKNOWN": len(start.unknown),
        "N_START_FORCES": start.n_forces,
        "N_NOTE": N_NOTE if e.memory.numel() else 0,
        "N_MODES": 0 if e.made is None else e.made.memory.modes.numel(),
        "N_DISCRETES": 0 if e.made is None else e.made.memory.discretes.numel(),
        "N_RELATIONS": 0 if e.made is None else e.made.memory.relations.numel(),
        "N_HELD": 0 if e.made is None else e.made.memory.held.numel(),
        "N_VARIABLES": len(table.variables),
        "SIZE_ARG": max(f.sz_arg() for f in functions),
        "SIZE_RES": max(f.sz_res() for f in functions),
        "SIZE_IW": max(f.sz_iw() for f in functions),
        "SIZE_W": max(f.sz_w() for f in functions),
        "ROUNDS": ROUNDS,
        "TOLERANCE": repr(facts.tolerance),
        "HAS_ME": int(facts.kind != "cs"),
    }
    first = {f"FIRST_{role.upper()}": number for role, number in table.first.items()}
    texts = {"MODEL_NAME": facts.name, "MODEL_IDENTIFIER": facts.identifier, "MODEL_TOKEN": facts.token}
    nominal = {v.name: v.declaration.nominal for v in s.variables}
    low = [-np.inf if q.declaration.min is None else q.declaration.min for q in s.parameters]
    high = [np.inf if q.declaration.max is None else q.declaration.max for q in s.parameters]
    kinds = [GUESS if v.initial == "approx" else PARAMETER_KINDS[v.variability] for v in table.of_role("parameter")]
    memory = table.of_role("memory")
    sentences = [f"{a.place}: {a.sentence}" for a in s.hybrid.actions]
    lines = [
        "/* Sizes, numbers and names of the model; made at export. */",
        "#ifndef CARTPEND_MODEL_H",
        "#define CARTPEND_MODEL_H",
        "#include <math.h>",
        *(f"#define {name} {json.dumps(text)}" for name, text in texts.items()),
        *(f"#define {name} {number}" for name, number in (sizes | first | dict(solver)).items()),
        _doubles("P_START", [q.value or 0.0 for q in s.parameters]),
        _doubles("P_LOW", low),
        _doubles("P_HIGH", high),
        _doubles("U_START", start.u),
        _doubles("V_START", start.point),
        _doubles("V_SCALE", start.scale),
        _doubles("NOMINAL", [abs(nominal.get(name) or 1.0) for name in s.states]),
        _integers("P_KIND", kinds),
        _integers("UNKNOWN", start.unknown),
        _integers("SETTABLE", [int(b) for b in start.settable]),
        _integers("STATE_OF", table.state_of),
        _integers("ALGEBRAIC_OF", table.algebraic_of),
        _integers("INPUT_OF", table.input_of),
        _integers("DISCRETE_OF", table.discrete_of),
        _integers("MEMORY_AT", memory_positions(e)),
        _integers("MEMORY_IS_BOOLEAN", [int(v.type == "Boolean") for v in memory]),
        _texts("VARIABLE_NAME", [v.name for v in table.variables]),
        _texts("ACTION_SENTENCE", sentences),
        _texts("EVENT_PLACES", [", ".join(sorted(set(e.places)))]),
        "#endif",
        "",
    ]
    return "\n".join(lines)


def _doubles(name: str, values: Iterable[float]) -> str:
    return _table("double", name, [_double(float(v)) for v in values])


def _double(value: float) -> str:
    return repr(value) if np.isfinite(value) else "HUGE_VAL" if value > 0 else "-HUGE_VAL"


def _integers(name: str, values: Iterable[int]) -> str:
    return _table("int", name, [str(v) for v in values])


def _texts(name: str, values: Iterable[str]) -> str:
    # json escapes as C does, but for letters beyond ASCII
    return _table("char *const", name, [json.dumps(v.encode("ascii", "replace").decode()) for v in values])


def _table(kind: str, name: str, entries: list[str]) -> str:
    """Return a table that is never empty, as C wants it."""
    return f"static const {kind} {name}[] = {{{', '.join(entries) or '0'}}};"
