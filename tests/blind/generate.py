"""Data sets from their keys alone: the same key gives the same bytes, alone or among others."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from blind.catalogue import EFFECTS, scale_of
from blind.keys import Key
from blind.laws.law import Law
from blind.plant import SAMPLE
from blind.rigs import NOISE, RIGS, ROLES, STEPS, Rig, Run
from blind.sizes import COARSE, FINE, HIGHEST, LOWEST, Baseline, Column, InvisibleError, chosen_size, outputs, share_of
from blind.stepping import Array

DISTURBANCE = 0.01
NOISY = 5.0


@dataclass(frozen=True, slots=True)
class DataSet:
    """What the tool sees, and what it must not: `truth`. Arrays are (n_outputs, n_samples) by run."""

    key: Key
    runs: tuple[Run, ...]
    measured: tuple[Array, ...]
    guesses: dict[str, float]
    truth: dict[str, Any]


@dataclass(slots=True)
class Draft:
    """A data set on the way: parameters, runs, numbers of each law at size 1, sizes, shares, disturbances."""

    key: Key
    rig: Rig
    p: dict[str, float]
    runs: tuple[Run, ...]
    full: list[dict[str, float]]
    targets: list[float]
    guesses: dict[str, float]
    pushes: list[dict[str, Array]] | None
    yardstick: Array
    sizes: list[float]
    shares: list[float]

    @property
    def laws(self) -> tuple[dict[str, float], ...]:
        names = [effect for effect, _ in self.key.effects]
        return tuple(EFFECTS[n].sized(f, s) for n, f, s in zip(names, self.full, self.sizes, strict=True))


def generate(keys: Sequence[Key]) -> list[DataSet | InvisibleError]:
    """Make data sets; a key whose effect cannot be made visible gives the error in its place.

    Parameters
    ----------
    keys
        Any keys; those of the same rig and laws are simulated together, and each gives what it gives alone.
    """
    drafts = [draft(key) for key in keys]
    groups: dict[tuple[Any, ...], list[Draft]] = defaultdict(list)
    for item in drafts:
        shapes = tuple(item.key.shape(effect) for effect, _ in item.key.effects)
        groups[(item.key.rig, item.key.effects, shapes, item.pushes is None)].append(item)
    made: dict[Key, DataSet | InvisibleError] = {}
    for group in groups.values():
        wrong = sized(group)
        made |= {item.key: wrong[item.key] for item in group if item.key in wrong}
        made |= finished([item for item in group if item.key not in wrong])
    return [made[key] for key in keys]


def draft(key: Key) -> Draft:
    """Draw all random numbers of a data set but its noise."""
    rig, g = RIGS[key.rig], key.stream("truth")
    p, runs = rig.draw(g), rig.runs(g, rig.n_samples)
    full = [
        {name: float(x) for name, x in EFFECTS[effect].draw(g, scale_of(rig.scales, at)).items()}
        for effect, at in key.effects
    ]
    targets = [float(np.exp(g.uniform(np.log(1.5 * LOWEST), np.log(HIGHEST)))) for _ in key.effects]
    wrong = [float(np.exp(g.choice((-1, 1)) * g.uniform(np.log(2), np.log(5)))) for _ in rig.free]
    is_wrong = key.regime == "wrong_start"
    guesses = {
        free.name: p[free.key] * factor if is_wrong else free.nominal
        for free, factor in zip(rig.free, wrong, strict=True)
    }
    pushes = disturbances(key, rig, p, runs) if key.regime == "disturbed" else None
    return Draft(key, rig, p, runs, full, targets, guesses, pushes, np.ones(len(rig.outputs)), [], [])


def disturbances(key: Key, rig: Rig, p: dict[str, float], runs: tuple[Run, ...]) -> list[dict[str, Array]]:
    """Return random forces at each connection, 1 % of the typical force there, correlated over 0.05 to 1 s."""
    g, series = key.stream("disturbance"), []
    for run in runs:
        typical = {}
        if "phi" in rig.coordinates:
            angle = 0.5 * abs(run.start["phi"]) if run.start else 0.2
            typical["phi"] = p["m_p"] * p["g"] * p["l"] / 2 * np.sin(angle)
        if "s" in rig.coordinates:
            pull = 0.35 * abs(run.start["s"]) * (p["K1"] + p["K2"]) if run.u is None else 0.0
            typical["s"] = pull if run.u is None else p["n"] * p["k"] / p["R"] * float(np.sqrt(np.mean(run.u**2)))
        series.append({name: coloured(g, DISTURBANCE * force, rig.n_samples) for name, force in typical.items()})
    return series


def coloured(g: np.random.Generator, sd: float, n: int) -> Array:
    """Return an Ornstein-Uhlenbeck process at the samples."""
    keep = np.exp(-SAMPLE / np.exp(g.uniform(np.log(0.05), np.log(1.0))))
    white, x = g.standard_normal(n), np.empty(n)
    x[0] = white[0]
    for k in range(1, n):
        x[k] = keep * x[k - 1] + np.sqrt(1 - keep**2) * white[k]
    return sd * x


def kinds_of(key: Key, only: int | None = None) -> list[tuple[type[Law], str]]:
    found = []
    for k, (name, at) in enumerate(key.effects):
        effect = EFFECTS[name]
        law = effect.other if key.shape(name) == "other" and effect.other else effect.same
        if only is None or k == only:
            found.append((law, at))
    return found


def sized(group: list[Draft]) -> dict[Key, InvisibleError]:
    """Choose the sizes of all effects of a group, each by itself; return the keys that cannot be shown."""
    rig = group[0].rig
    wrong: dict[Key, InvisibleError] = {}
    if not group[0].key.effects:
        return wrong
    baseline = Baseline(rig, [d.p for d in group], [d.runs for d in group])
    if group[0].pushes is not None:
        _measure_disturbances(group, baseline)
    for k, (name, at) in enumerate(group[0].key.effects):
        _first_sizes(group, k, baseline)
        for attempt in range(4):
            y = outputs(rig, kinds_of(group[0].key, k), _training(group, k), COARSE) / baseline.noise
            y = y.reshape(len(group), 2, *y.shape[1:])
            for item, left in zip(group, baseline.left(y), strict=True):
                share = float(share_of(left, item.yardstick))
                item.shares[k] = share
                if attempt < 3 and not LOWEST <= share <= HIGHEST:
                    item.sizes[k] = _resized(item.sizes[k], share)
            if all(LOWEST <= item.shares[k] <= HIGHEST for item in group):
                break
        for item in group:
            if not LOWEST <= item.shares[k] <= 1.2 * HIGHEST:
                wrong[item.key] = InvisibleError(
                    f"{item.key.name}: {name} at {at} leaves {item.shares[k]:.2g} noise sd."
                )
    return wrong


def _resized(size: float, share: float) -> float:
    """Return a better size where the share is too small or too large."""
    aim = 1.5 * LOWEST if share < LOWEST else 0.7 * HIGHEST
    # a limit that is never reached leaves nothing at all; a run that is lost leaves no number
    factor = aim / share if share > 0 and np.isfinite(share) else 4.0 if share == 0 else 0.5
    return float(np.clip(size * np.clip(factor, 0.2, 4.0), 1e-4, 1.0))


def _training(group: list[Draft], k: int) -> list[Column]:
    # of several effects the later ones have no size yet
    name = group[0].key.effects[k][0]
    return [
        Column(item.p, (EFFECTS[name].sized(item.full[k], item.sizes[k]),), run)
        for item in group
        for run in item.runs[:2]
    ]


def _measure_disturbances(group: list[Draft], baseline: Baseline) -> None:
    """Take 0.3 of what disturbances leave as the yardstick of an output where that is more than noise."""
    columns = [
        Column(item.p, (), run, push)
        for item in group
        for run, push in zip(item.runs[:2], item.pushes or (), strict=False)
    ]
    y = outputs(group[0].rig, (), columns, COARSE) / baseline.noise
    moved = y.reshape(len(group), 1, 2, *y.shape[1:]) - baseline.y[:, None]
    for item, left in zip(group, baseline.left_linear(moved), strict=True):
        item.yardstick = np.maximum(1.0, 0.3 * np.sqrt(np.mean(left[0] ** 2, axis=(0, 2))))


def _first_sizes(group: list[Draft], k: int, baseline: Baseline) -> None:
    """Choose sizes by linear fits on a grid."""
    name = group[0].key.effects[k][0]
    effect, columns = EFFECTS[name], []
    for item in group:
        for size in effect.sizes:
            columns += [Column(item.p, (effect.sized(item.full[k], size),), run) for run in item.runs[:2]]
    with np.errstate(all="ignore"):
        y = outputs(group[0].rig, kinds_of(group[0].key, k), columns, COARSE) / baseline.noise
    y = y.reshape(len(group), len(effect.sizes), 2, *y.shape[1:])
    moved = np.nan_to_num(y - baseline.y[:, None], nan=0.0, posinf=0.0, neginf=0.0)
    for item, left in zip(group, baseline.left_linear(moved), strict=True):
        shares = share_of(left, item.yardstick)
        item.sizes.append(chosen_size(effect.sizes, shares, item.targets[k]))
        item.shares.append(0.0)


def finished(group: list[Draft]) -> dict[Key, DataSet]:
    """Simulate with fine steps, and lay noise and steps over what the sensors show."""
    if not group:
        return {}
    rig, kinds = group[0].rig, kinds_of(group[0].key)
    clean = outputs(rig, kinds, [Column(d.p, d.laws, run) for d in group for run in d.runs], FINE)
    moved = clean
    if group[0].pushes is not None:
        columns = [
            Column(d.p, d.laws, run, push) for d in group for run, push in zip(d.runs, d.pushes or (), strict=True)
        ]
        moved = outputs(rig, kinds, columns, FINE)
    shape = (len(group), 3, *clean.shape[1:])
    return {
        item.key: _data_set(item, y, x)
        for item, y, x in zip(group, clean.reshape(shape), moved.reshape(shape), strict=True)
    }


def _data_set(item: Draft, clean: Array, moved: Array) -> DataSet:
    key, rig, g = item.key, item.rig, item.key.stream("noise")
    measured = []
    for y in moved:
        # a log has nine digits, and a last digit that depends on the machine is not among them
        measured.append(np.array([_sensed(name, row, key.regime, g) for name, row in zip(rig.outputs, y, strict=True)]))
    floors = np.sqrt(np.mean((np.array(measured) - clean) ** 2, axis=2))
    hidden = [
        {"effect": effect, "at": at, "shape": key.shape(effect), "share": float(f"{share:.4g}"), "parameters": numbers}
        for (effect, at), share, numbers in zip(key.effects, item.shares, item.laws, strict=True)
    ]
    truth = {
        "rig": key.rig,
        "regime": key.regime,
        "kind": key.kind,
        "seed": key.seed,
        "exclude": list(key.exclude),
        "effects": hidden,
        "parameters": {free.name: item.p[free.key] for free in rig.free},
        "noise": {name: NOISE[name] * (NOISY if key.regime == "noisy" else 1.0) for name in rig.outputs},
        "floor": {f"run{k + 1}": dict(zip(rig.outputs, map(float, row), strict=True)) for k, row in enumerate(floors)},
        "roles": {f"run{k + 1}": role for k, role in enumerate(ROLES)},
    }
    return DataSet(key, item.runs, tuple(measured), item.guesses, truth)


def _sensed(name: str, y: Array, regime: str, g: np.random.Generator) -> Array:
    noise = NOISE[name] * g.standard_normal(y.size)
    if regime == "quantised" and name in STEPS:
        return STEPS[name] * np.round(y / STEPS[name])
    return y + noise * (NOISY if regime == "noisy" else 1.0)
