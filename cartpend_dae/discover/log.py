"""What a search has found so far."""

from dataclasses import dataclass, field

from cartpend_dae.discover.records import Candidate, Regime, Step
from cartpend_dae.discover.state import Base


@dataclass(frozen=True, slots=True)
class Uncovered:
    """A model with its first effect, and what was tried; it `is_clear` if that leaves little to random forces."""

    base: Base
    step: Step
    tried: dict[str, Candidate]
    is_clear: bool


@dataclass(slots=True)
class Log:
    """What a search has found so far, kept when it is interrupted.

    `tried` holds the last word on each candidate, most of them as `judged` in a regime; `past` are the models that it
    went through, with their steps.
    """

    steps: list[Step] = field(default_factory=list)
    tried: dict[str, Candidate] = field(default_factory=dict)
    base: Base | None = None
    judged: Regime = "noise"
    past: list[tuple[Base, list[Step]]] = field(default_factory=list)
    is_interrupted: bool = False

    def begin_with(self, seen: Uncovered | None) -> None:
        """Begin anew, with a first effect if there is one."""
        self.steps, self.base = ([], None) if seen is None else ([seen.step], seen.base)
        self.past = []
        self.tried |= {} if seen is None else seen.tried

    def back_to(self, before: "Log") -> None:
        """Let what was found before stand."""
        self.steps, self.tried, self.base = before.steps, before.tried, before.base
        self.judged, self.past = before.judged, before.past
