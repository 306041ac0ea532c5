"""What each operation of CasADi does to the dimensions of its operands: the algebra of `dimensions`.

A dimension is a small integer, as a large model has few different ones: a known dimension, counted from 0 up (a
number), `LITERAL` for a literal number, which fits anything in a sum, `WRONG` for what comes of a clash, which fits
anything too so that one slip is told once, or below it one that is not known yet.
"""

from fractions import Fraction

import casadi as ca

from cartpend_dae.units import Unit, power

Exponents = tuple[Fraction | int, ...]
Dimension = int

NUMBER, LITERAL, WRONG = 0, -1, -2

_SAME = {ca.OP_ADD, ca.OP_SUB, ca.OP_FMIN, ca.OP_FMAX, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_HYPOT}
_COMPARED = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_ATAN2}
_KEPT = {ca.OP_ASSIGN, ca.OP_NEG, ca.OP_FABS, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_COPYSIGN, ca.OP_LIFT}
_COUNTED = {ca.OP_SIGN, ca.OP_NOT, ca.OP_AND, ca.OP_OR}
_PURE = {
    ca.OP_EXP, ca.OP_EXPM1, ca.OP_LOG, ca.OP_LOG1P, ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS,
    ca.OP_ATAN, ca.OP_SINH, ca.OP_COSH, ca.OP_TANH, ca.OP_ASINH, ca.OP_ACOSH, ca.OP_ATANH, ca.OP_ERF, ca.OP_ERFINV,
}  # fmt: skip
_FIXED_POWERS = {ca.OP_SQ: Fraction(2), ca.OP_SQRT: Fraction(1, 2), ca.OP_INV: Fraction(-1)}
POWERS = {ca.OP_POW, ca.OP_CONSTPOW}


class Dimensions:
    """The dimensions met so far, what unknown ones turned out to be, and where two clashed."""

    def __init__(self) -> None:
        self._exponents: list[Exponents] = [(0,) * 7]
        self._dimension_of: dict[Exponents, Dimension] = {self._exponents[NUMBER]: NUMBER}
        self._last_unknown: Dimension = WRONG
        self._solved: dict[Dimension, tuple[Dimension, int]] = {}
        self.clashes: list[tuple[int, Dimension, Dimension | None]] = []
        """An instruction, the dimension of its first operand, and of the second (None: a number was needed)."""

    def of_unit(self, unit: Unit) -> Dimension:
        """Return the dimension of a unit, without radians."""
        return self._known(unit.dimension[:-1])

    def unit_of(self, a: Dimension) -> Unit:
        """Return the SI unit of a known dimension."""
        return Unit((*self._exponents[a], 0))

    def unknown(self) -> Dimension:
        """Return a new dimension that is not known yet."""
        self._last_unknown -= 1
        return self._last_unknown

    def find(self, a: Dimension) -> Dimension:
        """Return what a dimension is by now."""
        while a in self._solved:
            a = self._solved[a][0]
        return a

    def found_at(self, a: Dimension) -> int | None:
        """Return the instruction that made an unknown dimension known; None if it was known or still is not."""
        at = None
        while a in self._solved:
            a, at = self._solved[a]
        return at if a >= NUMBER else None

    def combine(self, k: int, operation: int, a: Dimension, b: Dimension, *, exponent: float | None) -> Dimension:
        """Return the dimension of the result of instruction k.

        Parameters
        ----------
        k
            The instruction, noted where its operands clash or where it shows what an unknown one is.
        operation
            One of CasADi's `OP_...`.
        a, b
            The dimensions of its operands as `find` gives them; of a single operand twice.
        exponent
            The value of the second operand if it is a literal.
        """
        if operation in _SAME:
            return self._equal(k, a, b)
        if operation in _COMPARED:
            self._equal(k, a, b)
            return NUMBER
        if operation in _KEPT:
            return a
        if operation == ca.OP_IF_ELSE_ZERO:
            return b
        if operation in _COUNTED:
            return NUMBER
        if operation in _PURE:
            return self._number(k, a)
        if operation == ca.OP_MUL:
            return self._product(a, b)
        if operation == ca.OP_TWICE:
            return self._product(LITERAL, a)
        if operation == ca.OP_DIV:
            return self._product(a, self._power(b, Fraction(-1)))
        if operation in _FIXED_POWERS:
            return self._power(a, _FIXED_POWERS[operation])
        if operation in POWERS and exponent is not None:
            return self._power(a, exponent)
        if operation in POWERS:
            self._number(k, b)
            return self._number(k, a)
        return self.unknown()

    def per_second(self, a: Dimension, order: int) -> Dimension:
        """Return the dimension of a derivative; a negative order goes back."""
        kg, m, s, *others = self._exponents[a]
        return self._known((kg, m, s - order, *others))

    def _known(self, exponents: Exponents) -> Dimension:
        if exponents not in self._dimension_of:
            self._dimension_of[exponents] = len(self._exponents)
            self._exponents.append(exponents)
        return self._dimension_of[exponents]

    def _equal(self, k: int, a: Dimension, b: Dimension) -> Dimension:
        if a in (b, WRONG) or b == LITERAL:
            return a
        if b == WRONG or a == LITERAL:
            return b
        if a < LITERAL:
            self._solved[a] = b, k
            return b
        if b < LITERAL:
            self._solved[b] = a, k
            return a
        self.clashes.append((k, a, b))
        return WRONG

    def _number(self, k: int, a: Dimension) -> Dimension:
        if a < WRONG:
            self._solved[a] = NUMBER, k
        elif a > NUMBER:
            self.clashes.append((k, a, None))
        return NUMBER

    def _product(self, a: Dimension, b: Dimension) -> Dimension:
        if a < LITERAL or b < LITERAL:
            return WRONG if WRONG in (a, b) else self.unknown()
        if a == LITERAL and b == LITERAL:
            return LITERAL
        pairs = zip(self._exponents[max(a, NUMBER)], self._exponents[max(b, NUMBER)], strict=True)
        return self._known(tuple(x + y for x, y in pairs))

    def _power(self, a: Dimension, exponent: float | Fraction) -> Dimension:
        if a < WRONG:
            return self.unknown()
        return a if a < NUMBER else self.of_unit(power(self.unit_of(a), exponent))
