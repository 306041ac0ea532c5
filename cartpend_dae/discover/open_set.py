"""Where the catalogue ends: what is left at the end, at which place, and the most that a law there could explain."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cartpend_dae.assess import Assessment
from cartpend_dae.discover.closure import KINDS, SPARE, Closure, ClosureKind, Reach, closure_at, train
from cartpend_dae.discover.localize import FOLLOW, LIMIT, Localisation, PlaceEvidence, at_place, localize
from cartpend_dae.discover.portrait import Portrait
from cartpend_dae.discover.records import Search
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.errors import SolverError

# the range of a closure over that of the motion
WIDER = 1.1
# a closure explains something if its criterion falls by this much, and this share of the squared residual goes
MIN_GAIN, MIN_SHARE = 20.0, 0.1


@dataclass(frozen=True, slots=True)
class OpenSet:
    """What no effect of the catalogue explains: where it acts, and the closures there, the best first.

    `explained` is the share of the mean squared residual that the best closure removes; `errors` are those of the
    model with it on all runs.
    """

    where: Localisation
    at: str | None
    closures: tuple[Closure, ...]
    explained: float
    errors: Assessment | None = None

    @property
    def is_a_law(self) -> bool:
        """Whether a law of displacement and speed at the place explains a good part of what is left."""
        return bool(self.closures) and self.closures[0].gain > MIN_GAIN and self.explained > MIN_SHARE

    @property
    def portrait(self) -> Portrait | None:
        """What is known of the input at the place."""
        return next((one for one in self.where.portraits if one.at == self.at), None)

    @property
    def sentence(self) -> str:
        """What is left, in words."""
        strongest = self.where.places[0]
        if strongest.evidence <= LIMIT:
            return "What is left is not in the catalogue, and acts at no place of the model that an input could act on."
        seen = self.where.portraits[0].sentence
        head = f"What is left is not in the catalogue. It acts at `{strongest.at}`"
        like = f" (or {', '.join(f'`{name}`' for name in strongest.alike)})" if strongest.alike else ""
        if not self.closures:
            return f"{head}{like}. {seen} No closure was trained there."
        best, share = self.closures[0], 100 * self.explained
        if not self.is_a_law:
            much = f"{share:.0f} %" if share > 0 else "nothing"
            return (
                f"{head}{like}. {seen} A law of {_depends(strongest)} at `{self.at}` explains {much} of it: "
                f"it has a memory, depends on something else, or is a disturbance."
            )
        rest = "nothing but noise is left then" if not best.gate.is_passed else "structure is left then, too"
        return (
            f"{head}{like}. {seen} Any law of {_depends(strongest)} at `{self.at}` explains at most about "
            f"{share:.0f} % of the squared error ({best.words}; {rest})."
        )


def _depends(place: PlaceEvidence) -> str:
    return "displacement and speed" if place.kind == "load" else "the signal"


def open_set(
    bench: Workbench,
    search: Search,
    *,
    kinds: tuple[ClosureKind, ...] = KINDS,
    until_noise: bool = False,
    seed: int = 0,
) -> OpenSet:
    """Look into what a search has left unexplained.

    Parameters
    ----------
    bench
        The workbench of the search.
    search
        Its outcome.
    kinds
        The closures to train, one after the other.
    until_noise
        No more are trained after one that leaves nothing but noise.
    seed
        Which noise the placebo of `localize` is made of.

    Raises
    ------
    SolverError
        If the final model cannot be followed along its data.
    """
    *_, last = open_set_so_far(bench, search, kinds=kinds, until_noise=until_noise, seed=seed)
    return last


def open_set_so_far(
    bench: Workbench, search: Search, *, kinds: tuple[ClosureKind, ...], until_noise: bool, seed: int
) -> Iterator[OpenSet]:
    """Yield what is known after the places were looked at, and after each closure; see `open_set`."""
    taken = tuple(step.candidate.insertion for step in search.steps)
    where = localize(bench, taken, search.final, seed=seed)
    if where.places[0].evidence <= LIMIT:
        yield OpenSet(where, None, (), 0.0)
        return
    at = where.places[0].at
    yield OpenSet(where, at, (), 0.0)
    seen = next(one for one in where.portraits if one.at == at)
    is_free = all(run.score == "free" for run in bench.setup.train)
    last = 0.0 if is_free else search.bandwidth
    sd = bench.problem(taken).prior_sd if is_free else search.final.weights_sd
    begin = where.followed
    compared = search.final if search.bandwidth == last else bench.fit(taken, begin.point, (last,), sd, patient=False)
    stages = (FOLLOW * bench.frequency, last) if is_free else (last,)
    found: list[Closure] = []
    bench.begin("closures", len(kinds))
    for kind in kinds:
        closure = closure_at(at_place(bench, at), kind, reach_of(seen))
        try:
            trained = train(bench, taken, (begin, compared), closure, stages, sd)
        except SolverError:  # its numbers may grow beyond all bounds
            continue
        found = sorted([*found, trained], key=lambda closure: -closure.gain)
        yield OpenSet(where, at, tuple(found), 1 - found[0].fit.chi2 / compared.chi2)
        if until_noise and not trained.gate.is_passed:
            return


def reach_of(seen: Portrait) -> Reach:
    """Return what a closure must cover where an unknown input was seen."""
    low, high = float(seen.x.min()), float(seen.x.max())
    half = WIDER * max(high - low, 1e-12) / 2
    return Reach((low + high) / 2, half, WIDER * float(np.abs(seen.v).max()), SPARE * seen.rms)
