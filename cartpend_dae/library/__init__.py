"""Components of mechanics, circuits and signals; ordinary ones, as a user would write them."""

from cartpend_dae.library import (
    controllers,
    converters,
    electrical,
    electrical_sources,
    friction,
    machines,
    planar,
    rotational,
    rotational_friction,
    rotational_parts,
    rotational_sources,
    signals,
    thermal,
    translational,
    translational_parts,
    translational_sources,
)

__all__ = [
    "controllers",
    "converters",
    "electrical",
    "electrical_sources",
    "friction",
    "machines",
    "planar",
    "rotational",
    "rotational_friction",
    "rotational_parts",
    "rotational_sources",
    "signals",
    "thermal",
    "translational",
    "translational_parts",
    "translational_sources",
]
