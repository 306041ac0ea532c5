"""Where is something missing? An unknown force, voltage or reading at each place, all estimated together.

At every motion an effect could act on there may be a force that nobody knows, at every input of an actuator a voltage,
behind every sensor an error. All of them are fitted jointly by a Kalman smoother on the linearised runs, with the
parameters of the model free to move; a place counts by how much less likely the data are without it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cartpend_dae.discover.asked import check_places, named_places
from cartpend_dae.discover.linear_runs import LinearRuns, linear_runs
from cartpend_dae.discover.portrait import Portrait, portrait, unit_at
from cartpend_dae.discover.smoother import TINY, Smoothed, imagined, likely, smooth
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, Insertion, Place, fits, places
from cartpend_dae.effects.catalogue import card_of
from cartpend_dae.errors import ModelError
from cartpend_dae.identify import Fit

# bandwidths of the output injection of fits, in units of the dominant frequency
EARLY, FOLLOW = 5.0, 2.0
# correlation time of the unknown inputs [s]
MEMORY = 1.0
# twice the log likelihood that a place must explain to count; nothing there gives at most 5 in 99 of 100
LIMIT = 20.0
# innovations this much larger than the noise make it larger, at most so many times
MUCH, ROUNDS = 1.3, 3
FINER = (3, 9)
# columns of a transfer matrix are parallel below this ratio of its singular values
PARALLEL = 1e-5
SAME = 1e-9
PLACEBOS = 4
# steps of the variances where they only have to be compared
ROUGHLY = 5
# sizes that are tried of each input, over one that lasts all the time
LADDER = 100.0 ** np.arange(6)
# share of its size at which an input begins beside the one that explains most alone
FAINT = 1e-3


@dataclass(frozen=True, slots=True)
class PlaceEvidence:
    """What the data say of an unknown input at a place.

    `evidence` is twice the log likelihood that it adds to all others, `rms` the size of the estimate and `placebo`
    what the same estimate comes to where nothing acts there, SI; `alike` are places whose input no data of these
    sensors can tell from one here, and `is_seen` says whether any sensor sees it at all.
    """

    at: str
    kind: str
    unit: str
    evidence: float
    rms: float
    placebo: float
    alike: tuple[str, ...]
    is_seen: bool


@dataclass(frozen=True, slots=True)
class Localisation:
    """Places by their evidence, the strongest first; `series` holds by run the times and each place's estimate.

    `followed` is the fit along the data about which the runs were linearised.
    """

    places: tuple[PlaceEvidence, ...]
    portraits: tuple[Portrait, ...]
    series: dict[str, dict[str, np.ndarray]]
    sensors: tuple[str, ...]
    followed: Fit

    @property
    def statement(self) -> str:
        """Which places can be told apart with these sensors."""
        groups = list(dict.fromkeys(tuple(sorted((p.at, *p.alike))) for p in self.places if p.alike))
        listing = "; ".join(", ".join(f"`{name}`" for name in group) for group in groups)
        unseen = [f"`{p.at}`" for p in self.places if not p.is_seen]
        blind = f" No sensor sees an input at {', '.join(unseen)}." if unseen else ""
        n, many = len(self.sensors), len(self.places)
        count = f"{many} places, {n} {'sensor' if n == 1 else 'sensors'}: "
        if groups:
            return (
                f"{count}inputs of any shape at these places cannot be told apart, only by how small and slow "
                f"they would have to be: {listing}.{blind}"
            )
        crowd = f", though no more than {n} of them at once by their shape alone" if many > n else ""
        return f"{count}an input at one place can be told from one at any other{crowd}.{blind}"


def localize(
    bench: Workbench,
    taken: tuple[Insertion, ...] = (),
    fit: Fit | None = None,
    *,
    only_at: str | Sequence[str] | None = None,
    seed: int = 0,
) -> Localisation:
    """Estimate what acts on a model besides what is in it, and where.

    Parameters
    ----------
    bench
        The workbench with the runs.
    taken
        Effects in the model already.
    fit
        Where to begin the fit that follows the data; the guesses if None.
    only_at
        Names of the places to look at, or that of one; all if None.
    seed
        Which noise the placebo is made of.

    Raises
    ------
    ModelError
        If there is no place at which something could act, or none of a name in `only_at`.
    SolverError
        If the model cannot be followed along its data.
    """
    only_at = named_places(only_at)
    names = tuple(insertion.content for insertion in taken)
    depends = names, fit.point if fit is not None else None, only_at, seed
    return bench.store.recall("places", depends, lambda: _localized(bench, taken, fit, only_at, seed))


def _localized(
    bench: Workbench, taken: tuple[Insertion, ...], fit: Fit | None, only_at: tuple[str, ...] | None, seed: int
) -> Localisation:
    unknown = unknown_inputs(bench, only_at)
    sd, guess = bench.problem(taken).prior_sd, fit.point if fit is not None else {}
    # it follows the data anyway: where Gauss and Newton's method ends is near enough
    followed = bench.fit(taken, guess, (EARLY * bench.frequency, FOLLOW * bench.frequency), sd, patient=False)
    bench.report("places", f"{len(unknown)} unknown inputs", float(np.sqrt(followed.chi2 / followed.n_residuals)))

    def linearised(fineness: int) -> LinearRuns:
        return linear_runs(bench, taken, unknown, followed.point, FOLLOW * bench.frequency, sd, fineness=fineness)

    twins = _twins(linearised(1))
    everywhere = [insertion.place.at for insertion in unknown]
    unknown = tuple(unknown[group[0]] for group in twins)
    weighed = _weighed(linearised)
    linear, evidence, inputs = weighed.linear, weighed.evidence, weighed.inputs
    placebo = _placebo(linear, weighed.variances, seed)
    alike, seen = _structure(linear)
    names = [insertion.place.at for insertion in unknown]
    rms = [float(np.sqrt(np.mean(np.concatenate([part[:, i] for part in inputs]) ** 2))) for i in range(len(names))]
    found = [
        PlaceEvidence(
            names[i],
            insertion.card.id.removeprefix("unknown_"),
            unit_at(insertion),
            float(evidence[i]),
            rms[i],
            float(placebo[i]),
            tuple(everywhere[k] for j in sorted({i, *np.flatnonzero(alike[i])}) for k in twins[j] if k != twins[i][0]),
            bool(seen[i]),
        )
        for i, insertion in enumerate(unknown)
    ]
    order = sorted(range(len(found)), key=lambda i: -found[i].evidence)
    series = {
        run.name: {"time": run.time[run.first], **{name: part[:, i] for i, name in enumerate(names)}}
        for run, part in zip(linear.runs, inputs, strict=True)
    }
    strong = [i for i in order if found[i].evidence > LIMIT]
    portraits = tuple(portrait(linear, unknown[i], [part[:, i] for part in inputs]) for i in strong)
    return Localisation(tuple(found[i] for i in order), portraits, series, linear.problem.outputs, followed)


def unknown_inputs(bench: Workbench, only_at: tuple[str, ...] | None = None) -> tuple[Insertion, ...]:
    """Return an unknown input at every place of the model, or at those named: a load, a drive or a reading.

    Raises
    ------
    ModelError
        If there is no place at which something could act, or none of a name.
    """
    measured = tuple(dict.fromkeys(name for run in bench.setup.train for name in run.outputs))
    cards = _cards()
    found = tuple(
        Insertion(card, place) for place in places(bench.setup.model, measured) for card in cards if fits(card, place)
    )
    if not found:
        raise ModelError("There is no place in this model at which an unknown force, voltage or reading could act.")
    if only_at is None:
        return found
    check_places(only_at, [insertion.place.at for insertion in found], "at which an unknown input could act")
    return tuple(insertion for insertion in found if insertion.place.at in only_at)


def _cards() -> tuple[Card, ...]:
    kinds = {"constant_load": "unknown_load", "input_offset": "unknown_drive", "sensor_offset": "unknown_reading"}
    return tuple(replace(card_of(effect), id=name) for effect, name in kinds.items())


def at_place(bench: Workbench, at: str) -> Place:
    """Return the place of a name among those of unknown inputs.

    Raises
    ------
    ModelError
        If there is none.
    """
    return unknown_inputs(bench, (at,))[0].place


@dataclass(frozen=True, slots=True)
class _Weighed:
    """Runs with the noise that is left, variances of all inputs together, what each adds, and estimates by run."""

    linear: LinearRuns
    variances: np.ndarray
    evidence: np.ndarray
    inputs: list[np.ndarray]


def _weighed(linearised: Callable[[int], LinearRuns]) -> _Weighed:
    """Find the sizes of all inputs and twice the log likelihood that each adds to the others.

    Where inputs that are constant over a block leave more than noise the blocks become shorter, and what is left then
    counts as noise of the sensors.
    """
    linear = linearised(1)
    found = _together(linear)
    for fineness in FINER:
        if _excess(linear, found[2]) < MUCH:
            break
        linear = linearised(fineness)
        found = _together(linear)
    for _ in range(ROUNDS):
        excess = _excess(linear, found[2])
        if excess < MUCH:
            break
        linear = linear.with_noise(excess)
        found = _together(linear)
    return _with_evidence(linear, *found)


def _excess(linear: LinearRuns, joint: Smoothed) -> float:
    """Return the rms of innovations over their standard deviations."""
    return float(np.sqrt(joint.squares[0] / max(linear.n, 1)))


def _with_evidence(linear: LinearRuns, alone: np.ndarray, variances: np.ndarray, joint: Smoothed) -> _Weighed:
    n = len(linear.unknown)
    without = smooth(linear, np.where(np.eye(n, dtype=bool), 0.0, variances), MEMORY)
    # what an input adds while the others stay as they are is more than what it adds while they may grow
    evidence = 2 * (joint.log_likelihood[0] - without.log_likelihood)
    strong = np.flatnonzero(evidence > LIMIT)
    if n > 1 and strong.size:
        allowed = ~np.eye(n, dtype=bool)[strong]
        at_least = np.maximum(variances, FAINT * alone)
        _, rest = likely(linear, allowed, MEMORY, np.repeat(at_least, strong.size, axis=0), steps=ROUGHLY)
        evidence[strong] = 2 * (joint.log_likelihood[0] - rest.log_likelihood)
    return _Weighed(linear, variances, np.maximum(evidence, 0.0), [part[0] for part in joint.inputs])


def _together(linear: LinearRuns) -> tuple[np.ndarray, np.ndarray, Smoothed]:
    """Return variances (1, n) of each input alone, and of all together: begun from all alike, and from the best one."""
    n = len(linear.unknown)
    n_blocks = sum(len(run.blocks) for run in linear.runs)
    none = smooth(linear, np.zeros((1, n)), MEMORY)
    least = none.pulls * n_blocks / np.maximum(none.stiffness, TINY) ** 2
    # how large an input must be depends on whether it lasts, so that all sizes are tried
    rungs = (np.eye(n)[None] * least * LADDER[:, None, None]).reshape(-1, n)
    tried = smooth(linear, rungs, MEMORY).log_likelihood.reshape(LADDER.size, n)
    begin = least * LADDER[np.argmax(tried, axis=0)]
    found, single = likely(linear, np.eye(n, dtype=bool), MEMORY, np.repeat(begin, n, axis=0), steps=ROUGHLY)
    alone = np.diag(found)[None]
    best = np.arange(n) == int(np.argmax(single.log_likelihood))
    starts = np.vstack([alone, np.where(best, alone, FAINT * alone)])
    variances, both = likely(linear, np.ones((2, n), dtype=bool), MEMORY, starts)
    first = int(np.argmax(both.log_likelihood))
    return alone, variances[first : first + 1], both.only(first)


def _placebo(linear: LinearRuns, variances: np.ndarray, seed: int) -> np.ndarray:
    """Return the rms of each input's estimate where that input is absent and the others are as large as they are."""
    n, generator = len(linear.unknown), np.random.default_rng(seed)
    absent = np.tile(np.where(np.eye(n, dtype=bool), 0.0, variances), (PLACEBOS, 1))
    found = smooth(
        linear, np.repeat(variances, n * PLACEBOS, axis=0), MEMORY, imagined(linear, absent, MEMORY, generator)
    )
    squares = np.concatenate([part**2 for part in found.inputs], axis=1).mean(axis=1)
    return np.sqrt(np.array([squares[i::n, i].mean() for i in range(n)]))


