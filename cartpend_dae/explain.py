"""Errors of Python and CasADi in the code of a model's author, in words of the model: where, what, and the cure."""

import re
import reprlib
import sys
import sysconfig
import traceback
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from types import GeneratorType
from typing import Any

import casadi as ca
import numpy as np

_OURS = str(Path(__file__).parent)
_TOOLS = tuple(str(Path(module.__file__ or "").parent) for module in (ca, np))
_PYTHON = sysconfig.get_paths()["stdlib"]
_CASADI_PLACE = re.compile(r"\S*\.(?:cpp|hpp):\d+: ?")
_LEAD = re.compile(r"^`(?:equations|connect)` (?:of|in) ")  # what stands before the name of a component
_MAX_LENGTH = 120

_KNOWN = (
    (r"truth value", "Python decides on a symbol, which has no value while the model is made: write "),
    (
        r"to_int not defined|interpreted as an integer|__trunc__|__format__",
        "a number is asked of a symbol, which has no value while the model is made: use functions of CasADi such as "
        "`ca.floor`, and for counts and indices a plain field of the component, such as `n: int = 3`",
    ),
    (
        r"not iterable by design",
        "a symbol is taken as a list: `yield` each equation by itself, and write `return` only without a value",
    ),
    (
        r"maximum recursion depth",
        "it makes or calls itself without end: a component cannot be a part of its own class, unless a condition ends "
        "the chain",
    ),
    (
        r"unsupported operand type\(s\).*'SX'|Wrong number or type of arguments",
        "a symbol meets what is neither a number nor a symbol: check the types of what stands in this statement",
    ),
)
"""What an error is, by a pattern of its text: the cause and the cure."""

_DECISIONS = (
    (r"\b(max|min)\(", "`ca.fmax(a, b)` for `max` and `ca.fmin(a, b)` for `min`"),
    (r"\b(np|numpy)\.", "one equation for each element of an array"),
    (r"\band\b|\bor\b|\bnot\b|<.*<|>.*>", "`ca.logic_and(a, b)` for `and` and for `a < b < c`, `ca.logic_or` for `or`"),
    (r"\bif\b|\bwhile\b", "`ca.if_else(condition, a, b)` for `if`"),
)
"""What stands in a statement that decides on a symbol, and what to write instead."""


OF_PARTS = "; whether a part exists, `self.is_zero('name')` decides, or a plain field such as `has_brake: bool = True`"
"""What else may help where a decision about parts fails."""


def known_cause(error: Exception, line: str = "") -> str | None:
    """Return cause and cure of a mistake that ends in a foreign error, None if it is not a known one.

    Parameters
    ----------
    error
        What was raised.
    line
        The statement that raised it.
    """
    cause = next((words for pattern, words in _KNOWN if re.search(pattern, str(error))), None)
    if cause is None or not cause.endswith(" "):
        return cause
    return cause + ", ".join([cure for pattern, cure in _DECISIONS if re.search(pattern, line)] or [_DECISIONS[-1][1]])


def failure_sentence(what: str, error: Exception, hint: str = "") -> str:
    """Return the sentence for an error in the code of an author.

    Parameters
    ----------
    what
        Whose code failed, such as "`equations` of `motor` (DCMotor)".
    error
        What was raised; its traceback says where.
    hint
        What else may help against a decision on a symbol.
    """
    frames = traceback.extract_tb(error.__traceback__)
    places = [frame for frame in frames if not _is_tool(frame.filename)]
    place = (places or list(frames))[-1]
    line = (place.line or "").partition("  #")[0]
    shown = f", `{_short(line)}`" if line else ""
    cause = known_cause(error, line)
    if cause is None:
        text = _CASADI_PLACE.sub("", str(error).strip().split("\n")[0]).rstrip(".")
        is_ours = frames[-1].filename.startswith(_OURS)
        cause = text if is_ours else f"Python's {type(error).__name__}, {text or 'without a text'}; mend this statement"
    cause += hint if isinstance(error, RuntimeError) and "truth value" in str(error) else ""
    end = "" if cause[-1] == "?" else "."
    return f"{what} fails at {location(place.filename, place.lineno)}{shown}: {cause}{end}"


