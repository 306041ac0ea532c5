"""Laws without a name at a port, trained in the same programme as the parameters of the model.

What a spline, a Gaussian process and a small neural network of displacement and speed can explain at a place is the
most that any such law could explain there, and a placeholder for the one that is not in the catalogue.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from cartpend_dae.discover.evidence import coloured_bic
from cartpend_dae.discover.gate import residuals
from cartpend_dae.discover.records import Gate
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import Card, EffectParameter, Insertion, Place
from cartpend_dae.effects.card import Kind, R, T
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.explain import nearest
from cartpend_dae.identify import Fit, estimate
from cartpend_dae.language import Component
from cartpend_dae.library import closures
from cartpend_dae.system import System
from cartpend_dae.unknowns import Free, Prior

ClosureKind = Literal["spline", "process", "network"]
KINDS: tuple[ClosureKind, ...] = get_args(ClosureKind)
_CLASSES: dict[ClosureKind, tuple[type[Component], ...]] = {
    "spline": (closures.TurningSpline, closures.SlidingSpline, closures.SignalSpline),
    "process": (closures.TurningProcess, closures.SlidingProcess, closures.SignalProcess),
    "network": (closures.TurningNetwork, closures.SlidingNetwork, closures.SignalNetwork),
}
_WORDS = {"spline": "splines", "process": "a Gaussian process", "network": "a neural network"}
# parameters of a closure that are numbers of its place, and not learned: size, middle and half of its range, speed
_GIVEN: dict[Kind, tuple[str, ...]] = {
    R: ("tau_0", "phi_m", "phi_0", "w_0"),
    T: ("f_0", "s_m", "s_0", "v_0"),
    None: ("y_0", "u_m", "u_0"),
}
# weights of outputs are known to be of order one, those inside a neuron to be near where they start
WEIGHT = 1.0
# force of the closure's prior over the rms of what is missing
SPARE = 3.0


@dataclass(frozen=True, slots=True)
class Closure:
    """A closure at a place, trained: `gain` is by how much the criterion fell, `gate` what is left behind it."""

    kind: ClosureKind
    insertion: Insertion
    fit: Fit
    gain: float
    gate: Gate

    @property
    def words(self) -> str:
        """What it is, in a sentence."""
        return _WORDS[self.kind]


@dataclass(frozen=True, slots=True)
class Reach:
    """What a closure must cover at its place, SI: middle and half of the range of positions, speed, size of force."""

    middle: float
    half: float
    speed: float
    force: float


def closure_card(kind: ClosureKind, place: Place) -> Card:
    """Return the card of a closure at a place, which no search tries."""
    classes: dict[Kind, type[Component]] = dict(zip((R, T, None), _CLASSES[kind], strict=True))
    return Card(
        id=f"{kind}_closure",
        summary=f"a law of displacement and speed by {_WORDS[kind]}",
        insertion=place.insertion,
        components={place.kind: classes[place.kind]},
        parameters=tuple(EffectParameter({place.kind: name}, -np.inf, np.inf, "choice") for name in _GIVEN[place.kind]),
        dissipative=False,
        nested_in=(),
        equivalent_to={},
        regressors=("x", "v"),
        excited_by="motion that covers the plane of displacement and speed",
        source="see cartpend_dae/library/closures.py",
    )


def closure_at(place: Place, kind: ClosureKind, reach: Reach) -> Insertion:
    """Return a closure at a place, as an effect that can be inserted into the model.

    Raises
    ------
    ModelError
        If there is no such kind, or the place is neither between two flanges nor at an input or a sensor.
    """
    if kind not in KINDS:
        kinds = ", ".join(f"`{known}`" for known in KINDS)
        raise ModelError(f"There is no closure of the kind `{kind}`{nearest(kind, KINDS, f'the kinds are: {kinds}.')}")
    if place.insertion not in ("parallel", "input", "sensor") or place.kind not in _GIVEN:
        raise ModelError(
            f"`{place.at}` is no place for a closure, which stands between two flanges, before an input "
            f"or behind a sensor."
        )
    numbers = (reach.force, reach.middle, reach.half, reach.speed)
    values = dict(zip(_GIVEN[place.kind], numbers, strict=False))
    return Insertion(closure_card(kind, place), place, values)


def kind_of(closure: Insertion) -> ClosureKind:
    """Return what kind of closure an effect is."""
    kinds: dict[str, ClosureKind] = {f"{kind}_closure": kind for kind in KINDS}
    return kinds[closure.card.id]


def weights(system: System, closure: str) -> tuple[Free, ...]:
    """Return the weights of the closure of a dotted name as free parameters with their priors."""
    found = []
    for parameter in system.parameters:
        path, _, name = parameter.name.rpartition(".")
        if path.startswith(f"{closure}.") and parameter.value is not None:
            prior = Prior(0.0 if name == "a" else parameter.value, WEIGHT)
            found.append(Free(parameter.name, parameter.value, -np.inf, np.inf, 1.0, "1", prior=prior))
    return tuple(found)


def train(
    bench: Workbench,
    taken: tuple[Insertion, ...],
    base: tuple[Fit, Fit],
    closure: Insertion,
    bandwidths: tuple[float, ...],
    sd: np.ndarray,
) -> Closure:
    """Train a closure and refit the model with it, along decreasing output injection.

    Parameters
    ----------
    bench
        The workbench.
    taken
        Effects in the model already.
    base
        Fits without the closure: the one to begin from, and the one to compare with, at the last bandwidth.
    closure
        The closure at its place, see `closure_at`.
    bandwidths
        Bandwidths of the output injection, one after the other [rad/s].
    sd
        Noise used as weight, shape (n_y,).

    Raises
    ------
    SolverError
        If no fit ends with a usable point.
    """
    problem = bench.with_weights(taken, closure, lambda system: weights(system, closure.prefix))
    begin, compared = base
    point, found = dict(begin.point), None
    for bandwidth in bandwidths:
        depends = [one.content for one in (*taken, closure)], bandwidth, point, sd
        at = {"bandwidth": bandwidth, "guess": point, "sd": sd}
        found = bench.store.recall("closure", depends, lambda at=at: estimate(problem, **at, patient=False))
        bench.report(
            f"closure at {bandwidth:.3g} rad/s", closure.prefix, float(np.sqrt(found.chi2 / found.n_residuals))
        )
        point = found.point
    assert found is not None
    if not np.isfinite(found.chi2):
        raise SolverError(f"The model with `{closure.prefix}` diverges.")
    return Closure(kind_of(closure), closure, found, coloured_bic(compared) - coloured_bic(found), residuals(found))
