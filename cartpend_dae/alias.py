"""FlatSystem -> AliasedSystem: equations such as a = b, a = -b, a = r b, a = const disappear.

A variable with all its derivatives is a chain. Joining x = k d^j(y)/dt^j + c joins the whole chains:
s1 = r phi makes the speeds and accelerations of the two aliases too. Factors are exact fractions, or
expressions of parameters.
"""

from collections import defaultdict, deque
from dataclasses import dataclass, field
from fractions import Fraction

import casadi as ca

from cartpend_dae.contradiction import contradiction_sentences
from cartpend_dae.errors import StructureError
from cartpend_dae.rows import Row, exact, linear_rows
from cartpend_dae.system import (
    AliasedSystem,
    Coefficient,
    FlatSystem,
    Frictions,
    Initials,
    Relation,
    coefficient_column,
    symbolic,
)

_ONE, _ZERO = 1, 0
_CONSTANT = -1
# rank of variables whose derivative the model names: they become states, and keep their names
_DIFFERENTIATED = -1
Rank = tuple[int, int, int, int]


@dataclass(slots=True)
class _Chains:
    """A forest: each variable points to the chain it was joined to."""

    relations: dict[int, Relation] = field(default_factory=dict)

    def find(self, variable: int) -> Relation:
        """Return the relation of a variable to the base of its chain."""
        relation = self.relations.get(variable)
        if relation is None:
            return Relation(variable, 0, _ONE, _ZERO)
        if relation.base not in self.relations:  # the base of a chain, or a constant
            return relation
        upper = self.find(relation.base)
        offset = relation.offset
        if relation.order == 0:
            offset = _add(_times(relation.factor, upper.offset), offset)
        order = relation.order + upper.order
        if upper.base == _CONSTANT:
            order, factor = 0, _ZERO
        else:
            factor = _times(relation.factor, upper.factor)
        found = Relation(upper.base, order, factor, offset)
        self.relations[variable] = found
        return found


def alias(flat: FlatSystem) -> AliasedSystem:
    """Eliminate all equations that make one variable a multiple of another, or a constant.

    Parameters
    ----------
    flat
        The flat system.

    Raises
    ------
    StructureError
        If two equations contradict each other.
    """
    rows = linear_rows(flat)
    chains = _Chains()
    used, redundant, contradictions = _merge(flat, rows, chains)
    if contradictions:
        others = [i for i in used if flat.origins[i] not in set(redundant)]
        raise StructureError(contradiction_sentences(flat, others, contradictions))
    relations = tuple(chains.find(i) for i in range(len(flat.variables)))
    keep = [i for i in range(len(flat.origins)) if i not in used]
    return _substitute(flat, relations, keep, tuple(redundant))


def _times(a: Coefficient, b: Coefficient) -> Coefficient:
    if b is _ONE:
        return a
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        return symbolic(a) * symbolic(b)
    return a * b


def _add(a: Coefficient, b: Coefficient) -> Coefficient:
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        total = symbolic(a) + symbolic(b)
        return exact(float(total)) if total.is_constant() else total
    return a + b


def _divide(a: Coefficient, b: Coefficient) -> Coefficient:
    if isinstance(a, ca.SX) or isinstance(b, ca.SX):
        return symbolic(a) / symbolic(b)
    return a * b if b in (1, -1) else Fraction(a) / b


def _is_zero(value: Coefficient) -> bool:
    return value.is_zero() if isinstance(value, ca.SX) else value == 0


