"""The reference pages that are read off the program: components, commands, keys, and the table of files.

Sphinx writes the first three into docs/reference/generated at each build. ``python docs/reference_pages.py`` writes the
table of files into docs/architecture.md; tests/test_docs.py fails where it is not up to date.
"""

import ast
import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from typer import Context
from typer.cli import get_docs_for_click

from cartpend_dae import library, study_schema
from cartpend_dae.cli import COMMANDS, loaded
from cartpend_dae.shelf import Entry, components

DOCS = Path(__file__).resolve().parent
GENERATED = DOCS / "reference" / "generated"
ARCHITECTURE = DOCS / "architecture.md"
LIBRARY = Path(library.__file__).parent
MARKS = "<!-- files: made by python docs/reference_pages.py -->\n", "<!-- end of files -->\n"
FOLDERS = ("cartpend_dae", "models")


def write_all() -> None:
    """Write the pages of all modules of the library with their table, and those of the commands and of the keys."""
    pages = {
        f"components/{module}.md": library_page(module, list(entries))
        for module, entries in groupby(components(), _module)
    }
    pages |= {"commands.md": commands_page(), "study_keys.md": study_keys(), "modules.txt": module_table()}
    (GENERATED / "components").mkdir(parents=True, exist_ok=True)
    for name, text in pages.items():
        path = GENERATED / name
        if not path.exists() or path.read_text("utf-8") != text:  # Sphinx reads again what is newer
            path.write_text(text, "utf-8")


def _module(entry: Entry) -> str:
    return entry.name.split(".")[0]


def library_page(module: str, entries: list[Entry]) -> str:
    """Return the page of one module of the library, a section for each component."""
    head = f"# {module}\n\n`from cartpend_dae.library.{module} import ...`\n"
    return "\n".join([head, *map(_component, entries)])


def module_table() -> str:
    """Return the table of the modules of the library, by the first sentences of their docstrings."""
    lines = ["| module | what it holds |", "|---|---|"]
    for module, _ in groupby(components(), _module):
        sentence = _first_sentence(LIBRARY / f"{module}.py")
        lines.append(f"| [{module}](generated/components/{module}.md) | {sentence} |")
    return "\n".join(lines) + "\n"


def _first_sentence(path: Path) -> str:
    """Return the first paragraph of a file's docstring, for a cell of a table."""
    said = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    return said.partition("\n\n")[0].replace("\n", " ").replace("|", "\\|")


def _component(entry: Entry) -> str:
    lines = [f"## {entry.name.split('.')[1]}\n", *map(_paragraph, entry.law.split("\n\n"))]
    if entry.ports:
        lines += ["Ports: " + ", ".join(f"`{name}` ({kind})" for name, kind in entry.ports.items()) + ".", ""]
    rows = [(name, s["unit"], s["direction"], s["doc"]) for name, s in entry.signals.items()]
    rows += [
        (name, p["unit"], "" if p["default"] is None else f"{p['default']:g}", p["doc"])
        for name, p in entry.parameters.items()
    ]
    if rows:
        lines += ["| name | unit | default or direction | what it is |", "|---|---|---|---|"]
        lines += [f"| `{name}` | {unit} | {middle} | {doc} |" for name, unit, middle, doc in rows]
    return "\n".join(lines) + "\n"


def _paragraph(text: str) -> str:
    """Return a paragraph of a docstring as Markdown: a drawing as it is, else text whose stars are stars."""
    if text.startswith("    "):
        return f"```text\n{text}\n```\n"
    whole = re.sub(r"(?<=\s)(\+?-)(?=[\w(])", "\\1\u2060", text)  # a sign stays with what it is the sign of
    return whole.replace("*", r"\*") + "\n"


def commands_page() -> str:
    """Return the page of all commands, as their own help tells them."""
    parts = ["# Commands\n\nThe same is printed by `cartpend COMMAND --help`.\n"]
    for name in COMMANDS:
        command = loaded(name)
        text = get_docs_for_click(obj=command, ctx=Context(command, info_name=f"cartpend {name}"), name=name)
        text = text.replace(command.epilog, f"Example: `{COMMANDS[name].example}`")
        text = re.sub(r" <list\[\w+\]>`", "...`", text).replace(" range>`", ">`")
        text = re.sub(r"(`[A-Z]+) <(?:str|path)>`", r"\1`", text)  # what an argument is stands beside it
        parts.append(f"#{text}".replace("```console\n$ ", "```console\n$ cartpend "))
    return "\n".join(parts)


