"""The model so far, and how the regime fits and decides."""

from dataclasses import dataclass

import numpy as np

from cartpend_dae.discover.records import Candidate, Regime
from cartpend_dae.discover.weigh import Weighed
from cartpend_dae.discover.workbench import Stride
from cartpend_dae.effects import Insertion
from cartpend_dae.identify import Fit


@dataclass(frozen=True, slots=True)
class Base:
    """The model so far: its fits by bandwidth, the last of which decides; `bare` is chi2 without any additions.

    In the regime of random forces its last fit is `weighed` against them. `rival` is what other laws of the contact
    leave in the place of the last addition, if there are any: so much the shape of a law may matter.
    """

    taken: tuple[Insertion, ...]
    fits: dict[float, Fit]
    bare: float = 0.0
    weighed: Weighed | None = None
    rival: float | None = None

    @property
    def fit(self) -> Fit:
        """The last fit."""
        return list(self.fits.values())[-1]


@dataclass(frozen=True, slots=True)
class Rules:
    """How the regime fits and decides: `stages` of the base, the stage of screening, weights.

    Random forces may act as the `loads` do. `weighing` are the steps of the workbench on which models are weighed, and
    `alone` are the rules where noise is all that is left; what was `told` there first is fitted whatever it promises.
    """

    regime: Regime
    stages: tuple[float, ...]
    screening: float
    sd: np.ndarray
    loads: tuple[Insertion, ...] = ()
    weighing: Stride = None
    alone: "Rules | None" = None
    told: tuple[Candidate, ...] = ()

    @property
    def descent(self) -> tuple[float, ...]:
        """The stages from that of screening on: from far off a fit gets to the last one along these."""
        return tuple(w for w in self.stages if w <= self.screening)


def push_left(before: Base, after: Base) -> float:
    """Return the random forces found over those without any additions, at low frequency.

    It is infinite if unknown, as where none of them acted without additions.
    """
    if before.weighed is None or after.weighed is None:
        return np.inf
    old, new = (
        dict(zip(one.forces.names, one.forces.strengths, strict=True)) for one in (before.weighed, after.weighed)
    )
    left = {name: size for name, size in new.items() if size}
    return max((size / old[name] for name, size in left.items() if old.get(name)), default=np.inf if left else 0.0)
