"""Modelica text: a model as one flat `.mo`, and flat `.mo` files as models."""

from cartpend_dae.modelica.writer import modelica_text

__all__ = ["modelica_text"]
