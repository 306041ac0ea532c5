"""The catalogue of effects that a model can lack, and their insertion into any model."""

from cartpend_dae.effects.card import Card, EffectParameter
from cartpend_dae.effects.catalogue import catalogue
from cartpend_dae.effects.insert import Insertion, insert
from cartpend_dae.effects.places import Place, places

__all__ = ["Card", "EffectParameter", "Insertion", "Place", "catalogue", "insert", "places"]
