"""The augmented model as a Python file: the user's own source, and a subclass with what was added.

What was added is read from the augmented model itself (its attached parts and their connections), so that
the file says what was simulated.
"""

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import decode_source
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca

import cartpend_dae
from cartpend_dae import language, splice
from cartpend_dae.discover import Discovery
from cartpend_dae.effects.rebuild import signals_of
from cartpend_dae.effects.walk import walk
from cartpend_dae.everyday import quantity, uncertain, with_unit
from cartpend_dae.language import Component, Port, attached_to, bindings_of, parameters_of
from cartpend_dae.quantities import InstanceState, state_of
from cartpend_dae.report.text import effect_name, estimated
from cartpend_dae.session import Opened

INDENT = "    "


@dataclass(slots=True)
class _Names:
    """Global names of the file: those of the user's module, and what has to be imported beside them."""

    module: dict[str, Any]
    imports: list[str] = field(default_factory=list)
    folders: list[str] = field(default_factory=list)

    def use(self, package: str, name: str, value: object) -> str:
        """Return the name under which `value` of `package` is known in the file; import it if need be."""
        return self._known(name, value, f"from {package} import {name}")

    def use_module(self, module: ModuleType) -> str:
        """Return the name under which a module is known; one that is a user's own file is imported from its folder."""
        package, _, name = module.__name__.rpartition(".")
        if package:
            return self.use(package, name, module)
        file = Path(module.__file__ or name)
        if str(file.parent) not in self.folders:
            self.folders.append(str(file.parent))
        return self._known(file.stem, module, f"import {file.stem}")

    def _known(self, name: str, value: object, statement: str) -> str:
        if self.module.get(name) is value:
            return name
        local = name
        while local in self.module:
            local += "_"
        self.module[local] = value
        self.imports.append(statement + (f" as {local}" if local != name else ""))
        return local

    def import_lines(self) -> list[str]:
        """Return the imports, after what makes the folders of a user's own effects known."""
        paths = [f"sys.path.insert(0, {folder!r})  # an effect of the user's own is there" for folder in self.folders]
        return [*(["import sys", ""] if paths else []), *paths, *sorted(set(self.imports))]


def model_plus_source(opened: Opened, discovery: Discovery) -> str:
    """Return the source of a module that defines the augmented, calibrated model.

    Parameters
    ----------
    opened
        The study; its model file is copied, without what runs under ``if __name__ == "__main__"``.
    discovery
        What was found.
    """
    cls = type(opened.model)
    reference = opened.study.model
    names = _Names(dict(vars(sys.modules[cls.__module__])))
    name = f"{cls.__name__}Plus"
    while name in names.module:
        name += "Plus"
    body = [*_values(opened, discovery), *_additions(discovery, names)]
    lines = [
        f"class {name}({cls.__name__}):",
        *(INDENT + line if line else "" for line in _docstring(opened, discovery)),
        "",
        *(INDENT + line if line else "" for line in _constructor(dict(reference.arguments))),
        f"{INDENT}def __post_init__(self) -> None:",
        f"{INDENT * 2}super().__post_init__()",
        *(INDENT * 2 + line for line in body),
    ]
    assemble = names.use("cartpend_dae", "assemble", cartpend_dae.assemble)
    main = ["", "", 'if __name__ == "__main__":', f"{INDENT}print({assemble}({name}()))"]
    source = _copied(reference.path)
    return "\n".join([source, "", *names.import_lines(), "", "", *lines, *main]) + "\n"


def _copied(path: Path) -> str:
    """Return the source of a model file, so that it imports from anywhere and does nothing else."""
    source = decode_source(path.read_bytes())
    lines = source.splitlines()
    tree = ast.parse(source)
    for node in reversed(tree.body):
        if isinstance(node, ast.If) and re.fullmatch(r"__name__ == '__main__'", ast.unparse(node.test)):
            del lines[node.lineno - 1 : node.end_lineno]
    if _imports_neighbours(tree, path.parent):
        at = max((node.end_lineno or 0 for node in tree.body if _comes_first(node)), default=0)
        lines[at:at] = [
            "",
            "import sys",
            "",
            f"sys.path.insert(0, {str(path.parent)!r})  # the model imports files there",
        ]
    for k in range(min(2, len(lines))):
        if re.match(r"\s*#.*coding[:=]", lines[k]):
            lines[k] = "# -*- coding: utf-8 -*-"
    return "\n".join(lines).rstrip() + "\n"


