"""Measured runs in SI units as `Experiment`, what their noise is, and the `Trajectory` of a simulation."""

import math
import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cartpend_dae.errors import StudyError
from cartpend_dae.everyday import for_people
from cartpend_dae.notebook import lines, sparkline, table

if TYPE_CHECKING:
    import xarray  # pyright: ignore[reportMissingImports]

SHOWN = 30
"""Variables of a trajectory that a notebook shows."""
CLEARLY = 0.5
"""Share of one estimate of noise below which another one is clearly less; each scatters by 4 to 7 %."""
FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One signal of a run: `values` (n,) in `unit` (SI), NaN where an output was not measured.

    `hold` is how an input continues between samples, `sd` the stated noise of an output (None: to be
    estimated), `quantum` its quantisation step (0: none seen).
    """

    values: FloatArray
    hold: Literal["zoh", "foh"]
    sd: float | None
    unit: str
    quantum: float


@dataclass(frozen=True, slots=True)
class Start:
    """A start value [SI] and whether it is estimated, with prior knowledge of the sd given; None keeps the model's."""

    value: float | None
    free: bool
    sd: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """One recorded run in SI, or a piece of one; `time` (n,) [s] increases strictly and starts as it was recorded.

    Rows in which no output is known need not have been recorded: they keep the steps of the integration short. A
    `steady` run starts at rest, apart from what `start` gives; one with `piece` [s] is fitted in pieces of that length.
    """

    name: str
    role: Literal["train", "select", "test"]
    time: FloatArray
    inputs: Mapping[str, Channel]
    outputs: Mapping[str, Channel]
    start: Mapping[str, Start]
    score: Literal["free", "horizon", "innovation"]
    horizon: float | None
    steady: bool = False
    piece: float | None = None


def noise_sd(values: FloatArray, inputs: Iterable[FloatArray] = ()) -> float:
    """Estimate the white noise of a smooth signal: median of its 6th differences, at least quantum/sqrt(12).

    The 6th difference of white noise has the variance C(12, 6) sd^2, and that of a well sampled signal is
    small. NaN are skipped: differences across them count only where there are no seven values in even steps. With
    fewer than seven values there is no difference, and the result is NaN.

    Any other sum of neighbouring samples, and of `inputs` at these, would do: what it leaves is noise at least. A
    signal that jumps with an input, as a current does with its voltage, is judged by the sum that leaves least.
    """
    rows = np.flatnonzero(np.isfinite(values))
    known = values[rows]
    if len(known) < 7:
        return math.nan
    steps = np.lib.stride_tricks.sliding_window_view(np.diff(rows), 6)
    is_even = (steps == steps[:, :1]).all(axis=1)
    is_even = is_even if is_even.any() else np.ones_like(is_even)
    noise = np.median(np.abs(np.diff(known, n=6)[is_even])) / 0.6745 / math.sqrt(math.comb(12, 6))
    beside = _least_left(known, [given[rows] for given in inputs], is_even)
    # both scatter, and the least of many sums more so: it counts where the difference is none of scatter
    noise = beside if beside < CLEARLY * noise else noise
    return float(max(noise, quantum(known) / math.sqrt(12)))


def jumps(values: FloatArray, inputs: Iterable[FloatArray]) -> bool:
    """Return whether what would pass for noise of a signal, as it is none of a smooth one, follows from its inputs."""
    return noise_sd(values, inputs) < CLEARLY * noise_sd(values)


def _least_left(values: FloatArray, inputs: list[FloatArray], is_even: np.ndarray) -> float:
    """Return what the sum of seven neighbouring values and of inputs there leaves that leaves least; as noise."""
    windows = [np.lib.stride_tricks.sliding_window_view(series, 7)[is_even] for series in (values, *inputs)]
    given = np.column_stack([np.ones(len(windows[0])), *windows[1:]])
    if not inputs or len(given) < 10 * given.shape[1] or not np.all(np.isfinite(given)):
        return math.inf
    basis, size, _ = np.linalg.svd(given, full_matrices=False)
    basis = basis[:, size > 1e-10 * size[0]]
    left = windows[0] - basis @ (basis.T @ windows[0])
    least = left @ np.linalg.svd(left, full_matrices=False)[2][-1]
    # the smallest singular value of noise alone is so much below the mean one
    short = 1 - math.sqrt(7 / (len(left) - basis.shape[1]))
    return float(np.median(np.abs(least)) / 0.6745 / short)


def quantum(values: FloatArray) -> float:
    """Return the step of a quantised signal: 9 in 10 differences are multiples of it; 0 if there is none."""
    known = values[np.isfinite(values)]
    levels = np.unique(known)
    if len(levels) < 3:
        return 0.0
    steps = np.abs(np.diff(known))
    rounding = 64 * np.finfo(float).eps * np.abs(levels).max()
    steps, spacings = steps[steps > rounding], np.diff(levels)
    spacings = spacings[spacings > rounding]
    if not len(steps) or not len(spacings):
        return 0.0
    for step in np.quantile(spacings, (0.0, 0.01, 0.05, 0.2, 0.5)):
        small = steps[steps / step < 10.5]
        counts = np.round(small / step)
        if not counts.any():
            continue
        step = float(counts @ small / (counts @ counts))
        counts = np.round(steps / step)
        is_multiple = (counts >= 1) & (np.abs(steps / step - counts) < 0.1)
        # An even ramp stands on multiples of its own rise; it is not quantised.
        if is_multiple.mean() >= 0.9 and (len(np.unique(counts)) > 1 or len(steps) < len(known) - 1):
            return step
    return 0.0


