"""FlatSystem -> AliasedSystem: equations such as a = b, a = -b, a = r b, a = const disappear.

A variable with all its derivatives is a chain. Joining x = k d^j(y)/dt^j + c joins the whole chains:
s1 = r phi makes the speeds and accelerations of the two aliases too. Factors are exact fractions, or
expressions of parameters.
"""

from functools import partial

import casadi as ca

from cartpend_dae.chains import CONSTANT, DIFFERENTIATED, Chains, Merger, Rank
from cartpend_dae.contradiction import contradiction_sentences
from cartpend_dae.errors import StructureError
from cartpend_dae.hidden import hidden_rows
from cartpend_dae.rows import Row, linear_rows
from cartpend_dae.system import (
    AliasedSystem,
    Coefficient,
    FlatSystem,
    Initials,
    Relation,
    coefficient_column,
    symbolic,
)


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
    merger = Merger(
        linear_rows(flat), _ranks(flat), {*flat.inputs, *flat.hybrid.discretes}, partial(present_value, flat)
    )
    merger.join_all()
    n_used = -1
    while n_used < len(merger.used):
        n_used = len(merger.used)
        merger.replace(hidden_rows(merger.open_rows(), _not_algebraic(flat, merger.chains)))
    merger.is_symbolic = True
    merger.join_all()
    if merger.contradictions:
        others = sorted(merger.used - set(merger.redundant))
        raise StructureError(contradiction_sentences(flat, others, merger.contradictions))
    relations = tuple(merger.chains.find(i) for i in range(len(flat.variables)))
    keep = [i for i in range(len(flat.origins)) if i not in merger.used]
    rewritten = [row for row in merger.open_rows() if row.has_cancelled]
    return _substitute(flat, relations, keep, rewritten, tuple(flat.origins[i] for i in merger.redundant))


def _not_algebraic(flat: FlatSystem, chains: Chains) -> set[int]:
    """Return the bases that are inputs, or of which some derivative is named."""
    found = {chains.find(i).base for i, _ in flat.derivatives} | {*flat.inputs, *flat.hybrid.discretes}
    return found | {relation.base for i in chains.relations if (relation := chains.find(i)).order > 0}


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
    kinds = {"input": 0, "discrete": 0, "variable": 1, "output": 2, "potential": 3, "flow": 4}
    external, differentiated = {*flat.inputs, *flat.hybrid.discretes}, {i for i, _ in flat.derivatives}
    return [
        (
            -2
            if i in external
            else DIFFERENTIATED
            if i in differentiated or v.declaration.wish > 0
            else max(1, kinds[v.kind]),
            -v.declaration.wish,
            v.name.count("."),
            i,
        )
        for i, v in enumerate(flat.variables)
    ]


def _substitute(
    flat: FlatSystem, relations: tuple[Relation, ...], keep: list[int], rewritten: list[Row], redundant: tuple[str, ...]
) -> AliasedSystem:
    """Rewrite what remains in the symbols of the chains, by one substitution; `rewritten` equations are so already."""
    wanted = [(relation, 0) for relation in relations]
    wanted += [(relations[variable], order) for variable, order in flat.derivatives]
    highest: dict[int, int] = {}
    for relation, more in wanted:
        if relation.base != CONSTANT:
            highest[relation.base] = max(relation.order + more, highest.get(relation.base, 0))
    keys = tuple((base, order) for base, top in highest.items() for order in range(top + 1))
    names = [flat.variables[base].name for base, _ in keys]
    symbols = [ca.SX.sym("der(" * o + name + ")" * o) for name, (_, o) in zip(names, keys, strict=True)]
    stacked = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
    old = ca.vertcat(flat.symbols, flat.derivative_symbols)
    new = relation_values(wanted, keys, stacked)
    friction = flat.frictions
    parts = [
        flat.residual[keep, 0],
        flat.initials.residual,
        *friction.laws,
        *flat.hybrid.laws,
    ]
    residual, initials, *laws = ca.substitute(parts, [old], [new])
    at, position = {key: k for k, key in enumerate(keys)}, {equation: k for k, equation in enumerate(keep)}
    for row in rewritten:
        terms = (symbolic(value) * stacked[at[key]] for key, value in row.terms.items())
        residual[position[row.equation]] = sum(terms, symbolic(row.constant))
    return AliasedSystem(
        flat=flat,
        relations=relations,
        keys=keys,
        symbols=stacked,
        residual=residual,
        origins=tuple(flat.origins[i] for i in keep),
        frictions=friction.with_laws(laws[:5]),
        hybrid=flat.hybrid.with_laws(laws[5:]),
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
    index = [nothing if r.base == CONSTANT else position[r.base, r.order + more] for r, more in wanted]
    factors = coefficient_column([r.factor for r, _ in wanted])
    offsets = coefficient_column([r.offset if more == 0 else 0 for r, more in wanted])
    return factors * ca.vertcat(symbols, 0)[index, 0] + offsets