def _merge(flat: FlatSystem, rows: list[Row], chains: _Chains) -> tuple[set[int], list[str], list[tuple[int, float]]]:
    """Join chains row by row until no row with one or two terms is left.

    Returns the equations used up, those that say nothing new, and those that read number = 0.
    """
    contradictions: list[tuple[int, float]] = []
    used: set[int] = set()
    redundant: list[str] = []
    rank, inputs = _ranks(flat), set(flat.inputs)
    waiting: dict[int, set[int]] = defaultdict(set)
    for index, row in enumerate(rows):
        for variable, _ in row.terms:
            waiting[variable].add(index)
    queue = deque(index for index, row in enumerate(rows) if len(row.terms) <= 2)
    while queue:
        index = queue.popleft()
        row = rows[index]
        if row.equation in used or _is_long(row, chains):
            continue
        _reduce(row, chains)
        if not row.terms:
            used.add(row.equation)
            value = present_value(flat, row.constant)
            if abs(value) > 1e-12:
                contradictions.append((row.equation, value))
            else:
                redundant.append(flat.origins[row.equation])
            continue
        joined = _join(row, chains, rank, inputs) if len(row.terms) <= 2 else None
        if joined is None:
            continue
        used.add(row.equation)
        touched = waiting.pop(joined, set())
        base = chains.find(joined).base
        if base != _CONSTANT:
            waiting[base] |= touched
        queue.extend(touched)
    return used, redundant, contradictions


def _is_long(row: Row, chains: _Chains) -> bool:
    """Whether more than two terms are left, and none cancel: found without computing coefficients."""
    if len(row.terms) <= 2:
        return False
    keys: set[tuple[int, int]] = set()
    n_left = 0
    for variable, order in row.terms:
        if variable in chains.relations:
            relation = chains.find(variable)
            if relation.base == _CONSTANT:
                continue
            keys.add((relation.base, relation.order + order))
        else:
            keys.add((variable, order))
        n_left += 1
    return n_left > 2 and len(keys) == n_left


def _reduce(row: Row, chains: _Chains) -> None:
    """Write a row in the bases of the chains, in place."""
    joined = chains.relations
    if not any(variable in joined for variable, _ in row.terms):
        return
    terms: dict[tuple[int, int], Coefficient] = {}
    constant = row.constant
    for key, coefficient in row.terms.items():
        variable, order = key
        if variable in joined:
            relation = chains.find(variable)
            if order == 0 and not _is_zero(relation.offset):
                constant = _add(constant, _times(coefficient, relation.offset))
            if relation.base == _CONSTANT:
                continue
            key = (relation.base, relation.order + order)
            coefficient = _times(coefficient, relation.factor)
        terms[key] = _add(terms[key], coefficient) if key in terms else coefficient
    row.constant = constant
    row.terms = {key: value for key, value in terms.items() if not _is_zero(value)}


def present_value(flat: FlatSystem, value: Coefficient) -> float:
    """Return the value of a coefficient at the present parameters, NaN if it depends on more than these."""
    if not isinstance(value, ca.SX):
        return float(value)
    symbols, bindings = flat.parameter_symbols, flat.parameter_bindings
    for _ in range(20):
        if not ca.symvar(value):
            return float(value)
        value = ca.substitute(value, symbols, bindings)
    return float("nan")


def _ranks(flat: FlatSystem) -> list[Rank]:
    """Return how gladly each variable is kept as the base of its chain: smaller is gladder.

    Inputs come first, then what is or wants to be a state, of these the most wanted, and the one nearest to the root.
    """
    kinds = {"input": 0, "variable": 1, "output": 2, "potential": 3, "flow": 4}
    external, differentiated = set(flat.inputs), {i for i, _ in flat.derivatives}
    return [
        (
            -2
            if i in external
            else _DIFFERENTIATED
            if i in differentiated or v.declaration.wish > 0
            else max(1, kinds[v.kind]),
            -v.declaration.wish,
            v.name.count("."),
            i,
        )
        for i, v in enumerate(flat.variables)
    ]


def _is_differentiated(rank: list[Rank], variable: int) -> bool:
    return rank[variable][0] == _DIFFERENTIATED


