"""Stage 2: with how much output injection of the model effects are screened, so that what is missing shows."""

from collections.abc import Iterator, Mapping

from cartpend_dae.discover.probe import At
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.screen import Screening
from cartpend_dae.discover.shape import MOST
from cartpend_dae.discover.state import Base, Rules
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Insertion

# where no effect explains this share of chi2, the injection hides what is missing
HIDDEN = 0.1


def screened_where_it_shows(
    bench: Workbench, base: Base, rules: Rules, options: list[Insertion]
) -> tuple[float, list[Candidate]]:
    """Screen with the injection of the stage of screening, or with less, or none, where that hides what is missing."""
    stages = sorted((w for w in base.fits if w <= rules.screening), reverse=True)
    screenings = {stage: _screening(bench, base, rules, options, stage) for stage in stages}
    best, most = (rules.screening, list[Candidate]()), -1.0
    for stage in _in_turn(base, screenings, in_order(base, screenings, bench.last)):
        screened = screenings[stage].found()
        share = max((c.predicted for c in screened if not c.why_not), default=0.0) / base.fits[stage].chi2
        if share > most:
            best, most = (stage, screened), share
        if share > HIDDEN:
            break
    return best


def _in_turn(base: Base, screenings: Mapping[float, Screening], order: list[float]) -> Iterator[float]:
    """Yield stages one after the other, those at which a glance tells that nothing shows after all others."""
    later = []
    for stage in order:
        if len(order) == 1 or screenings[stage].glance > HIDDEN * base.fits[stage].chi2:
            yield stage
        else:
            later.append(stage)
    yield from later


def in_order(base: Base, screenings: Mapping[float, Screening], last: float) -> list[float]:
    """Put the stages first at which one simulation tells already that something shows, then the one where most does.

    Where nothing shows with injection, the stage that leaves least comes before the free simulation: one simulation
    does not tell of waves, such as cogging, whose phase is right along what was measured, and lost without injection.
    """
    stages = list(screenings)
    if len(stages) < 2 or not any(screening.options for screening in screenings.values()):
        return stages
    shares: dict[float, float] = {}
    for stage, screening in screenings.items():
        shares[stage] = screening.promise / base.fits[stage].chi2
        if stage > last and shares[stage] > HIDDEN:
            return [stage, *(other for other in stages if other != stage)]
    ranked = sorted(stages, key=lambda stage: -shares[stage])
    led = min(stages[:-1], key=lambda stage: base.fits[stage].chi2)
    return [led, *(other for other in ranked if other != led)] if ranked[0] == last else ranked


def screened_freely(bench: Workbench, base: Base, rules: Rules, options: list[Insertion]) -> list[Candidate]:
    """Return effects as screened along the free simulation, if one promises nearly all; else none."""
    screening = _screening(bench, base, rules, options, bench.last)
    if not options or screening.promise < (1 - MOST) * base.fits[bench.last].chi2:
        return []
    return screening.found()


def _screening(bench: Workbench, base: Base, rules: Rules, options: list[Insertion], stage: float) -> Screening:
    return Screening(At(bench, base.taken, base.fits[stage].point, stage, rules.sd, None), options)
