"""Stiffness of the two springs of the rig, from the published table of hung weights.

``python models/studies/springs.py`` prints the table.

A straight line is fitted to the length against the load: the loads were weighed and the lengths read off, so
the lengths carry the error. The stiffness is the inverse of the slope, and the ends of its confidence
interval are the inverses of those of the slope (Student's t with n - 2 degrees of freedom).

The published table gives masses in pounds. A load of 4.448 N for each (the pound-force to four digits, which
is g = 9.8062 m/s2) gives the published 1320.1 N/m of spring 2 to its last digit; standard gravity gives
1320.2 and 9.81 m/s2 gives 1320.7, which is nothing beside the confidence interval. Spring 1 does not agree:
the table gives 1215.7 N/m, and the study prints 1197.3. No g can mend that, for it would spoil spring 2; a
single reading that is 5 mm off would come close (0.130 m in place of 0.135 m gives 1196.3).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

NEWTON_PER_POUND = 4.448
MASS_LB = np.array([0.0, 7.48, 10.005, 12.45, 16.45])
LENGTH_1_M = np.array([0.110, 0.135, 0.145, 0.155, 0.170])
LENGTH_2_M = np.array([0.125, 0.150, 0.160, 0.1675, 0.180])
PUBLISHED = {"K1": 1197.3, "K2": 1320.1}


@dataclass(frozen=True, slots=True)
class Stiffness:
    """A stiffness [N/m] with the ends of its confidence interval, and the unstretched length [m]."""

    value: float
    low: float
    high: float
    length: float


def stiffness(load: NDArray[np.float64], length: NDArray[np.float64], confidence: float = 0.95) -> Stiffness:
    """Fit length = length_0 + load / k to loads [N] and lengths [m]."""
    (slope, intercept), covariance = np.polyfit(load, length, 1, cov=True)
    half = t.ppf((1 + confidence) / 2, len(load) - 2) * np.sqrt(covariance[0, 0])
    return Stiffness(1 / slope, 1 / (slope + half), 1 / (slope - half), intercept)


def springs() -> dict[str, Stiffness]:
    """Return both springs of the table."""
    load = MASS_LB * NEWTON_PER_POUND
    return {"K1": stiffness(load, LENGTH_1_M), "K2": stiffness(load, LENGTH_2_M)}


def agrees(name: str) -> bool:
    """Return whether the table gives the published stiffness within 0.1 %, far below its uncertainty."""
    return abs(PUBLISHED[name] / springs()[name].value - 1) < 1e-3


def main() -> None:
    print("spring   k [N/m]   95 % interval [N/m]   length [m]   published [N/m]   difference")
    for name, k in springs().items():
        published = PUBLISHED[name]
        verdict = "agrees" if agrees(name) else "does not follow from the table"
        print(
            f"{name:6}{k.value:10.1f}{k.low:13.1f} to {k.high:6.1f}{k.length:12.4f}{published:16.1f}"
            f"{100 * (published / k.value - 1):+13.2f} %   {verdict}"
        )


if __name__ == "__main__":
    main()
