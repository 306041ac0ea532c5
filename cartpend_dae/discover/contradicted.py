"""Whether a fit gives an effect numbers with which it is another thing than its name says."""

import numpy as np

from cartpend_dae.data import Experiment
from cartpend_dae.discover.evidence import taken_back
from cartpend_dae.effects import Insertion
from cartpend_dae.identify import Fit

# so many standard deviations from zero a wave is there
THERE = 3.0
# of two sizes of a wave that take each other back less than this share of the larger one remains: a constant less as
# much of a cosine that is a tenth of a turn long. Two harmonics of which a short way shows the sum leave more (0.75 on
# the rod, reported seeds 1129 and 1131)
REMAINS = 0.2


def contradicted(runs: tuple[Experiment, ...], insertion: Insertion, fit: Fit) -> str:
    """Say why a fit does not give an effect the numbers of such an effect; empty where it does.

    A law of friction peaks at rest; waves of a sensor's error that are longer than its way and higher than its range
    stand for anything; and of two waves of a law one that ends as the longest that may be is none: a load or a spring
    beside the other one. Sizes that take each other back are no wave either, but how a far longer one begins.
    """
    why = insertion.contradiction(fit.values) or _longest_wave(insertion, fit) or _no_wave(insertion, fit)
    if why or insertion.card.insertion != "sensor" or not _waves(insertion):
        return why
    read = [run.outputs[insertion.place.at].values for run in runs if insertion.place.at in run.outputs]
    span = max((float(np.nanmax(part) - np.nanmin(part)) for part in read), default=np.inf)
    error = max(abs(fit.values[size]) for size in insertion.size_names)
    return f"its error of {error:.3g} is larger than the range of {span:.3g} that is read" if error > span else ""


def _waves(insertion: Insertion) -> dict[str, list[str]]:
    """Return the wave numbers of an effect, each with the sizes that its card has before it, by dotted name."""
    found: dict[str, list[str]] = {}
    sizes: list[str] = []
    for item in insertion.parameters:
        name = f"{insertion.prefix}.{item.names[insertion.place.kind]}"
        if item.role == "wave":
            found[name], sizes = sizes, []
        elif item.role == "size":
            sizes.append(name)
    return found


def _longest_wave(insertion: Insertion, fit: Fit) -> str:
    """Say which of several waves ends as the longest that may be, and is there; empty where none does."""
    waves = _waves(insertion)
    if len(waves) < 2:
        return ""
    told = {e.name: e for e in fit.parameters}
    for wave, sizes in waves.items():
        end = told.get(wave)
        if end is None or end.status != "at-bound" or end.value > insertion.starts[wave]:
            continue
        if any(abs(told[size].value) > THERE * told[size].sd for size in sizes if size in told):
            name = wave.rpartition(".")[2]
            return f"its `{name}` ends at {end.value:.3g}, its lower bound: a load or a spring rather than a wave"
    return ""


def _no_wave(insertion: Insertion, fit: Fit) -> str:
    """Say which sizes of an effect that repeats along the way take each other back; empty where none do.

    Their own values are then told badly, or not at all.
    """
    if not _waves(insertion):
        return ""
    open_ones = [e.name for e in fit.parameters if e.name in insertion.size_names and e.status == "unidentifiable"]
    names, r = taken_back(fit, insertion.size_names, insertion.size_names, REMAINS)
    these = open_ones if len(open_ones) > 1 else sorted(names) if r else []
    said = " and ".join(f"`{name.rpartition('.')[2]}`" for name in these)
    return f"its {said} are told together alone: it repeats nowhere along the way" if these else ""
