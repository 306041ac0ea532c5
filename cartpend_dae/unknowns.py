"""What an estimation looks for: numbers with bounds, sizes and prior knowledge, and parameters tied to others."""

import ast
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from cartpend_dae.errors import ModelError
from cartpend_dae.system import System

_OPERATIONS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of a quantity before the data, a normal distribution: value and standard deviation, SI."""

    value: float
    sd: float


@dataclass(frozen=True, slots=True)
class Free:
    """A quantity to be estimated: bounds and guess in SI, and the size by which it is scaled.

    The solver works with value/scale, or with log(value/scale) where `is_log`; there the value stays positive.
    One that `is_per_run` has a value of its own in each run.
    """

    name: str
    guess: float
    lower: float
    upper: float
    scale: float
    unit: str
    is_log: bool = False
    prior: Prior | None = None
    is_per_run: bool = False

    def scaled(self, value: float) -> float:
        """Return what the solver works with, of a value in SI."""
        if not self.is_log:
            return value / self.scale
        return math.log(value / self.scale) if value > 0 else -math.inf

    def value(self, scaled: Any) -> Any:  # noqa: ANN401 - a number or a CasADi expression
        """Return the value in SI of what the solver works with, a number or an expression."""
        return (ca.exp(scaled) if self.is_log else scaled) * self.scale

    def slope(self, scaled: float) -> float:
        """Return d(value)/d(scaled)."""
        return float(self.value(scaled)) if self.is_log else self.scale


@dataclass(frozen=True, slots=True)
class Tie:
    """An independent parameter that follows from others: its index, and its value in the system's parameters."""

    name: str
    index: int
    text: str
    symbol: ca.SX
    value: ca.SX


def tie(system: System, name: str, text: str) -> Tie:
    """Read how a parameter follows from others, such as ``2 * spring.c``; numbers are in SI units.

    Parameters
    ----------
    system
        The assembled system.
    name
        The parameter that follows.
    text
        Numbers and dotted names of parameters, joined by ``+ - * / **`` and parentheses.

    Raises
    ------
    ModelError
        If the text is not such an expression, names no parameter, or names `name` itself.
    """
    index = system.parameter_index(name)
    try:
        value = ca.SX(_value(ast.parse(text, mode="eval").body, system))
    except SyntaxError:
        raise ModelError(_refusal(name, text, "it cannot be read")) from None
    except _UnfitError as error:
        raise ModelError(_refusal(name, text, str(error))) from None
    if ca.depends_on(value, system.p[index]):
        raise ModelError(_refusal(name, text, "it names the parameter itself"))
    if not ca.symvar(value):
        raise ModelError(_refusal(name, text, "it names no parameter; a number is a `guess` with `fixed = true`"))
    return Tie(name, index, text, system.p[index], value)


class _UnfitError(Exception):
    pass


def _refusal(name: str, text: str, why: str) -> str:
    return f"The tie `{text}` of `{name}` is no expression of parameters: {why}. Write it like `2 * spring.c`."


def _value(node: ast.expr, system: System) -> Any:  # noqa: ANN401 - a number or SX
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return number
        case ast.Name() | ast.Attribute():
            return system.p[system.parameter_index(_dotted(node))]
        case ast.UnaryOp(op=ast.USub()):
            return -_value(node.operand, system)
        case ast.UnaryOp(op=ast.UAdd()):
            return _value(node.operand, system)
        case ast.BinOp() if type(node.op) in _OPERATIONS:
            return _OPERATIONS[type(node.op)](_value(node.left, system), _value(node.right, system))
        case _:
            raise _UnfitError(f"`{ast.unparse(node)}` is neither a number nor the name of a parameter")


def _dotted(node: ast.expr) -> str:
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value)}.{node.attr}"
    raise _UnfitError(f"`{ast.unparse(node)}` is no dotted name")
