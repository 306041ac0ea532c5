"""Values with their units and uncertainties as people write them."""

import math

# a value whose standard deviation is so many times larger is hardly known, and shown with its own digits
HARDLY = 1e3


def for_people(unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which a quantity is shown: degrees for radians, else as it is."""
    shown = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2"}
    return (180 / math.pi, shown[unit]) if unit in shown else (1.0, unit)


def quantity(value: float, unit: str) -> str:
    """Write a value of SI `unit` in everyday units, with three digits."""
    factor, shown = for_people(unit)
    return with_unit(f"{value * factor:.3g}", shown)


def with_unit(text: str, unit: str) -> str:
    """Write a number with its unit; the unit 1 is left out."""
    return text if unit == "1" else f"{text} {unit}"


def uncertain(value: float, sd: float | None) -> str:
    """Write a value and its standard deviation to the digit that the latter allows: 0.01502 ± 0.00002."""
    if sd is None or not math.isfinite(sd):
        return f"{value:.4g}"
    if sd == 0 or not math.isfinite(value):
        return f"{value:.6g} ± {sd:.2g}"
    if sd > HARDLY * abs(value) > 0:
        return f"{value:.4g} ± {sd:.2g}"
    decimals = 1 - math.floor(math.log10(sd))
    if decimals > 8 or abs(value) >= 1e7:
        return f"{value:.{max(3, decimals + math.floor(math.log10(abs(value) or sd)) + 1)}g} ± {sd:.2g}"
    return f"{round(value, decimals):.{max(0, decimals)}f} ± {round(sd, decimals):.{max(0, decimals)}f}"
