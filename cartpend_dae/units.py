"""Units: Modelica unit strings such as `N.m/rad`, their algebra, and conversion at the edges.

A unit string follows the Modelica specification 3.6, section 19: `.` multiplies, one `/` divides, an exponent
follows its symbol (`m/s2`), a denominator of several factors stands in parentheses (`J/(kg.K)`), and `1` is
the unit of a number. Beyond it, `m^(1/2)` writes a fractional exponent.

The angle: SI counts the radian as 1, so `N.m/A` and `V.s/rad` are one quantity, and mechanics drops it at
will (`v == r * w` has m/s on one side and m.rad/s on the other). `Unit` keeps rad as an exponent of its own,
as FMI does, because printed units read better; `same_dimension` ignores it, so no equation is refused for a
radian. The price: a check cannot tell torque from energy, or turns from radians. `to_si` and `from_si` do
refuse `Hz` or `1/min` where rad/s is expected, because there a factor of 2 pi would be lost in silence.
"""

import math
import re
from dataclasses import dataclass
from difflib import get_close_matches
from fractions import Fraction
from functools import lru_cache, reduce
from typing import Any, TypeVar

from numpy.typing import NDArray

from .errors import ModelError

Values = TypeVar("Values", float, NDArray[Any])

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""The base units of FMI, in its order, which is the order of `Unit.dimension`."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: its exponents over `BASE_UNITS`, and value in SI = `factor` * value + `offset`."""

    dimension: tuple[Fraction | int, ...]  # whole ones as int: ten times as fast over a large model
    factor: float = 1.0
    offset: float = 0.0

    def __str__(self) -> str:
        return format_unit(self)


def multiply(a: Unit | str, b: Unit | str) -> Unit:
    """The unit of a product."""
    a, b = _without_offset(a), _without_offset(b)
    return Unit(tuple(x + y for x, y in zip(a.dimension, b.dimension, strict=True)), a.factor * b.factor)


def divide(a: Unit | str, b: Unit | str) -> Unit:
    """The unit of a quotient."""
    a, b = _without_offset(a), _without_offset(b)
    return Unit(tuple(x - y for x, y in zip(a.dimension, b.dimension, strict=True)), a.factor / b.factor)


def power(unit: Unit | str, exponent: float | Fraction) -> Unit:
    """The unit of a power; a float exponent is taken as the fraction that it stands for (1/3, 0.37)."""
    unit, exact = _without_offset(unit), Fraction(exponent).limit_denominator(1000)
    exact = int(exact) if exact.denominator == 1 else exact
    return Unit(tuple(x * exact for x in unit.dimension), unit.factor ** float(exact))


def derivative(unit: Unit | str) -> Unit:
    """The unit of a time derivative: per second, and an offset falls away (degC gives K/s)."""
    unit = _as_unit(unit)
    return divide(Unit(unit.dimension, unit.factor), "s")


def same_dimension(a: Unit | str, b: Unit | str) -> bool:
    """Whether two units measure the same quantity, whatever their scale; radians do not count."""
    return _as_unit(a).dimension[:-1] == _as_unit(b).dimension[:-1]


@lru_cache(maxsize=4096)
def parse(text: str) -> Unit:
    """Read a unit string; a `ModelError` names the part that is wrong and suggests another."""
    try:
        return _read_quotient(text.strip())
    except ModelError as error:
        raise ModelError(f"The unit `{text}` cannot be read: {error}") from None
    except ArithmeticError:
        raise ModelError(f"The unit `{text}` cannot be read: its exponents are too large.") from None


def to_si(values: Values, unit: Unit | str, expected: Unit | str | None = None, *, difference: bool = False) -> Values:
    """Convert a number or an array from `unit` to SI.

    `expected` is any unit of the quantity that is wanted, and a unit of another one is a `ModelError`. With
    `difference`, for differences and standard deviations, the offset of `degC` does not apply.
    """
    known = _checked(unit, expected)
    return values * known.factor + (0.0 if difference else known.offset)


