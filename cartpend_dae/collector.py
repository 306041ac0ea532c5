"""What `der`, `time` and `dry_friction` note while the equations of a model are collected."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

import casadi as ca

from cartpend_dae.errors import ModelError


@dataclass(frozen=True, slots=True)
class DryFriction:
    """A set-valued force: `level_pos` or `-level_neg` while sliding, up to the static levels while stuck.

    `mode` is the discrete variable that shows -1, 0 (stuck), 1 or 2 (free); None where it is not asked for.
    """

    force: ca.SX
    speed: ca.SX
    level_pos: ca.SX
    level_neg: ca.SX
    static_pos: ca.SX
    static_neg: ca.SX
    mode: ca.SX | None = None


@dataclass(frozen=True, slots=True)
class Relation:
    """A symbol that is 1 while left < right, and 0 otherwise."""

    symbol: ca.SX
    left: ca.SX
    right: ca.SX


@dataclass(frozen=True, slots=True)
class Clock:
    """A symbol that is 1 at the times offset + n period [s]."""

    pulse: ca.SX
    period: ca.SX
    offset: ca.SX


@dataclass(slots=True)
class Collector:
    """Derivatives, dry frictions, relations, clocks and comparisons by ``==`` and ``!=``, in order of first use.

    `derivatives` maps the element hash of a symbol to (symbol, its derivative); `rates` are those of clocks that run
    wrong.
    """

    time: ca.SX
    derivatives: dict[int, tuple[ca.SX, ca.SX]] = field(default_factory=dict)
    frictions: list[DryFriction] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)
    clocks: list[Clock] = field(default_factory=list)
    equalities: list[ca.SX] = field(default_factory=list)
    rates: list[ca.SX] = field(default_factory=list)


_collector: ContextVar[Collector] = ContextVar("collector")


@contextmanager
def collecting(collector: Collector) -> Iterator[Collector]:
    """Make `collector` the one that `der`, `time` and `dry_friction` write to."""
    token = _collector.set(collector)
    try:
        yield collector
    finally:
        _collector.reset(token)


def collector_of(what: str) -> Collector:
    """Return the collector in use; `what` needs it.

    Raises
    ------
    ModelError
        Outside of `equations`.
    """
    try:
        return _collector.get()
    except LookupError:
        raise ModelError(f"`{what}` has a meaning inside `equations` only, while a model is assembled.") from None
