"""Stage 2: which effect at which place could explain the residual? One linearisation for all, no fit."""

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from scipy.optimize import lsq_linear

from cartpend_dae.discover.contact import is_dry, moves_alike
from cartpend_dae.discover.disturbed import is_composite, predictions
from cartpend_dae.discover.records import Candidate, Prediction
from cartpend_dae.discover.slopes import basis_of
from cartpend_dae.discover.sweep import Sweep, alone_with, batches, one_by_one, sweep
from cartpend_dae.discover.weigh import Weighed
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, Place, fits
from cartpend_dae.errors import UNSOLVED
from cartpend_dae.parallel import in_parallel
from cartpend_dae.problem import Problem

# squared sine of the angle between what an effect changes and what is free already, below which no sensor sees it:
# one linearisation for all effects turns directions by up to 1e-3
BLIND = 1e-6
# another start that promises this share of the best one is tried as well
NEAR = 0.8
# where no effect promises this share of what is left, sizes are tried: so many times the one that moves as much
ENOUGH = 0.5
PROBES = (0.3, 1.0, 3.0)
# what promises less than this share of the best is not judged alone, if it is a wave or does several things at once:
# their predictions mostly hold even where they change between two samples (in ten searches on tuning seeds the least
# were a third of what they are alone; those of a gap are a thousandth)
SLIGHT = 0.02
# what promises less than this share of what is left promises nothing but rounding
ROUNDING = 1e-14
UNSEEN = "no sensor sees it apart from what is free already"


def candidates(cards: tuple[Card, ...], places: tuple[Place, ...], taken: tuple[Insertion, ...]) -> list[Insertion]:
    """Return every effect at every place that fits, from each of its starts, except what the model has already.

    A contact has one law of dry friction: where the model has one, another is no addition.
    """
    names = {insertion.prefix for insertion in taken}
    rubbing = [insertion.place for insertion in taken if is_dry(insertion.card)]
    rubbed = [place for place in places if any(moves_alike(place, other) for other in rubbing)]
    fitting = [(card, place) for place in places for card in cards if fits(card, place)]
    fitting = [(card, place) for card, place in fitting if not (is_dry(card) and place in rubbed)]
    found = [Insertion(card, place, start) for card, place in fitting for start in card.starts(place.kind)]
    return [insertion for insertion in found if insertion.prefix not in names]


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
    names = tuple(option.content for option in (*taken, *options))
    against = None if weighed is None else (weighed.linear, weighed.bandwidth, weighed.forces)
    trail = None if weighed is None or weighed.trail is None else weighed.trail.content
    at = _At(bench, taken, point, bandwidth, sd, weighed)
    depends = names, len(taken), dict(point), bandwidth, sd, against, trail
    kept = bench.store.recall("screen", depends, lambda: _kept(at, options))
    chosen = [replace(options[p.number], values=p.values) for p in kept]
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


def promise(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    point: Mapping[str, float],
    options: list[Insertion],
    bandwidth: float,
    sd: np.ndarray,
) -> float:
    """Return by how much the cost would fall with the best of the effects that one simulation tells of, as a screening.

    Arguments are those of `screen`; each effect has the first of its starts.
    """
    names = tuple(option.content for option in (*taken, *options))
    at = _At(bench, taken, point, bandwidth, sd, None)
    depends = names, len(taken), dict(point), bandwidth, sd
    batch = batches(options)[0]
    parts = [part for part in (batch[::2], batch[1::2]) if part]

    def most() -> float:
        return max(in_parallel(lambda part: _promise(at, part), parts, jobs=bench.jobs))

    return bench.store.recall("promise", depends, most)


def _promise(at: "_At", batch: tuple[Insertion, ...]) -> float:
    try:
        found = at.sweep(batch, False)
    except UNSOLVED:
        return 0.0
    smooth = tuple(option for option in batch if all(name in found.sizes for name in option.size_names))
    return max((c.predicted for c, _ in _predictions(smooth, found) if not c.why_not), default=0.0)


