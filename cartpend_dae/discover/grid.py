"""In which step a record stands, where noise lies over it."""

import numpy as np
from scipy import optimize

# places that the range of a record is divided into, and how many times finer than 1/range frequencies are tried
PLACES, FINER = 2**13, 4
# a record stands on a grid of at least so many steps, and each step has so many places
LEAST, PER_STEP = 4, 4
# of its phases the mean must be so long, and so many times as long as that of other steps; its square times the number
# of places that were read must be so much, which by chance happens in one of a hundred records: ln of what is tried
# over 0.01
COHERENT, CLEARER, CHANCE = 0.4, 3.0, 14.0


def grid(values: np.ndarray) -> float:
    """Return the step in multiples of which values stand, apart from an offset and noise; 0 if there is none.

    With the step q the phases 2 pi y/q are alike: their mean has the length exp(-2 (pi s/q)^2) with the noise s, and
    is short for any other q where the values are many. Where most of them rest in a few steps, all places that were
    read count alike.

    Parameters
    ----------
    values
        What was read, finite, shape (n,).

    References
    ----------
    K. V. Mardia, P. E. Jupp, Directional Statistics (2000), section 3.4 (the mean resultant length).
    """
    span = float(np.ptp(values)) if values.size else 0.0
    if not span > 0:
        return 0.0
    counts = np.histogram(values, PLACES, (values.min(), values.max()))[0]
    number = _peak(counts) or _peak(np.sign(counts))
    return 1 / _refined(values, number / (FINER * span), 1 / (FINER * span)) if number else 0.0


def _peak(counts: np.ndarray) -> int:
    """Return the first frequency, in parts `FINER` of one over the range, that stands out; 0 if none does."""
    length = np.abs(np.fft.rfft(counts, FINER * PLACES)) / counts.sum()
    coherent = max(COHERENT, np.sqrt(CHANCE / np.count_nonzero(counts)))
    for k in range(FINER * LEAST, min(FINER * PLACES // PER_STEP, length.size - 1)):
        is_peak = length[k] > coherent and length[k] >= length[k - 1] and length[k] >= length[k + 1]
        if is_peak and length[k] > CLEARER * np.median(length[k // 2 : 3 * k // 2]):
            return k
    return 0


def _refined(values: np.ndarray, frequency: float, width: float) -> float:
    """Return the frequency within a width at which the mean of the phases is longest."""
    found = optimize.minimize_scalar(
        lambda f: -abs(np.mean(np.exp(2j * np.pi * f * values))),
        bounds=(frequency - width, frequency + width),
        method="bounded",
        options={"xatol": width * 1e-4},
    )
    return float(found.x)
