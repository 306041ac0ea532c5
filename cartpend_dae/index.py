"""AliasedSystem -> IndexedSystem: constraints are differentiated until every highest derivative can be solved for.

The structural analysis says how often each equation is differentiated. Of the variables below the highest
order, dummy derivatives are those that the constraints give, so that only as many states are left as there
are degrees of freedom; `state_select` says which of them are wanted. Where the constraints give them with
coefficients that change along the motion (a pendulum in Cartesian coordinates through full turns) no such
choice holds for ever: all are kept as states, and the constraints as invariants towards which the solution
is drawn back.

References
----------
J. D. Pryce, BIT 41 (2001), 364-394, doi:10.1023/A:1021998624799 (structural analysis).
S. E. Mattsson, G. Soederlind, SIAM J. Sci. Comput. 14 (1993), 677-692, doi:10.1137/0914043 (dummy derivatives).
U. M. Ascher, H. Chin, S. Reich, Numer. Math. 67 (1994), 131-149, doi:10.1007/s002110050020 (invariants).
"""

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np

from cartpend_dae.alias import present_value
from cartpend_dae.diagnose import input_derivative_sentence, singular_sentence
from cartpend_dae.errors import StructureError
from cartpend_dae.graph import matching, structural_offsets
from cartpend_dae.selection import Key, check_demands, demanded_orders, rank, wishes
from cartpend_dae.system import AliasedSystem, IndexedSystem

Line = dict[int, float | ca.SX]


def reduce_index(aliased: AliasedSystem) -> IndexedSystem:
    """Differentiate constraints and choose the states.

    Parameters
    ----------
    aliased
        The system without trivial equations.

    Raises
    ------
    StructureError
        If equations and unknowns cannot be matched, or a constraint would need the derivative of an input or
        of a dry friction force.
    """
    inputs = {*aliased.flat.inputs, *aliased.flat.hybrid.discretes}
    wanted: dict[int, int] = {}
    for base, order in aliased.keys:
        wanted[base] = max(order, wanted.get(base, 0))
        if base in inputs and order > 0:
            raise StructureError(input_derivative_sentence(aliased, base))
    for base, order in demanded_orders(aliased).items():
        wanted[base] = max(order, wanted[base])
    bases = [base for base in wanted if base not in inputs]
    column_of = {base: j for j, base in enumerate(bases)}
    entries = _signature(aliased, column_of)
    top = [(row, column) for (row, column), order in entries.items() if order == wanted[bases[column]]]
    n = len(aliased.origins)
    match = matching([r for r, _ in top], [c for _, c in top], (n, len(bases)))
    if n == len(bases) and np.all(match >= 0):
        counts, highest = np.zeros(n, dtype=int), np.array([wanted[base] for base in bases])
    else:
        _check_structure(aliased, bases, entries)
        counts, highest, _ = structural_offsets(
            [r for r, _ in entries],
            [c for _, c in entries],
            list(entries.values()),
            [wanted[base] for base in bases],
            n,
        )
    return _reduced(aliased, bases, counts, highest)


def _signature(aliased: AliasedSystem, column_of: dict[int, int]) -> dict[tuple[int, int], int]:
    """Return the highest order of each variable in each equation."""
    rows, columns = ca.jacobian_sparsity(aliased.residual, aliased.symbols).get_triplet()
    entries: dict[tuple[int, int], int] = {}
    for row, position in zip(rows, columns, strict=True):
        base, order = aliased.keys[position]
        if base in column_of:
            key = (row, column_of[base])
            entries[key] = max(order, entries.get(key, 0))
    return entries


def _check_structure(aliased: AliasedSystem, bases: list[int], entries: dict[tuple[int, int], int]) -> None:
    n = len(aliased.origins)
    match = matching([r for r, _ in entries], [c for _, c in entries], (n, len(bases)))
    if n != len(bases) or np.any(match < 0):
        raise StructureError(singular_sentence(aliased, bases, list(entries), match))


