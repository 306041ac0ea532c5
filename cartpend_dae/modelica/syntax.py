"""What a Modelica file declares, from the syntax tree of pymoca; what is not supported is refused with its line."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from cartpend_dae.errors import StudyError

Node: TypeAlias = Any
"""A node of pymoca's syntax tree; pymoca is optional, so that its classes cannot be named here."""

ANY = "any"


@dataclass(frozen=True, slots=True)
class Source:
    """The text, and what it is called in messages."""

    name: str
    text: str

    def error(self, what: str, pattern: str) -> StudyError:
        """Return an error that names the first line in which a pattern stands."""
        bare = re.sub(r"//[^\n]*|/\*.*?\*/", lambda m: re.sub(r"[^\n]", " ", m[0]), self.text, flags=re.DOTALL)
        found = re.search(pattern, bare)
        line = f", line {bare.count(chr(10), 0, found.start()) + 1}" if found else ""
        return StudyError(f"{self.name}{line}: {what}")


@dataclass(slots=True)
class Declared:
    """A declaration: its kind, unit, attributes as syntax trees, and what it is set to."""

    name: str
    kind: str
    type: str
    unit: str
    doc: str
    attributes: dict[str, Node] = field(default_factory=dict)
    value: Node = None


def text_of(source: Path | str) -> tuple[str, str]:
    """Return the text of a source, and what it is called in messages."""
    if isinstance(source, str) and "\n" in source:
        return source, "Modelica text"
    path = Path(source)
    try:
        return path.read_text("utf-8-sig"), str(path)
    except OSError as error:
        raise StudyError(f"{path}: it cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise StudyError(f"{path}: it is not UTF-8 text.") from None


def parsed_class(origin: Source, model: str | None) -> Node:
    """Return the class to be read."""
    try:
        import pymoca.parser  # type: ignore[import-not-found]
    except ImportError:
        raise StudyError(
            f"{origin.name}: reading Modelica needs the parser pymoca: `pip install cartpend-dae[modelica]`."
        ) from None
    try:
        tree = pymoca.parser.parse(origin.text)
    except pymoca.parser.ModelicaSyntaxError as error:
        found = re.fullmatch(r"(.*) \(input, line (\d+)\)", str(error), re.DOTALL)
        line, what = (f", line {found[2]}", found[1]) if found else ("", str(error))
        raise StudyError(f"{origin.name}{line}: this is no Modelica: {' '.join(what.split())[:200]}.") from None
    classes = {name: c for name, c in tree.classes.items() if c.type in ("model", "block", "class")}
    if not classes:
        raise StudyError(f"{origin.name}: it holds no model.")
    if model is not None and model not in classes:
        raise StudyError(f"{origin.name}: it holds no model `{model}`; there are: {', '.join(classes)}.")
    return classes[model or list(classes)[-1]]


def plain(name: str) -> str:
    """Return a name without the quotes of Modelica."""
    return name[1:-1] if name.startswith("'") else name


def declarations_of(origin: Source, cls: Node) -> dict[str, Declared]:
    """Return the declarations of a class by their names in the text."""
    if cls.extends:
        raise origin.error("`extends` is not supported: write the inherited equations out.", r"\bextends\b")
    found = {}
    for name, symbol in cls.symbols.items():
        kind = str(symbol.type)
        place = rf"(?<![\w.]){re.escape(name)}(?![\w.])"
        if kind not in ("Real", "Integer", "Boolean"):
            raise origin.error(
                f"`{plain(name)}` is a `{kind}`, and only Real, Integer and Boolean scalars are read: flatten the "
                f"model first (a Modelica compiler writes it flat).",
                place,
            )
        if any(getattr(d, "value", None) is not None for row in symbol.dimensions for d in row):
            raise origin.error(f"`{plain(name)}` is an array: only scalars are read.", place)
        prefixes = set(symbol.prefixes)
        role = next((p for p in ("constant", "parameter", "input", "output", "discrete") if p in prefixes), "")
        variable = Declared(plain(name), role, kind, ANY, symbol.comment or "")
        _attributes(variable, symbol.class_modification)
        found[name] = variable
    return found


def _attributes(variable: Declared, modification: Node) -> None:
    for argument in getattr(modification, "arguments", None) or ():
        name, values = argument.value.component.name, argument.value.modifications
        if not values:
            continue
        if name == "value":
            variable.value = values[0]
        elif name == "unit":
            variable.unit = str(getattr(values[0], "value", values[0])).strip('"') or ANY
        else:
            variable.attributes[name] = values[0]


def check_sections(origin: Source, cls: Node) -> None:
    """Refuse equations and statements of a kind that is not read."""
    for equation in (*cls.equations, *cls.initial_equations):
        kind = type(equation).__name__
        if kind == "ConnectClause":
            raise origin.error("`connect` is not supported: flatten the model first.", r"\bconnect\s*\(")
        if kind == "ForEquation":
            raise origin.error("`for` is not supported: write the equations out.", r"\bfor\b")
    for statement in cls.statements:
        if type(statement).__name__ != "WhenStatement":
            raise origin.error("only `when` is read in an algorithm.", r"\balgorithm\b")


def stepped_names(cls: Node) -> set[str]:
    """Return the names of the variables that `when` assigns."""
    found: set[str] = set()
    for block in when_blocks(cls):
        for statement in block[1]:
            if type(statement).__name__ == "Equation":
                found.add(reference(statement.left) or "")
            elif type(statement).__name__ == "AssignmentStatement":
                found |= {reference(target) or "" for target in statement.left}
    return found - {""}


def when_blocks(cls: Node) -> Iterator[tuple[Node, list[Node]]]:
    """Yield the condition and the statements of each branch of `when`."""
    for section in (*cls.equations, *cls.statements):
        if type(section).__name__ in ("WhenEquation", "WhenStatement"):
            yield from zip(section.conditions, section.blocks, strict=True)


def reference(tree: Node) -> str | None:
    """Return the name that a tree is, None if it is no plain name."""
    if type(tree).__name__ != "ComponentRef":
        return None
    return ".".join([tree.name, *[child.name for child in tree.child]])


def operator_of(tree: Node) -> str:
    """Return the name of the operator or function of an expression, empty where there is none."""
    operator = getattr(tree, "operator", "")
    return reference(operator) or str(operator)


def uses_names(tree: Node) -> bool:
    """Whether an expression names a variable."""
    if reference(tree) is not None:
        return True
    parts = [*getattr(tree, "operands", ()), *getattr(tree, "expressions", ()), *getattr(tree, "conditions", ())]
    return any(uses_names(part) for part in parts)


def differentiated_names(cls: Node) -> set[str]:
    """Return the names x in ``der(x)``."""
    found: set[str] = set()

    def walk(tree: Node) -> None:
        if type(tree).__name__ == "Expression" and operator_of(tree) == "der":
            found.add(reference(tree.operands[0]) or "")
        for name in ("left", "right", "operands", "expressions", "conditions"):
            part = getattr(tree, name, None)
            for item in part if isinstance(part, list | tuple) else [part]:
                if item is not None and not isinstance(item, str | int | float):
                    walk(item)
        for block in getattr(tree, "blocks", ()):
            for item in block:
                walk(item)

    for equation in cls.equations:
        walk(equation)
    return found - {""}
