"""Stage 2: which effect at which place could explain the residual? One linearisation for each, no fit."""

from collections.abc import Mapping

import numpy as np

from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, Place, fits
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.shooting import Linearisation

# effects that change the residual by less than this share of their own size are invisible to these sensors
BLIND = 1e-10


def candidates(cards: tuple[Card, ...], places: tuple[Place, ...], taken: tuple[Insertion, ...]) -> list[Insertion]:
    """Return every effect at every place that fits, from each of its starts, except what the model has already."""
    names = {insertion.prefix for insertion in taken}
    fitting = [(card, place) for place in places for card in cards if fits(card, place)]
    found = [Insertion(card, place, start) for card, place in fitting for start in card.starts(place.kind)]
    return [insertion for insertion in found if insertion.prefix not in names]


def screen(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    point: Mapping[str, float],
    options: list[Insertion],
    bandwidth: float,
    sd: np.ndarray,
) -> list[Candidate]:
    """Predict for each candidate its parameters and by how much the cost would fall.

    At the fit without the effect, the cost is quadratic in all parameters to first order of the residual;
    its minimum within the bounds of the effect gives both.

    Parameters
    ----------
    bench
        The workbench.
    taken
        Effects in the model already.
    point
        Their fit: parameters and free starts by name, SI.
    options
        The candidates.
    bandwidth
        Bandwidth of the output injection of that fit [rad/s].
    sd
        Noise used as weight, shape (n_y,).

    Returns
    -------
    list
        Candidates without a fit, the most promising first; `why_not` is set where there is nothing to fit. Each
        effect stands once at a place, with the start that promises most.
    """
    found = []
    for insertion in options:
        try:
            linear = bench.linearised((*taken, insertion), point, bandwidth, sd)
            found.append(_predict(insertion, linear))
        except (ModelError, SolverError) as error:
            found.append(Candidate(insertion, insertion.starts, 0.0, 0.0, 0.0, None, f"it cannot be tried: {error}"))
    ranked = sorted(found, key=lambda candidate: (bool(candidate.why_not), -candidate.predicted))
    best: dict[str, Candidate] = {}
    for candidate in ranked:
        best.setdefault(candidate.insertion.prefix, candidate)
    return list(best.values())


def _predict(insertion: Insertion, linear: Linearisation) -> Candidate:
    names = [item.name for item in linear.variables]
    # a shape has no slope where the sizes are 0: it stays where it starts
    own = [names.index(name) for name in insertion.size_names]
    others = [i for i in range(len(names)) if i not in own]
    gram, gradient = linear.grams.sum(axis=0), linear.gradients.sum(axis=0)
    projection = np.linalg.pinv(gram[np.ix_(others, others)], hermitian=True)
    coupling = gram[np.ix_(own, others)]
    left = gram[np.ix_(own, own)] - coupling @ projection @ coupling.T
    pull = gradient[own] - coupling @ projection @ gradient[others]
    visible = np.diag(left) > BLIND * np.clip(np.diag(gram)[own], 1e-300, None)
    if not visible.any():
        why = "no sensor sees it apart from what is free already"
        return Candidate(insertion, insertion.starts, 0.0, 0.0, 0.0, None, why)
    scale = np.array([linear.variables[i].scale for i in own])
    low = np.array([linear.variables[i].lower for i in own]) / scale
    high = np.array([linear.variables[i].upper for i in own]) / scale
    size = _within(left, pull, low, high, visible)
    values = insertion.starts | dict(zip(insertion.size_names, size * scale, strict=True))
    if not size.any():
        wanted = -np.linalg.lstsq(left, pull, rcond=1e-12)[0] * scale
        values |= dict(zip(insertion.size_names, wanted, strict=True))
        why = "it would need the wrong sign: it does not oppose motion"
        return Candidate(insertion, values, 0.0, 0.0, 0.0, None, why)
    return Candidate(insertion, values, float(-pull @ size), 0.0, 0.0, None, "")


def _within(
    gram: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray, visible: np.ndarray
) -> np.ndarray:
    """Return the visible sizes with the least cost, leaving out one after the other those beyond their bounds."""
    size = np.zeros(gradient.size)
    free = visible.copy()
    while free.any():
        size[:] = 0.0
        size[free] = -np.linalg.lstsq(gram[np.ix_(free, free)], gradient[free], rcond=1e-12)[0]
        beyond = np.maximum(low - size, size - high)
        if beyond.max() <= 0:
            return size
        free[int(np.argmax(beyond))] = False
    return np.zeros(gradient.size)
