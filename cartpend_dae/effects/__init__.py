"""The catalogue of effects that a model can lack, and their insertion into any model."""

from cartpend_dae.effects.card import Card, EffectParameter, choice, level, shape, size
from cartpend_dae.effects.catalogue import catalogue
from cartpend_dae.effects.insert import Insertion, insert
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
    "level",
    "places",
    "shape",
    "size",
]
