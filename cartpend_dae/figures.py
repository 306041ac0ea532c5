"""Figures of a recorded channel: what it can show, whatever the model.

All are computed on the samples as they are; only spectra and delays need even steps, and interpolate for them.
"""

import math
from dataclasses import dataclass

import numpy as np

from cartpend_dae import units as si
from cartpend_dae.data import FloatArray, noise_sd
from cartpend_dae.recording import Signal

STILL = 0.05
"""Share of its rms below which a speed counts as zero."""
LEVELS = 20
"""Values between which an input that is held may jump for it to be a command, which has no noise."""
LIKE = 0.7
"""Least correlation of two channels whose delay is given."""


@dataclass(frozen=True, slots=True)
class ChannelFigures:
    """What one channel shows; `low`, `high`, `quantum`, `noise_sd` in SI, frequencies in Hz, shares of 1.

    `sign_changes` are of the value, beyond its noise, `reversals` of its rate of change. `still` is the share of
    time in which that rate is near zero, `saturated` that of samples at an extreme, `band` holds the middle 95 % of
    the power, `lines` counts the peaks of the spectrum.
    """

    variable: str
    kind: str
    column: str
    unit: str
    samples: int
    missing: float
    low: float
    high: float
    quantum: float
    noise_sd: float
    saturated: float
    sign_changes: int
    reversals: int
    still: float
    band: tuple[float, float]
    lines: int


@dataclass(frozen=True, slots=True)
class Delay:
    """By how much `late` follows `early` [s], with the spread of the estimate, and how it was seen."""

    early: str
    late: str
    seconds: float
    spread: float
    how: str


def channel_figures(signal: Signal, time: FloatArray) -> ChannelFigures:
    """Return the figures of a channel over the time that is used, `time` (n,) [s]."""
    inside = (signal.time >= time[0]) & (signal.time <= time[-1])
    known = inside & np.isfinite(signal.values)
    stamps, values = signal.time[known], signal.values[known]
    noise = _noise(signal, signal.values[inside])
    power = spectrum(stamps, values)
    rate, width = rate_of_change(stamps, values, noise)
    floor = STILL * _rms(rate)
    return ChannelFigures(
        variable=signal.variable,
        kind="output" if signal.hold is None else "input",
        column=signal.column,
        unit=signal.unit,
        samples=len(values),
        missing=1 - len(values) / max(1, np.count_nonzero(inside)),
        low=float(values.min()),
        high=float(values.max()),
        quantum=signal.quantum,
        noise_sd=noise,
        saturated=saturated_share(values, signal.quantum),
        sign_changes=sign_changes(values, 3 * noise),
        reversals=sign_changes(rate, floor),
        # a rate counts as long as it lasts
        still=float(np.average(np.abs(rate) <= floor, weights=width)),
        band=power_band(*power),
        lines=count_lines(power[1]),
    )


def _noise(signal: Signal, values: FloatArray) -> float:
    """Return the noise floor; what is commanded and jumps from level to level has none."""
    levels = np.unique(values[np.isfinite(values)])
    if signal.hold == "zoh" and len(levels) <= LEVELS:
        return 0.0
    return noise_sd(values)


def saturated_share(values: FloatArray, quantum: float) -> float:
    """Return the share of samples at the least or largest value; a signal that turns there once is not saturated."""
    low, high = values.min(), values.max()
    tolerance = max(quantum / 2, 1e-9 * (high - low))
    share = 0.0
    for at_end in (values <= low + tolerance, values >= high - tolerance):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at_end.astype(int), [0]])))
        lengths = edges[1::2] - edges[::2]
        share += float(lengths[lengths >= 3].sum()) / len(values)
    return min(share, 1.0)


def sign_changes(values: FloatArray, floor: float) -> int:
    """Count how often the values change sign; those within `floor` of zero have none."""
    signs = np.sign(values[np.abs(values) > floor])
    return int(np.count_nonzero(np.diff(signs)))