def study_keys() -> str:
    """Return the tables of a study file with their keys, from the classes that check them."""
    schema = TypeAdapter(study_schema.StudyTable).json_schema()
    tables = {"StudyTable": schema, **schema["$defs"]}
    titles = _titles(tables)
    parts = ["# All keys of a study file\n"]
    for name in titles:
        cls = getattr(study_schema, name)
        parts += [
            f"({name.lower()})=\n## {titles[name]}\n",
            (cls.__doc__ or "").replace("``", "`").replace("\n    ", "\n"),
        ]
        parts += ["", "| key | value | when absent |", "|---|---|---|"]
        needed = tables[name].get("required", [])
        for key, entry in tables[name]["properties"].items():
            absent = "needed" if key in needed else _default(entry.get("default"))
            parts.append(f"| `{key}` | {_kind(entry, titles)} | {absent} |")
        parts.append("")
    return "\n".join(parts)


def _titles(tables: dict[str, Any]) -> dict[str, str]:
    """Return what each table is called in a file, in the order in which they are met, by the name of its class."""
    titles, todo = {"StudyTable": "The file"}, ["StudyTable"]
    for name in todo:
        for key, entry in tables[name]["properties"].items():
            for inner, form in _inner(entry):
                if inner not in titles:
                    todo.append(inner)
                    titles[inner] = f"`{form.format(key)}`" if name == "StudyTable" else f"`{key}` of {titles[name]}"
    return titles


def _inner(entry: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the tables that a value holds, and how they are written at the top of a file."""
    for one in entry.get("anyOf", [entry]):
        for held, form in (
            (one, "[{}]"),
            (one.get("items"), "[[{}]]"),
            (one.get("additionalProperties"), '[{}."NAME"]'),
        ):
            if isinstance(held, dict) and "$ref" in held:
                yield held["$ref"].rpartition("/")[2], form


def _default(value: object) -> str:
    return "" if value in (None, [], {}) or isinstance(value, dict) else f"`{str(value).lower()}`"


def _kind(entry: dict[str, Any], titles: dict[str, str]) -> str:
    if "$ref" in entry:
        name = entry["$ref"].rpartition("/")[2]
        return f"[{titles[name]}](#{name.lower()})"
    if "anyOf" in entry:
        return " or ".join(_kind(one, titles) for one in entry["anyOf"] if one.get("type") != "null")
    if "enum" in entry:
        return ", ".join(f"`{value}`" if value.strip(".,' ") else f'`"{value}"`' for value in entry["enum"])
    if entry.get("type") == "array":
        return f"list of {_kind(entry['items'], titles)}" if "items" in entry else "two values"
    if entry.get("type") == "object":
        inner = entry.get("additionalProperties")
        return f"table of {_kind(inner, titles)}" if isinstance(inner, dict) else "table"
    names = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false"}
    return names.get(entry.get("type", ""), f"`{entry['const']}`" if "const" in entry else "value")


def file_table() -> str:
    """Return the table of all files of the package and the models, by the first sentences of their docstrings."""
    lines = ["| file | what it is |", "|---|---|"]
    for folder in FOLDERS:
        for path in sorted((DOCS.parent / folder).rglob("*.py")):
            if sentence := _first_sentence(path):
                lines.append(f"| `{path.relative_to(DOCS.parent).as_posix()}` | {sentence} |")
    return "\n".join(lines) + "\n"


def architecture() -> str:
    """Return the text of docs/architecture.md with the table of files as it is now."""
    before, _, rest = ARCHITECTURE.read_text("utf-8").partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    return f"{before}{MARKS[0]}{file_table()}{MARKS[1]}{after}"


if __name__ == "__main__":
    ARCHITECTURE.write_text(architecture(), "utf-8")
