"""Gathered -> Hybrid: the conditions, clocks and actions of all components, with their targets."""

import casadi as ca

from cartpend_dae.collector import Collector
from cartpend_dae.gathered import Gathered
from cartpend_dae.hybrid import Action, Hybrid
from cartpend_dae.switching import Assign, Terminate, When


def hybrid_of(tables: Gathered, collector: Collector) -> Hybrid:
    """Return the events of a model; what is wrong with them is added to the findings.

    Parameters
    ----------
    tables, collector
        What was gathered on the walk through the components.
    """
    conditions: list[ca.SX] = []
    actions: list[Action] = []
    values: list[ca.SX] = []
    for place, statement in tables.whens:
        if isinstance(statement, When):
            conditions.append(statement.condition)
            _check_condition(tables, collector, place, statement.condition)
        for action in statement.actions if isinstance(statement, When) else (statement,):
            number = len(conditions) - 1 if isinstance(statement, When) else -1
            if isinstance(action, Terminate):
                actions.append(Action(number, "terminate", -1, place, action.sentence))
                values.append(ca.SX(0))
                continue
            target = tables.variable_of.get(action.variable.element_hash(), (-1, None))[0]
            kind = "assign" if isinstance(action, Assign) else "reinit"
            _check_target(tables, place, kind, target, action.variable)
            actions.append(Action(number, kind, target, place))
            values.append(action.value)
    _check_equalities(tables, collector)
    discretes = tuple(i for i, variable in enumerate(tables.variables) if variable.kind == "discrete")
    modes = tuple(_mode_of(tables, friction.mode) for friction in (collector.frictions[i] for _, i in tables.frictions))
    _check_assigned(tables, discretes, {a.target for a in actions if a.kind == "assign"} | set(modes))
    return Hybrid(
        relations=_stack([relation.symbol for relation in collector.relations]),
        differences=_stack([relation.left - relation.right for relation in collector.relations]),
        relation_places=tuple(tables.relation_places),
        pulses=_stack([clock.pulse for clock in collector.clocks]),
        periods=_stack([clock.period for clock in collector.clocks]),
        offsets=_stack([clock.offset for clock in collector.clocks]),
        conditions=_stack(conditions),
        actions=tuple(actions),
        values=_stack(values),
        discretes=discretes,
        modes=modes,
    )


def _stack(items: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*items) if items else ca.SX(0, 1)


def _mode_of(tables: Gathered, mode: ca.SX | None) -> int:
    return -1 if mode is None else tables.variable_of[mode.element_hash()][0]


def _check_equalities(tables: Gathered, collector: Collector) -> None:
    """Refuse to ask whether what changes between events equals a value: it does at single instants, if at all."""
    for place, condition in zip(tables.equality_places, collector.equalities, strict=True):
        if moving := _moving(tables, collector, condition):
            tables.findings.append(
                f"The condition `{condition}` in `{place}` asks whether {', '.join(moving)} equals a value: it does "
                f"so at single instants that no step meets; compare by `<`, `<=`, `>` or `>=`."
            )


def _moving(tables: Gathered, collector: Collector, condition: ca.SX) -> list[str]:
    """Return what a condition depends on that changes between events."""
    moving = []
    for symbol in ca.symvar(condition):
        known = tables.variable_of.get(symbol.element_hash())
        is_time = symbol.element_hash() == collector.time.element_hash()
        # a signal may carry a clock; whether it does is seen once the equations are solved
        if is_time or (known is not None and tables.variables[known[0]].kind in ("variable", "potential", "flow")):
            moving.append(f"`{symbol.name()}`")
    return sorted(moving)


def _check_condition(tables: Gathered, collector: Collector, place: str, condition: ca.SX) -> None:
    """Refuse a condition on what changes between events but by a comparison whose change can be located."""
    moving = _moving(tables, collector, condition)
    if moving:
        tables.findings.append(
            f"The condition `{condition}` of `when` in `{place}` depends on {', '.join(moving)} outside of a "
            f"comparison, so that no event tells when it becomes true: compare by `<`, `<=`, `>` or `>=`."
        )


def _check_target(tables: Gathered, place: str, kind: str, target: int, variable: ca.SX) -> None:
    if target < 0:
        tables.findings.append(f"`{kind}` in `{place}` names `{variable}`, which is no variable of the model.")
    elif kind == "assign" and tables.variables[target].kind != "discrete":
        tables.findings.append(
            f"`assign` in `{place}` names `{tables.variables[target].name}`, which is no discrete variable: declare it "
            f"by `discrete(unit=...)`, or let a state jump by `reinit`."
        )
    elif kind == "reinit" and tables.variables[target].kind == "discrete":
        tables.findings.append(
            f"`reinit` in `{place}` names the discrete variable `{tables.variables[target].name}`: use `assign`."
        )


def _check_assigned(tables: Gathered, discretes: tuple[int, ...], assigned: set[int]) -> None:
    for i in discretes:
        if i not in assigned:
            name = tables.variables[i].name
            tables.findings.append(
                f"The discrete variable `{name}` is assigned nowhere: `yield when(..., assign(...))`, or make it a "
                f"parameter."
            )
