"""The search where small disturbances move the rig: each candidate is weighed against random forces of free size."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from cartpend_dae.discover.contact import is_other_law
from cartpend_dae.discover.contradicted import contradicted
from cartpend_dae.discover.evidence import described, price_of_corrections
from cartpend_dae.discover.iterated import refined
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.slopes import basis_of
from cartpend_dae.discover.unknown_input import likelihood, whitened
from cartpend_dae.discover.weigh import LEFT, Forces, Weighed, weigh
from cartpend_dae.discover.workbench import ROUGH, Workbench
from cartpend_dae.effects import Insertion, catalogue
from cartpend_dae.errors import SolverError
from cartpend_dae.identify import Fit
from cartpend_dae.shooting import weighted_residuals

# an effect costs 2 ln(n/0.01) a parameter, n the number of candidates: by chance one in a hundred libraries passes
CHANCE = 0.01
# jackknife standard deviations by which a size must differ from zero
MIN_T = 3.0
# candidates whose criterion differs by less, or this share of what the best one gains, explain the data alike
ALIKE, ALIKE_SHARE = 20.0, 0.03
EARLY = 8
# fits follow the bandwidth that suits the forces found, until it changes by less than this factor, so often at most
SETTLED, ROUNDS = 1.5, 3
# then steps of Gauss and Newton go on to the largest likelihood, at most so many, until -2 ln likelihood falls by less
STEPS, LITTLE = 4, 1.0
# a model that candidates are compared with is fitted again so often at most
POLISHED = 3
# sensitivities beyond this are those of a simulation that runs away
DIVERGED = 1e50
LOST = "its simulation diverges"
# columns of which no more is left are not told from what is fitted already; sizes are held by this weight, as bounds
# let them run away along directions of which no more is left
BLIND, HELD = 1e-8, 1e-4
TINY = 1e-150
# columns that are whitened at once, which bounds the memory
MANY = 100


def penalty(n_options: int) -> float:
    """Return what a parameter must gain in -2 ln likelihood where so many candidates are tried."""
    return 2 * float(np.log(max(n_options, 1) / CHANCE))


def fitted(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    loads: tuple[Insertion, ...],
    guess: Mapping[str, float],
    bandwidth: float,
    sd: np.ndarray,
    *,
    near: Forces | None = None,
) -> tuple[Fit, Weighed]:
    """Fit and weigh a model, with the output injection that suits the random forces found.

    Parameters
    ----------
    bench
        The workbench.
    taken
        Effects in the model.
    loads
        Where random forces may act.
    guess
        Where to start: parameters and free starts by name, SI.
    bandwidth
        First bandwidth of the output injection [rad/s].
    sd
        Noise of each output, shape (n_y,).
    near
        Random forces of a model like this one.
    """
    first = bench.fit(taken, guess, (bandwidth,), sd, patient=False, iterations=EARLY, stride=ROUGH)
    if not np.isfinite(first.chi2):
        raise SolverError(LOST)
    weighed = weigh(bench, taken, loads, first.point, bandwidth, sd, near=near, is_rough=near is not None)
    fit = first
    for _ in range(ROUNDS):
        used = weighed.bandwidth
        fit = bench.fit(taken, fit.point, (used,), sd, patient=False)
        weighed = weigh(bench, taken, loads, fit.point, used, sd, near=weighed.forces)
        if max(used, weighed.bandwidth) < SETTLED * min(used, weighed.bandwidth):
            break
    return refined(bench, taken, loads, (fit, weighed), sd) or _likelier(bench, taken, loads, fit, weighed, sd)


def polished(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    loads: tuple[Insertion, ...],
    found: tuple[Fit, Weighed],
    sd: np.ndarray,
) -> tuple[Fit, Weighed]:
    """Return a fit and its weighing after as much fitting as a candidate gets that is compared with it.

    A candidate begins where the model without it ended and is fitted anew from there; without this it would gain what
    that model itself would gain by it, up to 23 of -2 ln likelihood (tuning seeds 50 and 52 of the blind bed).
    """
    fit, weighed = found
    for _ in range(POLISHED):
        try:
            again = fitted(bench, taken, loads, fit.point, float(fit.bandwidth[0]), sd, near=weighed.forces)
        except SolverError:  # it diverges from there
            break
        gain = weighed.criterion - again[1].criterion
        if not gain > 0:
            break
        fit, weighed = again
        if gain < LITTLE:
            break
    return fit, weighed


def reweighed(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    loads: tuple[Insertion, ...],
    fit: Fit,
    sd: np.ndarray,
    *,
    near: Forces | None = None,
) -> tuple[Fit, Weighed]:
    """Return a fit against random forces with its weighing, which is not kept with a candidate; see `fitted`."""
    weighed = weigh(bench, taken, loads, fit.point, float(fit.bandwidth[0]), sd, near=near)
    return refined(bench, taken, loads, (fit, weighed), sd) or (fit, weighed)


def _likelier(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    loads: tuple[Insertion, ...],
    fit: Fit,
    weighed: Weighed,
    sd: np.ndarray,
) -> tuple[Fit, Weighed]:
    """Go on from a fit of predictions towards the largest likelihood, as long as it rises."""
    bandwidth = float(fit.bandwidth[0])
    for _ in range(STEPS):
        try:
            ahead = bench.fit(taken, weighed.next, (bandwidth,), sd, patient=False, iterations=0)
            after = weigh(bench, taken, loads, ahead.point, bandwidth, sd, near=weighed.forces)
        except SolverError:  # it diverges there
            break
        gain = weighed.criterion - after.criterion
        if not gain > 0:
            break
        fit, weighed = ahead, after
        if gain < LITTLE:
            break
    return fit, weighed


def predictions(pairs: list[tuple[Candidate, Mapping[str, np.ndarray]]], base: Weighed) -> list[Candidate]:
    """Predict by how much -2 ln likelihood would fall with each candidate, random forces at their likeliest.

    Parameters
    ----------
    pairs
        Candidates, and what their sizes change, by name, shape (n,).
    base
        The model without them.
    """
    judged = [(c, list(columns.values())) for c, columns in pairs]
    found: list[Candidate] = []
    while judged:
        count, width = 0, 0
        while count < len(judged) and (width := width + len(judged[count][1])) <= MANY:
            count += 1
        found += _predictions(judged[: max(count, 1)], base)
        judged = judged[max(count, 1) :]
    return found


def _predictions(pairs: list[tuple[Candidate, list[np.ndarray]]], base: Weighed) -> list[Candidate]:
    known = [base.found.residual, *base.found.base.T]
    is_good = [bool(columns) and all(np.all(np.abs(column) < DIVERGED) for column in columns) for _, columns in pairs]
    new = [column for (_, columns), good in zip(pairs, is_good, strict=True) if good for column in columns]
    rows = base.chain.spread(np.column_stack([*known, *new]))
    sizes = np.array([share * base.forces.sizes for share in LEFT])
    white = whitened(base.chain, rows, sizes, np.tile(base.forces.times, (len(LEFT), 1, 1)))
    grams = [_new(one[base.chain.measured], len(known)) for one in white.rows]
    n, first, found = int(base.chain.measured.sum()), 1, []
    for (candidate, columns), good in zip(pairs, is_good, strict=True):
        if good:
            own = list(range(first, first + len(columns)))
            found.append(_predicted(candidate, own, grams, white.determinant.sum(axis=1), n, base))
            first += len(columns)
        else:
            found.append(replace(candidate, predicted=0.0, why_not=candidate.why_not or LOST))
    return found


def _new(rows: np.ndarray, n_known: int) -> np.ndarray:
    """Return the products of the residual and of columns of length one, without what is fitted already.

    Parameters
    ----------
    rows
        Residual, `n_known` - 1 columns of what is fitted already, and others, shape (n, m).
    """
    fitted_already, others = rows[:, 1:n_known], rows[:, n_known:]
    basis = basis_of(fitted_already, BLIND)
    lengths = np.maximum(np.linalg.norm(others, axis=0), TINY)
    columns = np.column_stack([rows[:, 0], others / lengths])
    left = columns - basis @ (basis.T @ columns)
    return np.vstack([left.T @ left, np.r_[1.0, lengths]])


def _predicted(
    candidate: Candidate,
    own: list[int],
    grams: list[np.ndarray],
    determinants: np.ndarray,
    n: int,
    base: Weighed,
) -> Candidate:
    kind = candidate.insertion.place.kind
    bounds = [item.bounds_at(kind) for item in candidate.insertion.parameters if item.role == "size"]
    best, sizes = np.inf, np.zeros(len(own))
    concerned = np.ix_([0, *own], [0, *own])
    if not all(np.all(np.isfinite(gram[concerned])) for gram in grams):  # what is whitened may grow beyond all numbers
        return replace(candidate, predicted=0.0, why_not=candidate.why_not or LOST)
    for gram, determinant in zip(grams, determinants, strict=True):
        squares, found = _bounded(gram, own, bounds)
        value = float(likelihood(n, squares, determinant))
        if value < best:
            best, sizes = value, found
    gain = base.linear - best
    if candidate.why_not or not gain > 0 or not np.any(sizes):
        why = candidate.why_not or "it would need the wrong sign: it does not oppose motion"
        return replace(candidate, predicted=0.0, why_not=why)
    values = candidate.insertion.starts | dict(zip(candidate.insertion.size_names, map(float, sizes), strict=True))
    return replace(candidate, predicted=gain, parameters=values)


def _bounded(gram: np.ndarray, own: list[int], bounds: list[tuple[float, float]]) -> tuple[float, np.ndarray]:
    """Minimise the squares over the sizes within their bounds, from products alone."""
    products, lengths = gram[:-1], gram[-1]
    values, vectors = np.linalg.eigh(products[np.ix_(own, own)])
    good = values > BLIND  # of columns of length one, before what is fitted already is taken out
    if not good.any():
        return float(products[0, 0]), np.zeros(len(own))
    root = np.sqrt(values[good])
    matrix = np.vstack([root[:, None] * vectors[:, good].T, HELD * np.eye(len(own))])
    target = np.r_[-(vectors[:, good] / root).T @ products[own, 0], np.zeros(len(own))]
    low, high = (np.array(side) * lengths[own] for side in zip(*bounds, strict=True))
    found = lsq_linear(matrix, target, (low, high), method="bvls", tol=1e-12).x
    found[np.abs(found) < 1e-6 * np.abs(found).max(initial=0.0)] = 0.0
    squares = products[0, 0] + 2 * products[own, 0] @ found + found @ products[np.ix_(own, own)] @ found
    return max(float(squares), 0.0), found / lengths[own]


def judge(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    loads: tuple[Insertion, ...],
    base: tuple[Fit, Weighed],
    candidate: Candidate,
    sd: np.ndarray,
    n_options: int,
) -> Candidate:
    """Fit a candidate, and say whether it is worth its parameters.

    It must raise the likelihood by more than chance in a library of this size, predict blocks of time from the others
    better, and runs kept for selection if there are any; and one of its sizes must differ from zero in all parts of
    the data, or, of several parameters, the blocks left out be predicted better by more than chance.
    """
    before, weighed = base
    together = (*taken, candidate.insertion)
    guess = before.point | candidate.parameters
    fit, after = fitted(bench, together, loads, guess, float(before.bandwidth[0]), sd, near=weighed.forces)
    parameters = {name: fit.values[name] for name in candidate.insertion.parameter_names}
    gain = weighed.criterion - after.criterion
    sizes = [name for name in candidate.insertion.size_names if after.sd.get(name, 0.0) > 0]
    t = max((abs(fit.values[name]) / after.sd[name] for name in sizes), default=0.0)
    needed = penalty(n_options) * len(parameters)
    states = [e.status for e in fit.parameters if e.name in candidate.insertion.size_names]
    why = ""
    if states and all(status == "at-bound" for status in states):
        why = "its parameter ends on its bound, where it has no effect"
    elif states and all(status == "unidentifiable" for status in states):
        why = "no sensor sees it apart from what is free already, as it ends"
    elif gain < needed:
        why = f"against random forces -2 ln likelihood falls by {gain:.1f}, less than {needed:.1f}"
    elif weighed.validated < after.validated:
        why = "parts of the data left out are predicted worse with it"
    elif t < _least_t(candidate.insertion, needed, weighed.validated - after.validated):
        why = f"its size differs between parts of the data: {t:.1f} jackknife sds from zero"
    elif not _helps_selection(bench, taken, together, before, fit, sd):
        why = "the runs kept for selection are predicted worse with it"
    why = why or contradicted(bench.setup.train, candidate.insertion, fit)
    return replace(candidate, parameters=parameters, gain=gain, t=float(t), fit=fit, why_not=why)


def _least_t(insertion: Insertion, needed: float, better: float) -> float:
    """Return by how many jackknife standard deviations a size must differ from zero.

    A single parameter must pass by its own spread what it must by its likelihood, as t^2 is what it gains where random
    forces are as they are modelled: losses in gears gained 27 of -2 ln likelihood with 1.4 standard deviations, where
    nothing was missing (blind set 1204 of the driven cart). Several parameters may spread and yet predict better.
    """
    if len(insertion.parameter_names) == 1:
        return float(np.sqrt(needed))
    return 0.0 if better >= needed else MIN_T


def _helps_selection(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    together: tuple[Insertion, ...],
    before: Fit,
    after: Fit,
    sd: np.ndarray,
) -> bool:
    if not bench.setup.select:
        return True
    bandwidth = float(after.bandwidth[0])
    return _selection(bench, together, after, bandwidth, sd) < _selection(bench, taken, before, bandwidth, sd)


def _selection(
    bench: Workbench, insertions: tuple[Insertion, ...], fit: Fit, bandwidth: float, sd: np.ndarray
) -> float:
    """Return the squares of the errors of prediction on the runs kept for selection."""
    problem = bench.build(insertions, bench.setup.select)
    return float(np.sum(weighted_residuals(problem, fit.values, bandwidth, sd) ** 2))


def margin_of(best: Candidate, other: Candidate) -> float:
    """Return by how much less an effect may gain than the best one and explain the data alike.

    Laws of one contact are weighed along the course that each makes likeliest, where no share of what both explain is
    the error of that.
    """
    return ALIKE if is_other_law(best, other) else max(ALIKE, ALIKE_SHARE * best.gain)


def is_composite(insertion: Insertion) -> bool:
    """Return whether an effect between two parts contains another one of the catalogue, or of a user's own file."""
    card = insertion.card
    if card.insertion != "series":
        return False
    return bool(card.contains) or any(card.id in other.nested_in for other in catalogue())


def ordered(judged: list[Candidate], second: Callable[[Candidate, Candidate], str]) -> list[Candidate]:
    """Put the one to take first: of those that explain the data alike, the one with the fewest parameters.

    One that does several things at once comes after those.
    """
    found = sorted(judged, key=lambda c: (bool(c.why_not), -c.gain))
    good = [c for c in found if not c.why_not]
    if not good:
        return found
    alike = [c for c in good if good[0].gain - c.gain < margin_of(good[0], c)]
    alike = [c for c in alike if not is_composite(c.insertion)] or alike
    first = min(alike, key=lambda c: (described(c.fit, c.insertion), -_plain_gain(c)))
    return [first, *(replace(c, why_not=c.why_not or second(c, first)) for c in found if c is not first)]


def _plain_gain(candidate: Candidate) -> float:
    """Return by how much -2 ln likelihood falls with the law alone, without what its corrections may gain by chance."""
    assert candidate.fit is not None
    return candidate.gain - price_of_corrections(candidate.fit, candidate.insertion)
