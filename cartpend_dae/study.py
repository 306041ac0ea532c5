"""The study file: what model, which parameters are free, which runs were recorded, what is asked.

`load_study` reads the TOML file and reports everything that is wrong with it at once; `load_model` makes the
Component that it names. The tables themselves are described in `study_schema`.
"""

import importlib.util
import sys
import tomllib
import traceback
import types
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from hashlib import sha256
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from cartpend_dae import units
from cartpend_dae.errors import ModelError, StudyError
from cartpend_dae.explain import misspelt, nearest_file
from cartpend_dae.language import Component
from cartpend_dae.parcel import PRIVATE
from cartpend_dae.study_paths import expand
from cartpend_dae.study_schema import (
    DesignSpec,
    DiscoverSpec,
    ExperimentSpec,
    IdentifySpec,
    ModelReference,
    ScoreSpec,
    StudyTable,
)


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """A parameter that the study names; numbers are in `unit`, without one in the model's SI unit.

    What is None keeps the model's value or bound; `fixed` takes the guess as the value.
    """

    name: str
    guess: float | None = None
    min: float | None = None
    max: float | None = None
    unit: str | None = None
    fixed: bool = False
    is_log: bool = False
    prior: tuple[float, float] | None = None
    tie: str | None = None
    is_per_run: bool = False


@dataclass(frozen=True, slots=True)
class Study:
    """A study as it was read from `path`, every path in it absolute."""

    path: Path
    model: ModelReference
    parameters: tuple[FreeParameter, ...]
    experiments: tuple[ExperimentSpec, ...]
    identify: IdentifySpec
    discover: DiscoverSpec
    scores: tuple[ScoreSpec, ...]
    design: DesignSpec | None = None


def load_study(path: Path | str) -> Study:
    """Read and check a study file.

    Data files are looked for when they are read (`pieces.load_experiments`), not here.

    Raises
    ------
    StudyError
        If the file cannot be read or is wrong; one line for each finding, naming its key.
    """
    path = Path(path).absolute()
    raw = _read_toml(path)
    try:
        table = TypeAdapter(StudyTable).validate_python(raw, context={"base": path.parent})
    except ValidationError as error:
        findings = [dict(finding) for finding in error.errors(include_url=False)]
        lines = (f"{path}: {_sentence(finding, raw)}" for finding in _causes(findings))
        raise StudyError("\n".join(lines)) from None
    return Study(
        path=path,
        model=table.model,
        parameters=tuple(
            FreeParameter(
                name,
                entry.guess,
                entry.min,
                entry.max,
                entry.unit,
                entry.fixed,
                entry.scale == "log",
                None if entry.prior is None else (entry.prior.value, entry.prior.sd),
                entry.tie,
                entry.per_run,
            )
            for name, entry in table.parameters.items()
        ),
        experiments=table.experiment,
        identify=table.identify,
        discover=table.discover,
        scores=table.score,
        design=table.design,
    )


def parameter_in_si(parameter: FreeParameter, unit: str) -> FreeParameter:
    """Return the parameter with its numbers in `unit`, the SI unit that the model declares.

    Raises
    ------
    StudyError
        If the unit of the study measures something else.
    """
    given = parameter.unit or unit

    def convert(value: float | None) -> float | None:
        return None if value is None else float(units.to_si(value, given, unit))

    try:
        low, high = convert(parameter.min), convert(parameter.max)
        prior = parameter.prior
        if prior is not None:
            prior = (
                float(units.to_si(prior[0], given, unit)),
                float(units.to_si(prior[1], given, unit, difference=True)),
            )
        return replace(parameter, guess=convert(parameter.guess), min=low, max=high, unit=unit, prior=prior)
    except ModelError as error:
        raise StudyError(
            f'`parameters."{parameter.name}"` is in `{given}`, but the model has it in `{unit}`: {error}'
        ) from None


def model_reference(text: str) -> ModelReference:
    """Read ``FILE`` or ``FILE:Class`` as it is typed on the command line."""
    file, colon, name = text.rpartition(":")
    if not (colon and name.isidentifier() and file.endswith(".py")):
        file, name = text, ""
    try:
        return ModelReference(path=expand(file, Path.cwd()), name=name or None)
    except ValueError as error:
        raise StudyError(f"The path `{file}` {error}.") from None