def from_si(
    values: Values, unit: Unit | str, expected: Unit | str | None = None, *, difference: bool = False
) -> Values:
    """Convert a number or an array from SI to `unit`: the inverse of `to_si`, with its arguments."""
    known = _checked(unit, expected)
    return (values - (0.0 if difference else known.offset)) / known.factor


def format_unit(unit: Unit) -> str:
    """Write a unit as `parse` reads it; a scale that has no name of its own stands as a number before it."""
    if (name := _preferred_names().get(unit)) is not None:
        return name
    scale = "" if unit.factor == 1.0 else f"{unit.factor:.6g} "
    powers = tuple(zip(BASE_UNITS, unit.dimension, strict=True))
    above = ".".join(_format_power(name, x) for name, x in powers if x > 0)
    below = ".".join(_format_power(name, -x) for name, x in powers if x < 0)
    return scale + (above or "1") + (below and (f"/({below})" if "." in below else f"/{below}"))


# Every unit but the base units: a factor, and what it multiplies. These take an SI prefix ...
_PREFIXABLE = {
    "g": (1e-3, "kg"), "N": (1.0, "kg.m/s2"), "J": (1.0, "N.m"), "W": (1.0, "J/s"), "Pa": (1.0, "N/m2"),
    "bar": (1e5, "Pa"), "Hz": (1.0, "1/s"), "C": (1.0, "A.s"), "V": (1.0, "W/A"), "F": (1.0, "C/V"),
    "Ohm": (1.0, "V/A"), "S": (1.0, "A/V"), "Wb": (1.0, "V.s"), "T": (1.0, "Wb/m2"), "H": (1.0, "Wb/A"),
}  # fmt: skip
# ... and these do not. Inch, foot and pound are those of 1959; 9.80665 m/s2 is standard gravity.
_OTHERS = {
    "%": (0.01, "1"), "min": (60.0, "s"), "h": (3600.0, "s"), "d": (86400.0, "s"), "degC": (1.0, "K"),
    "deg": (math.pi / 180, "rad"), "rev": (2 * math.pi, "rad"), "rpm": (math.pi / 30, "rad/s"),
    "in": (0.0254, "m"), "ft": (0.3048, "m"), "lb": (0.45359237, "kg"), "lbf": (0.45359237 * 9.80665, "N"),
}  # fmt: skip
_DERIVED = _PREFIXABLE | _OTHERS
_OFFSETS = {"degC": 273.15}
_PREFIXES = {
    "P": 1e15, "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "da": 1e1, "d": 1e-1, "c": 1e-2, "m": 1e-3,
    "u": 1e-6, "n": 1e-9, "p": 1e-12, "f": 1e-15,
}  # fmt: skip
# What people write instead, where difflib would not find what they meant.
_SLIPS = {
    "Nm": "N.m", "Nms": "N.m.s", "°": "deg", "°C": "degC", "Ω": "Ohm", "µm": "um", "sec": "s", "RPM": "rpm",
    "KG": "kg", "volt": "V", "amp": "A", "inch": "in", "metre": "m", "meter": "m", "hour": "h",
}  # fmt: skip
# The names that `format_unit` prefers to a product of base units; of equal units the first.
_PREFERRED = (
    "1 N N.m W V Ohm C F H Pa T N/m N.s/m N.m/rad N.m.s/rad V.s/rad N.m/A % deg deg/s rev rpm min h mm cm km "
    "um in ft mm/s km/h g lb ms us mV kV mA uH mH uF nF mN kN lbf kOhm kW bar degC"
)
# A symbol, then perhaps a whole exponent as Modelica has it, or a fractional one.
_FACTOR = re.compile(r"([^\W\d_]+|%|°[CF]?)(?:([+-]?[0-9]+)|\^\(([+-]?[0-9]+/[1-9][0-9]*)\))?")


def _read_quotient(text: str) -> Unit:
    """Read `numerator` or `numerator/denominator`."""
    numerator, *denominators = _split(text, "/")
    above = Unit((0,) * len(BASE_UNITS)) if numerator == "1" else _read_product(numerator)
    if not denominators:
        return above
    if len(denominators) > 1:
        raise ModelError("it divides twice. Put the denominator in parentheses, as in `J/(kg.K)`.")
    if len(_split(denominators[0], ".")) > 1:
        raise ModelError(f"what follows `/` is ambiguous. Did you mean `{numerator}/({denominators[0]})`?")
    return divide(above, _read_product(denominators[0]))