def _is_tool(filename: str) -> bool:
    """Whether a file is of this package, CasADi, numpy or Python, not of the author of a model."""
    if filename.startswith((_OURS, *_TOOLS)):
        return True
    return filename.startswith(_PYTHON) and "site-packages" not in filename


def location(filename: str, line: int | None) -> str:
    """Return file and line, the file as seen from the working directory if it lies below it."""
    path = Path(filename)
    below = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
    return f"{below}:{line}"


def place_of(statements: object) -> str:
    """Return " (file:line)" of the `yield` at which a generator of statements waits, "" for what is no generator."""
    generator: Any = statements
    while isinstance(generator, GeneratorType) and isinstance(generator.gi_yieldfrom, GeneratorType):
        generator = generator.gi_yieldfrom
    frame = generator.gi_frame if isinstance(generator, GeneratorType) else None
    return f" ({location(frame.f_code.co_filename, frame.f_lineno)})" if frame is not None else ""


def nearest(name: str, known: Sequence[str], otherwise: str = "") -> str:
    """Return "; did you mean ...?" with the nearest names; if none is near `otherwise`, else what there is."""
    near = get_close_matches(name, known, n=3, cutoff=0.5)
    near += [other for other in known if other.lower() == name.lower() and other not in near]
    if near:
        return f"; did you mean {', '.join(f'`{other}`' for other in near)}?"
    if otherwise:
        return f"; {otherwise}"
    more = f" and {len(known) - 12} more" if len(known) > 12 else ""
    return f"; it has {', '.join(f'`{other}`' for other in known[:12]) or 'nothing of its own'}{more}."


def nearest_file(path: Path) -> str:
    """Return "; did you mean ...?" with the file in the same folder that is named most alike, else a full stop."""
    try:
        known = [other.name for other in path.parent.iterdir() if other.suffix == path.suffix and other.is_file()]
    except OSError:
        known = []
    near = get_close_matches(path.name, known, n=1, cutoff=0.7)
    return f"; did you mean `{near[0]}`?" if near else "."


def misspelt(error: BaseException) -> str | None:
    """Return the sentence for a name that is not there, with the nearest one; None for an error of another kind."""
    last = error.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    if isinstance(error, NameError) and not isinstance(error, UnboundLocalError) and error.name and last:
        known = [*last.tb_frame.f_locals, *last.tb_frame.f_globals]
        return f"there is no `{error.name}`{nearest(error.name, known, 'define or import it first.')}"
    if isinstance(error, ImportError) and (
        found := re.match(r"cannot import name '(\w+)' from '([\w.]+)'", str(error))
    ):
        name, module = found.groups()
        known = [other for other in dir(sys.modules.get(module)) if not other.startswith("_")]
        everywhere = f" `cartpend components {name}` looks in all modules." if ".library." in module else ""
        return f"`{module}` has no `{name}`{nearest(name, known)}{everywhere}"
    return None


def listed_findings(title: str, findings: Sequence[str]) -> str:
    """Return one finding as it is, several under a title, sorted by component, one a line."""
    different = sorted(dict.fromkeys(findings), key=lambda text: _LEAD.sub("", text).replace("`", ""))
    if len(different) == 1:
        return different[0]
    return f"{title} has {len(different)} mistakes:\n" + "\n".join(f"  - {finding}" for finding in different)


def argument_sentence(name: str, unknown: list[str], missing: list[str], known: list[str]) -> str:
    """Return the sentence for arguments of a constructor that it does not know, or misses."""
    parts = []
    if unknown:
        parts.append("has no parameter " + ", ".join(f"`{n}`" for n in unknown))
    if missing:
        parts.append("needs a value for " + ", ".join(f"`{n}`" for n in missing))
    listing = ", ".join(f"`{n}`" for n in known) or "none"
    return f"{name} {' and '.join(parts)}; its parameters are: {listing}."


def position_sentence(name: str, values: Sequence[object], known: list[str]) -> str:
    """Return the sentence for arguments of a constructor without names."""
    shown = ", ".join(f"{argument}={reprlib.repr(value)}" for argument, value in zip(known, values, strict=False))
    return f"{name} takes its arguments by name, not by position: " + (
        f"write `{name}({shown})`, if that is what you mean." if shown else "it has none."
    )


def _short(text: str) -> str:
    return text if len(text) <= _MAX_LENGTH else f"{text[:_MAX_LENGTH]} ..."
