"""A function of expressions at many times at once: one operation of numpy for each of its instructions.

CasADi evaluates a function at one time after the other, and takes longer for each instruction than numpy for each
element of an array. The result is the same up to rounding.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import casadi as ca
import numpy as np
from scipy.special import erf

# Times handled together, so that the intermediate results stay in the cache of the processor.
TOGETHER = 8192


def _number(comparison: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *values: np.asarray(comparison(*values), dtype=float)


OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_INV: lambda a: np.divide(1.0, a),
    ca.OP_SQ: np.square,
    ca.OP_TWICE: lambda a: np.add(a, a),
    ca.OP_SQRT: np.sqrt,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_EXPM1: np.expm1,
    ca.OP_LOG1P: np.log1p,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh,
    ca.OP_ACOSH: np.arccosh,
    ca.OP_ATANH: np.arctanh,
    ca.OP_HYPOT: np.hypot,
    ca.OP_ERF: erf,
    ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil,
    ca.OP_FMOD: np.fmod,
    ca.OP_FABS: np.fabs,
    ca.OP_SIGN: np.sign,
    ca.OP_COPYSIGN: np.copysign,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_LT: _number(np.less),
    ca.OP_LE: _number(np.less_equal),
    ca.OP_EQ: _number(np.equal),
    ca.OP_NE: _number(np.not_equal),
    ca.OP_NOT: _number(np.logical_not),
    ca.OP_AND: _number(np.logical_and),
    ca.OP_OR: _number(np.logical_or),
    ca.OP_IF_ELSE_ZERO: lambda condition, a: np.where(np.not_equal(condition, 0.0), a, 0.0),
}


Step = tuple[int, tuple[int, ...], tuple[int, ...], float, int]
"""An instruction: its kind, with what, to what; its number, if it is one; the row of the result it fills, or -1."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """Instructions of which each output is another value, and which of them each element of the column is.

    Of `n_values` rows the steps fill the first `n_written`; one more is zero.
    """

    steps: tuple[Step, ...]
    n_values: int
    n_written: int
    columns: np.ndarray


@dataclass(frozen=True)
class AllTimes:
    """A function, whose one output is a column, to be evaluated at many times."""

    function: ca.Function

    @cached_property
    def plan(self) -> _Plan | None:
        """Its instructions, None where numpy lacks one of them."""
        return _plan(self.function) if _is_known(self.function) else None

    def __call__(self, arguments: Sequence[np.ndarray], n_times: int) -> np.ndarray:
        """Return all elements of the output at all times, shape (n_times, n_elements).

        Parameters
        ----------
        arguments
            For each input its elements: a column for each time, shape (n, n_times), or the same at all, shape (n,).
        n_times
            Number of times.
        """
        values, columns = self.distinct(arguments, n_times)
        return values if np.array_equal(columns, np.arange(values.shape[1])) else values[:, columns]

    def columns(self) -> np.ndarray:
        """Return which of its distinct values each element of the output is, if that can be told (n_elements,)."""
        return np.arange(self.function.numel_out(0)) if self.plan is None else self.plan.columns

    def distinct(self, arguments: Sequence[np.ndarray], n_times: int) -> tuple[np.ndarray, np.ndarray]:
        """Return what the elements are made of (n_times, n), and which column of it each element is (n_elements,).

        At many times all at once by numpy. Else one after the other in memory that numpy owns: a mapped function
        would want a copy of the parameters for each, and CasADi hands a matrix to numpy through a list of Python
        numbers, four times its size.
        """
        function = self.function
        if function.is_a("SXFunction") and _is_faster(function.n_instructions(), n_times) and self.plan is not None:
            values = np.empty((self.plan.n_values, n_times))
            values[self.plan.n_written :] = 0.0
            _run_all(self.plan.steps, arguments, values)
            return values.T, self.plan.columns
        return _one_by_one(function, arguments, n_times), _columns(function)


def pays_along(function: ca.Function, n_times: int) -> bool:
    """Whether `along` can evaluate a function, and is faster for so many times than CasADi one after the other."""
    return function.is_a("SXFunction") and _is_faster(function.n_instructions(), n_times) and _is_known(function)


def along(function: ca.Function, arguments: Sequence[np.ndarray], n_times: int) -> np.ndarray:
    """Return the nonzeros of the first output of a function at all times, shape (nnz, n_times).

    Parameters
    ----------
    function
        An SX function with one output that `pays_along` accepts.
    arguments
        For each input its nonzeros: a column for each time, shape (nnz, n_times), or the same at all, shape (nnz,).
    n_times
        Number of times.
    """
    result = np.zeros((function.nnz_out(0), n_times))
    _run_all(tuple(_steps(function)), arguments, result)
    return result


def _is_known(function: ca.Function) -> bool:
    known = {*OPERATIONS, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
    return all(function.instruction_id(k) in known for k in range(function.n_instructions()))


def _is_faster(n_steps: int, n_times: int) -> bool:
    # measured: 4 us for each instruction, against 4 ns for each instruction and 3 us for each time
    return 4000 * n_steps <= n_times * (4 * n_steps + 3000)


def _steps(function: ca.Function) -> Iterator[Step]:
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        number = function.instruction_constant(k) if kind == ca.OP_CONST else 0.0
        yield kind, tuple(function.instruction_input(k)), tuple(function.instruction_output(k)), number, -1


def _columns(function: ca.Function) -> np.ndarray:
    """Return which nonzero each element of the output is; one more column stands for all zeros."""
    pattern = function.sparsity_out(0)
    columns = np.full(pattern.numel(), pattern.nnz())
    columns[np.array(pattern.row(), dtype=int)] = np.arange(pattern.nnz())
    return columns


def _plan(function: ca.Function) -> _Plan:
    """Find outputs that are one value: variables that connections made equal, and all that are zero."""
    steps: list[Step] = []
    value_in: dict[int, int] = {}  # which step made what stands in a place of the work space
    row_of: dict[int, int] = {}
    rows = np.zeros(function.nnz_out(0) + 1, dtype=int)
    for step in _steps(function):
        kind, read, written, *_ = step
        if kind != ca.OP_OUTPUT:
            value_in[written[0]] = len(steps)
            steps.append(step)
            continue
        value = value_in[read[0]]
        if value not in row_of:
            row = row_of[value] = len(row_of)
            if isinstance(OPERATIONS.get(steps[value][0]), np.ufunc):
                steps[value] = (*steps[value][:4], row)  # computed where it stands in the result
            else:
                steps.append((kind, read, (written[0], row), 0.0, -1))
        rows[written[1]] = row_of[value]
    rows[-1] = len(row_of)
    columns = rows[_columns(function)]
    return _Plan(tuple(steps), int(columns.max(initial=-1)) + 1, len(row_of), columns)


def _run_all(steps: Sequence[Step], arguments: Sequence[np.ndarray], result: np.ndarray) -> None:
    """Carry out the instructions at all times."""
    with np.errstate(all="ignore"):
        for begin in range(0, result.shape[1], TOGETHER):
            part = slice(begin, min(begin + TOGETHER, result.shape[1]))
            _run(steps, [a if a.ndim == 1 else a[:, part] for a in arguments], result[:, part])


def _run(steps: Sequence[Step], inputs: Sequence[np.ndarray], result: np.ndarray) -> None:
    """Carry out the instructions, and write the rows of the result."""
    work: dict[int, Any] = {}
    for kind, read, written, number, row in steps:
        if kind == ca.OP_INPUT:
            work[written[0]] = inputs[read[0]][read[1]]
        elif kind == ca.OP_OUTPUT:
            result[written[1]] = work[read[0]]
        elif kind == ca.OP_CONST:
            work[written[0]] = number
        elif row >= 0:
            work[written[0]] = OPERATIONS[kind](*[work[i] for i in read], out=result[row])
        else:
            work[written[0]] = OPERATIONS[kind](*[work[i] for i in read])


def _one_by_one(function: ca.Function, arguments: Sequence[np.ndarray], n_times: int) -> np.ndarray:
    """Return the nonzeros of the output at one time after the other, and zero, shape (n_times, nnz or nnz + 1)."""
    now = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
    found, n = np.zeros(function.nnz_out(0)), function.nnz_out(0)
    values = np.zeros((n_times, n + (n < function.numel_out(0))))
    buffer, evaluate = cast(Any, function.buffer())  # its stub wants a size, which its methods refuse
    moving = []
    for i, (argument, place) in enumerate(zip(arguments, now, strict=True)):
        if not place.size:
            continue
        buffer.set_arg(i, place.data)
        if argument.ndim == 1:
            place[:] = argument
        else:
            moving.append((place, argument))
    if not found.size:
        return values
    buffer.set_res(0, found.data)
    for k in range(n_times):
        for place, argument in moving:
            place[:] = argument[:, k]
        evaluate()
        values[k, :n] = found
    return values
