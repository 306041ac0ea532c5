"""Flat or library-free Modelica text -> Component; pymoca parses.

Read are models of Real, Integer and Boolean scalars with equations, `if`, `when`, `reinit`, `sample`, `pre`, `noEvent`,
initial equations and attributes. What is not supported is refused with its line.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca

from cartpend_dae.declarations import discrete, param, signal, var
from cartpend_dae.errors import StudyError
from cartpend_dae.language import Component, Statements, der, dry_friction, initial, time
from cartpend_dae.switching import assign, both, either, if_else, noevent, pre, reinit, sample, terminate, when

ANY = "any"
FUNCTIONS: dict[str, Callable[..., ca.SX]] = {
    "sin": ca.sin, "cos": ca.cos, "tan": ca.tan, "asin": ca.asin, "acos": ca.acos, "atan": ca.atan,
    "atan2": ca.atan2, "sinh": ca.sinh, "cosh": ca.cosh, "tanh": ca.tanh, "exp": ca.exp, "log": ca.log,
    "log10": ca.log10, "sqrt": ca.sqrt, "abs": ca.fabs, "min": ca.fmin, "max": ca.fmax, "floor": ca.floor,
    "ceil": ca.ceil, "mod": lambda x, y: x - y * ca.floor(x / y),
}  # fmt: skip
INFIX: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "^": lambda a, b: a**b,
    ".+": lambda a, b: a + b,
    ".*": lambda a, b: a * b,
}
COMPARISONS: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: b < a,
    ">=": lambda a, b: b <= a,
}


@dataclass(frozen=True, slots=True)
class _Source:
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
class _Variable:
    """A declaration: its kind, unit, attributes as syntax trees, and what it is set to."""

    name: str
    kind: str
    type: str
    unit: str
    doc: str
    attributes: dict[str, Any] = field(default_factory=dict)
    value: Any = None


def read_modelica(source: Path | str, *, model: str | None = None) -> Component:
    """Make a component of a flat or library-free Modelica model.

    Parameters
    ----------
    source
        A file, or the text itself.
    model
        Which model of the file; by default its last one.

    Raises
    ------
    StudyError
        If the file cannot be read, is no Modelica, or holds what is not supported; with the line.
    """
    text, name = _text(source)
    origin = _Source(name, text)
    cls = _class(origin, model)
    variables = _variables(origin, cls)
    _check_sections(origin, cls)
    return _component(origin, cls, variables)


def _text(source: Path | str) -> tuple[str, str]:
    if isinstance(source, str) and "\n" in source:
        return source, "Modelica text"
    path = Path(source)
    try:
        return path.read_text("utf-8-sig"), str(path)
    except OSError as error:
        raise StudyError(f"{path}: it cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise StudyError(f"{path}: it is not UTF-8 text.") from None


def _class(origin: _Source, model: str | None) -> Any:
    try:
        import pymoca.parser
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


def _plain(name: str) -> str:
    return name[1:-1] if name.startswith("'") else name


def _variables(origin: _Source, cls: Any) -> dict[str, _Variable]:
    if cls.extends:
        raise origin.error("`extends` is not supported: write the inherited equations out.", r"\bextends\b")
    found = {}
    for name, symbol in cls.symbols.items():
        kind = str(symbol.type)
        place = rf"(?<![\w.]){re.escape(name)}(?![\w.])"
        if kind not in ("Real", "Integer", "Boolean"):
            raise origin.error(
                f"`{_plain(name)}` is a `{kind}`, and only Real, Integer and Boolean scalars are read: flatten the model "
                f"first (a Modelica compiler writes it flat).",
                place,
            )
        if any(getattr(d, "value", None) is not None for row in symbol.dimensions for d in row):
            raise origin.error(f"`{_plain(name)}` is an array: only scalars are read.", place)
        prefixes = set(symbol.prefixes)
        role = next((p for p in ("constant", "parameter", "input", "output", "discrete") if p in prefixes), "")
        variable = _Variable(_plain(name), role, kind, ANY, symbol.comment or "")
        _attributes(variable, symbol.class_modification)
        found[name] = variable
    return found


def _attributes(variable: _Variable, modification: Any) -> None:
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


def _check_sections(origin: _Source, cls: Any) -> None:
    for equation in (*cls.equations, *cls.initial_equations):
        kind = type(equation).__name__
        if kind == "ConnectClause":
            raise origin.error("`connect` is not supported: flatten the model first.", r"\bconnect\s*\(")
        if kind == "ForEquation":
            raise origin.error("`for` is not supported: write the equations out.", r"\bfor\b")
    for statement in cls.statements:
        if type(statement).__name__ != "WhenStatement":
            raise origin.error("only `when` is read in an algorithm.", r"\balgorithm\b")


def _component(origin: _Source, cls: Any, variables: dict[str, _Variable]) -> Component:
    """Make the class, with a declaration for each variable, and an instance of it."""
    numbers = _constants(origin, variables)
    stepped = _stepped(cls)
    fields: dict[str, Any] = {"__doc__": f"`{cls.name}`, read from {origin.name}."}
    annotations: dict[str, Any] = {}
    for name, variable in variables.items():
        declared = _declared(variable, numbers, name in stepped)
        if declared is not None:
            fields[variable.name] = declared
            if variable.kind == "parameter":
                annotations[variable.name] = Any

    def equations(self: Component) -> Statements:
        yield from _Equations(origin, cls, variables, numbers, stepped, self).all()

    fields |= {"equations": equations, "__annotations__": annotations}
    made = type(_plain(cls.name), (Component,), fields)
    for name, declaration in fields.items():
        if hasattr(declaration, "__set_name__"):
            declaration.__set_name__(made, name)
    return made()


def _constants(origin: _Source, variables: Mapping[str, _Variable]) -> dict[str, float]:
    """Return the values of constants and parameters as far as they are numbers."""
    found: dict[str, float] = {}
    for _ in variables:
        before = len(found)
        for name, variable in variables.items():
            if variable.kind in ("constant", "parameter") and name not in found and variable.value is not None:
                value = _number(variable.value, found)
                if value is not None:
                    found[name] = value
        if len(found) == before:
            break
    for name, variable in variables.items():
        if variable.kind in ("constant", "parameter") and name not in found:
            if variable.value is None and (start := _number(variable.attributes.get("start"), found)) is not None:
                found[name] = start
                continue
            raise origin.error(f"the value of `{variable.name}` is no number.", re.escape(name))
    return found


def _number(tree: Any, known: Mapping[str, float]) -> float | None:
    """Return the number that an expression of constants is, None where it is none."""
    if tree is None:
        return None
    reader = _Reader(None, {name: ca.SX(value) for name, value in known.items()}, {})
    try:
        value = reader.value(tree)
    except (KeyError, StudyError):
        return None
    return float(value) if value.is_constant() else None


def _stepped(cls: Any) -> set[str]:
    """Return the names of the variables that `when` assigns."""
    found: set[str] = set()
    for block in _when_blocks(cls):
        for statement in block[1]:
            if type(statement).__name__ == "Equation":
                found.add(_reference(statement.left) or "")
            elif type(statement).__name__ == "AssignmentStatement":
                found |= {_reference(target) or "" for target in statement.left}
    return found - {""}


def _when_blocks(cls: Any) -> Iterator[tuple[Any, list[Any]]]:
    for section in (*cls.equations, *cls.statements):
        if type(section).__name__ in ("WhenEquation", "WhenStatement"):
            yield from zip(section.conditions, section.blocks, strict=True)


def _reference(tree: Any) -> str | None:
    """Return the name that a tree is, None if it is no plain name."""
    if type(tree).__name__ != "ComponentRef":
        return None
    return ".".join([tree.name, *[child.name for child in tree.child]])


def _declared(variable: _Variable, numbers: Mapping[str, float], is_stepped: bool) -> Any:
    """Return the declaration of a variable; none for what is only a number or a truth value."""
    start = _number(variable.attributes.get("start"), numbers)
    bounds = {key: _number(variable.attributes.get(key), numbers) for key in ("min", "max", "nominal")}
    unit, doc = variable.unit, variable.doc
    if variable.kind == "constant":
        return None
    if variable.kind == "parameter":
        is_plain = type(variable.value).__name__ == "Primary" or not _uses_names(variable.value)
        low, high = bounds["min"], bounds["max"]
        return param(unit=unit, default=_number(variable.value, numbers) if variable.value is not None else start,
                     min=low, max=high, doc=doc) if is_plain else None  # fmt: skip
    if variable.kind == "input":
        return signal("in", unit=unit, default=start, doc=doc)
    if is_stepped or variable.kind == "discrete" or (variable.type == "Integer" and variable.value is None):
        return discrete(unit="1" if unit == ANY and variable.type != "Real" else unit, start=start or 0.0, doc=doc)
    if variable.type == "Boolean":
        return None
    return var(unit=unit, start=start, doc=doc, **bounds)


def _uses_names(tree: Any) -> bool:
    if _reference(tree) is not None:
        return True
    parts = [*getattr(tree, "operands", ()), *getattr(tree, "expressions", ()), *getattr(tree, "conditions", ())]
    return any(_uses_names(part) for part in parts)


def _operator(tree: Any) -> str:
    operator = getattr(tree, "operator", "")
    return _reference(operator) or str(operator)


class _Reader:
    """Expressions as CasADi symbols; `truths` are definitions of Boolean variables, written out where they are used."""

    def __init__(
        self,
        origin: _Source | None,
        values: Mapping[str, ca.SX],
        truths: Mapping[str, Any],
        moving: frozenset[str] = frozenset(),
    ) -> None:
        self.origin, self.values, self.truths, self.moving = origin, values, truths, moving
        self.known: dict[str, ca.SX] = {}
        self.is_in_when = False

    def refuse(self, what: str, pattern: str) -> StudyError:
        """Return the error for what is not supported."""
        return self.origin.error(what, pattern) if self.origin is not None else StudyError(what)

    def value(self, tree: Any) -> ca.SX:
        """Return an expression as a number."""
        kind = type(tree).__name__
        if kind in ("int", "float", "bool"):
            return ca.SX(float(tree))
        if kind == "Primary":
            if isinstance(tree.value, str):
                raise self.refuse(f'a text, "{tree.value}", stands where a number should be.', re.escape(tree.value))
            return ca.SX(float(tree.value))
        if (name := _reference(tree)) is not None:
            return self._named(name)
        if kind == "IfExpression":
            return self._choice(tree)
        if kind == "Expression":
            return self._operation(tree.operator, list(tree.operands))
        if kind == "Function":
            return self._operation(tree.name, list(tree.arguments))
        raise self.refuse(f"`{kind}` is not supported in an expression.", r"[{\[]")

    def _named(self, name: str) -> ca.SX:
        if name == "time":
            return time()
        if name in self.truths:
            return if_else(self._defined(name), 1, 0)
        if name not in self.values:
            raise self.refuse(f"`{_plain(name)}` is not declared.", re.escape(name))
        return self.values[name]

    def _defined(self, name: str) -> ca.SX:
        """Return the truth value of a Boolean variable, with the same events wherever it stands."""
        if _operator(self.truths[name]) == "sample" and not self.is_in_when:
            raise self.refuse(f"the clock `{_plain(name)}` is read outside of `when`.", re.escape(name))
        if name not in self.known:
            self.known[name] = self.truth(self.truths[name])
        return self.known[name]

    def _choice(self, tree: Any) -> ca.SX:
        found = self.value(tree.expressions[-1])
        pairs = list(zip(tree.conditions, tree.expressions, strict=False))[: len(tree.expressions) - 1]
        for condition, expression in reversed(pairs):
            found = if_else(self.condition(condition), self.value(expression), found)
        return found

    def _operation(self, operator: Any, operands: list[Any]) -> ca.SX:
        name = _reference(operator) or str(operator)
        if name == "*" and (friction := self._friction(operands)) is not None:
            return friction
        if name in INFIX and len(operands) == 2:
            return INFIX[name](self.value(operands[0]), self.value(operands[1]))
        if name in ("+", "-") and len(operands) == 1:
            return self.value(operands[0]) if name == "+" else -self.value(operands[0])
        if name in FUNCTIONS:
            return FUNCTIONS[name](*[self.value(operand) for operand in operands])
        if name == "der":
            return der(self.value(operands[0]))
        if name == "pre":
            return pre(self.value(operands[0]))
        if name == "noEvent":
            return self._without_events(operands[0])
        if name == "smooth":
            return self._without_events(operands[1])
        if name == "sign":
            return self._sign(operands[0])
        if name in COMPARISONS or name in ("and", "or", "not"):
            condition = self.truth_of(name, operands)
            return if_else(condition, 1, 0)
        raise self.refuse(f"the function `{name}` is not supported.", rf"\b{re.escape(name)}\s*\(")

    def _without_events(self, tree: Any) -> ca.SX:
        return _Quiet(self.origin, self.values, self.truths, self.moving).value(tree)

    def _sign(self, tree: Any) -> ca.SX:
        value = self.value(tree)
        return if_else(value > 0, 1, if_else(value < 0, -1, 0))

    def _friction(self, operands: list[Any]) -> ca.SX | None:
        """Return ``level * sign(speed)`` as dry friction, which sticks exactly; None for any other product."""
        for factor, other in (operands, operands[::-1]):
            is_sign = type(factor).__name__ == "Expression" and _operator(factor) == "sign"
            if not is_sign or _reference(factor.operands[0]) not in self.moving:
                continue
            turns = 0
            while type(other).__name__ == "Expression" and _operator(other) == "-" and len(other.operands) == 1:
                other, turns = other.operands[0], turns + 1
            force = dry_friction(self.value(factor.operands[0]), self.value(other))
            return -force if turns % 2 else force
        return None

    def condition(self, tree: Any) -> Any:
        """Return a condition, with events."""
        return self.truth(tree)

    def truth(self, tree: Any) -> ca.SX:
        """Return a truth value."""
        if isinstance(tree, bool):
            return ca.SX(float(tree))
        if type(tree).__name__ == "Primary" and isinstance(tree.value, bool):
            return ca.SX(float(tree.value))
        name = _reference(tree)
        if name is not None and name in self.truths:
            return self._defined(name)
        if type(tree).__name__ == "Expression":
            return self.truth_of(_operator(tree), list(tree.operands))
        return ca.SX(0.5) < self.value(tree)

    def truth_of(self, name: str, operands: list[Any]) -> ca.SX:
        """Return the truth value of an operation."""
        if name in COMPARISONS:
            return COMPARISONS[name](self.value(operands[0]), self.value(operands[1]))
        if name in ("==", "<>"):
            return self._equal(name, operands)
        if name in ("and", "or"):
            return (both if name == "and" else either)(*[self.truth(operand) for operand in operands])
        if name == "not":
            return ca.logic_not(self.truth(operands[0]))
        if name == "sample":
            if not self.is_in_when:
                raise self.refuse("`sample` stands outside of a condition of `when`.", r"\bsample\s*\(")
            return sample(self.value(operands[1]), self.value(operands[0]))
        if name == "pre":
            return self.truth(operands[0])
        if name == "noEvent":
            return _Quiet(self.origin, self.values, self.truths, self.moving).truth(operands[0])
        return ca.SX(0.5) < self._operation(name, operands)

    def _equal(self, name: str, operands: list[Any]) -> ca.SX:
        left, right = self.value(operands[0]), self.value(operands[1])
        differ = either(left < right - 0.5, right + 0.5 < left)
        return differ if name == "<>" else ca.logic_not(differ)


class _Quiet(_Reader):
    """Expressions whose conditions make no events."""

    def condition(self, tree: Any) -> Any:
        """Return a condition without events."""
        return noevent(self.truth(tree))


class _Equations:
    """The statements of a model, made anew each time that it is assembled."""

    def __init__(
        self,
        origin: _Source,
        cls: Any,
        variables: Mapping[str, _Variable],
        numbers: Mapping[str, float],
        stepped: set[str],
        component: Component,
    ) -> None:
        self.cls, self.variables, self.stepped = cls, variables, stepped
        declared = type(component).__dict__
        values, truths = {}, {}
        for name, variable in variables.items():
            if variable.name in declared:
                values[name] = getattr(component, variable.name)
            elif variable.kind == "constant":
                values[name] = ca.SX(numbers[name])
            elif variable.type == "Boolean":
                truths[name] = self._definition(origin, name)
        self.values = values
        self.reader = _Reader(origin, values, truths, frozenset(_differentiated(cls)))
        for name, variable in variables.items():
            if variable.kind == "parameter" and name not in values:
                values[name] = self.reader.value(variable.value)

    def _definition(self, origin: _Source, name: str) -> Any:
        """Return what a Boolean variable is equal to."""
        if self.variables[name].value is not None:
            return self.variables[name].value
        for equation in self.cls.equations:
            if type(equation).__name__ == "Equation" and _reference(equation.left) == name:
                return equation.right
        raise origin.error(
            f"the Boolean `{_plain(name)}` is not defined by an equation `{name} = ...`.", re.escape(name)
        )

    def all(self) -> Statements:
        """Yield all statements."""
        read = self.reader
        for name, variable in self.variables.items():
            is_bound = variable.value is not None and variable.kind not in ("constant", "parameter", "input")
            if is_bound and name in self.values:
                yield self.values[name] == read.value(variable.value)
            fixed = variable.attributes.get("fixed")
            if getattr(fixed, "value", fixed) is True and name in self.values and name not in self.stepped:
                if variable.kind != "discrete" and variable.kind != "parameter":
                    yield initial(self.values[name] == read.value(variable.attributes.get("start", 0.0)))
        for equation in self.cls.equations:
            yield from self._equation(equation)
        for statement in self.cls.statements:
            yield from self._when(statement)
        for equation in self.cls.initial_equations:
            yield initial(read.value(equation.left) == read.value(equation.right))

    def _equation(self, equation: Any) -> Statements:
        kind, read = type(equation).__name__, self.reader
        if kind == "Equation":
            name = _reference(equation.left)
            if name is not None and self.variables[name].type == "Boolean" if name in self.variables else False:
                return  # written out where it is used
            yield read.value(equation.left) == read.value(equation.right)
        elif kind == "IfEquation":
            yield from self._if(equation)
        elif kind == "WhenEquation":
            yield from self._when(equation)
        elif kind == "Function" and equation.name == "assert":
            return
        elif kind == "Function" and equation.name == "terminate":
            raise read.refuse("`terminate` stands outside of `when`.", r"\bterminate\b")
        else:
            raise read.refuse(f"`{kind}` is not supported among equations.", r"\bequation\b")

    def _if(self, equation: Any) -> Statements:
        """Yield an equation for each line of the branches, chosen by the conditions."""
        blocks, read = equation.blocks, self.reader
        if len({len(block) for block in blocks}) != 1:
            raise read.refuse("the branches of an `if` equation have different numbers of equations.", r"\bif\b")
        for lines in zip(*blocks, strict=True):
            residuals = [read.value(line.left) - read.value(line.right) for line in lines]
            found = residuals[-1]
            for condition, residual in reversed(list(zip(equation.conditions, residuals[:-1], strict=False))):
                found = if_else(read.condition(condition), residual, found)
            yield found == 0

    def _when(self, section: Any) -> Statements:
        self.reader.is_in_when = True
        yield from self._whens(section)
        self.reader.is_in_when = False

    def _whens(self, section: Any) -> Statements:
        for tree, block in zip(section.conditions, section.blocks, strict=True):
            parts = [part for row in tree.values for part in (row if isinstance(row, list) else [row])] if (
                type(tree).__name__ == "Array") else [tree]  # fmt: skip
            for part in parts:
                truth = self.reader.truth(part)
                actions = []
                for statement in block:
                    action = self._action(statement, truth)
                    if isinstance(action, str):
                        yield terminate(truth, action)
                    else:
                        actions.append(action)
                if actions:
                    yield when(truth, *actions)

    def _action(self, statement: Any, truth: ca.SX) -> Any:
        kind, read = type(statement).__name__, self.reader
        if kind == "Equation":
            return assign(read.value(statement.left), read.value(statement.right))
        if kind == "AssignmentStatement":
            return assign(read.value(statement.left[0]), read.value(statement.right))
        if kind == "Function" and statement.name == "reinit":
            return reinit(read.value(statement.arguments[0]), read.value(statement.arguments[1]))
        if kind == "Function" and statement.name == "terminate":
            return str(getattr(statement.arguments[0], "value", "")).strip('"')
        raise read.refuse(f"`{getattr(statement, 'name', kind)}` is not supported in `when`.", r"\bwhen\b")


def _differentiated(cls: Any) -> set[str]:
    """Return the names x in ``der(x)``."""
    found: set[str] = set()

    def walk(tree: Any) -> None:
        if type(tree).__name__ == "Expression" and _operator(tree) == "der":
            found.add(_reference(tree.operands[0]) or "")
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
