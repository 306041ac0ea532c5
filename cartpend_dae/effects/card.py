"""What the catalogue knows of an effect besides its equations."""

from dataclasses import dataclass
from typing import Literal

from cartpend_dae.language import Component, Port


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A parameter of an effect by kind of port: its name, bounds in SI, and that it is zero without effect."""

    names: dict[type[Port] | None, str]
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class Card:
    """One effect of the catalogue; its equations are those of ordinary library components.

    `components` gives the component for each class of port (None: a measured signal). `insertion` says
    where it goes: parallel between two flanges, or between a model output and its sensor.
    """

    id: str
    summary: str
    insertion: Literal["parallel", "sensor"]
    components: dict[type[Port] | None, type[Component]]
    parameters: tuple[EffectParameter, ...]
    dissipative: bool
    nested_in: tuple[str, ...]
    equivalent_to: tuple[str, ...]
    regressors: tuple[str, ...]
    excited_by: str
    source: str