def _read_product(text: str) -> Unit:
    return reduce(multiply, map(_read_factor, _split(text, ".")))


def _read_factor(text: str) -> Unit:
    """Read a symbol with its exponent, or an expression in parentheses."""
    if text.startswith("(") and text.endswith(")"):
        return _read_quotient(text[1:-1])
    if not text:
        raise ModelError("a symbol is missing. A number without a unit has the unit `1`.")
    if (match := _FACTOR.fullmatch(text)) is None:
        raise ModelError(f"`{text}` is not a symbol with an exponent. Write for example `N.m/rad`, `m/s2` or `1/s`.")
    name, whole, fraction = match.groups()
    unit, exponent = _read_symbol(name), whole or fraction
    return power(unit, Fraction(exponent)) if exponent else unit


@lru_cache(maxsize=1024)
def _read_symbol(name: str) -> Unit:
    """Look a symbol up, whole before prefixed: `min` is a minute, `ft` a foot, `cd` a candela."""
    if name in BASE_UNITS:
        return Unit(tuple(int(name == base) for base in BASE_UNITS))
    if name in _DERIVED:
        factor, base = _DERIVED[name]
        unit = _read_quotient(base)
        return Unit(unit.dimension, factor * unit.factor, _OFFSETS.get(name, 0.0))
    for prefix, scale in _PREFIXES.items():
        rest = name.removeprefix(prefix)
        if rest != name and rest != "kg" and (rest in _PREFIXABLE or rest in BASE_UNITS):
            unit = _read_symbol(rest)
            return Unit(unit.dimension, scale * unit.factor)
    near = [_SLIPS[name]] if name in _SLIPS else get_close_matches(name, (*BASE_UNITS, *_DERIVED), n=1)
    raise ModelError(f"`{name}` is not a known unit." + "".join(f" Did you mean `{other}`?" for other in near))


def _split(text: str, separator: str) -> list[str]:
    """Split at the separators that stand outside of parentheses."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if depth < 0:
            break
        if letter == separator and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    if depth:
        raise ModelError(f"the parentheses of `{text}` do not match.")
    return parts


def _format_power(name: str, exponent: Fraction | int) -> str:
    if exponent.denominator > 1:
        return f"{name}^({exponent})"
    return name if exponent == 1 else f"{name}{exponent}"


@lru_cache(maxsize=1)
def _preferred_names() -> dict[Unit, str]:
    return {parse(name): name for name in reversed(_PREFERRED.split())}


def _as_unit(unit: Unit | str) -> Unit:
    return parse(unit) if isinstance(unit, str) else unit


def _without_offset(unit: Unit | str) -> Unit:
    unit = _as_unit(unit)
    if unit.offset:
        raise ModelError(f"`{unit}` has an offset, so it stands only alone. Write `K` for a difference.")
    return unit


def _checked(unit: Unit | str, expected: Unit | str | None) -> Unit:
    """Return the unit, unless it does not measure what is expected."""
    known = _as_unit(unit)
    if expected is None:
        return known
    wanted = _as_unit(expected)
    if not same_dimension(known, wanted):
        names = [f"`{name}`" for other, name in _preferred_names().items() if other.dimension == wanted.dimension]
        hint = f" It could be {', '.join(sorted(names)[:4])}." if names else ""
        raise ModelError(f"The unit `{unit}` does not measure what is expected, a quantity in `{expected}`.{hint}")
    kg, m, s, *others, angle = known.dimension
    is_rate = s != 0 and not any((kg, m, *others))
    events = wanted if angle else known  # of a rate of angle and a rate of events (Hz, 1/min), the latter
    counts_turns = events.factor != 1.0 or "Hz" in f"{unit} {expected}"
    if is_rate and angle != wanted.dimension[-1] and counts_turns:
        raise ModelError(
            f"Between `{unit}` and the expected `{expected}` a factor of 2 pi would be lost, because one "
            "counts turns. Write `rev/s`, `rpm` or `rad/s`."
        )
    return known