def load_model(reference: ModelReference) -> Component:
    """Run the Python file and make the Component that `reference` names.

    The file may import its neighbours. It is run anew at every call, as a module with a name of its own.

    Raises
    ------
    StudyError
        If the file cannot be read or fails, does not define the Component, or the constructor refuses.
    """
    path = reference.path
    module = run_file(path)
    found = {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, Component) and value.__module__ == module.__name__
    }
    cls = found.get(reference.name or (next(iter(found)) if len(found) == 1 else ""))
    if cls is None:
        raise StudyError(_which_component(path, reference.name, list(found)))
    try:
        return cls(**reference.arguments)
    except (Exception, SystemExit) as error:
        given = ", ".join(f"{key} = {value!r}" for key, value in reference.arguments.items())
        made = f"cannot be made{f' with {given}' if given else ''}"
        raise StudyError(f"{path}: `{cls.__name__}` {made}: {_what_went_wrong(error, path)}") from error


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except FileNotFoundError:
        raise StudyError(f"{path}: there is no such study file{nearest_file(path)}") from None
    except OSError as error:
        raise StudyError(f"{path}: the study file cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError as error:
        raise StudyError(f"{path}: the study file is not UTF-8 text (byte {error.start}); save it as UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{path}: the study file is not valid TOML: {str(error).rstrip('.')}.") from None


_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text in quotes",
    "path_type": "a path in quotes",
    "finite_number": "a finite number",
    "tuple_type": "a list",
    "mapping_type": "a table",
    "dict_type": "a table",
    "dataclass_type": "a table",
    "string_too_short": "a text that is not empty",
    "string_too_long": "a single character",
}
_LIMITS = {"greater_than": ("gt", "above"), "greater_than_equal": ("ge", "of at least")}
_UNKNOWN = ("unexpected_keyword_argument", "extra_forbidden")
_ARRAYS = {("experiment",), ("score",)}