def _kept(at: "_At", options: list[Insertion]) -> list[Prediction]:
    """Screen all, as it can be kept on disk."""
    grouped = batches(options)
    # shapes are looked for along the first batch, which takes longest: it is judged in two parts
    parts = [part for batch in grouped[:1] for part in (batch[::2], batch[1::2]) if part]
    done = _swept(at, [*parts, *grouped[1:]], with_shapes=True)
    again = [option for batch in done for option in batch.again]
    done += _swept(at, batches(again), with_shapes=False)
    pairs = _settled(at, done)
    moving = frozenset(chain.from_iterable(batch.moving for batch in done))
    named = {option.prefix: k for k, option in enumerate(options)}
    found = _probed(at, pairs, moving) if at.weighed is None else predictions(pairs, at.weighed)
    return [
        Prediction(
            named[c.insertion.prefix], dict(c.insertion.values), c.parameters, c.predicted, c.why_not, c.response
        )
        for c in found
    ]


def _swept(at: "_At", batches: list[tuple[Insertion, ...]], *, with_shapes: bool) -> list["_Batch"]:
    return list(in_parallel(lambda batch: _screened(at, batch, with_shapes), batches, jobs=at.bench.jobs))


def _settled(at: "_At", done: list["_Batch"]) -> list["_Judged"]:
    """Return what was judged in batches, where those too fast for that are judged alone."""
    least = SLIGHT * max((c.predicted for batch in done for c, _ in batch.judged), default=0.0)
    kept: list[_Judged] = []
    alike: dict[str, list[Insertion]] = {}
    for batch in done:
        for pair in batch.judged:
            candidate, _ = pair
            is_fast = not batch.rough.isdisjoint(candidate.insertion.size_names)
            if is_fast and not (_is_followed(candidate) and candidate.predicted < least):
                alike.setdefault(_problem_of(candidate.insertion), []).append(candidate.insertion)
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


def _probed(at: "_At", pairs: list["_Judged"], moving: frozenset[str]) -> list[Candidate]:
    """Try effects in series at sizes that move the data as much as what is left, if no straight line explains half.

    What gives way, `moving` by itself, resonates: with its size the response grows, and then turns, which no slope at
    size 0 tells. What swings beside it tells it, and is no reason not to try. Each effect is tried from each of its
    starts.
    """
    found = [c for c, _ in pairs]
    series = [(c, columns) for c, columns in pairs if c.insertion.card.insertion == "series" and len(columns) == 1]
    able = [(c, columns) for c, columns in series if c.insertion.prefix in moving]
    if not able:
        return found
    try:
        base = at.alone(able[0][0].insertion)
    except UNSOLVED:
        return found
    whole = _left(base.residual, base.base)
    plain = (c.predicted for c in found if not c.why_not and not c.insertion.card.resonates)
    if max(plain, default=0.0) > ENOUGH * whole:
        return found
    alike: dict[str, list[_Judged]] = {}
    for pair in able:
        alike.setdefault(_problem_of(pair[0].insertion), []).append(pair)
    groups = sorted(alike.values(), key=len, reverse=True)
    better = in_parallel(lambda pairs: _at_sizes(at, pairs, whole), groups, jobs=at.bench.jobs)
    instead = dict(zip((id(c) for pairs in groups for c, _ in pairs), chain.from_iterable(better), strict=True))
    return [instead.get(id(candidate), candidate) for candidate in found]


def _at_sizes(at: "_At", pairs: list["_Judged"], whole: float) -> list[Candidate]:
    """Return candidates that have one problem at the sizes of which they explain most."""
    try:
        problem = at.problem([candidate.insertion for candidate, _ in pairs])
    except UNSOLVED:
        return [candidate for candidate, _ in pairs]
    return [_at_best_size(at, problem, pair, whole) for pair in pairs]


