"""The catalogue of effects that a model can lack, and their insertion into any model."""

from cartpend_dae.effects.card import (
    Card,
    EffectParameter,
    choice,
    instant,
    level,
    shape,
    size,
    step,
    teeth,
    wave_number,
)
from cartpend_dae.effects.catalogue import catalogue
from cartpend_dae.effects.insert import Insertion, insert, insert_all, insertion_at
from cartpend_dae.effects.places import Place, fits, places

__all__ = [
    "Card",
    "EffectParameter",
    "Insertion",
    "Place",
    "catalogue",
    "choice",
    "fits",
    "insert",
    "insert_all",
    "insertion_at",
    "instant",
    "level",
    "places",
    "shape",
    "size",
    "step",
    "teeth",
    "wave_number",
]
