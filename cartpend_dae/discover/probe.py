"""Stage 2: what is in series, at sizes: with what gives way the response resonates, which no slope at size 0 tells."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.slopes import basis_of
from cartpend_dae.discover.sweep import Sweep, alone_with, one_by_one, sweep
from cartpend_dae.discover.weigh import Weighed
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion
from cartpend_dae.errors import UNSOLVED
from cartpend_dae.parallel import in_parallel
from cartpend_dae.problem import Problem

# where no effect promises this share of what is left, sizes are tried: so many times the one that moves as much
ENOUGH = 0.5
PROBES = (0.3, 1.0, 3.0)


@dataclass(frozen=True, slots=True)
class At:
    """The point at which all candidates are judged; see `screen`."""

    bench: Workbench
    taken: tuple[Insertion, ...]
    point: Mapping[str, float]
    bandwidth: float
    sd: np.ndarray
    weighed: Weighed | None

    def sweep(self, batch: tuple[Insertion, ...], with_shapes: bool) -> Sweep:
        """Linearise the model in the sizes of many effects at once; see `sweep`."""
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
        """Linearise the model with a single effect more, at values of its parameters; see `one_by_one`."""
        point = {**self.point, **(values or {})}
        return one_by_one(problem or self.problem([option]), option, point, self.bandwidth, self.sd)


# a candidate, and what its sizes change, by name
Judged = tuple[Candidate, Mapping[str, np.ndarray]]


def problem_of(option: Insertion) -> str:
    """Return what the problem of an effect depends on: all but the values from which what is estimated starts."""
    free = {name.rpartition(".")[2] for name in option.parameter_names}
    return str((option.prefix, {name: value for name, value in option.values.items() if name not in free}))


def probed(at: At, pairs: list[Judged], moving: frozenset[str], before: Sequence[Candidate]) -> list[Candidate]:
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
    plain = (c.predicted for c in (*found, *before) if not c.why_not and not c.insertion.card.resonates)
    if max(plain, default=0.0) > ENOUGH * whole:
        return found
    alike: dict[str, list[Judged]] = {}
    for pair in able:
        alike.setdefault(problem_of(pair[0].insertion), []).append(pair)
    groups = sorted(alike.values(), key=len, reverse=True)
    better = in_parallel(lambda pairs: _at_sizes(at, pairs, whole), groups, jobs=at.bench.jobs)
    instead = dict(zip((id(c) for pairs in groups for c, _ in pairs), chain.from_iterable(better), strict=True))
    return [instead.get(id(candidate), candidate) for candidate in found]


def _at_sizes(at: At, pairs: list[Judged], whole: float) -> list[Candidate]:
    """Return candidates that have one problem at the sizes of which they explain most."""
    try:
        problem = at.problem([candidate.insertion for candidate, _ in pairs])
    except UNSOLVED:
        return [candidate for candidate, _ in pairs]
    return [_at_best_size(at, problem, pair, whole) for pair in pairs]


def _at_best_size(at: At, problem: Problem, pair: Judged, whole: float) -> Candidate:
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