def _reduced(aliased: AliasedSystem, bases: list[int], counts: np.ndarray, highest: np.ndarray) -> IndexedSystem:
    extended, levels = _differentiate(aliased, counts)
    tops = [(base, int(order)) for base, order in zip(bases, highest, strict=True)]
    extended = _with_keys(extended, tops)
    wish = wishes(aliased)
    dummies, dropped = _dummy_derivatives(extended, tops, counts, levels, wish)
    unknowns = [*tops, *dummies]
    taken = set(unknowns)
    solved = [i for i in range(len(extended.origins)) if i not in set(dropped)]
    indexed = IndexedSystem(
        aliased=replace(
            extended, residual=extended.residual[solved, 0], origins=tuple(extended.origins[i] for i in solved)
        ),
        unknowns=tuple(unknowns),
        states=tuple((base, k) for base, order in tops for k in range(order) if (base, k) not in taken),
        invariants=extended.residual[dropped, 0] if dropped else ca.SX(0, 1),
        invariant_origins=tuple(extended.origins[i] for i in dropped),
        dummies=tuple((key, aliased.origins[i]) for key, i in dummies.items()),
        differentiated=tuple((aliased.origins[i], int(n)) for i, n in enumerate(counts) if n),
    )
    check_demands(indexed, wish)
    return indexed


def _with_keys(aliased: AliasedSystem, wanted: list[Key]) -> AliasedSystem:
    """Make symbols for derivatives that no equation shows yet."""
    known = set(aliased.keys)
    keys, symbols = list(aliased.keys), [aliased.symbols]
    for base, order in wanted:
        for k in range(order + 1):
            if (base, k) not in known:
                known.add((base, k))
                keys.append((base, k))
                symbols.append(ca.SX.sym("der(" * k + aliased.flat.variables[base].name + ")" * k))
    return replace(aliased, keys=tuple(keys), symbols=ca.vertcat(*symbols))


def _differentiate(aliased: AliasedSystem, counts: np.ndarray) -> tuple[AliasedSystem, list[list[int]]]:
    """Append the derivatives of the equations; `levels[i][k]` is where the k-th derivative of equation i stands."""
    levels = [[i] for i in range(len(counts))]
    current = list(range(len(counts)))
    for round_number in range(1, int(counts.max(initial=0)) + 1):
        equations = [i for i in range(len(counts)) if counts[i] >= round_number]
        source = [current[i] for i in equations]
        aliased = _with_keys(aliased, [(base, order + 1) for base, order in aliased.keys])
        rate = _total_derivative(aliased, source)
        first = len(aliased.origins)
        aliased = replace(
            aliased,
            residual=ca.vertcat(aliased.residual, rate),
            origins=(*aliased.origins, *(f"derivative of {aliased.origins[k]}" for k in source)),
        )
        for offset, i in enumerate(equations):
            current[i] = first + offset
            levels[i].append(first + offset)
    return aliased, levels


def _total_derivative(aliased: AliasedSystem, equations: list[int]) -> ca.SX:
    """Differentiate equations with respect to time by the chain rule; parameters are constant."""
    flat = aliased.flat
    residual = aliased.residual[equations]
    forces = ca.jacobian_sparsity(residual, flat.frictions.force).get_triplet()[0]
    if len(forces):
        names = ", ".join(sorted({aliased.origins[equations[row]] for row in forces}))
        raise StructureError(
            f"{flat.name}: a constraint must be differentiated that holds a dry friction force, which jumps: {names}. "
            f"Give one of the parts that it joins a mass or a stiffness."
        )
    table = dict(zip(aliased.keys, ca.vertsplit(aliased.symbols), strict=True))
    used = sorted(set(ca.jacobian_sparsity(residual, aliased.symbols).get_triplet()[1]))
    keys = [aliased.keys[k] for k in used]
    for base, _ in keys:
        if base in flat.inputs or base in flat.hybrid.discretes:
            raise StructureError(input_derivative_sentence(aliased, base, equations))
    lower = ca.vertcat(*[table[key] for key in keys]) if keys else ca.SX(0, 1)
    upper = ca.vertcat(*[table[base, order + 1] for base, order in keys]) if keys else ca.SX(0, 1)
    moved = ca.jtimes(residual, lower, upper) if keys else ca.SX.zeros(len(equations))
    return moved + ca.jacobian(residual, flat.time)


