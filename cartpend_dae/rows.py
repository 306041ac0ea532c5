"""The equations of a flat system that are linear with coefficients constant in time, as rows of numbers.

Those of a group are looked at once for all its instances.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca
import numpy as np

from cartpend_dae.freeze import pick
from cartpend_dae.system import Coefficient, FlatSystem, Group


@dataclass(slots=True)
class Row:
    """A linear equation: sum of coefficient * d^order(variable) + constant = 0, by (variable, order).

    `has_cancelled`: it says less than the equation it stands for seems to say, because terms of that cancel.
    """

    equation: int
    terms: dict[tuple[int, int], Coefficient]
    constant: Coefficient
    has_cancelled: bool = False


@dataclass(frozen=True, slots=True)
class _Form:
    """Linear equations of one form: (equation, unknown) of each coefficient, then the constants of the equations.

    `values` are the coefficients, (n_coefficients, 1), and `numbers` those that are literal numbers, by position.
    """

    equations: tuple[int, ...]
    entries: tuple[tuple[int, int], ...]
    values: ca.SX
    numbers: dict[int, int | Fraction]

    @property
    def expressions(self) -> list[int]:
        """Positions of the values that are no numbers."""
        return [k for k in range(self.values.numel()) if k not in self.numbers]


def linear_rows(flat: FlatSystem) -> list[Row]:
    """Return all linear equations, coefficients that are numbers as exact fractions.

    Parameters
    ----------
    flat
        The flat system.
    """
    rows: list[Row] = []
    loose = np.ones(len(flat.origins), dtype=bool)
    for group in flat.groups:
        rows += _group_rows(flat, group)
        loose[group.equations.ravel()] = False
    rows += _loose_rows(flat, np.flatnonzero(loose).tolist())
    rows.sort(key=lambda row: row.equation)
    return rows


def _loose_rows(flat: FlatSystem, equations: list[int]) -> Iterator[Row]:
    keys = [(i, 0) for i in range(len(flat.variables))] + list(flat.derivatives)
    unknowns = ca.vertcat(flat.symbols, flat.derivative_symbols)
    form = _form(
        flat.residual[equations, 0], unknowns, ca.vertcat(flat.frictions.force, flat.time, flat.hybrid.symbols)
    )
    symbolic = form.expressions
    elements = ca.vertsplit(form.values[symbolic]) if symbolic else []
    yield from _rows(form, [equations], [keys], elements)


def _group_rows(flat: FlatSystem, group: Group) -> Iterator[Row]:
    variables, derivatives, parameters, time = group.function.sx_in()
    residual = group.function(variables, derivatives, parameters, time)
    form = _form(residual, ca.vertcat(variables, derivatives), time)
    if not form.equations:
        return
    symbolic = form.expressions
    elements: list[ca.SX] = []
    if symbolic:
        function = ca.Function("coefficients", [parameters], [form.values[symbolic]])
        columns = function.map(group.equations.shape[1])(pick(flat.parameter_symbols, group.parameters))
        elements = ca.vertsplit(ca.vec(columns))
    keys = [[(i, 0) for i in column] for column in group.variables.T.tolist()]
    if group.derivatives.size:
        for column, own in zip(keys, group.derivatives.T.tolist(), strict=True):
            column += [flat.derivatives[i] for i in own]
    yield from _rows(form, group.equations.T.tolist(), keys, elements)


def _rows(
    form: _Form, equations: list[list[int]], keys: list[list[tuple[int, int]]], elements: list[ca.SX]
) -> Iterator[Row]:
    """Yield the rows of all instances; `elements` are their coefficients that are no numbers, instance by instance."""
    n = len(form.entries)
    members: list[list[tuple[int, int]]] = [[] for _ in form.equations]
    for k, (equation, unknown) in enumerate(form.entries):
        members[equation].append((unknown, k))
    place = {k: i for i, k in enumerate(form.expressions)}
    for instance, own in enumerate(keys):
        values: list[Coefficient] = [0] * form.values.numel()
        for k, number in form.numbers.items():
            values[k] = number
        for k, i in place.items():
            values[k] = elements[instance * len(place) + i]
        for position, equation in enumerate(form.equations):
            terms = {own[unknown]: values[k] for unknown, k in members[position]}
            yield Row(equations[instance][equation], terms, values[n + position])


def _form(residual: ca.SX, unknowns: ca.SX, other: ca.SX) -> _Form:
    """Find the equations that are linear in the unknowns, with coefficients that depend on parameters only."""
    n_equations = residual.numel()
    jacobian = ca.jacobian(residual, unknowns)
    rows, columns = (np.asarray(part, dtype=int) for part in jacobian.sparsity().get_triplet())
    coefficients = nonzeros(jacobian)
    varying = np.zeros(n_equations, dtype=bool)
    if coefficients.numel():
        moving = ca.jacobian_sparsity(coefficients, ca.vertcat(unknowns, other)).get_triplet()[0]
        varying[rows[np.unique(moving).astype(int)]] = True
    varying[np.unique(ca.jacobian_sparsity(residual, other).get_triplet()[0]).astype(int)] = True
    if not residual.is_smooth():  # a sign or a comparison has slope zero and yet is no constant
        varying |= [not equation.is_smooth() for equation in ca.vertsplit(residual)]
    linear = np.flatnonzero(~varying)
    position = {equation: k for k, equation in enumerate(linear.tolist())}
    wanted = [k for k, row in enumerate(rows.tolist()) if row in position]
    constants = ca.substitute(residual[linear.tolist(), 0], unknowns, ca.SX.zeros(unknowns.numel()))
    values = ca.vertcat(coefficients[wanted, 0], constants)
    return _Form(
        equations=tuple(linear.tolist()),
        entries=tuple((position[int(rows[k])], int(columns[k])) for k in wanted),
        values=values,
        numbers=_numbers(values),
    )


def _numbers(values: ca.SX) -> dict[int, int | Fraction]:
    """Return the elements of a column that are numbers, found and evaluated all at once."""
    symbols = ca.symvar(values)
    if not symbols:
        return {i: exact(float(value)) for i, value in enumerate(np.asarray(ca.DM(values)).ravel())}
    column = ca.vertcat(*symbols)
    symbolic = set(ca.jacobian_sparsity(values, column).get_triplet()[0])
    numbers = np.asarray(ca.Function("numbers", [column], [values])(0))
    return {i: exact(float(numbers[i, 0])) for i in range(values.numel()) if i not in symbolic}


def exact(number: float) -> int | Fraction:
    """Return a number as the fraction that was meant, 0.1 as 1/10; whole ones as int, which is ten times faster."""
    if number.is_integer():
        return int(number)
    meant = Fraction(number).limit_denominator(10**9)
    return meant if float(meant) == number else Fraction(number)


def nonzeros(matrix: ca.SX) -> ca.SX:
    """Return the structural nonzeros of a matrix as a column, in the order of its sparsity."""
    return ca.sparsity_cast(matrix, ca.Sparsity.dense(matrix.nnz(), 1))
