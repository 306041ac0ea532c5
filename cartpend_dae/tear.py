"""A nonlinear block -> a few unknowns to be iterated, and the others as explicit functions of these.

Only coefficients that are numbers are divided by: one that depends on a parameter may vanish. And an unknown is
taken only from an equation that is linear in the block, or if the whole block is linear in the unknown: then
Newton's method takes the same steps as on the whole block (it does not see linear substitutions), while tearing by
structure alone puts the exponential of one diode into that of the next.
"""

from dataclasses import dataclass

import casadi as ca

from cartpend_dae.graph import Pair, tear
from cartpend_dae.rows import nonzeros

_JUMPING = {
    ca.OP_SIGN,
    ca.OP_FLOOR,
    ca.OP_CEIL,
    ca.OP_LT,
    ca.OP_LE,
    ca.OP_EQ,
    ca.OP_NE,
    ca.OP_NOT,
    ca.OP_AND,
    ca.OP_OR,
    ca.OP_IF_ELSE_ZERO,
}


@dataclass(frozen=True, slots=True)
class Torn:
    """A block with fewer unknowns: `definitions` of unknowns in order of solution, and what is left."""

    definitions: tuple[tuple[int, ca.SX], ...]
    equations: tuple[int, ...]
    unknowns: tuple[int, ...]


def tear_block(residual: ca.SX, unknowns: ca.SX) -> Torn:
    """Solve equations of a block for unknowns, as long as there are any that may be solved.

    What would leave a Jacobian with more entries is not done: fewer unknowns would cost more than they save.

    Parameters
    ----------
    residual, unknowns
        Equations and unknowns of the block, both of shape (n, 1).
    """
    equations, left = list(range(unknowns.numel())), list(range(unknowns.numel()))
    definitions: list[tuple[int, ca.SX]] = []
    while left:
        symbols = unknowns[left]
        jacobian = ca.jacobian(residual, symbols)
        entries = list(zip(*ca.jacobian_sparsity(residual, symbols).get_triplet(), strict=True))
        for solvable in _solvable(residual, symbols, jacobian):
            order = tear(entries, solvable, len(left))
            new = [(symbols[j], _solved(residual[i], symbols[j], jacobian[i, j])) for i, j in order]
            rest = sorted(set(range(len(left))) - {i for i, _ in order})
            kept = sorted(set(range(len(left))) - {j for _, j in order})
            _, (smaller,) = ca.substitute_inplace([s for s, _ in new], [v for _, v in new], [residual[rest]])
            if order and ca.jacobian_sparsity(smaller, symbols[kept]).nnz() <= jacobian.nnz():
                break
        else:
            return Torn(tuple(definitions), tuple(equations), tuple(left))
        definitions = [(left[j], value) for (_, j), (_, value) in zip(order, new, strict=True)] + definitions
        residual = smaller
        equations, left = [equations[i] for i in rest], [left[j] for j in kept]
    return Torn(tuple(definitions), (), ())


def _solvable(residual: ca.SX, symbols: ca.SX, jacobian: ca.SX) -> tuple[list[Pair], list[Pair], list[Pair]]:
    """Return the entries with a number: of unknowns that enter linearly everywhere, and of linear equations.

    First come those that are both, so that unknowns are kept that enter nonlinearly anyway.
    """
    places = list(zip(*jacobian.sparsity().get_triplet(), strict=True))
    values = nonzeros(jacobian)
    varying = set(ca.jacobian_sparsity(values, symbols).get_triplet()[0])
    jumping = jumps(residual, symbols)
    bent_rows = {places[k][0] for k in varying} | {i for i, _ in jumping}
    bent_columns = {places[k][1] for k in varying} | {j for _, j in jumping}
    numbers = [
        place
        for place, value in zip(places, ca.vertsplit(values), strict=True)
        if value.is_constant() and abs(float(value)) > 1e-12
    ]
    by_row = [place for place in numbers if place[0] not in bent_rows]
    by_column = [place for place in numbers if place[1] not in bent_columns]
    return [place for place in by_row if place[1] not in bent_columns], by_column, by_row


def _solved(equation: ca.SX, symbol: ca.SX, coefficient: ca.SX) -> ca.SX:
    return -ca.substitute(equation, symbol, 0) / coefficient


def jumps(residual: ca.SX, unknowns: ca.SX) -> set[Pair]:
    """Return (equation, unknown) where a step of the equation depends on the unknown; its slope does not show that.

    Parameters
    ----------
    residual, unknowns
        Shapes (n, 1) and (m, 1).
    """
    if residual.is_smooth():
        return set()
    steps = [(i, step) for i, equation in enumerate(ca.vertsplit(residual)) for step in _steps(equation)]
    where = ca.jacobian_sparsity(ca.vertcat(*(step for _, step in steps)), unknowns).get_triplet()
    return {(steps[k][0], j) for k, j in zip(*where, strict=True)}


def _steps(equation: ca.SX) -> list[ca.SX]:
    """Return what decides about the steps of an expression: the arguments of signs and comparisons."""
    if equation.is_smooth():
        return []
    found: list[ca.SX] = []
    seen: set[int] = set()
    waiting = [equation]
    while waiting:
        node = waiting.pop()
        key = node.element_hash()
        if key in seen:
            continue
        seen.add(key)
        arguments = [node.dep(k) for k in range(node.n_dep())]
        if node.op() in _JUMPING:
            found += arguments[:1] if node.op() == ca.OP_IF_ELSE_ZERO else arguments
        waiting += arguments
    return found
