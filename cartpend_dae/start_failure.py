"""Why there is no start, in the words of the model: what misses, what stands against what, what was tried."""

from itertools import islice

import numpy as np

from cartpend_dae.start_conditions import Conditions, Rank, Request
from cartpend_dae.start_search import ranked
from cartpend_dae.start_solver import Outcome, dependence, finite_rows, first_guess, newton, shifted
from cartpend_dae.system import System

MOST_TRIALS = 20
"""So many start values are tried one by one where they cannot all hold: each costs a search."""


def failure_sentence(
    system: System, request: Request, conditions: Conditions, outcome: Outcome, tried: list[str]
) -> str:
    """Say what cannot hold, which start values stand against each other, and what was tried."""
    finite = finite_rows(outcome.residual, outcome.jacobian)
    wanted = conditions.ranks <= Rank.FIXED
    if not outcome.is_finite or not np.all(finite[wanted]):
        bad = _listed([conditions.names[i] for i in np.flatnonzero(wanted & ~finite).tolist()])
        return (
            f"{system.name}: the start equations give no finite numbers at the guess; give start values. "
            f"Without a finite value or slope: {bad}. Tried: {_listed(tried)}."
        )
    broken = sorted(outcome.broken.tolist(), key=lambda i: -abs(outcome.residual[i]))
    missing = "; ".join(f"{conditions.names[i]} misses by {abs(outcome.residual[i]):.3g}" for i in broken[:8])
    if outcome.has_converged and request.steady and any(conditions.ranks[i] == Rank.STEADY for i in broken):
        return _no_rest(system, conditions, outcome, broken)
    conflict = _conflict(conditions, request, outcome) if broken else []
    if len(conflict) == 1:
        return (
            f"{system.name}: the start values contradict each other or the equations: {missing}. "
            f"The equations alone rule out {_value(system, conditions, request, conflict[0])}. Drop one of the two."
        )
    if conflict:
        others = _listed([conditions.names[i] for i in conflict if i not in broken])
        return (
            f"{system.name}: the start values contradict each other or the equations: {missing}. "
            f"In use already: {others}. Drop one of them. These cannot hold together with the equations: "
            f"{_listed([_value(system, conditions, request, i) for i in conflict])}."
        )
    what = "steady state" if request.steady else "consistent start"
    return (
        f"{system.name}: no {what} was found: {missing or 'the modes of dry friction do not settle'}. "
        f"Tried: {_listed(tried)}. Give start values near a solution, or check whether there is one."
    )


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
    declared = [q.declaration.unit for q in (*system.variables, *system.parameters) if q.name == name]
    return f" {declared[0]}" if declared and declared[0] != "1" else ""


def _listed(items: list[str]) -> str:
    more = [f"and {len(items) - 8} more"] if len(items) > 8 else []
    return ", ".join([*items[:8], *more]) or "none"