def _dummy_derivatives(
    aliased: AliasedSystem, tops: list[Key], counts: np.ndarray, levels: list[list[int]], wish: Mapping[Key, int]
) -> tuple[dict[Key, int], list[int]]:
    """Choose, stage by stage, the lower derivatives that constraints give.

    Returns the dummy derivatives with their constraints, and the equations left over, which become invariants.
    """
    rows = [i for i, count in enumerate(counts) if count >= 1]
    if not rows:
        return {}, []
    table = dict(zip(aliased.keys, ca.vertsplit(aliased.symbols), strict=True))
    unknown = ca.vertcat(*[table[key] for key in tops])
    jacobian = ca.jacobian(aliased.residual[[levels[i][-1] for i in rows]], unknown)
    columns = list(range(len(tops)))
    static = list(range(len(rows)))
    dummies: dict[Key, int] = {}
    invariants: list[int] = []
    for stage in range(1, int(counts.max()) + 1):
        now = [row for row in range(len(rows)) if counts[rows[row]] >= stage]
        eligible = [j for j in columns if tops[j][1] >= stage]
        ranks = {j: rank(wish, tops[j][0], tops[j][1] - stage) for j in eligible}
        pivots = _constant_pivots(aliased, jacobian, [row for row in now if row in static], ranks)
        static = list(pivots)
        dummies |= {(tops[column][0], tops[column][1] - stage): rows[row] for row, column in pivots.items()}
        invariants += [levels[rows[row]][int(counts[rows[row]]) - stage] for row in now if row not in pivots]
        columns = list(pivots.values())
    return dummies, invariants


def _constant_pivots(
    aliased: AliasedSystem, jacobian: ca.SX, rows: list[int], ranks: Mapping[int, int]
) -> dict[int, int]:
    """Eliminate with pivots that are constant in time; return row -> column for the rows that have one.

    Columns of the lowest rank are taken as long as there are any: columns that are independent form a matroid, so that
    this greedy choice leaves the states that are wanted most. Of equal ranks, numbers are taken before expressions
    of parameters, and of these the last column.
    """
    lines = {row: _line(jacobian, row, set(ranks)) for row in rows}
    pivots: dict[int, int] = {}
    for limit in sorted(set(ranks.values())):
        for row in sorted(set(rows) - set(pivots), key=lambda r: (len(lines[r]), r)):
            line = lines[row]
            constant = [j for j, value in line.items() if ranks[j] <= limit and _is_constant(aliased, value)]
            if not constant:
                continue
            pivots[row] = max(constant, key=lambda j: (-ranks[j], not isinstance(line[j], ca.SX), j))
            _eliminate(lines, pivots, row)
    return pivots


def _eliminate(lines: dict[int, Line], pivots: dict[int, int], row: int) -> None:
    """Subtract a row from those without a pivot, in place, so that its own column stands in it alone."""
    line, column = lines[row], pivots[row]
    for other, others in lines.items():
        if other in pivots or column not in others:
            continue
        ratio = others.pop(column) / line[column]
        for j, value in line.items():
            if j != column:
                others[j] = _as_number(others.get(j, 0.0) - ratio * value)
        lines[other] = {j: value for j, value in others.items() if isinstance(value, ca.SX) or value != 0}


def _line(jacobian: ca.SX, row: int, columns: set[int]) -> Line:
    line = jacobian[row, :]
    found = {j: _as_number(line[0, j]) for j in line.sparsity().get_triplet()[1] if j in columns}
    return {j: value for j, value in found.items() if isinstance(value, ca.SX) or value != 0}


def _as_number(value: float | ca.SX) -> float | ca.SX:
    """Return a number as such: it is reckoned with a hundred times faster than as an expression."""
    return float(value) if isinstance(value, ca.SX) and value.is_constant() else value


def _is_constant(aliased: AliasedSystem, value: float | ca.SX) -> bool:
    """Whether a coefficient is a number or an expression of parameters, and is not zero now."""
    if not isinstance(value, ca.SX):
        return abs(value) > 1e-12
    if ca.depends_on(value, ca.vertcat(aliased.symbols, aliased.flat.time)):
        return False
    return abs(present_value(aliased.flat, value)) > 1e-12
