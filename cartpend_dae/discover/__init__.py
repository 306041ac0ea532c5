"""Closing the loop: from the residual of a model to the effect that it lacks, added and proved.

Stages, each usable by itself: `gate.residuals`, `screen.screen`, `search.search`, `prove.prove`.
"""

from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.prove import discover, prove
from cartpend_dae.discover.records import Discovery, FreeSpec, Gate, Search, Setup
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.search import search

__all__ = [
    "Discovery",
    "FreeSpec",
    "Gate",
    "Search",
    "Setup",
    "discover",
    "prove",
    "residuals",
    "screen",
    "search",
]
