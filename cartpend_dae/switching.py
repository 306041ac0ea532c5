"""What a model author writes about events: relations that switch, discrete variables, clocks, `when`.

    yield when(self.s < 0, reinit(self.v, -self.e * self.v))
    yield when(sample(0.01), assign(self.held, self.u))
    yield self.f == if_else(self.s_rel < 0, self.c * self.s_rel, 0)

An event is where a relation such as ``self.s < 0`` changes: it is located exactly, and everything that depends on
it is decided again until nothing changes any more.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from cartpend_dae.collector import Clock, Relation, collector_of
from cartpend_dae.errors import ModelError
from cartpend_dae.quantities import Expression


@dataclass(frozen=True, slots=True)
class Assign:
    """A discrete variable takes a value."""

    variable: ca.SX
    value: ca.SX


@dataclass(frozen=True, slots=True)
class Reinit:
    """A state jumps to a value."""

    variable: ca.SX
    value: ca.SX


@dataclass(frozen=True, slots=True)
class Terminate:
    """The simulation ends, and the sentence says why."""

    sentence: str


@dataclass(frozen=True, slots=True)
class When:
    """What is done at the instant at which a condition becomes true."""

    condition: ca.SX
    actions: tuple[Assign | Reinit | Terminate, ...]


@dataclass(frozen=True, slots=True)
class NoEvent:
    """A condition that is evaluated continuously, without an event where it changes."""

    condition: ca.SX


def when(condition: ca.SX, *actions: Assign | Reinit | Terminate) -> When:
    """State what is done at the instant at which `condition` becomes true.

    Parameters
    ----------
    condition
        A relation such as ``self.s < 0``, relations joined by `casadi.logic_and`, `logic_or` and `logic_not`, or
        ``sample(period)``. It must have been false before.
    actions
        `assign` of discrete variables, `reinit` of states, `terminate`; all values are those before the event.

    Raises
    ------
    ModelError
        For anything else as an action, or none.
    """
    for action in actions:
        if not isinstance(action, Assign | Reinit | Terminate):
            raise ModelError(f"`when` takes `assign`, `reinit` and `terminate`, not {action!r}.")
    if not actions:
        raise ModelError("`when` needs something to do: `assign`, `reinit` or `terminate`.")
    return When(_with_relations(condition), actions)


def assign(variable: ca.SX, value: Expression) -> Assign:
    """Let a discrete variable take a value [unit of the variable].

    Inside `when` it happens once, at the event; yielded by itself it is decided anew at every event.
    """
    return Assign(_symbol("assign", variable), _scalar("assign", value))


def reinit(variable: ca.SX, value: Expression) -> Reinit:
    """Let a state jump to a value [unit of the variable]."""
    return Reinit(_symbol("reinit", variable), _scalar("reinit", value))


def terminate(condition: ca.SX, sentence: str) -> When:
    """End the simulation at the instant at which a condition becomes true; the sentence says why."""
    return When(_with_relations(condition), (Terminate(sentence),))


def pre(variable: ca.SX) -> ca.SX:
    """Return the value before the event: what `assign` and `reinit` read anyway, said aloud."""
    return _symbol("pre", variable)


def if_else(condition: ca.SX | NoEvent, value: Expression, otherwise: Expression) -> ca.SX:
    """Return `value` while a condition holds and `otherwise` while not; where it changes is an event.

    Parameters
    ----------
    condition
        A relation such as ``self.s < 0``, also joined ones, or ``noevent(relation)``, which is evaluated
        continuously: cheaper, and right where the two values join smoothly.
    value, otherwise
        Expressions of one unit.
    """
    decided = condition.condition if isinstance(condition, NoEvent) else _with_relations(condition)
    return ca.if_else(decided, _scalar("if_else", value), _scalar("if_else", otherwise))


def noevent(condition: ca.SX) -> NoEvent:
    """Mark a condition that makes no event."""
    return NoEvent(condition)


def sample(period: Expression, offset: Expression = 0.0) -> ca.SX:
    """Return a condition for `when` that is true at the times offset + k period [s], k = 0, 1, 2 and so on."""
    collector = collector_of("sample")
    pulse = ca.SX.sym("sample")
    collector.clocks.append(Clock(pulse, ca.SX(period), ca.SX(offset)))
    return pulse


def both(*conditions: ca.SX) -> ca.SX:
    """Return the condition that all hold."""
    return _joined(ca.logic_and, conditions)


def either(*conditions: ca.SX) -> ca.SX:
    """Return the condition that at least one holds."""
    return _joined(ca.logic_or, conditions)


def _joined(operation: object, conditions: Sequence[ca.SX]) -> ca.SX:
    result = ca.SX(conditions[0])
    for condition in conditions[1:]:
        result = operation(result, condition)  # type: ignore[operator]
    return result


def _symbol(what: str, variable: object) -> ca.SX:
    if not isinstance(variable, ca.SX) or not variable.is_scalar() or not variable.is_symbolic():
        raise ModelError(f"`{what}` takes a variable of a component, such as `self.v`, not {variable!r}.")
    return variable


def _scalar(what: str, value: Expression) -> ca.SX:
    if isinstance(value, ca.SX) and not value.is_scalar():
        rows, columns = value.shape
        raise ModelError(f"`{what}` takes one value, not a matrix of {rows} by {columns}: write one for each element.")
    return ca.SX(value)


def _with_relations(condition: object) -> ca.SX:
    """Return a condition with a symbol for each comparison, whose change is an event."""
    if not isinstance(condition, ca.SX) or not condition.is_scalar():
        raise ModelError(f"A condition compares expressions, such as `self.s < 0`, and is not {condition!r}.")
    operation = condition.op()
    if operation == ca.OP_LT:
        return _relation(condition.dep(0), condition.dep(1))
    if operation == ca.OP_LE:  # a <= b is not b < a
        return ca.logic_not(_relation(condition.dep(1), condition.dep(0)))
    if operation == ca.OP_NOT:
        return ca.logic_not(_with_relations(condition.dep(0)))
    if operation in (ca.OP_AND, ca.OP_OR):
        join = ca.logic_and if operation == ca.OP_AND else ca.logic_or
        return join(_with_relations(condition.dep(0)), _with_relations(condition.dep(1)))
    if operation in (ca.OP_EQ, ca.OP_NE):
        collector_of("a condition with events").equalities.append(condition)
    return condition


def _relation(left: ca.SX, right: ca.SX) -> ca.SX:
    collector = collector_of("a condition with events")
    for known in collector.relations:
        if ca.is_equal(known.left, left, 3) and ca.is_equal(known.right, right, 3):
            return known.symbol
    symbol = ca.SX.sym("relation")
    collector.relations.append(Relation(symbol, left, right))
    return symbol
