"""Stage 2: which effect at which place could explain the residual? One linearisation for each, no fit."""

from collections.abc import Mapping

import numpy as np

from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, Place
from cartpend_dae.shooting import Linearisation

# effects that change the residual by less than this share of their own size are invisible to these sensors
BLIND = 1e-10


def candidates(cards: tuple[Card, ...], places: tuple[Place, ...], taken: tuple[Insertion, ...]) -> list[Insertion]:
    """Return every effect at every place that fits it, except what is in the model already."""
    names = {insertion.prefix for insertion in taken}
    found = []
    for place in places:
        for card in cards:
            is_sensor = place.kind is None
            if is_sensor != (card.insertion == "sensor") or place.kind not in card.components:
                continue
            insertion = Insertion(card, place)
            if insertion.prefix not in names:
                found.append(insertion)
    return found


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
        Candidates without a fit, the most promising first; `why_not` is set where there is nothing to fit.
    """
    found = []
    for insertion in options:
        linear = bench.linearised((*taken, insertion), point, bandwidth, sd)
        found.append(_predict(insertion, linear))
    return sorted(found, key=lambda candidate: (bool(candidate.why_not), -candidate.predicted))


def _predict(insertion: Insertion, linear: Linearisation) -> Candidate:
    names = [item.name for item in linear.variables]
    own = [names.index(name) for name in insertion.parameter_names]
    others = [i for i in range(len(names)) if i not in own]
    gram, gradient = linear.grams.sum(axis=0), linear.gradients.sum(axis=0)
    projection = np.linalg.pinv(gram[np.ix_(others, others)], hermitian=True)
    coupling = gram[np.ix_(own, others)]
    left = gram[np.ix_(own, own)] - coupling @ projection @ coupling.T
    pull = gradient[own] - coupling @ projection @ gradient[others]
    visible = np.diag(left) > BLIND * np.clip(np.diag(gram)[own], 1e-300, None)
    nothing = dict.fromkeys(insertion.parameter_names, 0.0)
    if not visible.all():
        why = "no sensor sees it apart from what is free already"
        return Candidate(insertion, nothing, 0.0, 0.0, 0.0, None, why)
    size = -np.linalg.solve(left, pull)
    scale = np.array([linear.variables[i].scale for i in own])
    values = dict(zip(insertion.parameter_names, size * scale, strict=True))
    low = np.array([linear.variables[i].lower for i in own])
    high = np.array([linear.variables[i].upper for i in own])
    if np.any(size * scale < low) or np.any(size * scale > high):
        return Candidate(
            insertion, values, 0.0, 0.0, 0.0, None, "it would need the wrong sign: it does not oppose motion"
        )
    return Candidate(insertion, values, float(-pull @ size), 0.0, 0.0, None, "")