def _at_best_size(at: "_At", problem: Problem, pair: "_Judged", whole: float) -> Candidate:
    """Return a candidate at the size of which it explains most, if that is more than its slope promises."""
    candidate, columns = pair
    insertion, best = candidate.insertion, candidate
    (name,), slope = insertion.size_names, float(np.linalg.norm(next(iter(columns.values()))))
    if not (slope > 0 and np.isfinite(slope)):
        return candidate
    for share in PROBES:
        values = insertion.starts | {name: share * np.sqrt(whole) / slope}
        with contextlib.suppress(*UNSOLVED):
            there = at.alone(insertion, values, problem)
            predicted = whole - _left(there.residual, np.column_stack([there.base, *there.sizes.values()]))
            if predicted > best.predicted:
                best = replace(candidate, parameters=values, predicted=predicted, why_not="", response=None)
    return best


def _left(residual: np.ndarray, columns: np.ndarray) -> float:
    """Return the squares that no combination of columns explains."""
    basis = basis_of(columns)
    return float(np.sum((residual - basis @ (basis.T @ residual)) ** 2))


@dataclass(frozen=True, slots=True)
class _At:
    """The point at which all candidates are judged; see `screen`."""

    bench: Workbench
    taken: tuple[Insertion, ...]
    point: Mapping[str, float]
    bandwidth: float
    sd: np.ndarray
    weighed: Weighed | None

    def sweep(self, batch: tuple[Insertion, ...], with_shapes: bool) -> Sweep:
        trail = None if self.weighed is None else self.weighed.trail
        at = self.bench, self.taken, batch, self.point, self.bandwidth, self.sd
        return sweep(*at, with_shapes=with_shapes, trail=trail)

    def problem(self, options: list[Insertion]) -> Problem:
        """Return the problem of an effect from several starts, in steps that follow the fastest of them."""
        problem = alone_with(self.bench, self.taken, options[0])
        each = (problem.guessing(option.starts) for option in options[1:])
        return max((problem, *each), key=lambda one: one.layout.substeps)

    def alone(
        self, option: Insertion, values: Mapping[str, float] | None = None, problem: Problem | None = None
    ) -> Sweep:
        point = {**self.point, **(values or {})}
        return one_by_one(problem or self.problem([option]), option, point, self.bandwidth, self.sd)


_Judged = tuple[Candidate, Mapping[str, np.ndarray]]


@dataclass(frozen=True, slots=True)
class _Batch:
    """What was judged together: each candidate and what its sizes change, by name; sizes that are too `rough` for that.

    `again` are effects from better shapes, and `moving` prefixes of those with a motion of their own.
    """

    judged: list[_Judged]
    again: tuple[Insertion, ...] = ()
    rough: frozenset[str] = frozenset()
    moving: frozenset[str] = frozenset()


def _screened(at: _At, batch: tuple[Insertion, ...], with_shapes: bool) -> _Batch:
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


def _problem_of(option: Insertion) -> str:
    """Return what the problem of an effect depends on: all but the values from which what is estimated starts."""
    free = {name.rpartition(".")[2] for name in option.parameter_names}
    return str((option.prefix, {name: value for name, value in option.values.items() if name not in free}))


def _alone(at: _At, options: list[Insertion]) -> list[_Judged]:
    """Judge options that have one problem, each from where it starts."""
    try:
        problem = at.problem(options)
    except UNSOLVED as error:
        return [_untried(option, error) for option in options]
    found: list[_Judged] = []
    for option in options:
        try:
            found += _predictions((option,), at.alone(option, option.starts, problem))
        except UNSOLVED as error:
            found.append(_untried(option, error))
    return found


def _untried(option: Insertion, error: Exception) -> _Judged:
    return Candidate(option, option.starts, 0.0, 0.0, 0.0, None, f"it cannot be tried: {error}"), {}


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _predictions(batch: tuple[Insertion, ...], found: Sweep) -> list[_Judged]:
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
