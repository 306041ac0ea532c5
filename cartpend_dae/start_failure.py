"""Why there is no start, in the words of the model: what misses, what stands against what, what was tried."""

from itertools import islice

import casadi as ca
import numpy as np

from cartpend_dae.contradiction import culprits
from cartpend_dae.diagnose import joined_paths, with_classes
from cartpend_dae.rows import linear_rows
from cartpend_dae.start_conditions import Conditions, Rank, Request
from cartpend_dae.start_search import ranked
from cartpend_dae.start_solver import Outcome, dependence, finite_rows, first_guess, newton, shifted
from cartpend_dae.system import System
from cartpend_dae.trouble import trouble_at

MOST_TRIALS = 20
"""So many start values are tried one by one where they cannot all hold: each costs a search."""

MOST_EQUATIONS = 5000
"""Of larger models the components behind a contradiction are not searched."""


def failure_sentence(
    system: System, request: Request, conditions: Conditions, outcome: Outcome, tried: list[str]
) -> str:
    """Say what cannot hold, which start values stand against each other, and what was tried."""
    finite = finite_rows(outcome.residual, outcome.jacobian)
    wanted = conditions.ranks <= Rank.FIXED
    if not outcome.is_finite or not np.all(finite[wanted]):
        bad = [conditions.names[i] for i in np.flatnonzero(wanted & ~finite).tolist()]
        where = _trouble(system, request, conditions, outcome)
        more = f"; {where}" if where and not any(name in where for name in bad) else ""
        return (
            f"{system.name}: the start equations give no finite numbers at the guess; give start values. "
            f"Without a finite value or slope: {_listed(bad)}{more}. Tried: {_listed(tried)}."
        )
    broken = sorted(outcome.broken.tolist(), key=lambda i: -abs(outcome.residual[i]))
    missing = "; ".join(f"{conditions.names[i]} misses by {abs(outcome.residual[i]):.3g}" for i in broken[:8])
    if outcome.has_converged and request.steady and any(conditions.ranks[i] == Rank.STEADY for i in broken):
        return _no_rest(system, conditions, outcome, broken)
    conflict = _conflict(conditions, request, outcome) if broken else []
    if len(conflict) == 1:
        return (
            f"{system.name}: the start values contradict each other or the equations: {missing}. "
            f"The equations{_held_by(system, conditions, request, conflict)} alone rule out "
            f"{_value(system, conditions, request, conflict[0])}. Drop one of the two."
        )
    if conflict:
        others = _listed([conditions.names[i] for i in conflict if i not in broken])
        return (
            f"{system.name}: the start values contradict each other or the equations: {missing}. "
            f"In use already: {others}. Drop one of them. These cannot hold together with the equations"
            f"{_held_by(system, conditions, request, conflict)}: "
            f"{_listed([_value(system, conditions, request, i) for i in conflict])}."
        )
    what = "steady state" if request.steady else "consistent start"
    return (
        f"{system.name}: no {what} was found: {missing or 'the modes of dry friction do not settle'}. "
        f"Tried: {_listed(tried)}. Give start values near a solution, or check whether there is one."
    )


def _trouble(system: System, request: Request, conditions: Conditions, outcome: Outcome) -> str:
    """Name the equations behind what is not finite where a search ended."""
    n_x, n_z, n_f, _ = conditions.sizes
    p = np.array(request.p, dtype=float)
    p[list(conditions.unknown)] = outcome.point[n_x + n_z + n_f :]
    return trouble_at(system, request.time, outcome.point[:n_x], outcome.point[n_x : n_x + n_z], request.u, p)


def _no_rest(system: System, conditions: Conditions, outcome: Outcome, broken: list[int]) -> str:
    """Say which states cannot rest, and which of the others stand against that."""
    resting = [i for i in broken if conditions.ranks[i] == Rank.STEADY]
    rates = []
    for i in resting[:8]:
        name = conditions.about[i]
        unit = unit_of(system, f"der({name})")
        by = [conditions.about[k] for k in dependence(outcome, i) if conditions.ranks[k] == Rank.STEADY]
        listing = _listed([f"`{other}`" for other in by])
        why = f", while {listing} {'rest' if len(by) > 1 else 'rests'}" if by else ", whatever the start"
        rates.append(f"`{name}` changes by {outcome.residual[i]:.4g}{unit}{why}")
    keep = [f"{name!r}" for name in _able_to_rest(conditions, outcome, resting)]
    advice = f": `steady=[{_listed(keep)}]`" if keep else ""
    return (
        f"{system.name} has no steady state: {'; '.join(rates)}. Remove what drives it, or name the variables that "
        f"can rest{advice}."
    )


