"""CasADi expressions as Modelica text; what several of them share becomes a variable of its own."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from cartpend_dae.errors import ModelError

KEYWORDS = {
    "algorithm", "and", "annotation", "assert", "block", "break", "class", "connect", "connector", "constant",
    "constrainedby", "der", "discrete", "each", "else", "elseif", "elsewhen", "encapsulated", "end", "enumeration",
    "equation", "expandable", "extends", "external", "false", "final", "flow", "for", "function", "if", "import",
    "impure", "in", "initial", "inner", "input", "loop", "model", "not", "operator", "or", "outer", "output",
    "package", "parameter", "partial", "protected", "public", "pure", "record", "redeclare", "replaceable", "return",
    "stream", "then", "true", "type", "when", "while", "within", "time",
}  # fmt: skip
INFIX = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/", ca.OP_POW: "^", ca.OP_CONSTPOW: "^"}
CALLS = {
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_EXP: "exp({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_SIN: "sin({0})",
    ca.OP_COS: "cos({0})",
    ca.OP_TAN: "tan({0})",
    ca.OP_ASIN: "asin({0})",
    ca.OP_ACOS: "acos({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_SINH: "sinh({0})",
    ca.OP_COSH: "cosh({0})",
    ca.OP_TANH: "tanh({0})",
    ca.OP_ASINH: "noEvent(if {0} < 0 then -log(sqrt({0} ^ 2 + 1.0) - {0}) else log({0} + sqrt({0} ^ 2 + 1.0)))",
    ca.OP_ACOSH: "log({0} + sqrt({0} ^ 2 - 1.0))",
    ca.OP_ATANH: "(0.5 * log((1.0 + {0}) / (1.0 - {0})))",
    ca.OP_ATAN2: "atan2({0}, {1})",
    ca.OP_FABS: "noEvent(abs({0}))",
    ca.OP_FMIN: "noEvent(min({0}, {1}))",
    ca.OP_FMAX: "noEvent(max({0}, {1}))",
    ca.OP_FLOOR: "noEvent(floor({0}))",
    ca.OP_CEIL: "noEvent(ceil({0}))",
    ca.OP_SIGN: "noEvent(if {0} > 0 then 1.0 else if {0} < 0 then -1.0 else 0.0)",
    ca.OP_NEG: "(-{0})",
    ca.OP_INV: "(1.0 / {0})",
    ca.OP_SQ: "({0} ^ 2)",
    ca.OP_TWICE: "(2.0 * {0})",
    ca.OP_LOG1P: "log(1.0 + {0})",
    ca.OP_EXPM1: "(exp({0}) - 1.0)",
    ca.OP_HYPOT: "sqrt({0} ^ 2 + {1} ^ 2)",
    ca.OP_COPYSIGN: "noEvent(if {1} < 0 then -abs({0}) else abs({0}))",
}
COMPARISONS = {ca.OP_LT: "{0} < {1}", ca.OP_LE: "{0} <= {1}"}
JOINS = {ca.OP_AND: "and", ca.OP_OR: "or"}
LONGEST = 60


@dataclass(frozen=True, slots=True)
class Text:
    """Modelica text of a value, and whether it is a truth value."""

    code: str
    is_truth: bool = False

    @property
    def number(self) -> str:
        """The value as a number."""
        return f"(if {self.code} then 1.0 else 0.0)" if self.is_truth else self.code

    @property
    def truth(self) -> str:
        """The value as a truth value."""
        return self.code if self.is_truth else f"({self.code} > 0.5)"


def identifier(name: str) -> str:
    """Return a dotted name as a Modelica identifier, in quotes where it has to be."""
    if re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII) and name not in KEYWORDS:
        return name
    if not name.isascii() or any(c in name for c in "'\"\\\n"):
        name = name.encode("unicode_escape").decode().replace("\\", "_").replace("'", "_").replace('"', "_")
    return f"'{name}'"


def literal(value: float) -> str:
    """Return a number as Modelica writes it, to the last digit."""
    if math.isinf(value):
        return "1e300" if value > 0 else "-1e300"
    if math.isnan(value):
        raise ModelError("An expression of the model holds `nan`, which Modelica cannot write.")
    text = repr(float(value))
    return f"({text})" if text.startswith("-") else text


def texts(
    expressions: Sequence[ca.SX], symbols: Mapping[str, tuple[ca.SX, Sequence[Text]]], prefix: str
) -> tuple[list[tuple[str, str]], list[Text]]:
    """Return expressions as text.

    Parameters
    ----------
    expressions
        Columns of expressions.
    symbols
        Columns of symbols, and what each of them is called.
    prefix
        What the names of shared subexpressions begin with.

    Returns
    -------
    tuple
        Shared subexpressions in order, each a name and its text; and the text of each expression.

    Raises
    ------
    ModelError
        For an operation that Modelica has not.
    """
    arguments = [column for column, _ in symbols.values()]
    names = [list(column) for _, column in symbols.values()]
    stacked = ca.cse(ca.SX(ca.densify(ca.vertcat(*expressions))))
    function = ca.Function("all", arguments, [stacked], {"allow_free": False})
    uses: Counter[int] = Counter()
    producers: dict[int, int] = {}
    steps = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = list(function.instruction_input(k)), list(function.instruction_output(k))
        if operation not in (ca.OP_INPUT, ca.OP_CONST):
            for slot in inputs:
                uses[producers[slot]] += 1
        if operation != ca.OP_OUTPUT:
            producers[outputs[0]] = k
        steps.append((k, operation, inputs, outputs))
    return _written(function, steps, uses, names, prefix, stacked.numel())


def _written(
    function: ca.Function,
    steps: list[tuple[int, int, list[int], list[int]]],
    uses: Counter[int],
    names: list[list[Text]],
    prefix: str,
    n: int,
) -> tuple[list[tuple[str, str]], list[Text]]:
    shared: list[tuple[str, str]] = []
    values: dict[int, Text] = {}
    results = [Text("0.0")] * n
    for k, operation, inputs, outputs in steps:
        if operation == ca.OP_OUTPUT:
            results[outputs[1]] = values[inputs[0]]
            continue
        if operation == ca.OP_INPUT:
            found = names[inputs[0]][inputs[1]]
        elif operation == ca.OP_CONST:
            found = Text(literal(function.instruction_constant(k)))
        else:
            found = _operation(operation, [values[slot] for slot in inputs])
            if (uses[k] > 1 and len(found.code) > 12) or len(found.code) > 40 * LONGEST:
                name = f"{prefix}{len(shared) + 1}"
                shared.append((name, found.number))
                # a truth value without events is no discrete variable, so that a number stands for it
                found = Text(f"noEvent({name} > 0.5)", True) if found.is_truth else Text(name)
        values[outputs[0]] = found
    return shared, results


def _operation(operation: int, inputs: list[Text]) -> Text:
    numbers = [value.number for value in inputs]
    if operation in INFIX:
        return Text(f"({numbers[0]} {INFIX[operation]} {numbers[1]})")
    if operation in CALLS:
        return Text(CALLS[operation].format(*numbers))
    if operation in COMPARISONS:
        return Text(f"noEvent({COMPARISONS[operation].format(*numbers)})", True)
    if operation in (ca.OP_EQ, ca.OP_NE):  # Modelica compares no real numbers
        differ = f"noEvent({numbers[0]} < {numbers[1]} or {numbers[0]} > {numbers[1]})"
        return Text(f"(not {differ})" if operation == ca.OP_EQ else differ, True)
    if operation in JOINS:
        return Text(f"({inputs[0].truth} {JOINS[operation]} {inputs[1].truth})", True)
    if operation == ca.OP_NOT:
        return Text(f"(not {inputs[0].truth})", True)
    if operation == ca.OP_IF_ELSE_ZERO:
        return Text(f"(if {inputs[0].truth} then {numbers[1]} else 0.0)")
    if operation == ca.OP_FMOD:
        return Text(f"noEvent({numbers[0]} - {numbers[1]} * integer({numbers[0]} / {numbers[1]}))")
    if operation in (ca.OP_ASSIGN, ca.OP_LIFT):
        return inputs[0]
    raise ModelError(f"The model holds the operation number {operation} of CasADi, which has no text in Modelica.")
