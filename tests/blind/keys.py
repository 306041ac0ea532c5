"""The name of a data set, from which everything about it follows, and its streams of random numbers."""

from dataclasses import dataclass
from hashlib import sha256
from typing import Literal, get_args

import numpy as np

from blind.catalogue import EFFECTS
from blind.rigs import RIGS

Regime = Literal["noise", "quantised", "noisy", "wrong_start", "disturbed"]
REGIMES: tuple[Regime, ...] = get_args(Regime)
OTHER_SEEDS = (1, 3)
"""Of each five seeds these have another shape than the catalogue's, where an effect has one: two fifths."""


@dataclass(frozen=True, slots=True, order=True)
class Key:
    """A data set: rig, regime, hidden effects as (effect, place), seed; `exclude` is kept from the tool."""

    rig: str
    regime: Regime
    effects: tuple[tuple[str, str], ...]
    seed: int
    exclude: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.rig not in RIGS:
            raise ValueError(f"There is no rig `{self.rig}`; the rigs are {', '.join(RIGS)}.")
        if self.regime not in REGIMES:
            raise ValueError(f"There is no regime `{self.regime}`; the regimes are {', '.join(REGIMES)}.")
        for effect, at in self.effects:
            if effect not in EFFECTS or at not in EFFECTS[effect].places.get(self.rig, ()):
                raise ValueError(f"`{effect}` at `{at}` cannot be hidden on `{self.rig}`.")

    @property
    def kind(self) -> str:
        if self.exclude:
            return "open"
        return ("none", "single", "pair", "triple")[len(self.effects)]

    @property
    def hidden(self) -> str:
        """The effects in one word."""
        return "+".join(f"{effect}@{at}" for effect, at in self.effects) or "nothing"

    @property
    def name(self) -> str:
        """A name that is safe for files."""
        mark = "open-" if self.exclude else ""
        return f"{self.rig}-{self.regime}-{mark}{self.hidden}-{self.seed}"

    def shape(self, effect: str) -> str:
        return "other" if EFFECTS[effect].other and self.seed % 5 in OTHER_SEEDS else "same"

    def stream(self, purpose: str) -> np.random.Generator:
        """Random numbers for one purpose; the truth is the same in all regimes, what is laid over it is not."""
        parts = [purpose, self.rig, self.hidden, str(self.seed)]
        if purpose != "truth":
            parts.append(self.regime)
        digest = sha256("|".join(parts).encode()).digest()
        return np.random.default_rng([int.from_bytes(digest[k : k + 4], "big") for k in range(0, 16, 4)])
