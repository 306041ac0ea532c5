"""Flat or library-free Modelica text -> Component; pymoca parses.

Read are models of Real, Integer and Boolean scalars with equations, `if`, `when`, `reinit`, `sample`, `pre`, `noEvent`,
initial equations and attributes. What is not supported is refused with its line.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import casadi as ca

from cartpend_dae.declarations import discrete, param, signal, var
from cartpend_dae.language import Component, Param, Statements, initial
from cartpend_dae.modelica.syntax import (
    ANY,
    Declared,
    Node,
    Source,
    check_sections,
    declarations_of,
    differentiated_names,
    parsed_class,
    plain,
    reference,
    stepped_names,
    text_of,
    uses_names,
)
from cartpend_dae.modelica.translate import Translator, number_of
from cartpend_dae.switching import assign, if_else, reinit, terminate, when


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
    text, name = text_of(source)
    origin = Source(name, text)
    cls = parsed_class(origin, model)
    variables = declarations_of(origin, cls)
    check_sections(origin, cls)
    return _component(origin, cls, variables)


def _component(origin: Source, cls: Node, variables: dict[str, Declared]) -> Component:
    """Make the class, with a declaration for each variable, and an instance of it."""
    numbers = _constants(origin, variables)
    stepped = stepped_names(cls)
    fields: dict[str, Node] = {"__doc__": f"`{cls.name}`, read from {origin.name}."}
    annotations: dict[str, Node] = {}
    for name, variable in variables.items():
        declared = _declared(variable, numbers, name in stepped)
        if declared is not None:
            fields[variable.name] = declared
            if variable.kind == "parameter":
                annotations[variable.name] = Param

    def equations(self: Component) -> Statements:
        yield from _Equations(origin, cls, variables, numbers, stepped, self).all()

    fields |= {"equations": equations, "__annotations__": annotations}
    made = type(plain(cls.name), (Component,), fields)
    for name, declaration in fields.items():
        if hasattr(declaration, "__set_name__"):
            declaration.__set_name__(made, name)
    return made()


def _constants(origin: Source, variables: Mapping[str, Declared]) -> dict[str, float]:
    """Return the values of constants and parameters as far as they are numbers."""
    found: dict[str, float] = {}
    for _ in variables:
        before = len(found)
        for name, variable in variables.items():
            if variable.kind in ("constant", "parameter") and name not in found and variable.value is not None:
                value = number_of(variable.value, found)
                if value is not None:
                    found[name] = value
        if len(found) == before:
            break
    for name, variable in variables.items():
        if variable.kind in ("constant", "parameter") and name not in found:
            if variable.value is None and (start := number_of(variable.attributes.get("start"), found)) is not None:
                found[name] = start
                continue
            raise origin.error(f"the value of `{variable.name}` is no number.", re.escape(name))
    return found


def _declared(variable: Declared, numbers: Mapping[str, float], is_stepped: bool) -> Node:
    """Return the declaration of a variable; none for what is only a number or a truth value."""
    start = number_of(variable.attributes.get("start"), numbers)
    bounds = {key: number_of(variable.attributes.get(key), numbers) for key in ("min", "max", "nominal")}
    unit, doc = variable.unit, variable.doc
    if variable.kind == "constant":
        return None
    if variable.kind == "parameter":
        is_plain = type(variable.value).__name__ == "Primary" or not uses_names(variable.value)
        low, high = bounds["min"], bounds["max"]
        return param(unit=unit, default=number_of(variable.value, numbers) if variable.value is not None else start,
                     min=low, max=high, doc=doc) if is_plain else None  # fmt: skip
    if variable.kind == "input":
        return signal("in", unit=unit, default=start, doc=doc)
    if is_stepped or variable.kind == "discrete" or (variable.type == "Integer" and variable.value is None):
        return discrete(unit="1" if unit == ANY and variable.type != "Real" else unit, start=start or 0.0, doc=doc)
    if variable.type == "Boolean":
        return None
    return var(unit=unit, start=start, doc=doc, min=bounds["min"], max=bounds["max"], nominal=bounds["nominal"])


class _Equations:
    """The statements of a model, made anew each time that it is assembled."""

    def __init__(
        self,
        origin: Source,
        cls: Node,
        variables: Mapping[str, Declared],
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
        self.reader = Translator(origin, values, truths, frozenset(differentiated_names(cls)))
        for name, variable in variables.items():
            if variable.kind == "parameter" and name not in values:
                values[name] = self.reader.value(variable.value)

    def _definition(self, origin: Source, name: str) -> Node:
        """Return what a Boolean variable is equal to."""
        if self.variables[name].value is not None:
            return self.variables[name].value
        for equation in self.cls.equations:
            if type(equation).__name__ == "Equation" and reference(equation.left) == name:
                return equation.right
        raise origin.error(
            f"the Boolean `{plain(name)}` is not defined by an equation `{name} = ...`.", re.escape(name)
        )

    def all(self) -> Statements:
        """Yield all statements."""
        read = self.reader
        for name, variable in self.variables.items():
            is_bound = variable.value is not None and variable.kind not in ("constant", "parameter", "input")
            if is_bound and name in self.values:
                yield self.values[name] == read.value(variable.value)
            fixed = variable.attributes.get("fixed")
            is_fixed = getattr(fixed, "value", fixed) is True and name in self.values and name not in self.stepped
            if is_fixed and variable.kind not in ("discrete", "parameter"):
                yield initial(self.values[name] == read.value(variable.attributes.get("start", 0.0)))
        for equation in self.cls.equations:
            yield from self._equation(equation)
        for statement in self.cls.statements:
            yield from self._when(statement)
        for equation in self.cls.initial_equations:
            yield initial(read.value(equation.left) == read.value(equation.right))

    def _equation(self, equation: Node) -> Statements:
        kind, read = type(equation).__name__, self.reader
        if kind == "Equation":
            name = reference(equation.left)
            if name is not None and name in self.variables and self.variables[name].type == "Boolean":
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

    def _if(self, equation: Node) -> Statements:
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

    def _when(self, section: Node) -> Statements:
        self.reader.is_in_when = True
        yield from self._whens(section)
        self.reader.is_in_when = False

    def _whens(self, section: Node) -> Statements:
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

    def _action(self, statement: Node, truth: ca.SX) -> Node:
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