def _able_to_rest(conditions: Conditions, outcome: Outcome, broken: list[int]) -> list[str]:
    """Return what is left when a state on which nothing depends, the angle of a motor that turns, need not rest.

    Where there is none in a conflict, the rest that is broken is left out.
    """
    resting = np.flatnonzero(conditions.ranks == Rank.STEADY)
    slopes = abs(outcome.jacobian[np.flatnonzero(conditions.ranks <= Rank.STEADY)]).sum(axis=0)
    sizes = np.asarray(slopes).ravel()[: conditions.sizes[0]]
    idle = {row for row, size in zip(resting.tolist(), sizes.tolist(), strict=False) if size == 0}
    left: set[int] = set()
    for row in broken:
        left |= (idle & {row, *dependence(outcome, row).tolist()}) or {row}
    return [conditions.about[row] for row in resting.tolist() if row not in left]


def _conflict(conditions: Conditions, request: Request, outcome: Outcome) -> list[int]:
    """Return start values and fixed initial equations that cannot hold together, no fewer of them."""
    removable = (conditions.ranks == Rank.CALLER) | (conditions.ranks == Rank.FIXED)
    if outcome.has_converged and outcome.broken.size and removable[outcome.broken[0]]:
        row = int(outcome.broken[0])
        return [row, *(i for i in dependence(outcome, row).tolist() if removable[i])]
    suspects = np.flatnonzero(removable).tolist()
    if len(suspects) > MOST_TRIALS:
        return []
    dropped: list[int] = []
    mode = np.zeros(conditions.function.size1_in(4))
    if _is_solvable(conditions, request, mode, suspects):
        for row in suspects:
            if not _is_solvable(conditions, request, mode, [*dropped, row]):
                dropped.append(row)
        return [row for row in suspects if row not in dropped]
    return []


@np.errstate(over="ignore", invalid="ignore")
def _is_solvable(conditions: Conditions, request: Request, mode: np.ndarray, without: list[int]) -> bool:
    problem = ranked(conditions, request, mode, tuple(without))
    guess = first_guess(problem, conditions.base, Rank.CALLER)
    return any(newton(problem, point).is_solved for point in (guess, *islice(shifted(guess, conditions.scale), 4)))


def _held_by(system: System, conditions: Conditions, request: Request, conflict: list[int]) -> str:
    """Name the components whose linear equations, with the other start values, fix the first of these."""
    flat = system.flat
    if len(flat.origins) > MOST_EQUATIONS:
        return ""
    initials = {origin: flat.initials.residual[i] for i, origin in enumerate(flat.initials.origins)}
    about = [conditions.about[i] for i in conflict]
    said = [
        flat.symbols[system.index_of(name)] if name else initials[conditions.names[i]]
        for i, name in zip(conflict, about, strict=True)
    ]
    linear = [row.equation for row in linear_rows(flat)]
    found = culprits(flat, linear, said[0], ca.vertcat(*said[1:]), request.p)
    origins = [flat.origins[i] for i in found] or _upstream(system, ca.vertcat(*said))
    paths = {path for origin in origins for path in joined_paths(flat, origin)}
    return f" of {with_classes(flat, paths)}" if paths else ""


def _upstream(system: System, expressions: ca.SX) -> list[str]:
    """Return where the equations stand that give what the expressions hold, from the states on."""
    aliased = system.aliased
    row_of = {origin: i for i, origin in enumerate(aliased.origins)}
    block_of = {name: block for block in system.blocks for name in block.unknowns}
    labels = [system.names[key] for key in aliased.keys]
    used = ca.jacobian_sparsity(expressions, ca.vertcat(aliased.flat.symbols)).get_triplet()[1]
    relations = [aliased.relations[i] for i in set(used)]
    waiting = [system.names[key] for r in relations if (key := (r.base, r.order)) in system.names]
    found: dict[str, None] = {}
    while waiting:
        block = block_of.get(waiting.pop())
        if block is None or block.origins[0] in found:
            continue
        found |= dict.fromkeys(block.origins)
        rows = aliased.residual[[row_of[origin] for origin in block.origins], 0]
        waiting += [labels[k] for k in set(ca.jacobian_sparsity(rows, aliased.symbols).get_triplet()[1])]
    return list(found)


def _value(system: System, conditions: Conditions, request: Request, row: int) -> str:
    name = conditions.about[row]
    if conditions.ranks[row] != Rank.CALLER:
        return conditions.names[row]
    return f"`{name}` = {request.start[name]:g}{unit_of(system, name)}"


def unit_of(system: System, name: str) -> str:
    """Return a space and the SI unit of a variable, a parameter or a derivative `der(...)`; the unit 1 is left out."""
    inner = name.removeprefix("der(").removesuffix(")") if name.startswith("der(") else None
    if inner is not None:
        unit = unit_of(system, inner) or " 1"
        return f"{unit}2" if unit.endswith("/s") else f"{unit}/s"
    groups = zip(system.positions, (system.variables, system.parameters), strict=True)
    declared = next((group[table[name]].declaration.unit for table, group in groups if name in table), "1")
    return "" if declared == "1" else f" {declared}"


def _listed(items: list[str]) -> str:
    more = [f"and {len(items) - 8} more"] if len(items) > 8 else []
    return ", ".join([*items[:8], *more]) or "none"
