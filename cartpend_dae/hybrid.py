"""What a model says of events: relations that switch, discrete variables, clocks, and what is done when."""

from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca


@dataclass(frozen=True, slots=True)
class Action:
    """What is done at an event: the value of `target` (a variable of the flat model) is set, or the run ends.

    `when` is the condition that must have become true; -1 means at every event. `place` names the component.
    """

    when: int
    kind: Literal["assign", "reinit", "terminate"]
    target: int
    place: str
    sentence: str = ""


@dataclass(frozen=True, slots=True)
class Hybrid:
    """The events of a model; symbols and expressions are columns.

    Relation k is a symbol that is 1 while `differences[k]` < 0 and 0 otherwise. Pulse k is a symbol that is 1 at
    the times `offsets[k]` + n `periods[k]`. `conditions` are true or false, in these symbols and the `discretes`,
    variables that change at events only. `values` belong to `actions`. `modes[k]` is the discrete variable that shows
    the mode of dry friction k, -1 where there is none.
    """

    relations: ca.SX
    differences: ca.SX
    relation_places: tuple[str, ...]
    pulses: ca.SX
    periods: ca.SX
    offsets: ca.SX
    conditions: ca.SX
    actions: tuple[Action, ...]
    values: ca.SX
    discretes: tuple[int, ...]
    modes: tuple[int, ...]

    @property
    def is_empty(self) -> bool:
        """Whether the model has no events of its own, besides those of dry friction."""
        return not (self.relation_places or self.discretes or self.actions)

    @property
    def symbols(self) -> ca.SX:
        """What is constant between events, but for the discrete variables."""
        return ca.vertcat(self.relations, self.pulses)

    def clock_places(self, otherwise: str) -> list[str]:
        """Return for each clock a place that listens to it, `otherwise` where none does."""
        listens = ca.jacobian_sparsity(self.conditions, self.pulses)
        places = [otherwise] * self.pulses.numel()
        for condition, k in zip(*listens.get_triplet(), strict=True):
            places[k] = next((action.place for action in self.actions if action.when == condition), places[k])
        return places

    @property
    def laws(self) -> list[ca.SX]:
        """The expressions, for a pass that rewrites them."""
        return [self.differences, self.periods, self.offsets, self.conditions, self.values]

    def with_laws(self, laws: list[ca.SX]) -> "Hybrid":
        """Return the same events with rewritten expressions."""
        differences, periods, offsets, conditions, values = laws
        return replace(
            self, differences=differences, periods=periods, offsets=offsets, conditions=conditions, values=values
        )
