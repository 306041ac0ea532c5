"""System -> text: what the passes did with its constraints and loops, and why each state is one."""

from collections import Counter
from collections.abc import Mapping, Sequence

import casadi as ca

from cartpend_dae.graph import structural_offsets
from cartpend_dae.quantities import STATE_SELECT
from cartpend_dae.selection import wishes
from cartpend_dae.system import Block, FlatSystem, System


def structure_report(system: System) -> str:
    """Return how a system got its states: index, differentiated constraints, loops, and what was chosen.

    Parameters
    ----------
    system
        The assembled system.
    """
    index = structural_index(system.flat)
    tied = f" tied by {system.invariants.numel()} invariants" if system.invariants.numel() else ""
    loops = [block for block in system.blocks if len(block.unknowns) > 1 or block.how == "nonlinear"]
    hints, places = _hints(system), _places(system)
    sections = [
        _listed("rigid couplings, removed with all derivatives", _couplings(system)),
        _listed("constraints differentiated", _differentiated(system, places)),
        _listed("states", [f"{name}{hints.get(name, '')}" for name in system.states]),
        _listed(
            "no states, because a constraint gives them",
            [f"{name}{hints.get(name, '')}, given by {places[origin]}" for name, origin in sorted(system.dummies)],
        ),
        _listed("invariants, kept by drawing the solution back to them", _invariants(system, places)),
        _listed("linear loops, solved symbolically", [_loop(system, b) for b in loops if b.how != "nonlinear"]),
        _listed("nonlinear loops, solved by iteration", [_loop(system, b) for b in loops if b.how == "nonlinear"]),
    ]
    head = (
        f"{system.name}: structural index {'unknown' if index is None else index} as written; "
        f"{len(system.states)} states{tied} and {len(system.algebraics) or 'no'} algebraic unknowns are left"
    )
    return "\n".join([head, *(line for section in sections for line in section)])


def structural_index(flat: FlatSystem) -> int | None:
    """Return the differentiation index of the equations as written, by structure; None if they are redundant.

    It is the largest number of differentiations, and one more if some variable appears without derivative
    (Pryce 2001, doi:10.1023/A:1021998624799); where coefficients cancel, the true index may be another.
    """
    inputs = set(flat.inputs)
    unknowns = [i for i in range(len(flat.variables)) if i not in inputs]
    column = {variable: j for j, variable in enumerate(unknowns)}
    keys = [(i, 0) for i in range(len(flat.variables))] + list(flat.derivatives)
    symbols = ca.vertcat(flat.symbols, flat.derivative_symbols)
    orders: dict[tuple[int, int], int] = {}
    for row, position in zip(*ca.jacobian_sparsity(flat.residual, symbols).get_triplet(), strict=True):
        variable, order = keys[position]
        if variable in column:
            entry = (row, column[variable])
            orders[entry] = max(order, orders.get(entry, 0))
    rows, columns = [i for i, _ in orders], [j for _, j in orders]
    try:
        counts, highest, _ = structural_offsets(
            rows, columns, list(orders.values()), [0] * len(unknowns), len(flat.origins)
        )
    except ValueError:
        return None
    return int(counts.max(initial=0)) + bool((highest == 0).any())


def _listed(title: str, lines: Sequence[str]) -> list[str]:
    return [f"{title} ({len(lines)}):", *(f"  {line}" for line in lines)] if lines else []


def _couplings(system: System) -> list[str]:
    """Return the eliminated variables whose derivatives are in the model: each took a constraint with it."""
    flat, relations = system.flat, system.aliased.relations
    moving = {i for i, _ in flat.derivatives}
    eliminated = [i for i, relation in enumerate(relations) if relation.base != i]
    return [
        line for i, line in zip(eliminated, system.eliminated, strict=True) if i in moving and relations[i].order == 0
    ]


def _differentiated(system: System, places: Mapping[str, str]) -> list[str]:
    width = max((len(places[origin]) for origin, _ in system.differentiated), default=0)
    times = {1: "once", 2: "twice"}
    return [
        f"{places[origin]:{width}}  {times.get(count, f'{count} times')}" for origin, count in system.differentiated
    ]


def _places(system: System) -> dict[str, str]:
    """Return where each equation stands, with the class of its component."""
    classes = dict(system.flat.components)
    origins = [*(origin for origin, _ in system.differentiated), *(origin for _, origin in system.dummies)]
    return {
        origin: f"{origin} ({classes[_component(origin)]})" if _component(origin) in classes else origin
        for origin in (*origins, *system.invariant_origins)
    }


def _component(origin: str) -> str:
    return origin.replace("derivative of ", "").partition(":")[0]


def _hints(system: System) -> dict[str, str]:
    """Return what was wished for the members of chains, by name."""
    return {
        system.names[key]: f' (state_select="{STATE_SELECT[wish + 2]}")'
        for key, wish in wishes(system.aliased).items()
        if key in system.names
    }


def _invariants(system: System, places: Mapping[str, str]) -> list[str]:
    held: dict[int, list[str]] = {}
    for row, column in sorted(zip(*ca.jacobian_sparsity(system.invariants, system.x).get_triplet(), strict=True)):
        held.setdefault(row, []).append(system.states[column])
    return [f"{places[origin]}, between {', '.join(held[i])}" for i, origin in enumerate(system.invariant_origins)]


def _loop(system: System, block: Block) -> str:
    classes = dict(system.flat.components)
    owners = [_component(origin) for origin in block.origins]
    counts = Counter(owner if owner in classes or owner == system.name else "connections" for owner in owners)
    equations = ", ".join(f"{count} of {owner}" for owner, count in sorted(counts.items()))
    iterated = f"; iterated: {', '.join(block.tearing) or 'none'}" if block.how == "nonlinear" else ""
    return f"{len(block.unknowns)} unknowns: {', '.join(block.unknowns)}; equations: {equations}{iterated}"