def _causes(findings: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Leave out keys that are missing only because the table around them has a wrong name."""
    misnamed = {f["loc"][:-1] for f in findings if f["type"] in _UNKNOWN and isinstance(f["input"], dict)}
    return [f for f in findings if f["type"] != "missing" or f["loc"][:-1] not in misnamed]


def _sentence(finding: Mapping[str, Any], raw: Mapping[str, Any]) -> str:
    """Put one finding of pydantic into words: the key, what was found, what is expected."""
    loc, kind, context = tuple(finding["loc"]), finding["type"], finding.get("ctx", {})
    key = _dotted(loc, raw)
    if kind in _UNKNOWN:
        return _unknown_key(loc, raw, finding["input"])
    if kind == "missing":
        return f"{key} is missing."
    if kind == "value_error":
        clause = _clause(context["error"])
        return f"{key} {clause}" if clause.endswith("?") else f"{key} {clause}."
    found = _shown(finding["input"])
    if loc in _ARRAYS and kind == "tuple_type":
        return f"{key} is {found}; expected an array of tables: write [[{loc[0]}]] in double brackets."
    if kind == "literal_error":
        return f"{key} is {found}; expected {context['expected']}."
    if kind in _LIMITS:
        name, word = _LIMITS[kind]
        return f"{key} is {found}; expected a number {word} {context[name]:g}."
    expected = _EXPECTED.get(kind)
    return f"{key} is {found}; expected {expected}." if expected else f"{key} is {found}: {finding['msg']}."


def _clause(error: Exception) -> str:
    """Continue a sentence that begins with a key by the text of an error."""
    text = str(error).rstrip(".")
    return f"is wrong: {text}" if isinstance(error, ModelError) else text


def _unknown_key(loc: tuple[Any, ...], raw: Mapping[str, Any], value: object) -> str:
    *parent, key = loc
    table = _table_at(loc[:-1])
    known = [field.name for field in fields(table)] if table is not None else []
    close = get_close_matches(str(key), known, n=1, cutoff=0.5)
    hint = f"did you mean `{close[0]}`? " if close else ""
    if not close and isinstance(value, dict) and parent and table is not StudyTable:
        # [parameters.bearing.d] is a table in a table; the keys of the study are names with dots.
        name = f"{parent[-1]}.{key}"
        hint = f'a name with dots stands in quotes, "{name}". ' if isinstance(parent[-1], str) else ""
    listing = ", ".join(f"`{name}`" for name in known)
    return f"{_dotted(loc, raw)} is not a known key; {hint}Known here: {listing}."


def _table_at(loc: tuple[Any, ...]) -> type | None:
    """Return the class of the table at a place of the file, None if there is none."""
    here: Any = StudyTable
    for key in loc:
        if is_dataclass(here):
            here = get_type_hints(here).get(key)
        else:
            arguments = get_args(here)
            here = arguments[-1] if get_origin(here) is Mapping else arguments[0] if arguments else None
        if get_origin(here) in (Union, types.UnionType):
            here = next((choice for choice in get_args(here) if is_dataclass(choice)), here)
    return here if isinstance(here, type) and is_dataclass(here) else None


def _dotted(loc: tuple[Any, ...], raw: Mapping[str, Any]) -> str:
    """Write a place as `experiment[0].inputs."amplifier.u".hold`, with the name of the run after it."""
    if not loc:
        return "The study"
    text = ""
    for part in loc:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += ("." if text else "") + (part if str(part).isidentifier() else f'"{part}"')
    name = None
    if len(loc) > 1 and isinstance(loc[1], int):
        entry = raw[str(loc[0])][loc[1]]
        name = entry.get("name") if isinstance(entry, dict) else None
    return f"`{text}`" + (f" (of `{name}`)" if isinstance(name, str) and name else "")


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _which_component(path: Path, name: str | None, found: list[str]) -> str:
    listing = ", ".join(f"`{known}`" for known in sorted(found))
    if not found:
        return f"{path}: the file defines no Component; a model is a class derived from `Component`."
    if name is None:
        return f"{path}: the file defines the Components {listing}; say which: {path.name}:{found[-1]}."
    close = get_close_matches(name, found, n=1)
    hint = f"did you mean `{close[0]}`? " if close else ""
    return f"{path}: the file defines no Component `{name}`; {hint}It defines: {listing}."


def run_file(path: Path, what: str = "model file") -> types.ModuleType:
    """Run a Python file as a module whose private name cannot shadow another one.

    Raises
    ------
    StudyError
        If the file cannot be read or fails; `what` says in the sentence which file it is.
    """
    if not path.is_file():
        raise StudyError(f"{path}: there is no such {what}{nearest_file(path)}")
    name = f"{PRIVATE}{sha256(str(path).encode()).hexdigest()[:16]}"
    spec = importlib.util.spec_from_loader(name, loader=None, origin=str(path))
    if spec is None:
        raise StudyError(f"{path}: the {what} cannot be loaded as a Python module.")
    module = importlib.util.module_from_spec(spec)
    module.__file__ = str(path)
    before = sys.modules.get(name)
    with _neighbours(path.parent):
        # Registered while it runs: dataclasses and type hints look their module up by name.
        sys.modules[name] = module
        try:
            exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
        except (Exception, SystemExit) as error:
            del sys.modules[name]
            if before is not None:
                sys.modules[name] = before
            raise StudyError(f"{path}: the {what} fails: {_what_went_wrong(error, path)}") from error
    return module


@contextmanager
def _neighbours(folder: Path) -> Iterator[None]:
    """Let a model import the files beside it, and forget them: another folder may use the same names."""
    before = set(sys.modules)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            file = getattr(sys.modules[name], "__file__", None)
            if file and Path(file).parent == folder and not name.startswith("_cartpend_model_"):
                del sys.modules[name]


def _what_went_wrong(error: BaseException, path: Path) -> str:
    """Name the line of `path` and the error; a sentence of the package speaks for itself."""
    kind, text = type(error).__name__, str(error).rstrip(".")
    if isinstance(error, SyntaxError):
        shown = f" in `{error.text.strip()}`" if error.text else ""
        where = "" if error.filename == str(path) else f" of {error.filename}"
        return f"line {error.lineno}{where}: {error.msg}{shown}."
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    place = f"line {lines[-1]}: " if lines else ""
    if slip := misspelt(error):
        return f"{place}{slip}"
    spoken = text if text and isinstance(error, ModelError | TypeError) else f"{kind}: {text}"
    return f"{place}{spoken.rstrip(': ')}."
