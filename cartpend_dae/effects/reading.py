"""A model as the search for places reads it: what its variables follow, and which way each of them moves."""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from cartpend_dae.alias import alias
from cartpend_dae.flatten import flatten
from cartpend_dae.language import Component
from cartpend_dae.system import AliasedSystem, Coefficient, Relation, symbolic

# a direction in the space of what moves: (chain and order, factor) of each
Motion = tuple[tuple[tuple[int, int], float], ...]


@dataclass(frozen=True, slots=True)
class Reading:
    """The aliased model, and how to read it: variables by name, and the values of coefficients."""

    aliased: AliasedSystem
    position_of: dict[str, int]
    number: Callable[[Coefficient], float]

    def relation(self, name: str) -> Relation:
        """Return what a variable follows."""
        return self.aliased.relations[self.position_of[name]]


def read(model: Component) -> Reading:
    """Return a model as the search for places reads it; errors are those of `flatten` and `alias`."""
    aliased = alias(flatten(model))
    return Reading(aliased, {v.name: i for i, v in enumerate(aliased.flat.variables)}, _evaluation(aliased))


def _evaluation(aliased: AliasedSystem) -> Callable[[Coefficient], float]:
    """Return a function that gives the value of a coefficient at the present parameters."""
    symbols, values = aliased.flat.parameter_symbols, aliased.flat.parameter_bindings
    while ca.symvar(values):  # bindings are expressions of parents' parameters, a tree of finite depth
        values = ca.substitute(values, symbols, aliased.flat.parameter_bindings)
    return lambda coefficient: float(ca.substitute(symbolic(coefficient), symbols, values))


def motion_of(b: Relation | None, a: Relation | None, number: Callable[[Coefficient], float]) -> Motion:
    """Return the relative position b - a as a direction in the space of chains; empty if it is constant."""
    terms: dict[tuple[int, int], float] = {}
    for relation, sign in ((b, 1.0), (a, -1.0)):
        if relation is not None and relation.base >= 0:
            key = (relation.base, relation.order)
            terms[key] = terms.get(key, 0.0) + sign * number(relation.factor)
    left = sorted((key, value) for key, value in terms.items() if abs(value) > 1e-12)
    return tuple((key, round(value / left[0][1], 9)) for key, value in left)
