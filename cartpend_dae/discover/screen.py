"""Stage 2: which effect at which place could explain the residual? One linearisation for all, no fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from cartpend_dae.discover.contact import is_dry, moves_alike
from cartpend_dae.discover.disturbed import is_composite, predictions
from cartpend_dae.discover.probe import At, Judged, probed, problem_of
from cartpend_dae.discover.records import Candidate, Prediction
from cartpend_dae.discover.slopes import basis_of
from cartpend_dae.discover.sweep import Sweep, batches
from cartpend_dae.discover.weigh import Weighed
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, Place, fits
from cartpend_dae.errors import UNSOLVED
from cartpend_dae.parallel import in_parallel

# squared sine of the angle between what an effect changes and what is free already, below which no sensor sees it:
# one linearisation for all effects turns directions by up to 1e-3
BLIND = 1e-6
# another start that promises this share of the best one is tried as well
NEAR = 0.8
# what promises less than this share of the best is not judged alone, if it is a wave or does several things at once:
# their predictions mostly hold even where they change between two samples (in ten searches on tuning seeds the least
# were a third of what they are alone; those of a gap are a thousandth)
SLIGHT = 0.02
# so many effects are judged along one simulation
TOGETHER = 30
# what promises less than this share of what is left promises nothing but rounding
ROUNDING = 1e-14
UNSEEN = "no sensor sees it apart from what is free already"


def candidates(cards: tuple[Card, ...], places: tuple[Place, ...], taken: tuple[Insertion, ...]) -> list[Insertion]:
    """Return every effect at every place that fits, from each of its starts, except what the model has already.

    A contact has one law of dry friction: where the model has one, another is no addition. All waves are tried along
    the simulation from the first start of their numbers.
    """
    names = {insertion.prefix for insertion in taken}
    rubbing = [insertion.place for insertion in taken if is_dry(insertion.card)]
    rubbed = [place for place in places if any(moves_alike(place, other) for other in rubbing)]
    fitting = [(card, place) for place in places for card in cards if fits(card, place)]
    fitting = [(card, place) for card, place in fitting if not (is_dry(card) and place in rubbed)]
    found = [Insertion(card, place, start) for card, place in fitting for start in _starts(card, place)]
    return [insertion for insertion in found if insertion.prefix not in names]


def _starts(card: Card, place: Place) -> list[dict[str, float]]:
    """Return the starts of a card with the first number of each of its waves."""
    first = {item.names[place.kind]: item.starts_at(place.kind)[0] for item in card.parameters if item.role == "wave"}
    return [start for start in card.starts(place.kind) if all(start[name] == first[name] for name in first)]


def screen(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    point: Mapping[str, float],
    options: list[Insertion],
    bandwidth: float,
    sd: np.ndarray,
    *,
    weighed: Weighed | None = None,
) -> list[Candidate]:
    """Predict for each candidate its parameters and by how much the cost would fall.

    At the fit without the effect, the cost is quadratic in all sizes to first order of the residual; its minimum
    within the bounds of the effect gives both. Shapes have no slope where the sizes are 0: each start is tried.

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
    weighed
        That fit against random forces, which candidates must explain better than; None leaves it at noise.

    Returns
    -------
    list
        Candidates without a fit, the most promising first; `why_not` is set where there is nothing to fit. Each
        effect stands once at a place, with the start that promises most; the next best is among its `others` if it
        promises about as much, as a fit may end elsewhere from there.
    """
    return Screening(At(bench, taken, point, bandwidth, sd, weighed), options).found()


@dataclass(frozen=True)
class Screening:
    """A screening of effects at a fit: what one simulation tells comes first, and is kept for the screening of all."""

    at: At
    options: list[Insertion]

    @cached_property
    def batches(self) -> list[tuple[Insertion, ...]]:
        """The effects in groups that one simulation tells of; the first one has one start of each."""
        return batches(self.options)

    @cached_property
    def first(self) -> list["_Batch"]:
        """What a simulation tells of the first group, which takes longest, as better shapes are looked for in it."""
        return _swept(self.at, self.batches[:1], with_shapes=True)

    @cached_property
    def better(self) -> list["_Batch"]:
        """What the first group does from those better shapes, such as other waves."""
        again = [option for batch in self.first for option in batch.again]
        return _swept(self.at, batches(again), with_shapes=False)

    @property
    def depends(self) -> tuple[Any, ...]:
        """All that it depends on besides the study."""
        at, weighed = self.at, self.at.weighed
        names = tuple(option.content for option in (*at.taken, *self.options))
        against = None if weighed is None else (weighed.linear, weighed.bandwidth, weighed.forces)
        trail = None if weighed is None or weighed.trail is None else weighed.trail.content
        return names, len(at.taken), dict(at.point), at.bandwidth, at.sd, against, trail

    @property
    def promise(self) -> float:
        """By how much the cost would fall with the best of the effects that one simulation tells of, from one start."""

        def most() -> float:
            smooth = (c for b in self.first for c, _ in b.judged if b.rough.isdisjoint(c.insertion.size_names))
            return max((c.predicted for c in smooth if not c.why_not), default=0.0)

        return self.at.bench.store.recall("promise", self.depends, most)

    @property
    def glance(self) -> float:
        """By how much with the best from better shapes as well, and of those whose predictions may be rough."""

        def most() -> float:
            judged = (c for b in (*self.first, *self.better) for c, _ in b.judged if not c.why_not)
            return max((c.predicted for c in judged), default=0.0)

        return self.at.bench.store.recall("glance", self.depends, most)

    def found(self) -> list[Candidate]:
        """Return all candidates, the most promising first; see `screen`."""
        kept = self.at.bench.store.recall("screen", self.depends, self._kept)
        chosen = [replace(self.options[p.number], values=p.values) for p in kept]
        found = [
            Candidate(option, p.parameters, p.predicted, 0.0, 0.0, None, p.why_not, p.response)
            for option, p in zip(chosen, kept, strict=True)
        ]
        ranked = sorted(found, key=lambda candidate: (bool(candidate.why_not), -candidate.predicted))
        best: dict[str, Candidate] = {}
        for candidate in ranked:
            first = best.setdefault(candidate.insertion.prefix, candidate)
            is_near = not candidate.why_not and candidate.predicted > NEAR * first.predicted
            if candidate is not first and is_near and not first.others:
                best[candidate.insertion.prefix] = replace(first, others=(candidate,))
        return list(best.values())

    def _kept(self) -> list[Prediction]:
        """Screen all, as it can be kept on disk."""
        at = self.at
        rest = _swept(at, self.batches[1:], with_shapes=True)
        again = [option for batch in rest for option in batch.again]
        done = [*self.first, *rest, *self.better, *_swept(at, batches(again), with_shapes=False)]
        found = _told(at, done)
        if further := _corrected(found):
            found += _told(at, _swept(at, batches(further), with_shapes=False), found)
        named = {option.prefix: k for k, option in enumerate(self.options)}
        return [
            Prediction(
                named[c.insertion.prefix], dict(c.insertion.values), c.parameters, c.predicted, c.why_not, c.response
            )
            for c in found
        ]


def _told(at: At, done: list["_Batch"], before: Sequence[Candidate] = ()) -> list[Candidate]:
    """Return what was judged in batches as it promises, as beside what promises something `before`."""
    pairs = _settled(at, done)
    if at.weighed is not None:
        return predictions(pairs, at.weighed)
    return probed(at, pairs, frozenset(chain.from_iterable(batch.moving for batch in done)), before)


def _corrected(found: list[Candidate]) -> list[Insertion]:
    """Return the effects from the other starts of what corrects their laws.

    Where the law itself is what is free already, as the gain of a sensor is, what corrects it may be seen.
    """
    return [
        replace(c.insertion, values={**c.insertion.values, item.names[c.insertion.place.kind]: start})
        for c in found
        if c.why_not in ("", UNSEEN)
        for item in c.insertion.card.parameters
        if item.corrects
        for start in item.starts_at(c.insertion.place.kind)[1:]
    ]


def _swept(at: At, batches: list[tuple[Insertion, ...]], *, with_shapes: bool) -> list["_Batch"]:
    """Judge batches, in parts that take about as long as one another."""
    parts = [part for batch in batches for part in _parts(batch)]
    return list(in_parallel(lambda part: _screened(at, part, with_shapes), parts, jobs=at.bench.jobs))


def _parts(batch: tuple[Insertion, ...]) -> list[tuple[Insertion, ...]]:
    number = -(-len(batch) // TOGETHER)
    return [batch[k::number] for k in range(number)]


def _settled(at: At, done: list["_Batch"]) -> list[Judged]:
    """Return what was judged in batches, where those too fast for that are judged alone."""
    least = SLIGHT * max((c.predicted for batch in done for c, _ in batch.judged), default=0.0)
    kept: list[Judged] = []
    alike: dict[str, list[Insertion]] = {}
    for batch in done:
        for pair in batch.judged:
            candidate, _ = pair
            is_fast = not batch.rough.isdisjoint(candidate.insertion.size_names)
            if is_fast and not (_is_followed(candidate) and candidate.predicted < least):
                alike.setdefault(problem_of(candidate.insertion), []).append(candidate.insertion)
            else:
                kept.append(pair)
    # those of several starts first: they take longest
    groups = sorted(alike.values(), key=len, reverse=True)
    alone = in_parallel(lambda these: _alone(at, these), groups, jobs=at.bench.jobs)
    return [*kept, *chain.from_iterable(alone)]


def _is_followed(candidate: Candidate) -> bool:
    """Return whether a prediction holds even for what changes between two samples."""
    insertion = candidate.insertion
    return any(item.role in ("wave", "teeth") for item in insertion.card.parameters) or is_composite(insertion)


@dataclass(frozen=True, slots=True)
class _Batch:
    """What was judged together: each candidate and what its sizes change, by name; sizes that are too `rough` for that.

    `again` are effects from better shapes, and `moving` prefixes of those with a motion of their own.
    """

    judged: list[Judged]
    again: tuple[Insertion, ...] = ()
    rough: frozenset[str] = frozenset()
    moving: frozenset[str] = frozenset()


def _screened(at: At, batch: tuple[Insertion, ...], with_shapes: bool) -> _Batch:
    """Judge a batch together, and halves where something cannot be simulated."""
    try:
        found = at.sweep(batch, with_shapes)
    except UNSOLVED as error:
        if len(batch) == 1:
            return _Batch([_untried(batch[0], error)])
        half = len(batch) // 2
        one, other = (_screened(at, part, with_shapes) for part in (batch[:half], batch[half:]))
        both = one.rough | other.rough, one.moving | other.moving
        return _Batch(one.judged + other.judged, one.again + other.again, *both)
    judged = _predictions(batch, replace(found, sizes={**found.sizes, **found.rough}))
    refused = {name for c, _ in judged if c.insertion.prefix in found.refused for name in c.insertion.size_names}
    for k, (c, columns) in enumerate(judged):
        if why := found.refused.get(c.insertion.prefix):
            judged[k] = replace(c, predicted=0.0, why_not=why, response=None), columns
    return _Batch(judged, found.again, frozenset(found.rough) - refused, found.moving)


def _alone(at: At, options: list[Insertion]) -> list[Judged]:
    """Judge options that have one problem, each from where it starts."""
    try:
        problem = at.problem(options)
    except UNSOLVED as error:
        return [_untried(option, error) for option in options]
    found: list[Judged] = []
    for option in options:
        try:
            found += _predictions((option,), at.alone(option, option.starts, problem))
        except UNSOLVED as error:
            found.append(_untried(option, error))
    return found


def _untried(option: Insertion, error: Exception) -> Judged:
    return Candidate(option, option.starts, 0.0, 0.0, 0.0, None, f"it cannot be tried: {error}"), {}


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _predictions(batch: tuple[Insertion, ...], found: Sweep) -> list[Judged]:
    basis = basis_of(found.base)
    left = found.residual - basis @ (basis.T @ found.residual)
    return [
        (_predict(insertion, found, basis, left), {name: found.sizes[name] for name in insertion.size_names})
        for insertion in batch
    ]


def _predict(insertion: Insertion, found: Sweep, basis: np.ndarray, left: np.ndarray) -> Candidate:
    columns = np.column_stack([found.sizes[name] for name in insertion.size_names])
    across = columns - basis @ (basis.T @ columns)
    whole, seen = np.linalg.norm(columns, axis=0), np.linalg.norm(across, axis=0)
    if not np.all(np.isfinite(whole)):
        return Candidate(insertion, insertion.starts, 0.0, 0.0, 0.0, None, "its law has no slope where it is absent")
    blind = seen**2 <= BLIND * np.clip(whole, 1e-150, None) ** 2
    if np.all(blind):
        return Candidate(insertion, insertion.starts, 0.0, 0.0, 0.0, None, UNSEEN)
    scale = 1 / np.maximum(whole, 1e-150)
    kind = insertion.place.kind
    bounds = [item.bounds_at(kind) for item in insertion.parameters if item.role == "size"]
    low, high = (np.array(side) / scale for side in zip(*bounds, strict=True))
    # two sizes may do together what is free already, as damping each way does: that direction is left alone
    values, vectors = np.linalg.eigh((across * scale).T @ (across * scale))
    good = values > BLIND
    root = np.sqrt(values[good])
    target = -(vectors[:, good] / root).T @ ((across * scale).T @ left)
    size = lsq_linear(root[:, None] * vectors[:, good].T, target, (low, high), method="bvls", tol=1e-12).x
    size[blind] = 0.0
    size[np.abs(size) < 1e-6 * np.abs(size).max(initial=0.0)] = 0.0
    change = across @ (size * scale)
    predicted = float(left @ left - np.sum((left + change) ** 2))
    parameters = insertion.starts | dict(zip(insertion.size_names, size * scale, strict=True))
    if not predicted > ROUNDING * float(left @ left) or not np.all(np.isfinite(change)):
        wanted = (vectors[:, good] / root) @ target * scale
        parameters |= dict(zip(insertion.size_names, wanted, strict=True))
        why = "it would need the wrong sign: it does not oppose motion"
        return Candidate(insertion, parameters, 0.0, 0.0, 0.0, None, why)
    return Candidate(insertion, parameters, predicted, 0.0, 0.0, None, "", change / np.linalg.norm(change))