def _join(row: Row, chains: _Chains, rank: list[Rank], inputs: set[int]) -> int | None:
    """Use a row of one or two terms to join a chain to another; return the variable that was eliminated."""
    items = list(row.terms.items())
    candidates = [
        (position, variable)
        for position, ((variable, order), coefficient) in enumerate(items)
        if order == 0 and variable not in inputs and not isinstance(coefficient, ca.SX)
    ]
    if len(items) == 2 and items[0][0][0] == items[1][0][0]:
        return None
    if not candidates:
        return None
    position, variable = max(candidates, key=lambda candidate: rank[candidate[1]])
    coefficient = items[position][1]
    offset = _divide(_times(-1, row.constant), coefficient)
    if len(items) == 1:
        chains.relations[variable] = Relation(_CONSTANT, 0, _ZERO, offset)
        return variable
    (other, order), other_coefficient = items[1 - position]
    factor = _divide(_times(-1, other_coefficient), coefficient)
    if isinstance(factor, ca.SX) and (
        order > 0 or _is_differentiated(rank, variable) > _is_differentiated(rank, other)
    ):
        # f = -m der(v) and i = (V - u)/R are laws, not other names: a state must not become a multiple of a flow
        return None
    if order > 0 and not isinstance(factor, ca.SX) and factor != 1:
        # x' = -y is a law too: where y has a nonlinear one, y is the unknown to keep, not x'
        return None
    chains.relations[variable] = Relation(other, order, factor, offset)
    return variable


def _substitute(
    flat: FlatSystem, relations: tuple[Relation, ...], keep: list[int], redundant: tuple[str, ...]
) -> AliasedSystem:
    """Rewrite what remains in the symbols of the chains, by one substitution."""
    wanted = [(relation, 0) for relation in relations]
    wanted += [(relations[variable], order) for variable, order in flat.derivatives]
    highest: dict[int, int] = {}
    for relation, more in wanted:
        if relation.base != _CONSTANT:
            highest[relation.base] = max(relation.order + more, highest.get(relation.base, 0))
    keys = tuple((base, order) for base, top in highest.items() for order in range(top + 1))
    names = [flat.variables[base].name for base, _ in keys]
    symbols = [ca.SX.sym("der(" * o + name + ")" * o) for name, (_, o) in zip(names, keys, strict=True)]
    stacked = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
    old = ca.vertcat(flat.symbols, flat.derivative_symbols)
    new = relation_values(wanted, keys, stacked)
    friction = flat.frictions
    parts = [
        flat.residual[keep],
        friction.speed,
        friction.level_pos,
        friction.level_neg,
        flat.initials.residual,
    ]
    residual, speed, level_pos, level_neg, initials = ca.substitute(parts, [old], [new])
    return AliasedSystem(
        flat=flat,
        relations=relations,
        keys=keys,
        symbols=stacked,
        residual=residual,
        origins=tuple(flat.origins[i] for i in keep),
        frictions=Frictions(friction.places, friction.force, speed, level_pos, level_neg),
        initials=Initials(initials, flat.initials.fixed, flat.initials.origins),
        redundant=redundant,
    )


def relation_values(wanted: list[tuple[Relation, int]], keys: tuple[tuple[int, int], ...], symbols: ca.SX) -> ca.SX:
    """Return derivatives of variables in the symbols of their chains, shape (n, 1).

    Parameters
    ----------
    wanted
        Relation of a variable, and the order of the derivative of it that is wanted.
    keys, symbols
        The members of the chains, and their symbols (n_keys, 1).
    """
    position = {key: k for k, key in enumerate(keys)}
    nothing = len(keys)  # a zero stands after the symbols, for constants
    index = [nothing if r.base == _CONSTANT else position[r.base, r.order + more] for r, more in wanted]
    factors = coefficient_column([r.factor for r, _ in wanted])
    offsets = coefficient_column([r.offset if more == 0 else 0 for r, more in wanted])
    return factors * ca.vertcat(symbols, 0)[index, 0] + offsets
