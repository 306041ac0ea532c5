"""Stage 2: with how much output injection of the model effects are screened, so that what is missing shows."""

from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.screen import promise, screen
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
    best, most = (rules.screening, list[Candidate]()), -1.0
    for stage in in_order(bench, base, rules, options, stages):
        fit = base.fits[stage]
        screened = screen(bench, base.taken, fit.point, options, stage, rules.sd)
        share = max((c.predicted for c in screened if not c.why_not), default=0.0) / fit.chi2
        if share > most:
            best, most = (stage, screened), share
        if share > HIDDEN:
            break
    return best


def in_order(bench: Workbench, base: Base, rules: Rules, options: list[Insertion], stages: list[float]) -> list[float]:
    """Put the stages first at which one simulation tells already that something shows, then the one where most does.

    Where nothing shows with injection, the stage that leaves least comes before the free simulation: one simulation
    does not tell of waves, such as cogging, whose phase is right along what was measured, and lost without injection.
    """
    if len(stages) < 2 or not options:
        return stages
    shares: dict[float, float] = {}
    for stage in stages:
        fit = base.fits[stage]
        shares[stage] = promise(bench, base.taken, fit.point, options, stage, rules.sd) / fit.chi2
        if stage > bench.last and shares[stage] > HIDDEN:
            return [stage, *(other for other in stages if other != stage)]
    ranked = sorted(stages, key=lambda stage: -shares[stage])
    led = min(stages[:-1], key=lambda stage: base.fits[stage].chi2)
    return [led, *(other for other in ranked if other != led)] if ranked[0] == bench.last else ranked


def screened_freely(bench: Workbench, base: Base, rules: Rules, options: list[Insertion]) -> list[Candidate]:
    """Return effects as screened along the free simulation, if one promises nearly all; else none."""
    fit = base.fits[bench.last]
    if not options or promise(bench, base.taken, fit.point, options, bench.last, rules.sd) < (1 - MOST) * fit.chi2:
        return []
    return screen(bench, base.taken, fit.point, options, bench.last, rules.sd)
