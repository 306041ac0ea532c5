"""The wishes of a model for its states (`state_select`), carried from variables to chains, and their check."""

from collections.abc import Mapping

import casadi as ca

from cartpend_dae.errors import StructureError
from cartpend_dae.system import AliasedSystem, IndexedSystem

Key = tuple[int, int]


def wishes(aliased: AliasedSystem) -> dict[Key, int]:
    """Return how gladly the members of chains become states, from -2 (never) to 2 (always); others are 0.

    Of the wishes of variables that are one but for a factor, the stronger counts, and of equally strong ones the
    affirmative.

    Raises
    ------
    StructureError
        If one variable must always and another never be a state, and both are one.
    """
    found: dict[Key, tuple[int, int]] = {}
    clashes = []
    for i, (variable, relation) in enumerate(zip(aliased.flat.variables, aliased.relations, strict=True)):
        wish, key = variable.declaration.wish, (relation.base, relation.order)
        if not wish or relation.base < 0:
            continue
        before, other = found.setdefault(key, (wish, i))
        if {before, wish} == {2, -2}:
            pair = (other, i) if before == 2 else (i, other)
            always, never = (aliased.flat.variables[k].name for k in pair)
            clashes.append(f"`{always}` must always and `{never}` never be a state, but they are one but for a factor")
        if (abs(wish), wish) > (abs(before), before):
            found[key] = (wish, i)
    if clashes:
        raise StructureError(f"{aliased.flat.name}: {'; '.join(sorted(clashes))}. Change `state_select` of one.")
    return {key: wish for key, (wish, _) in found.items()}


def demanded_orders(aliased: AliasedSystem) -> dict[int, int]:
    """Return for each chain the order of derivative that must exist, so that what is always a state can be one.

    Raises
    ------
    StructureError
        If it is constant or follows from an input.
    """
    wanted: dict[int, int] = {}
    findings = []
    for variable, relation in zip(aliased.flat.variables, aliased.relations, strict=True):
        if variable.declaration.wish < 2:
            continue
        if relation.base < 0:
            findings.append(f"`{variable.name}`, because it is constant")
        elif relation.base in aliased.flat.inputs:
            source = aliased.flat.variables[relation.base].name
            findings.append(f"`{variable.name}`, because the input `{source}` gives it")
        else:
            wanted[relation.base] = max(relation.order + 1, wanted.get(relation.base, 0))
    _refuse(aliased.flat.name, "always", findings)
    return wanted


def rank(wish: Mapping[Key, int], base: int, order: int) -> int:
    """Return how gladly a chain keeps its members up to an order as states; a demand of one speaks for all."""
    found = [wish.get((base, k), 0) for k in range(order + 1)]
    for value in (-2, 2, 1, -1):
        if value in found:
            return value
    return 0


def check_demands(indexed: IndexedSystem, wish: Mapping[Key, int]) -> None:
    """Refuse a choice of states against a demand of the model.

    Parameters
    ----------
    indexed
        The system with its states.
    wish
        The wishes of its chains; see `wishes`.

    Raises
    ------
    StructureError
        Naming each variable and what stands against it.
    """
    aliased = indexed.aliased
    givers, states = dict(indexed.dummies), set(indexed.states)
    always, never = [], []
    for variable, relation in zip(aliased.flat.variables, aliased.relations, strict=True):
        key, demand = (relation.base, relation.order), variable.declaration.wish
        if demand == 2 and key not in states:
            always.append(f"`{variable.name}`, because {_why_not(givers, key, wish)}")
        elif demand == -2 and key in states:
            never.append(f"`{variable.name}`, because {_why_still(indexed, key)}")
    _refuse(aliased.flat.name, "always", always)
    _refuse(aliased.flat.name, "never", never)


def _refuse(model: str, when: str, findings: list[str]) -> None:
    if findings:
        verb = "cannot be a state" if when == "always" else "remains a state"
        raise StructureError(
            f'{model}: what was declared `state_select="{when}"` {verb}: {"; ".join(sorted(findings))}. '
            f'Declare it "{"prefer" if when == "always" else "avoid"}" to make it a wish.'
        )


def _why_not(givers: Mapping[Key, str], key: Key, wish: Mapping[Key, int]) -> str:
    if key in givers:
        return f"{givers[key]} gives it, and no other variable there can be given instead"
    below = [k for k in range(key[1]) if wish.get((key[0], k), 0) == -2]
    return "its integral is never a state" if below else "the equations give it without any integration"


def _why_still(indexed: IndexedSystem, key: Key) -> str:
    aliased = indexed.aliased
    symbol = aliased.symbols[aliased.keys.index(key)]
    kept = sorted(set(ca.jacobian_sparsity(indexed.invariants, symbol).get_triplet()[0]))
    if kept:
        origins = "; ".join(indexed.invariant_origins[i] for i in kept)
        return f"the only constraints that hold it ({origins}) have coefficients that change along the motion"
    if any(base == key[0] for base, _ in dict(indexed.dummies)):
        return "only a derivative of it is given by a constraint"
    return "no constraint that could give it is free: it follows from nothing but its own derivative"