def _twins(linear: LinearRuns) -> list[list[int]]:
    """Group the inputs that act alike at every sample up to one factor, as a voltage and the force of its motor."""
    parts = [np.concatenate([run.local.unknown, run.local.seen_unknown], axis=1) for run in linear.runs]
    columns = np.concatenate([part.reshape(-1, part.shape[2]) for part in parts])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), TINY)
    groups: list[list[int]] = []
    for i in range(columns.shape[1]):
        home = next((g for g in groups if abs(columns[:, g[0]] @ columns[:, i]) > 1 - SAME), None)
        if home is None:
            groups.append([i])
        else:
            home.append(i)
    return groups


def _structure(linear: LinearRuns) -> tuple[np.ndarray, np.ndarray]:
    """Return which pairs of inputs no sensor tells apart whatever their shape, (n, n), and which are seen, (n,).

    Two inputs are alike if their columns of the transfer matrix are parallel at all frequencies, along all the motion.
    """
    n = len(linear.unknown)
    alike, seen = np.ones((n, n), dtype=bool), np.zeros(n, dtype=bool)
    for run in linear.runs:
        local, last = run.local, run.time.size - 2
        for k in np.linspace(0, last, 5).astype(int):
            width = run.time[k + 1] - run.time[k]
            for angle in np.geomspace(0.02, 1.0, 5) * min(1.0, 0.5 / width):
                pencil = np.exp(1j * angle * width) * np.eye(linear.n_x) - local.transition[k]
                columns = local.seen[k] @ np.linalg.solve(pencil, local.unknown[k]) + local.seen_unknown[k]
                size = np.linalg.norm(columns, axis=0)
                seen |= size > 0
                unit = columns / np.maximum(size, 1e-300)
                cosine = np.abs(unit.conj().T @ unit)
                alike &= (cosine > 1 - PARALLEL) | (size[:, None] == 0) | (size == 0)
    return alike & seen & seen[:, None], seen
