"""Modelica expressions -> CasADi symbols with the events of this package."""

import re
from collections.abc import Callable, Mapping

import casadi as ca

from cartpend_dae.errors import StudyError
from cartpend_dae.language import der, dry_friction, time
from cartpend_dae.modelica.syntax import Node, Source, operator_of, plain, reference
from cartpend_dae.switching import both, either, if_else, noevent, pre, sample

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


class Translator:
    """Expressions as CasADi symbols; `truths` are definitions of Boolean variables, written out where they are used."""

    def __init__(
        self,
        origin: Source | None,
        values: Mapping[str, ca.SX],
        truths: Mapping[str, Node],
        moving: frozenset[str] = frozenset(),
    ) -> None:
        self.origin, self.values, self.truths, self.moving = origin, values, truths, moving
        self.known: dict[str, ca.SX] = {}
        self.is_in_when = False

    def refuse(self, what: str, pattern: str) -> StudyError:
        """Return the error for what is not supported."""
        return self.origin.error(what, pattern) if self.origin is not None else StudyError(what)

    def value(self, tree: Node) -> ca.SX:
        """Return an expression as a number."""
        kind = type(tree).__name__
        if kind in ("int", "float", "bool"):
            return ca.SX(float(tree))
        if kind == "Primary":
            if isinstance(tree.value, str):
                raise self.refuse(f'a text, "{tree.value}", stands where a number should be.', re.escape(tree.value))
            return ca.SX(float(tree.value))
        if (name := reference(tree)) is not None:
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
            raise self.refuse(f"`{plain(name)}` is not declared.", re.escape(name))
        return self.values[name]

    def _defined(self, name: str) -> ca.SX:
        """Return the truth value of a Boolean variable, with the same events wherever it stands."""
        if operator_of(self.truths[name]) == "sample" and not self.is_in_when:
            raise self.refuse(f"the clock `{plain(name)}` is read outside of `when`.", re.escape(name))
        if name not in self.known:
            self.known[name] = self.truth(self.truths[name])
        return self.known[name]

    def _choice(self, tree: Node) -> ca.SX:
        found = self.value(tree.expressions[-1])
        pairs = list(zip(tree.conditions, tree.expressions, strict=False))[: len(tree.expressions) - 1]
        for condition, expression in reversed(pairs):
            found = if_else(self.condition(condition), self.value(expression), found)
        return found

    def _operation(self, operator: Node, operands: list[Node]) -> ca.SX:
        name = reference(operator) or str(operator)
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

    def _without_events(self, tree: Node) -> ca.SX:
        return QuietTranslator(self.origin, self.values, self.truths, self.moving).value(tree)

    def _sign(self, tree: Node) -> ca.SX:
        value = self.value(tree)
        return if_else(value > 0, 1, if_else(value < 0, -1, 0))

    def _friction(self, operands: list[Node]) -> ca.SX | None:
        """Return ``level * sign(speed)`` as dry friction, which sticks exactly; None for any other product."""
        for factor, other in (operands, operands[::-1]):
            is_sign = type(factor).__name__ == "Expression" and operator_of(factor) == "sign"
            if not is_sign or reference(factor.operands[0]) not in self.moving:
                continue
            turns = 0
            while type(other).__name__ == "Expression" and operator_of(other) == "-" and len(other.operands) == 1:
                other, turns = other.operands[0], turns + 1
            force = dry_friction(self.value(factor.operands[0]), self.value(other))
            return -force if turns % 2 else force
        return None

    def condition(self, tree: Node) -> Node:
        """Return a condition, with events."""
        return self.truth(tree)

    def truth(self, tree: Node) -> ca.SX:
        """Return a truth value."""
        if isinstance(tree, bool):
            return ca.SX(float(tree))
        if type(tree).__name__ == "Primary" and isinstance(tree.value, bool):
            return ca.SX(float(tree.value))
        name = reference(tree)
        if name is not None and name in self.truths:
            return self._defined(name)
        if type(tree).__name__ == "Expression":
            return self.truth_of(operator_of(tree), list(tree.operands))
        return ca.SX(0.5) < self.value(tree)

    def truth_of(self, name: str, operands: list[Node]) -> ca.SX:
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
            return QuietTranslator(self.origin, self.values, self.truths, self.moving).truth(operands[0])
        return ca.SX(0.5) < self._operation(name, operands)

    def _equal(self, name: str, operands: list[Node]) -> ca.SX:
        left, right = self.value(operands[0]), self.value(operands[1])
        differ = either(left < right - 0.5, right + 0.5 < left)
        return differ if name == "<>" else ca.logic_not(differ)


class QuietTranslator(Translator):
    """Expressions whose conditions make no events."""

    def condition(self, tree: Node) -> Node:
        """Return a condition without events."""
        return noevent(self.truth(tree))


def number_of(tree: Node, known: Mapping[str, float]) -> float | None:
    """Return the number that an expression of constants is, None where it is none."""
    if tree is None:
        return None
    reader = Translator(None, {name: ca.SX(value) for name, value in known.items()}, {})
    try:
        value = reader.value(tree)
    except (KeyError, StudyError):
        return None
    return float(value) if value.is_constant() else None