def _comes_first(node: ast.stmt) -> bool:
    is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and node.lineno < 10
    return is_docstring or (isinstance(node, ast.ImportFrom) and node.module == "__future__")


def _imports_neighbours(tree: ast.Module, folder: Path) -> bool:
    roots = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            roots |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            roots.add(node.module.partition(".")[0])
    return any((folder / f"{root}.py").is_file() or (folder / root / "__init__.py").is_file() for root in roots)


def _docstring(opened: Opened, discovery: Discovery) -> list[str]:
    base = type(opened.model).__name__
    study = opened.study.path.name.replace("\\", "/").replace('"', "'")
    title = f"{base} with what its measured runs ask for" if discovery.search.steps else f"{base}, calibrated"
    lines = [f'"""{title}: by `cartpend discover` from the study {study}.', ""]
    for step in discovery.search.steps:
        insertion = step.candidate.insertion
        own = [e for e in discovery.search.final.parameters if e.name in insertion.parameter_names]
        values = ", ".join(f"{e.name.rpartition('.')[2]} = {estimated(e)}" for e in own)
        lines.append(f"Added at `{insertion.place.at}`: {effect_name(insertion.card.id)}, {values}.")
    lines += [] if discovery.search.steps else ["Nothing was added."]
    lines += ["", "Root mean square error, before and after:" if discovery.search.steps else "Root mean square error:"]
    last = {run.name: run for run in discovery.after.runs}
    for run in discovery.before.runs:
        for name, error in run.outputs.items():
            new = last[run.name].outputs[name]
            after = f", {quantity(new.rmse, new.unit)}" if discovery.search.steps else ""
            lines.append(f"{INDENT}{name} of {run.name} ({run.role}): {quantity(error.rmse, error.unit)}{after}")
    for name, values in discovery.before.scores.items():
        for run, value in values.items():
            lines.append(f"{INDENT}{name} of {run}: {value:.3g}, {discovery.after.scores[name][run]:.3g}")
    return [*(line.replace("\\", "/") for line in lines), '"""']


def _constructor(arguments: dict[str, Any]) -> list[str]:
    """Make the arguments of the study the defaults of the new class."""
    if not arguments:
        return []
    return [
        "def __init__(self, **arguments: object) -> None:",
        f"{INDENT}super().__init__(**({arguments!r} | arguments))",
        "",
    ]


def _values(opened: Opened, discovery: Discovery) -> Iterator[str]:
    """Set what was estimated or fixed in the user's own parts."""
    where = _expressions(opened.model)
    for estimate in discovery.search.final.parameters:
        path, _, name = estimate.name.rpartition(".")
        if path in where:
            known = f"± {estimate.sd:.2g} " if estimate.status == "ok" else f"{estimate.status}, "
            yield f"{where[path]}.{name} = {_number(estimate.value)}  # {known}{estimate.unit}"
    for q in opened.fixed:
        path, _, name = q.name.rpartition(".")
        yield f"{where[path]}.{name} = {_number(q.value)}  # fixed by the study, {q.declaration.unit}"


@dataclass(frozen=True, slots=True)
class _Ends:
    """How the ports and signals of a model are written in its class; `where` has the expression of each component."""

    where: dict[str, str]
    paths: dict[int, str]
    signals: dict[int, tuple[str, str]]

    @classmethod
    def of(cls, model: Component) -> "_Ends":
        components = list(walk(model))
        signals = {
            symbol.element_hash(): (path, name)
            for path, component in components
            for name, symbol in signals_of(component)
        }
        return cls(_expressions(model), {id(component): path for path, component in components}, signals)

    def place(self, item: Port | ca.SX) -> tuple[str, str]:
        """Return path of the component and name."""
        return (self.paths[id(item.owner)], item.name) if isinstance(item, Port) else self.signals[item.element_hash()]

    def text(self, item: Port | ca.SX) -> str:
        path, name = self.place(item)
        return f"{self.where[path]}.{name}"


