"""Inputs that a designer of experiments would try: multisine, chirp, random binary signal, steps."""

import numpy as np

# lines of a multisine, and how many changes a random binary signal makes in the period of the fastest
LINES = 12


def multisine(time: np.ndarray, low: float, high: float, generator: np.random.Generator) -> np.ndarray:
    """Return a sum of sines of equal amplitude between two frequencies [Hz], of largest value 1.

    Phases are those of Schroeder, which keep the peaks low; frequencies are whole multiples of 1/duration, moved by
    `generator` so that they are no multiples of each other.

    References
    ----------
    M. R. Schroeder, IEEE Trans. Inf. Theory 16 (1970), 85-89, doi:10.1109/TIT.1970.1054411.
    """
    duration = time[-1] - time[0]
    lines = np.geomspace(max(low, 1 / duration), high, LINES) * duration
    lines = np.unique(np.maximum(1, np.round(lines + generator.uniform(-0.4, 0.4, LINES))))
    k = np.arange(1, lines.size + 1)
    phases = -np.pi * k * (k - 1) / lines.size
    angle = 2 * np.pi * np.outer(time - time[0], lines / duration) + phases
    return _full(np.sin(angle).sum(axis=1))


def chirp(time: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return a sine whose frequency [Hz] rises exponentially, of amplitude 1."""
    share = (time - time[0]) / (time[-1] - time[0])
    ratio, duration = high / low, time[-1] - time[0]
    phase = 2 * np.pi * low * duration * (ratio**share - 1) / np.log(ratio)
    return np.sin(phase)


def binary(time: np.ndarray, high: float, generator: np.random.Generator) -> np.ndarray:
    """Return a random binary signal of levels -1 and 1 that may change `2 high` times a second [Hz]."""
    slots = np.floor((time - time[0]) * 2 * high + 1e-9).astype(int)
    return np.where(generator.integers(0, 2, slots[-1] + 1)[slots] == 1, 1.0, -1.0)


def steps(time: np.ndarray) -> np.ndarray:
    """Return up, back, down and back to 0, each for a quarter of the time, of amplitude 1."""
    quarter = np.minimum(3, np.floor(4 * (time - time[0]) / (time[-1] - time[0]))).astype(int)
    return np.array([1.0, 0.0, -1.0, 0.0])[quarter]


def _full(values: np.ndarray) -> np.ndarray:
    return values / np.abs(values).max()
