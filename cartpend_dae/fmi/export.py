"""A model -> an FMU: C of its functions, a layer of C for FMI, the description, and a library for this machine."""

import hashlib
import re
import tempfile
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import get_args

from cartpend_dae.assemble import assemble, check_bounds
from cartpend_dae.dae import parameter_vector
from cartpend_dae.errors import ModelError
from cartpend_dae.fmi.build import library, packed, platform_folder, standard_headers
from cartpend_dae.fmi.description import Facts, Kind, Version, build_description, model_description
from cartpend_dae.fmi.equations import Equations, equations_of, functions_of
from cartpend_dae.fmi.solver import engine_files, solver_macros, solver_model
from cartpend_dae.fmi.source import functions_source, model_header
from cartpend_dae.fmi.start import StartProblem, start_problem
from cartpend_dae.fmi.structure import dependencies_of
from cartpend_dae.fmi.variables import VariableTable, outputs_of, variable_table
from cartpend_dae.language import Component
from cartpend_dae.quantities import is_number
from cartpend_dae.singular import check_regular
from cartpend_dae.system import System

# each instance keeps two dense matrices of this size: 16 MB
MOST_STATES = 1000
LAYERS: dict[str, tuple[str, ...]] = {
    "2.0": ("fmi2.c", "fmi2_model_exchange.c", "fmi2_co_simulation.c"),
    "3.0": ("fmi3.c", "fmi3_values.c", "fmi3_model_exchange.c", "fmi3_co_simulation.c"),
}
CORE = (
    "all.c",
    "instance.h",
    "linear.c",
    "handles.c",
    "evaluate.c",
    "start.c",
    "events.c",
    "values.c",
    "derivatives.c",
    "snapshot.c",
)


def export_fmu(
    model: Component | System,
    path: str | Path,
    *,
    version: Version = "2.0",
    kind: Kind = "both",
    outputs: Sequence[str] | None = None,
    parameters: Mapping[str, float] | None = None,
    stop: float = 10.0,
    tolerance: float = 1e-6,
) -> Path:
    """Write a model as an FMU that needs neither Python nor CasADi.

    Parameters
    ----------
    model
        A component, or the system that `assemble` made of it.
    path
        The file to write, `NAME.fmu`.
    version
        Of the standard: ``"2.0"`` or ``"3.0"``.
    kind
        ``"me"`` for model exchange, ``"cs"`` for co-simulation (the FMU brings its own solver), or ``"both"``.
    outputs
        Names of the variables that are outputs; by default the output signals that drive nothing else.
    parameters
        Other values of parameters, by name, in SI units, such as those of a fit.
    stop
        End of the default experiment [s]. Events that follow each other without end are told against this time.
    tolerance
        Relative tolerance of the default experiment.

    Returns
    -------
    Path
        The file written. Without a C compiler it holds sources only, and a warning in the log says so.

    Raises
    ------
    ModelError
        For arguments that are none, or a model that cannot be assembled.
    SolverError
        If the model has no start at its own parameters.
    """
    target = Path(path)
    _check(target, version, kind, {"stop": stop, "tolerance": tolerance})
    system = _with_parameters(assemble(model), dict(parameters or {}))
    check_regular(system, system.parameter_values)
    _check_size(system)
    e = equations_of(system, float(stop))
    start = start_problem(e)
    table = variable_table(e, start, outputs_of(system, outputs))
    doc = (type(model).__doc__ or "").strip() if isinstance(model, Component) else ""
    identifier = re.sub(r"\W", "_", system.name, flags=re.ASCII)
    numbers = (version, kind, float(stop), float(tolerance), e.memory.numel() > 0)
    facts = Facts(system.name, identifier, "", doc.partition("\n")[0], "cartpend_dae", *numbers)
    packed(target, _content(facts, e, start, table))
    return target


def _check_size(system: System) -> None:
    n = system.x.numel() + system.z.numel()
    if n > MOST_STATES:
        raise ModelError(
            f"{system.name} has {n} states and algebraic variables; an FMU solves dense equations and takes at most "
            f"{MOST_STATES}."
        )


def _with_parameters(system: System, values: dict[str, float]) -> System:
    """Return a system with other values of parameters; one that its start determines is known then."""
    if not values:
        return system
    p = parameter_vector(system, values)
    check_bounds(system, p)
    changed = [
        replace(q, value=float(p[k]), is_unknown=q.is_unknown and q.name not in values)
        for k, q in enumerate(system.parameters)
    ]
    return replace(system, parameters=tuple(changed))


def _content(facts: Facts, e: Equations, start: StartProblem, table: VariableTable) -> dict[str, bytes]:
    """Return the files of an FMU by their path inside."""
    functions = [*functions_of(e), *start.functions]
    solver, macros = None, {}
    if facts.kind != "me":
        solver = solver_model(e)
        macros = solver_macros(e, solver, start, facts.stop)
    source = functions_source([*functions, *(solver.functions if solver else ())])
    depends = dependencies_of(e, start)
    # what is exported decides the token, so that the same export has the same
    said = model_header(facts, e, start, table, functions, macros), model_description(facts, table, depends)
    facts = replace(facts, token=_token([source, *said]))
    names = CORE + LAYERS[facts.version] + (() if solver is None else ("solver.c", "engine_end.h"))
    c_files = {name: (files("cartpend_dae.fmi") / "c" / name).read_text("utf-8") for name in names}
    c_files |= standard_headers(facts.version) | (engine_files(solver) if solver else {})
    c_files |= {"functions.c": source, "model.h": model_header(facts, e, start, table, functions, macros)}
    chosen = f'#define FMI_LAYER "{LAYERS[facts.version][0]}"\n#define HAS_CS {int(solver is not None)}\n'
    c_files["all.c"] = chosen + c_files["all.c"]
    content = {"modelDescription.xml": model_description(facts, table, depends)}
    if facts.version == "3.0":
        content["sources/buildDescription.xml"] = build_description(facts.identifier)
    content |= {f"sources/{name}": text.encode("utf-8") for name, text in c_files.items()}
    return content | _binaries(c_files, facts.identifier, facts.version, source.count(";"))


def _token(content: Sequence[str | bytes]) -> str:
    digest = hashlib.sha256()
    for part in content:
        digest.update(part if isinstance(part, bytes) else part.encode("utf-8"))
    return f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"


def _binaries(c_files: dict[str, str], identifier: str, version: Version, size: int) -> dict[str, bytes]:
    """Return the library for this machine by its path in the FMU; nothing without a compiler."""
    folder = platform_folder(version)
    if folder is None:
        return {}
    with tempfile.TemporaryDirectory(prefix="cartpend-fmu-") as scratch:
        for name, text in c_files.items():
            (Path(scratch) / name).write_text(text, encoding="utf-8")
        made = library(Path(scratch), identifier, size)
        return {} if made is None else {f"binaries/{folder}/{made.name}": made.read_bytes()}


def _check(path: Path, version: str, kind: str, numbers: dict[str, object]) -> None:
    if path.suffix.lower() != ".fmu":
        raise ModelError(f"{path}: the name of an FMU ends with `.fmu`.")
    if not path.absolute().parent.is_dir():
        raise ModelError(f"{path}: the folder {path.absolute().parent} does not exist.")
    for name, value, known in (("version", version, get_args(Version)), ("kind", kind, get_args(Kind))):
        if value not in known:
            raise ModelError(f"There is no {name} {value!r} of an FMU; choose one of {', '.join(map(repr, known))}.")
    for name, value in numbers.items():
        if not is_number(value) or not 0 < value < float("inf"):
            raise ModelError(f"`{name}` must be a positive number, not {value!r}.")
