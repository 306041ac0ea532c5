"""Linear rows of one or two terms join variables to chains: multiples of one variable and its derivatives."""

from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from fractions import Fraction

import casadi as ca

from cartpend_dae.rows import Row, exact
from cartpend_dae.system import Coefficient, Relation, symbolic

_ONE, _ZERO = 1, 0
CONSTANT = -1
# rank of variables whose derivative the model names: they become states, and keep their names
DIFFERENTIATED = -1
Rank = tuple[int, int, int, int]


@dataclass(slots=True)
class Chains:
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
        if upper.base == CONSTANT:
            order, factor = 0, _ZERO
        else:
            factor = _times(relation.factor, upper.factor)
        found = Relation(upper.base, order, factor, offset)
        self.relations[variable] = found
        return found


@dataclass(slots=True)
class Merger:
    """The rows of a system while they are joined.

    `rank` says how gladly each variable is kept (smaller is gladder), `inputs` are never eliminated, `value` gives a
    constant at the present parameters. Factors that depend on parameters are taken with `is_symbolic` only: they hide
    what cancels in sums of equations. Collected are the equations `used`, those that say nothing new (`redundant`)
    and those that read number = 0 (`contradictions`).
    """

    rows: list[Row]
    rank: list[Rank]
    inputs: set[int]
    value: Callable[[Coefficient], float]
    is_symbolic: bool = False
    chains: Chains = field(default_factory=Chains)
    used: set[int] = field(default_factory=set)
    redundant: list[int] = field(default_factory=list)
    contradictions: list[tuple[int, float]] = field(default_factory=list)
    waiting: dict[int, set[int]] = field(default_factory=lambda: defaultdict(set))

    def join_all(self) -> None:
        """Join until no row with one or two terms is left."""
        self._run(index for index, row in enumerate(self.rows) if len(row.terms) <= 2)

    def replace(self, rows: Iterable[Row]) -> None:
        """Let rows take the place of others that stand for the same equations, and go on."""
        place = {row.equation: index for index, row in enumerate(self.rows)}
        changed = [(place[row.equation], row) for row in rows]
        for index, row in changed:
            self.rows[index] = row
        self._run(index for index, _ in changed)

    def open_rows(self) -> list[Row]:
        """Return the rows that are left, in the bases of the chains."""
        rows = [row for row in self.rows if row.equation not in self.used]
        for row in rows:
            reduce_row(row, self.chains)
        return rows

    def _run(self, start: Iterable[int]) -> None:
        queue = deque(start)
        for index in queue if self.waiting else range(len(self.rows)):
            for variable, _ in self.rows[index].terms:
                self.waiting[variable].add(index)
        while queue:
            index = queue.popleft()
            row = self.rows[index]
            if row.equation in self.used or _is_long(row, self.chains):
                continue
            reduce_row(row, self.chains)
            if not row.terms:
                self._note_constant(row)
                continue
            joined = self._join(row) if len(row.terms) <= 2 else None
            if joined is None:
                continue
            self.used.add(row.equation)
            touched = self.waiting.pop(joined, set())
            base = self.chains.find(joined).base
            if base != CONSTANT:
                self.waiting[base] |= touched
            queue.extend(touched)

    def _join(self, row: Row) -> int | None:
        """Use a row of one or two terms to join a chain to another; return the variable that was eliminated."""
        items = list(row.terms.items())
        candidates = [
            (position, variable)
            for position, ((variable, order), coefficient) in enumerate(items)
            if order == 0 and variable not in self.inputs and not isinstance(coefficient, ca.SX)
        ]
        if len(items) == 2 and items[0][0][0] == items[1][0][0]:
            return None
        if not candidates:
            return None
        position, variable = max(candidates, key=lambda candidate: self.rank[candidate[1]])
        coefficient = items[position][1]
        offset = _divide(_times(-1, row.constant), coefficient)
        if len(items) == 1:
            self.chains.relations[variable] = Relation(CONSTANT, 0, _ZERO, offset)
            return variable
        (other, order), other_coefficient = items[1 - position]
        factor = _divide(_times(-1, other_coefficient), coefficient)
        is_law = order > 0 or _is_state(self.rank, variable) > _is_state(self.rank, other)
        if isinstance(factor, ca.SX) and (is_law or not self.is_symbolic):
            # f = -m der(v) and i = (V - u)/R are laws, not other names: a state must not become a multiple of a flow
            return None
        if order > 0 and not isinstance(factor, ca.SX) and factor != 1:
            # x' = -y is a law too: where y has a nonlinear one, y is the unknown to keep, not x'
            return None
        self.chains.relations[variable] = Relation(other, order, factor, offset)
        return variable

    def _note_constant(self, row: Row) -> None:
        self.used.add(row.equation)
        value = self.value(row.constant)
        if abs(value) > 1e-12:
            self.contradictions.append((row.equation, value))
        else:
            self.redundant.append(row.equation)


def _is_long(row: Row, chains: Chains) -> bool:
    """Whether more than two terms are left, and none cancel: found without computing coefficients."""
    if len(row.terms) <= 2:
        return False
    keys: set[tuple[int, int]] = set()
    n_left = 0
    for variable, order in row.terms:
        if variable in chains.relations:
            relation = chains.find(variable)
            if relation.base == CONSTANT:
                continue
            keys.add((relation.base, relation.order + order))
        else:
            keys.add((variable, order))
        n_left += 1
    return n_left > 2 and len(keys) == n_left


def reduce_row(row: Row, chains: Chains) -> None:
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
            if relation.base == CONSTANT:
                continue
            key = (relation.base, relation.order + order)
            coefficient = _times(coefficient, relation.factor)
        terms[key] = _add(terms[key], coefficient) if key in terms else coefficient
    row.constant = constant
    row.terms = {key: value for key, value in terms.items() if not _is_zero(value)}
    row.has_cancelled |= len(row.terms) < len(terms)


def _is_state(rank: list[Rank], variable: int) -> bool:
    return rank[variable][0] == DIFFERENTIATED


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
