"""IndexedSystem -> System: which equation gives which unknown, in which order, and the solution itself.

Blocks that are linear in
their unknowns are solved here, symbolically; of the others few unknowns remain, with as many algebraic equations.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from cartpend_dae.alias import relation_values
from cartpend_dae.errors import StructureError
from cartpend_dae.explicit import solve_explicit
from cartpend_dae.graph import blocks, matching
from cartpend_dae.linear import solve_linear
from cartpend_dae.rows import nonzeros
from cartpend_dae.singular import Key, dependence_sentence
from cartpend_dae.system import (
    AliasedSystem,
    Block,
    Coefficient,
    IndexedSystem,
    Initials,
    StateRelation,
    System,
    coefficient_column,
    is_literal,
    symbolic,
)
from cartpend_dae.tear import jumps, tear_block

# decay of a violated constraint [1/s]: fast against the drift of any tolerance, slow against the motion
RATE = 20.0


def sort(indexed: IndexedSystem) -> System:
    """Make an explicit ordinary, or a semi-explicit differential-algebraic, system of index one.

    Parameters
    ----------
    indexed
        The system with the derivatives of its constraints.

    Raises
    ------
    StructureError
        If no assignment of equations to unknowns exists; equations and unknowns are named.
    """
    aliased = indexed.aliased
    names = _names(aliased)
    table = dict(zip(aliased.keys, ca.vertsplit(aliased.symbols), strict=True)) if aliased.keys else {}
    state_keys = indexed.states
    unknowns = _stack([table[key] for key in indexed.unknowns])
    labels = [names[key] for key in indexed.unknowns]
    (given, values), made, nonlinear = _solve_blocks(aliased, indexed.unknowns, unknowns, labels)
    named = _named(aliased, indexed.unknowns, [j for _, j in nonlinear], labels)
    solved = (
        ca.vertcat(unknowns[list(named), 0], given),
        ca.vertcat(*[value for _, _, value in named.values()], values),
    )
    made = tuple(_renamed(block, {labels[j]: name for j, (name, _, _) in named.items()}) for block in made)
    ode = [table[base, lower + 1] for base, lower in state_keys]
    outputs = relation_values([(relation, 0) for relation in aliased.relations], aliased.keys, aliased.symbols)
    friction = aliased.frictions
    groups = [
        _stack(ode),
        _stack([aliased.residual[i] for i, _ in nonlinear]),
        outputs,
        aliased.initials.residual,
        indexed.invariants,
        *friction.laws,
        *aliased.hybrid.laws,
    ]
    done, parameters = _without_dependent_parameters(aliased, _back_substitute(solved, groups))
    ode_x, alg, out, initials, invariants, *laws = done
    x = _stack([table[key] for key in state_keys])
    states = tuple(names[key] for key in state_keys)
    input_names = tuple(aliased.flat.variables[i].name for i in aliased.flat.inputs)
    inputs = _known(aliased, table, aliased.flat.inputs)
    state_relations = _state_relations(aliased, state_keys)
    return System(
        name=aliased.flat.name,
        flat=aliased.flat,
        time=aliased.flat.time,
        states=states,
        x=x,
        ode=_drawn_back(ode_x, invariants, x),
        algebraics=tuple(named[j][0] if j in named else labels[j] for _, j in nonlinear),
        z=_stack([named[j][1] if j in named else unknowns[j] for _, j in nonlinear]),
        alg=alg,
        inputs=input_names,
        u=inputs,
        parameters=tuple(aliased.flat.parameters[i] for i in parameters),
        p=aliased.flat.parameter_symbols[parameters, 0],
        frictions=friction.with_laws(laws[:5]),
        hybrid=aliased.hybrid.with_laws(laws[5:]),
        d=_known(aliased, table, aliased.hybrid.discretes),
        variables=aliased.flat.variables,
        outputs=out,
        state_relations=state_relations,
        initials=Initials(initials, aliased.initials.fixed, aliased.initials.origins),
        blocks=made,
        invariants=invariants,
        invariant_origins=indexed.invariant_origins,
        dummies=tuple((names[key], origin) for key, origin in indexed.dummies),
        differentiated=indexed.differentiated,
        aliased=aliased,
        names=names,
        redundant=aliased.redundant,
    )


def _known(aliased: AliasedSystem, table: dict[tuple[int, int], ca.SX], members: tuple[int, ...]) -> ca.SX:
    """Return the symbols of inputs or discrete variables, new ones for those that no equation uses."""
    return _stack([table.get((i, 0), ca.SX.sym(aliased.flat.variables[i].name)) for i in members])


def _stack(items: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*items) if items else ca.SX(0, 1)


def _drawn_back(ode: ca.SX, invariants: ca.SX, x: ca.SX) -> ca.SX:
    """Add to the state equations what draws the solution back to its invariants, zero where they hold.

    With H the slopes of the invariants h, x' = f - RATE H'(H H')^-1 h lets h decay with RATE while f itself
    keeps it: the errors of integration no longer pile up (Ascher, Chin, Reich 1994, doi:10.1007/s002110050020).
    """
    if not invariants.numel():
        return ode
    slopes = ca.densify(ca.jacobian(invariants, x))
    return ode - RATE * slopes.T @ ca.solve(slopes @ slopes.T, invariants)


def _names(aliased: AliasedSystem) -> dict[tuple[int, int], str]:
    """Name each chain member after a variable that equals it, preferring a component's own variable."""
    names = {
        (base, order): "der(" * order + aliased.flat.variables[base].name + ")" * order for base, order in aliased.keys
    }
    best: dict[tuple[int, int], tuple[int, int, int, int]] = {}
    kinds = {"variable": 0, "output": 1, "discrete": 1, "input": 2, "potential": 3, "flow": 4}
    for index, (variable, relation) in enumerate(zip(aliased.flat.variables, aliased.relations, strict=True)):
        key = (relation.base, relation.order)
        if key not in names or not (is_literal(relation.factor, 1) and is_literal(relation.offset, 0)):
            continue
        score = (
            0 if index == relation.base else 1,
            -variable.declaration.wish,
            kinds[variable.kind],
            variable.name.count("."),
        )
        if key not in best or score < best[key]:
            best[key], names[key] = score, variable.name
    return names


def _named(
    aliased: AliasedSystem, keys: tuple[tuple[int, int], ...], wanted: list[int], labels: list[str]
) -> dict[int, tuple[str, ca.SX, ca.SX]]:
    """Find for unknowns without a name of their own, such as der(x), a variable that is a multiple of it.

    Returns its name, a symbol for it, and the unknown written in the symbol.
    """
    variables = {variable.name for variable in aliased.flat.variables}
    nameless = {keys[j]: j for j in wanted if labels[j] not in variables}
    found: dict[int, tuple[str, ca.SX, ca.SX]] = {}
    for variable, relation in zip(aliased.flat.variables, aliased.relations, strict=True):
        j = nameless.get((relation.base, relation.order))
        if j is None or j in found or isinstance(relation.factor, ca.SX) or relation.factor == 0:
            continue
        symbol = ca.SX.sym(variable.name)
        found[j] = variable.name, symbol, (symbol - symbolic(relation.offset)) / symbolic(relation.factor)
    return found


def _renamed(block: Block, names: dict[str, str]) -> Block:
    unknowns, tearing = (tuple(names.get(name, name) for name in group) for group in (block.unknowns, block.tearing))
    return replace(block, unknowns=unknowns, tearing=tearing)


def _solve_blocks(
    aliased: AliasedSystem, unknown_keys: Sequence[Key], unknowns: ca.SX, labels: list[str]
) -> tuple[tuple[ca.SX, ca.SX], tuple[Block, ...], list[tuple[int, int]]]:
    """Solve block by block; return unknowns and values in order, the blocks, and (equation, unknown) left over."""
    jacobian = ca.jacobian(aliased.residual, unknowns)
    rows, columns = (list(part) for part in jacobian.sparsity().get_triplet())
    match = matching(rows, columns, (len(aliased.origins), len(labels)))
    _check_matching(aliased, labels, match)
    varying = _varying_entries(aliased.residual, jacobian, unknowns)
    explicit: list[tuple[int, int]] = []
    solutions: list[tuple[list[int], ca.SX]] = []
    sequence: list[list[int]] = []
    made: list[Block] = []
    nonlinear: list[tuple[int, int]] = []
    for equations in blocks(rows, columns, match):
        own = [int(match[i]) for i in equations]
        names = tuple(labels[j] for j in own)
        origins = tuple(aliased.origins[i] for i in equations)
        inside = set(own)
        if any(column in inside and other in inside for i in equations for column, other in varying.get(i, ())):
            torn = tear_block(aliased.residual[equations], unknowns[own])
            nonlinear += [(equations[i], own[j]) for i, j in zip(torn.equations, torn.unknowns, strict=True)]
            kept = tuple(names[j] for j in torn.unknowns), tuple(origins[i] for i in torn.equations)
            made.append(Block(names, origins, "nonlinear", *kept))
            sequence.append([own[j] for j, _ in torn.definitions])
            solutions += [(sequence[-1], ca.vertcat(*[value for _, value in torn.definitions]))]
            continue
        sequence.append(own)
        made.append(Block(names, origins, "explicit" if len(own) == 1 else "linear"))
        if len(own) == 1:
            explicit.append((equations[0], own[0]))
            continue
        constant = ca.substitute(aliased.residual[equations], unknowns[own], ca.SX.zeros(len(own)))
        try:
            solutions.append((own, solve_linear(jacobian[equations, own], -constant, names)))
        except StructureError as error:
            keys = [unknown_keys[j] for j in own]
            sentence = dependence_sentence(aliased, equations, keys, dict(zip(keys, names, strict=True)))
            raise StructureError(sentence) from error
    solutions.append(([j for _, j in explicit], solve_explicit(aliased.residual, unknowns, jacobian, explicit)))
    place = {j: k for k, j in enumerate(j for solved, _ in solutions for j in solved)}
    order = [j for own in sequence for j in own]
    values = ca.vertcat(*[value for _, value in solutions])[[place[j] for j in order], 0]
    return (unknowns[order, 0], values), tuple(made), nonlinear


def _check_matching(aliased: AliasedSystem, labels: list[str], match: np.ndarray) -> None:
    lonely = [aliased.origins[i] for i in np.flatnonzero(match < 0)]
    orphans = sorted(set(range(len(labels))) - set(match.tolist()))
    if not lonely and not orphans:
        return
    raise StructureError(
        f"{aliased.flat.name} is structurally singular: "
        f"{len(aliased.origins)} equations remain for {len(labels)} unknowns. "
        f"No unknown is left for: {'; '.join(sorted(lonely)) or 'none'}. "
        f"No equation gives: {', '.join(f'`{labels[j]}`' for j in orphans) or 'none'}. "
        f"The model had a solution before its constraints were differentiated: look for a constraint "
        f"that follows from others, and remove one of them."
    )


def _varying_entries(residual: ca.SX, jacobian: ca.SX, unknowns: ca.SX) -> dict[int, set[tuple[int, int]]]:
    """Return for each equation the pairs (a, b) of unknowns where the coefficient of a depends on b."""
    found: dict[int, set[tuple[int, int]]] = defaultdict(set)
    for row, column in jumps(residual, unknowns):
        found[row].add((column, column))
    if not jacobian.nnz():
        return found
    rows, columns = jacobian.sparsity().get_triplet()
    entries, of = ca.jacobian_sparsity(nonzeros(jacobian), unknowns).get_triplet()
    for entry, other in zip(entries, of, strict=True):
        found[rows[entry]].add((columns[entry], other))
    return found


def _back_substitute(definitions: tuple[ca.SX, ca.SX], groups: list[ca.SX]) -> list[ca.SX]:
    """Write all groups in states, inputs and parameters; symbols and values stand in order of solution."""
    symbols, values = definitions
    if not symbols.numel():
        return groups
    _, done = ca.substitute_inplace([symbols], [values], groups)
    return list(done)


def _without_dependent_parameters(aliased: AliasedSystem, groups: list[ca.SX]) -> tuple[list[ca.SX], list[int]]:
    """Replace parameters that are bound to expressions; parents come first, so their order is right."""
    flat = aliased.flat
    independent = [i for i, q in enumerate(flat.parameters) if q.value is not None]
    dependent = [i for i, q in enumerate(flat.parameters) if q.value is None]
    bound = (flat.parameter_symbols[dependent, 0], flat.parameter_bindings[dependent, 0])
    return _back_substitute(bound, groups), independent


def _state_relations(aliased: AliasedSystem, state_keys: tuple[tuple[int, int], ...]) -> dict[str, StateRelation]:
    position = {key: k for k, key in enumerate(state_keys)}
    coefficients: list[Coefficient] = []
    found: list[tuple[str, int]] = []
    for variable, relation in zip(aliased.flat.variables, aliased.relations, strict=True):
        key = (relation.base, relation.order)
        if key in position:
            found.append((variable.name, position[key]))
            coefficients += [relation.factor, relation.offset]
    if not found:
        return {}
    values, _ = _without_dependent_parameters(aliased, [coefficient_column(coefficients)])
    elements = ca.vertsplit(values[0])
    return {name: StateRelation(state, elements[2 * k], elements[2 * k + 1]) for k, (name, state) in enumerate(found)}