def rate_of_change(time: FloatArray, values: FloatArray, noise: float) -> tuple[FloatArray, FloatArray]:
    """Return rates of change [1/s] and the times over which they are taken [s], shapes (n - k,).

    They are taken over k samples, so many that noise alone stays below half of what counts as zero.
    """
    k, last = 1, max(1, len(values) // 10)
    while True:
        width = time[k:] - time[:-k]
        rate = (values[k:] - values[:-k]) / width
        if k == last or math.sqrt(2) * noise / float(np.median(width)) < STILL / 2 * _rms(rate):
            return rate, width
        k = min(last, 1 + 3 * k // 2)


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(values**2)))


def spectrum(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequencies [Hz] and power of the detrended signal under a Hann window, without frequency zero."""
    grid = np.linspace(time[0], time[-1], len(time))
    even = np.interp(grid, time, values)
    even = even - np.polyval(np.polyfit(grid - grid[0], even, 1), grid - grid[0])
    power = np.abs(np.fft.rfft(even * np.hanning(len(even)))) ** 2
    return np.fft.rfftfreq(len(even), grid[1] - grid[0])[1:], power[1:]


def power_band(frequency: FloatArray, power: FloatArray) -> tuple[float, float]:
    """Return the frequencies below and above which 2.5 % of the power lie; (0, 0) if there is none."""
    total = np.cumsum(power)
    if not total[-1] > 0:
        return 0.0, 0.0
    low, high = np.searchsorted(total, [0.025 * total[-1], 0.975 * total[-1]])
    return float(frequency[low]), float(frequency[min(high, len(frequency) - 1)])


def count_lines(power: FloatArray) -> int:
    """Count the peaks of a spectrum that hold 1 % of the largest and stand ten times above their neighbourhood."""
    if len(power) < 5 or not power.max() > 0:
        return 0
    padded = np.concatenate([[0.0], power, [0.0]])
    is_peak = (padded[1:-1] > padded[:-2]) & (padded[1:-1] >= padded[2:]) & (power > 0.01 * power.max())
    reach = max(5, len(power) // 50)
    floors = [np.median(power[max(0, k - reach) : k + reach + 1]) for k in np.flatnonzero(is_peak)]
    return int(np.count_nonzero(power[is_peak] > 10 * np.array(floors))) if floors else 0


def find_delays(signals: tuple[Signal, ...], time: FloatArray) -> tuple[Delay, ...]:
    """Estimate delays between channels of one quantity, and from the steps of each input to its first effect.

    A delay between two channels may be physical (a shaft winds up) as well as one of the measurement.
    """
    found = []
    for i, first in enumerate(signals):
        for second in signals[i + 1 :]:
            if si.same_dimension(first.unit, second.unit):
                found.append(lag(first, second, time))
    for source in (signal for signal in signals if signal.hold is not None):
        for signal in (signal for signal in signals if signal.hold is None):
            found.append(onset(source, signal, time))
    return tuple(delay for delay in found if delay is not None)


def lag(first: Signal, second: Signal, time: FloatArray) -> Delay | None:
    """Find the delay at which the changes of two channels are most alike, if they are alike at all.

    The changes are taken because a common trend would be alike at any delay; the peak of their cross-correlation
    is refined by a parabola. The spread is that of three parts of the run.
    """
    grid = np.linspace(time[0], time[-1], min(len(time), 200_000))
    a, b = (np.gradient(_even(signal, grid)) for signal in (first, second))
    whole = _peak(a, b)
    if whole is None or whole[1] < LIKE:
        return None
    step = grid[1] - grid[0]
    thirds = [_peak(x, y) for x, y in zip(np.array_split(a, 3), np.array_split(b, 3), strict=True)]
    usable = [peak[0] * step for peak in thirds if peak is not None and peak[1] >= LIKE]
    spread = float(np.std(usable)) if len(usable) > 1 else math.nan
    early, late = (first, second) if whole[0] >= 0 else (second, first)
    how = f"correlation {whole[1]:.2f} of their changes"
    return Delay(early.variable, late.variable, abs(whole[0]) * step, spread, how)


def _even(signal: Signal, grid: FloatArray) -> FloatArray:
    known = np.isfinite(signal.values)
    return np.interp(grid, signal.time[known], signal.values[known])


def _peak(a: FloatArray, b: FloatArray) -> tuple[float, float] | None:
    """Return where the cross-correlation of a(t) and b(t + delay) has its peak [samples], and its height."""
    a, b = a - a.mean(), b - b.mean()
    size = math.sqrt(float(a @ a) * float(b @ b))
    n = len(a)
    if n < 8 or not size > 0:
        return None
    m = 1 << (2 * n - 1).bit_length()
    every = np.fft.irfft(np.conj(np.fft.rfft(a, m)) * np.fft.rfft(b, m), m) / size
    reach = n // 4
    near = np.concatenate([every[-reach:], every[: reach + 1]])
    k = int(np.argmax(near))
    if k in (0, len(near) - 1):
        return None
    before, top, after = near[k - 1 : k + 2]
    bend = before - 2 * top + after
    return k - reach + (0.5 * (before - after) / bend if bend < 0 else 0.0), float(top)


def onset(source: Signal, signal: Signal, time: FloatArray) -> Delay | None:
    """Find when an output first answers the steps of an input, from the shape of the beginning of its answer.

    Counted are steps of more than a fifth of the range after ten samples at one level, at which the output has been
    on a straight line for as long as its answer is looked at. A dead band or a friction that sticks delays it too.
    """
    inside = np.isfinite(source.values) & (source.time >= time[0]) & (source.time <= time[-1])
    stamps, values = source.time[inside], source.values[inside]
    span = float(np.ptp(values))
    found = []
    for k in np.flatnonzero(np.abs(np.diff(values)) > max(0.2 * span, 1e-300)):
        if k >= 10 and np.ptp(values[k - 10 : k + 1]) < 0.01 * span:
            level = np.flatnonzero(np.abs(values - values[k]) > 0.05 * span)
            begin = stamps[max((j + 1 for j in level if j < k), default=0)]
            later = np.flatnonzero(np.abs(values[k + 1 :] - values[k + 1]) > 0.05 * span)
            end = stamps[k + 1 + later[0]] if later.size else stamps[-1]
            found.append(_onset_after(signal, float(begin), float(stamps[k + 1]), float(end)))
    seen = np.array([delay for delay in found if delay is not None])
    if not seen.size:
        return None
    spread = float(1.4826 * np.median(np.abs(seen - np.median(seen)))) if seen.size > 1 else math.nan
    how = f"onset after {seen.size} step{'s' if seen.size > 1 else ''}"
    return Delay(source.variable, signal.variable, float(np.median(seen)), spread, how)


def _onset_after(signal: Signal, begin: float, step: float, end: float) -> float | None:
    """Find the delay of the answer to one step [s]; None if the output was not on a line before it."""
    known = np.isfinite(signal.values)
    stamps, values = signal.time[known], signal.values[known]
    before, after = (stamps >= begin) & (stamps < step), (stamps >= step) & (stamps < end)
    noise = max(noise_sd(values), signal.quantum / 2, 1e-9 * float(np.ptp(values)))
    n = 8
    while True:
        if min(np.count_nonzero(before), np.count_nonzero(after)) < n:
            return None
        t_before, t = stamps[before][-n:] - step, stamps[after][:n] - step
        line = np.polyfit(t_before, values[before][-n:], 1)
        if float(np.std(values[before][-n:] - np.polyval(line, t_before))) > 3 * noise:
            return None
        answer = values[after][:n] - np.polyval(line, t)
        if np.count_nonzero(np.abs(answer) > 20 * noise) >= n // 2:
            return _beginning(t, answer)
        n += max(1, n // 4)


def _beginning(t: FloatArray, answer: FloatArray) -> float:
    """Fit a (t - t0)^n + b (t - t0)^(n + 1), zero before t0, and return t0.

    n = 0, 1, 2, 3 is a jump, a current behind an inductance, a speed, a position.
    """
    best = (math.inf, 0.0)
    for t0 in np.linspace(0.0, t[len(t) // 2], 101):
        since = np.clip(t - t0, 0, None)
        for n in (0, 1, 2, 3):
            shape = np.column_stack([np.where(t >= t0, since**k, 0.0) for k in (n, n + 1)])
            size = np.linalg.norm(shape, axis=0) + 1e-300
            weights = np.linalg.lstsq(shape / size, answer, rcond=None)[0]
            best = min(best, (float(np.sum((answer - shape / size @ weights) ** 2)), float(t0)))
    return best[1]
