"""Closing the loop: from the residual of a model to the effect that it lacks, added and proved.

Stages, each usable by itself on a `Workbench`, with data handed between them: `residuals`, `localize`, `screen`,
`search` or `refit`, `open_set`, `splits`, `rates` and `prove`; `discover` does them all.
"""

from cartpend_dae.discover.closure import Reach, closure_at, train, weights
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.localize import localize
from cartpend_dae.discover.open_set import OpenSet, open_set
from cartpend_dae.discover.prove import Beyond, Discovery, discover, prove
from cartpend_dae.discover.rates import Rate, rates
from cartpend_dae.discover.records import FreeSpec, Gate, Search, Setup
from cartpend_dae.discover.refit import refit
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.search import search
from cartpend_dae.discover.split import Split, splits
from cartpend_dae.discover.store import Store, store_for
from cartpend_dae.discover.workbench import Workbench

__all__ = [
    "Beyond",
    "Discovery",
    "FreeSpec",
    "Gate",
    "OpenSet",
    "Rate",
    "Reach",
    "Search",
    "Setup",
    "Split",
    "Store",
    "Workbench",
    "closure_at",
    "discover",
    "localize",
    "open_set",
    "prove",
    "rates",
    "refit",
    "residuals",
    "screen",
    "search",
    "splits",
    "store_for",
    "train",
    "weights",
]
