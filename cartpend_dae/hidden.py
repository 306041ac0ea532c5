"""Linear equations whose sums say more than each of them: what structure alone does not see.

Two capacitors side by side, away from the ground: u1 = va - vb and u2 = va - vb are two equations for two
potentials, until their difference shows that u1 = u2 is a constraint between states, and that nothing gives
va and vb themselves. Equations with numbers as coefficients are therefore eliminated exactly, and what is left
without potentials, flows and other algebraic variables takes the place of an equation.

References
----------
M. Otter, H. Elmqvist, "Transformation of differential algebraic array equations to index one form", Proc. 12th
Modelica Conf. 2017, 565-579, doi:10.3384/ecp17132565 (removal of singularities from linear integer equations).
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from heapq import heapify, heappop, heappush

import casadi as ca

from cartpend_dae.rows import Row
from cartpend_dae.system import Coefficient, symbolic

Key = tuple[int, int]
Terms = dict[Key, int | Fraction]


def hidden_rows(rows: Sequence[Row], fixed: set[int]) -> list[Row]:
    """Return sums of equations in which more cancels than one variable, each in place of one of its equations.

    Parameters
    ----------
    rows
        Linear equations; those with coefficients that are no numbers are left out.
    fixed
        The variables that are not algebraic: inputs, and those that are differentiated.
    """

    def is_algebraic(key: Key) -> bool:
        return key[0] not in fixed

    terms: list[Terms] = []
    constants: list[Coefficient] = []
    equations: list[int] = []
    for row in rows:
        numbers = {key: value for key, value in row.terms.items() if not isinstance(value, ca.SX)}
        if len(numbers) == len(row.terms) and any(map(is_algebraic, numbers)):
            terms.append(numbers)
            constants.append(row.constant)
            equations.append(row.equation)
    combined = _eliminate(terms, constants, is_algebraic)
    return [Row(equations[i], dict(terms[i]), constants[i], has_cancelled=True) for i in combined]


def _eliminate(terms: list[Terms], constants: list[Coefficient], is_algebraic: Callable[[Key], bool]) -> list[int]:
    """Eliminate algebraic variables in place, short rows first; return the rows in which others cancelled as well."""
    algebraic = [{key for key in row if is_algebraic(key)} for row in terms]
    holders: dict[Key, set[int]] = {}
    for i, keys in enumerate(algebraic):
        for key in keys:
            holders.setdefault(key, set()).add(i)
    queue = [(len(keys), i) for i, keys in enumerate(algebraic)]
    heapify(queue)
    done: set[int] = set()
    found: set[int] = set()
    while queue:
        length, i = heappop(queue)
        if i in done or length != len(algebraic[i]):
            continue
        done.add(i)
        shared = [key for key in algebraic[i] if len(holders[key]) > 1]
        if not shared:
            continue
        pivot = min(shared, key=lambda key: (len(holders[key]), key))
        for key in algebraic[i]:
            holders[key].discard(i)
        for k in holders.pop(pivot):
            ratio = Fraction(terms[k][pivot]) / terms[i][pivot]
            if _subtract(terms[k], terms[i], ratio) > 1:
                found.add(k)
            constants[k] = _less(constants[k], ratio, constants[i])
            new = {key for key in terms[k] if is_algebraic(key)}
            for key in algebraic[k] - new - {pivot}:
                holders[key].discard(k)
            for key in new - algebraic[k]:
                holders[key].add(k)
            algebraic[k] = new
            heappush(queue, (len(new), k))
    return sorted(found)


def _subtract(target: Terms, row: Terms, ratio: Fraction) -> int:
    """Subtract a multiple of a row in place; return how many terms cancelled."""
    n_cancelled = 0
    for key, value in row.items():
        new = target.get(key, 0) - ratio * value
        if new:
            target[key] = int(new) if new == int(new) else new
        else:
            target.pop(key, None)
            n_cancelled += 1
    return n_cancelled


def _less(constant: Coefficient, ratio: Fraction, other: Coefficient) -> Coefficient:
    if isinstance(constant, ca.SX) or isinstance(other, ca.SX):
        total = symbolic(constant) - float(ratio) * symbolic(other)
        return int(float(total)) if total.is_constant() and float(total).is_integer() else total
    return constant - ratio * other