def _additions(discovery: Discovery, names: _Names) -> Iterator[str]:
    """Make and attach every part that the augmented model has and the user's has not."""
    before = {path for path, _ in walk(discovery.setup.model)}
    ends = _Ends.of(discovery.model_plus)
    estimates = {e.name: e for e in discovery.search.final.parameters}
    used = {"self"}
    for path, owner in walk(discovery.model_plus):
        for name, (part, connections) in attached_to(owner).items():
            full = f"{path}.{name}" if path else name
            if path not in before or full in before:
                continue
            local = name.rpartition(".")[2]
            while local in used or local in names.module:
                local += "_"
            used.add(local)
            # a part that the user's file cannot know is called by the name of its variable
            ends.where[full] = local
            made = _made(part, owner, _where_attached(ends.where[path], names), names)
            yield f"{local} = {made}{_comment(part, full, estimates)}"
            joints = [", ".join(ends.text(item) for item in connection.ends) for connection in connections]
            connect = names.use("cartpend_dae", "connect", cartpend_dae.connect) if joints else ""
            yield f"{_where_attached(ends.where[path], names)}.attach("
            yield f"{INDENT}{name!r},".replace("'", '"')
            yield f"{INDENT}{local},"
            yield from (f"{INDENT}{connect}({text})," for text in joints)
            yield ")"
    yield from _splices(discovery, names, ends)


def _splices(discovery: Discovery, names: _Names, ends: _Ends) -> Iterator[str]:
    """Let what was added cut into the model, wherever it does so and the user's model does not."""
    old, was = dict(walk(discovery.setup.model)), _Ends.of(discovery.setup.model)
    for path, component in walk(discovery.model_plus):
        now, then = state_of(component), state_of(old[path]) if path in old else InstanceState()
        for name, to in now.diverted.items():
            if name not in then.diverted or was.place(then.diverted[name]) != ends.place(to):
                divert = names.use("cartpend_dae.splice", "divert", splice.divert)
                yield f'{divert}({_where_attached(ends.where[path], names)}, "{name}", {ends.text(to)})'
        for name, factors in now.scaled.items():
            for factor in factors[len(then.scaled.get(name, ())) :]:
                scale = names.use("cartpend_dae.splice", "scale", splice.scale)
                yield f'{scale}({_where_attached(ends.where[path], names)}, "{name}", {ends.text(factor)})'


def _made(part: Component, owner: Component, where: str, names: _Names) -> str:
    """Write the constructor of a library component with the values that it has, or takes from its owner."""
    cls = type(part)
    library = names.use_module(sys.modules[cls.__module__])
    arguments = []
    for name, declared in parameters_of(cls).items():
        bound = ca.SX(bindings_of(part)[name])
        if not bound.is_constant():
            taken = next(each for each in parameters_of(type(owner)) if ca.is_equal(getattr(owner, each), bound))
            arguments.append(f"{name}={where}.{taken}")
            continue
        value = float(ca.DM(bound))
        if value != declared.declaration.default:
            arguments.append(f"{name}={_number(value)}")
    return f"{library}.{cls.__name__}({', '.join(arguments)})"


def _comment(part: Component, path: str, estimates: dict[str, Any]) -> str:
    own = [estimates[f"{path}.{name}"] for name in parameters_of(type(part)) if f"{path}.{name}" in estimates]
    texts = [with_unit(uncertain(e.value, e.sd), e.unit) for e in own]
    return f"  # {', '.join(texts)}" if texts else ""


def _number(value: float | None) -> str:
    """Write a number with all its digits: an adaptive integrator answers to the twelfth with the seventh."""
    return repr(float(value)) if value is not None else "None"


def _where_attached(expression: str, names: _Names) -> str:
    if "attached_to(" in expression:
        names.use("cartpend_dae.language", "attached_to", language.attached_to)
    return expression


def _expressions(model: Component) -> dict[str, str]:
    """Return how each component of a model is reached from its class, by dotted path."""
    found: dict[str, str] = {}

    def visit(component: Component, path: str, text: str) -> None:
        found[path] = text
        for name, below, part in _parts(component):
            visit(part, f"{path}.{name}" if path else name, f"{text}{below}")
        for name, (part, _) in attached_to(component).items():
            visit(part, f"{path}.{name}" if path else name, f'attached_to({text})["{name}"][0]')

    visit(model, "", "self")
    return found


def _parts(component: Component) -> Iterator[tuple[str, str, Component]]:
    """Yield name, access and part for every part that stands in an attribute."""
    for name, value in vars(component).items():
        if isinstance(value, Component):
            yield name, f".{name}", value
        elif isinstance(value, list | tuple):
            items = ((f"[{i}]", item) for i, item in enumerate(value))
            yield from ((name + key, f".{name}{key}", item) for key, item in items if isinstance(item, Component))
        elif isinstance(value, dict):
            keyed = ((key, item) for key, item in value.items() if isinstance(item, Component))
            yield from ((f"{name}[{key}]", f".{name}[{key!r}]", item) for key, item in keyed)
