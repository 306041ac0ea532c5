"""Stiffness of the two springs of the rig, from the published table of hung weights.

Run it to print the table: ``python models/studies/springs.py``.

A straight line is fitted to the stretch against the load: the loads were weighed and the lengths read off, so
the lengths carry the error. The stiffness is the inverse of the slope, and the ends of its confidence interval are
the inverses of the ends of the slope's (Student's t with n - 2 degrees of freedom).

The table gives masses in pounds. A load of 4.448 N for each pound (the pound-force to four digits, g = 9.8062 m/s2)
gives the published 1320.1 N/m of spring 2 to its last digit; exact standard gravity gives 1320.2 and
g = 9.81 m/s2 gives 1320.7, which matters nothing beside the confidence interval. Spring 1 does not follow: its row
gives 1215.7 N/m, and the study prints 1197.3. That is inside the confidence interval, but no choice of g that fits spring 2
makes it; one reading misprinted by 5 mm would (0.130 instead of 0.135 m gives 1196.3, for one).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import linregress, t

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
    line = linregress(load, length)
    half = float(t.ppf((1 + confidence) / 2, len(load) - 2)) * line.stderr
    return Stiffness(1 / line.slope, 1 / (line.slope + half), 1 / (line.slope - half), float(line.intercept))


def springs() -> dict[str, Stiffness]:
    """Return both springs of the table."""
    load = MASS_LB * NEWTON_PER_POUND
    return {"K1": stiffness(load, LENGTH_1_M), "K2": stiffness(load, LENGTH_2_M)}


def main() -> None:
    print("spring  k [N/m]  95 % from     to  length [m]  published [N/m]  difference")
    for name, k in springs().items():
        published = PUBLISHED[name]
        print(
            f"{name:6}{k.value:9.1f}{k.low:11.1f}{k.high:7.1f}{k.length:12.4f}{published:17.1f}"
            f"{100 * (published / k.value - 1):+10.2f} %"
        )


if __name__ == "__main__":
    main()
