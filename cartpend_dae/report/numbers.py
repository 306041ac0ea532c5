"""Numbers and lists as a page shows them."""

import math
from collections.abc import Iterable


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with so many digits; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    if 10**digits <= abs(value) < 1e7:
        text = f"{value:,.0f}".replace(",", "\u202f") if abs(value) >= 10_000 else f"{value:.0f}"
    else:
        text = f"{value:.{digits}g}"
    mantissa, _, exponent = text.replace("-", "−").partition("e")
    return f"{mantissa}·10{_raised(exponent)}" if exponent else mantissa


def _raised(exponent: str) -> str:
    """Write an exponent such as −05 above the line."""
    sign = "⁻" if exponent.startswith("−") else ""
    return sign + exponent.lstrip("+−0").translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))


PREFIXES = ((1e3, "m"), (1e6, "µ"), (1e9, "n"))
PLAIN = ("1", "%", "deg", "rad", "kg", "g", "K")


def prefixed(unit: str, largest: float) -> tuple[float, str]:
    """Return the factor and the unit with a prefix that make a small number easy to read."""
    if unit.startswith(PLAIN) or not 0 < largest < 0.01:
        return 1.0, unit
    factor, prefix = next((pair for pair in PREFIXES if largest * pair[0] >= 0.1), PREFIXES[-1])
    return factor, prefix + unit


def percent(value: float | None) -> str:
    """Write a share as percent."""
    return "–" if value is None else f"{number(100 * value)} %"


def capital(text: str) -> str:
    """Begin a sentence."""
    return text[:1].upper() + text[1:]


def listed(names: Iterable[str]) -> str:
    """Join names by commas and an `and`."""
    every = list(names)
    return every[0] if len(every) == 1 else f"{', '.join(every[:-1])} and {every[-1]}" if every else "no run"