def von_neumann_z(residual: FloatArray) -> float:
    """Return how many standard deviations a residual is from white: about N(0, 1) if it is, large if smooth.

    With von Neumann's ratio q of the mean square successive difference to the variance about zero it is
    z = (1 - q/2) sqrt(n) over the n pairs of neighbours that are both known. The variance is taken about
    zero, not about the mean, because a residual with an offset has structure too.

    References
    ----------
    J. von Neumann (1941), Distribution of the ratio of the mean square successive difference to the variance,
    Ann. Math. Statist. 12(4), 367-395, doi:10.1214/aoms/1177731677.
    """
    before, after = residual[:-1], residual[1:]
    both = np.isfinite(before) & np.isfinite(after)
    before, after = before[both], after[both]
    power = (before @ before + after @ after) / 2
    return float(math.sqrt(len(before)) * (before @ after) / power) if power > 0 else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """The result of a run: `values` (n, n_columns) at `time` (n,) [s]; `units` holds one SI unit a name.

    `columns` says where each name stands in `values`: variables that are equal share a column. Without it the names
    stand in order. `n_events` counts the instants at which something was decided anew or an input jumped.
    """

    time: FloatArray
    names: tuple[str, ...]
    values: FloatArray
    units: tuple[str, ...]
    columns: Mapping[str, int] = field(default_factory=dict, repr=False)
    n_events: int = 0

    def __post_init__(self) -> None:
        """Make the table of names."""
        if not self.columns:
            object.__setattr__(self, "columns", {name: k for k, name in enumerate(self.names)})

    def __getitem__(self, name: str) -> FloatArray:
        if name == "time":
            return self.time
        if name not in self.columns:
            raise KeyError(f"The trajectory has no variable `{name}`; {nearest(name, self.names)}")
        return self.values[:, self.columns[name]]

    def __contains__(self, name: object) -> bool:
        return name == "time" or name in self.columns

    def with_constants(self, constants: Mapping[str, float], units: Iterable[str]) -> "Trajectory":
        """Return the trajectory with a column more for each constant, in SI `units`."""
        if not constants:
            return self
        values = np.hstack([self.values, np.tile([*constants.values()], (self.time.size, 1))])
        more = {name: self.values.shape[1] + k for k, name in enumerate(constants)}
        names, columns = (*self.names, *more), {**self.columns, **more}
        return Trajectory(self.time, names, values, (*self.units, *units), columns, self.n_events)

    def to_frame(self) -> pd.DataFrame:
        """Return the variables as columns, with `time` as the index."""
        values = self.values[:, [self.columns[name] for name in self.names]]
        return pd.DataFrame(values, pd.Index(self.time, name="time"), pd.Index(self.names))

    def to_pandas(self) -> pd.DataFrame:
        """Return `to_frame` with the SI units of the columns in its `attrs`."""
        frame = self.to_frame()
        frame.attrs["units"] = dict(zip(self.names, self.units, strict=True))
        return frame

    def to_xarray(self) -> "xarray.Dataset":
        """Return the variables as a data set over `time`, each with its SI unit.

        Raises
        ------
        StudyError
            If xarray is not installed.
        """
        try:
            import xarray
        except ImportError:
            raise StudyError("`to_xarray` needs xarray: pip install 'cartpend-dae[xarray]'.") from None
        time = xarray.Variable("time", self.time, {"units": "s"})
        variables = {
            name: ("time", self[name], {"units": unit}) for name, unit in zip(self.names, self.units, strict=True)
        }
        return xarray.Dataset(variables, coords={"time": time})

    def __repr__(self) -> str:
        if not self.time.size:
            return self._title
        ends = ((self[name][0], self[name][-1]) for name in self.names)
        rows = [
            (name, f"{first:.5g}", f"{last:.5g}", unit)
            for name, (first, last), unit in zip(self.names, ends, self.units, strict=True)
        ]
        return lines(self._title, [("variable", "start", "end", "unit"), *rows])

    @property
    def _title(self) -> str:
        ends = f" from {self.time[0]:g} s to {self.time[-1]:g} s" if self.time.size else ""
        return f"{len(self.names)} variables{ends}, {self.time.size} samples"

    def _repr_html_(self) -> str:
        """Show the variables in a notebook: ends, extremes and a small curve of each."""
        rows = []
        for name, unit in islice(zip(self.names, self.units, strict=True), SHOWN):
            factor, shown = for_people(unit)
            values = factor * self[name]
            numbers = (values[0], values[-1], np.nanmin(values), np.nanmax(values))
            rows.append((name, shown, *(f"{number:.4g}" for number in numbers), sparkline(values.tolist())))
        heads = ("variable", "unit", "start", "end", "least", "largest", "")
        more = len(self.names) - len(rows)
        return table(self._title, heads, rows, [f"and {more} more, by name or `to_pandas()`"] if more else [])

    def to_csv(self, path: Path | str) -> None:
        """Write a csv file with a column `time`; numbers read back exactly, and no half file is ever left."""
        path = Path(path)
        with NamedTemporaryFile("w", dir=path.parent, suffix=".part", delete=False, newline="") as file:
            try:
                self.to_frame().to_csv(file)
                file.close()
                os.chmod(file.name, 0o644)
                os.replace(file.name, path)
            except BaseException:
                os.unlink(file.name)
                raise


def nearest(name: str, known: Collection[str]) -> str:
    """Say which known names are like `name`, else which there are."""
    close = get_close_matches(name, list(known), n=3, cutoff=0.5)
    if close:
        return "did you mean " + " or ".join(f"`{other}`" for other in close) + "?"
    listing = ", ".join(f"`{other}`" for other in islice(known, 20))
    return f"there are: {listing}."
