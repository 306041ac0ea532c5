"""How large a hidden effect must be so that data show it, and how much of it is left after the rest is fitted.

The share of an effect is what it leaves in an output when the model without it is fitted to the training runs by
least squares: the largest rms over the outputs, in units of that output's noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blind.laws.law import Law
from blind.plant import Plant, run
from blind.rigs import NOISE, Rig, Run
from blind.stepping import Array

COARSE, FINE = 5, 20
LOWEST, HIGHEST = 10.0, 300.0


class InvisibleError(Exception):
    """The effect cannot be made visible on this rig with these numbers."""


@dataclass(frozen=True, slots=True)
class Column:
    """One run of one data set: parameters, numbers of each law, the run, disturbing forces (n_samples,)."""

    p: dict[str, float]
    laws: tuple[dict[str, float], ...]
    run: Run
    pushes: dict[str, Array] | None = None


def stacked(dicts: Sequence[dict[str, float]]) -> dict[str, Array]:
    return {name: np.array([d[name] for d in dicts], dtype=float) for name in dicts[0]}


def outputs(rig: Rig, kinds: Sequence[tuple[type[Law], str]], columns: Sequence[Column], substeps: int) -> Array:
    """Simulate columns with the same laws at once; return (n_columns, n_outputs, n_samples)."""
    laws = [kind(at, stacked([c.laws[k] for c in columns])) for k, (kind, at) in enumerate(kinds)]
    plant = Plant(rig.coordinates, stacked([c.p for c in columns]), laws)
    start = stacked([c.run.start for c in columns]) if rig.release else {}
    u = None if columns[0].run.u is None else np.array([c.run.u for c in columns]).T
    pushes = None
    if columns[0].pushes is not None:
        pushes = {name: np.array([c.pushes[name] for c in columns]).T for name in columns[0].pushes}  # type: ignore[index]
    shown = run(plant, start, rig.n_samples, substeps, u, pushes)
    return np.moveaxis(np.array([shown[name] for name in rig.outputs]), 2, 0)


class Baseline:
    """Least-squares fit of the model without effects to the two training runs of each data set.

    Parameters
    ----------
    rig
        The rig.
    p
        True parameters of each data set, where the fits start.
    runs
        Its runs; the first two train.
    """

    def __init__(self, rig: Rig, p: Sequence[dict[str, float]], runs: Sequence[tuple[Run, ...]]) -> None:
        self.rig, self.p, self.runs = rig, p, [list(r[:2]) for r in runs]
        self.noise = np.array([NOISE[name] for name in rig.outputs])[:, None]
        self.y, self.slopes = self._linear(list(p), self.runs)

    def _linear(self, p: Sequence[dict[str, float]], runs: Sequence[Sequence[Run]]) -> tuple[Array, Array]:
        """Return outputs (n_sets, 2, n_y, n) over noise and slopes (n_sets, n_unknowns, 2, n_y, n)."""
        rig, columns = self.rig, []
        keys = [free.key for free in rig.free]
        for q, pair in zip(p, runs, strict=True):
            columns += [Column(q, (), r) for r in pair]
            for key in keys:
                columns += [Column(q | {key: q[key] * (1 + 1e-3)}, (), r) for r in pair]
            if rig.release:
                columns += [
                    Column(q, (), replace(r, start={name: x * (1 + 1e-3) for name, x in r.start.items()})) for r in pair
                ]
        n = 1 + len(keys) + bool(rig.release)
        y = outputs(rig, (), columns, COARSE) / self.noise
        y = y.reshape(len(p), n, 2, *y.shape[1:])
        slopes = (y[:, 1:] - y[:, :1]) / 1e-3
        if rig.release:
            # each run has its own start
            first, second = slopes[:, -1:].copy(), slopes[:, -1:].copy()
            first[:, :, 1], second[:, :, 0] = 0.0, 0.0
            slopes = np.concatenate((slopes[:, :-1], first, second), axis=1)
        return y[:, 0], slopes

    def left_linear(self, moved: Array) -> Array:
        """Return what is left of changes (n_sets, k, 2, n_y, n) of the outputs [noise sd] after a linear fit."""
        left = np.empty_like(moved)
        for i, slope in enumerate(self.slopes):
            J = slope.reshape(len(slope), -1).T
            flat = moved[i].reshape(len(moved[i]), -1).T
            left[i] = (flat - J @ np.linalg.lstsq(J, flat, rcond=1e-9)[0]).T.reshape(moved[i].shape)
        return left

    def left(self, y: Array, iterations: int = 3) -> Array:
        """Return what is left of outputs (n_sets, 2, n_y, n) [noise sd] after a Gauss-Newton fit."""
        p, runs = [dict(q) for q in self.p], [list(pair) for pair in self.runs]
        shown, slopes = self.y, self.slopes
        best = np.full(len(p), np.inf)
        kept = np.empty_like(y)
        for iteration in range(iterations + 1):
            for i, rest in enumerate(y - shown):
                cost = float(np.mean(rest**2))
                if np.isfinite(cost) and cost < best[i]:
                    best[i], kept[i] = cost, rest
                J = slopes[i].reshape(len(slopes[i]), -1).T
                with np.errstate(all="ignore"):
                    good = np.isfinite(J).all() and np.isfinite(rest).all()
                change = np.linalg.lstsq(J, rest.reshape(-1), rcond=1e-9)[0] if good else np.zeros(J.shape[1])
                self._move(p[i], runs[i], np.clip(change, -0.7, 1.5))
            if iteration < iterations:
                shown, slopes = self._linear(p, runs)
        return kept

    def _move(self, p: dict[str, float], runs: list[Run], change: Array) -> None:
        """Change parameters and starts by shares of themselves."""
        for free, step in zip(self.rig.free, change, strict=False):
            p[free.key] = float(np.clip(p[free.key] * (1 + step), 1e-3 * free.nominal, 1e2 * free.nominal))
        if self.rig.release:
            for k in range(2):
                share = 1 + float(np.clip(change[len(self.rig.free) + k], -0.5, 0.5))
                runs[k] = replace(runs[k], start={name: x * share for name, x in runs[k].start.items()})


def share_of(left: Array, yardstick: Array) -> Array:
    """Return the share of effects from what they leave, (..., 2, n_y, n) [noise sd], in yardsticks (n_y,)."""
    rms = np.sqrt(np.mean(left**2, axis=(-3, -1)))
    return np.max(rms / yardstick, axis=-1)


def chosen_size(sizes: Sequence[float], shares: Array, target: float) -> float:
    """Return the size at which the share is the target, between sizes that fall; the largest if none reaches it."""
    for k in range(len(sizes) - 1):
        high, low = shares[k], shares[k + 1]
        if low <= target <= high and high > low > 0:
            weight = np.log(target / low) / np.log(high / low)
            return float(np.exp((1 - weight) * np.log(sizes[k + 1]) + weight * np.log(sizes[k])))
    finite = np.where(np.isfinite(shares), shares, 0.0)
    if len(sizes) and finite.min() > target:
        return float(sizes[-1])
    return float(sizes[int(np.argmax(finite))])
