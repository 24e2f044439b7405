"""Units of parameters and outputs: a table of units, texts such as "N/mm", and quantities such as "235 mm"."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from symmb._errors import DeclarationError
from symmb._names import did_you_mean
from symmb._options import is_finite_number, numbers_of, shown
from symmb._types import Array

BASES = "m", "kg", "s", "rad", "A", "K"
"""Base units, the same as in FMI. An angle counts as a dimension, so rpm and Hz differ."""


class Unit(NamedTuple):
    """A unit in SI units: number * pi**pi, and powers of the `BASES`."""

    number: Fraction
    pi: int
    powers: tuple[int, ...]

    @property
    def factor(self) -> float:
        return float(self.number) * math.pi**self.pi

    def times(self, other: "Unit", power: int = 1) -> "Unit":
        """The product of this unit and a power of another unit."""
        powers = tuple(a + power * b for a, b in zip(self.powers, other.powers, strict=True))
        return Unit(self.number * other.number**power, self.pi + power * other.pi, powers)


NO_UNIT = Unit(Fraction(1), 0, (0,) * len(BASES))
_MICRO = "u", "\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"
_PREFIXES = {**dict.fromkeys(_MICRO, -6), "m": -3, "c": -2, "d": -1, "k": 3, "M": 6, "G": 9}
_KINDS = {
    "m": (1, 0, (1,), "umcdk"), "s": (1, 0, (0, 0, 1), "um"), "rad": (1, 0, (0, 0, 0, 1), "m"),
    "h": (3600, 0, (0, 0, 1), ""), "g": ("1/1000", 0, (0, 1), "mk"), "A": (1, 0, (0, 0, 0, 0, 1), "m"),
    "Hz": (1, 0, (0, 0, -1), "k"), "Nmm": ("1/1000", 0, (2, 1, -2), ""),
    "N": (1, 0, (1, 1, -2), "mkM"), "Nm": (1, 0, (2, 1, -2), "mk"),
    "J": (1, 0, (2, 1, -2), "mk"), "W": (1, 0, (2, 1, -3), "mk"), "Pa": (1, 0, (-1, 1, -2), "kMG"),
    "bar": (100000, 0, (-1, 1, -2), "m"), "V": (1, 0, (2, 1, -3, 0, -1), "mk"), "H": (1, 0, (2, 1, -2, 0, -2), "um"),
    "ohm": (1, 0, (2, 1, -3, 0, -2), "mk"), "\N{GREEK CAPITAL LETTER OMEGA}": (1, 0, (2, 1, -3, 0, -2), "mk"),
    "deg": ("1/180", 1, (0, 0, 0, 1), ""), "\N{DEGREE SIGN}": ("1/180", 1, (0, 0, 0, 1), ""),
    "rpm": ("1/30", 1, (0, 0, -1, 1), ""), "min": (60, 0, (0, 0, 1), ""), "K": (1, 0, (0, 0, 0, 0, 0, 1), ""),
    "t": (1000, 0, (0, 1), ""), "in": ("0.0254", 0, (1,), ""), "ft": ("0.3048", 0, (1,), ""),
    "l": ("1/1000", 0, (3,), "m"), "L": ("1/1000", 0, (3,), "m"),
    "psi": ("44482216152605/6451600000", 0, (-1, 1, -2), ""),
    "lb": ("0.45359237", 0, (0, 1), ""), "lbf": ("4.4482216152605", 0, (1, 1, -2), ""),
}  # fmt: skip
"""Name of a unit -> its number, power of pi, powers of the `BASES`, and allowed prefixes."""
_TABLE = {
    prefix + name: Unit(Fraction(number) * Fraction(10) ** power, pi, (*powers, *NO_UNIT.powers[len(powers) :]))
    for name, (number, pi, powers, prefixes) in _KINDS.items()
    for prefix, power in {"": 0, **_PREFIXES}.items()
    if not prefix or prefix in prefixes or ("u" in prefixes and prefix in _MICRO)
}
_COMMON_FIRST = ["mm", "m", "kg", "s", "N", "kN", "MPa", "J", "W", "deg", "rad", "rpm", *_TABLE]
"""Names of units for error messages. A message lists the first names."""
_OFFSET = re.compile(r"(?:\N{DEGREE SIGN}|deg)[CF]")
_RAISED = re.compile("[\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}\N{SUPERSCRIPT TWO}\N{SUPERSCRIPT THREE}]+")
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LOWERED = str.maketrans("\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}\N{SUPERSCRIPT TWO}\N{SUPERSCRIPT THREE}", "-123")
_FACTOR = re.compile(r"([^\W\d_]+|\N{DEGREE SIGN}[CF]?)(?:\^(-?[1-9]))?")
_DIVIDES, _TIMES = re.compile(r"/(?![^(]*\))"), re.compile(r"\s*[*\N{MIDDLE DOT}.]\s*|\s+")
NUMBER = r"[+-]?\s*(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
"""A number in a text."""
_QUANTITY = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*", re.DOTALL)


def unit_of(owner: str, text: str) -> Unit:
    """The unit of a text such as "N/mm", "kg m^2" or "N s/(m rad)". The texts "" and "1" mean that there is no unit.

    Raises
    ------
    DeclarationError    if the text is not a unit or is ambiguous, or if the unit has another zero than the SI unit (°C)
    """
    if text.strip() in ("", "1"):
        return NO_UNIT
    plain = _RAISED.sub(lambda raised: "^" + raised[0].translate(_LOWERED), text).replace("**", "^")
    unit = NO_UNIT
    if len(text) > 100:
        raise DeclarationError(f"{owner}: {shown(text)} is too long for a unit.")
    for k, piece in enumerate(map(str.strip, _DIVIDES.split(plain))):
        if piece[:1] == "(" and piece[-1:] == ")" and len(piece) > 2:
            unit = unit.times(unit_of(owner, piece[1:-1]), -1 if k else 1)
            continue
        factors = _TIMES.split(piece)
        if k and len(factors) > 1:
            raise DeclarationError(f"{owner}: {shown(text)} is ambiguous. Write brackets, as N/(m s).")
        for factor in factors if k or piece != "1" else ():
            match = _FACTOR.fullmatch(factor)
            if match is None:
                raise DeclarationError(f"{owner}: {shown(text)} is not a unit. Write mm, N/mm, kg m^2 or N/(m s).")
            unit = unit.times(_named(owner, text, match[1]), int(match[2] or 1) * (-1 if k else 1))
    largest = 10**100
    if not Fraction(1, largest) < unit.number < largest:
        raise DeclarationError(f"{owner}: {shown(text)} is a unit that is too large or too small.")
    return unit


def _named(owner: str, text: str, name: str) -> Unit:
    if _OFFSET.fullmatch(name):
        raise DeclarationError(
            f"{owner}: {shown(text)}: the zero of {name} is not the zero of K. Give temperatures and differences in K."
        )
    if name not in _TABLE:
        where = "" if name == text.strip() else f" in {shown(text)}"
        raise DeclarationError(f"{owner}: {shown(name)}{where} is not a known unit.{did_you_mean(name, _COMMON_FIRST)}")
    return _TABLE[name]


def scaled(value: Any, ratio: Unit, inverse: bool = False) -> Any:
    """A number or an expression times a ratio of units, or divided by it. For the ratio 1/1000, divide by 1000."""
    divides = ratio.number.numerator == 1 and not ratio.pi
    by = ratio.number.denominator if divides else ratio.factor
    return value if by == 1 else value / by if divides != inverse else value * by


def ratio_of(owner: str, what: str, unit: str, own: str) -> Unit:
    """The ratio of a given unit to the declared unit. DeclarationError is raised if their dimensions differ."""
    given, known = unit_of(owner, unit), unit_of(owner, own)
    if given.powers != known.powers:
        told = f"is in {own}" if own else f"has no unit: declare it with a unit, as (..., {unit!r}), or give a number"
        raise DeclarationError(f"{owner}: {shown(unit)} does not fit {what}, which {told}.")
    return given.times(known, -1)


def dimensions(owner: str, text: str) -> tuple[int, ...]:
    """Powers of the base units in a unit. The power of the angle is 0 if the unit has a length: N m/rad equals N m."""
    powers = unit_of(owner, text).powers
    return (*powers[:3], 0, *powers[4:]) if powers[0] else powers


def quantity(owner: str, given: object) -> tuple[float, str]:
    """The number and the unit of a quantity such as 235, (235, "mm") or "235 mm".

    Raises
    ------
    DeclarationError    if the quantity has another form; the unit itself is not checked
    """
    match = _QUANTITY.fullmatch(given.replace("\N{MINUS SIGN}", "-")) if isinstance(given, str) else None
    if match and re.match(r",\d", match[2]):
        raise DeclarationError(
            f"{owner} {shown(given)} has a comma. Write decimals with a point, as 2.5, and no thousands separators."
        )
    if match and match[2]:
        given = float("".join(match[1].split())), match[2]
    number, unit = given if isinstance(given, tuple | list) and len(given) == 2 else (given, "")
    if not is_finite_number(number) or not isinstance(unit, str):
        hint = (
            ' Give a number, or one with a unit, as (235, "mm") or "235 mm".' if isinstance(given, str | tuple) else ""
        )
        raise DeclarationError(f"{owner} {shown(given)} is not a finite number.{hint}")
    return float(number), unit.strip()


def number_in(owner: str, what: str, given: object, own: str) -> float:
    """A quantity as a number in `own`. Plain numbers are in `own`. DeclarationError if units do not fit."""
    number, unit = quantity(f"{owner}:", given)
    return scaled(number, ratio_of(owner, what, unit, own)) if unit else number


def numbers_in(owner: str, what: str, given: Any, own: str) -> Array | None:
    """Values such as [1, 2], ([234, 236], "mm") or ["234 mm", "236 mm"] in the unit `own`; None for anything else.

    DeclarationError is raised if a unit does not fit.
    """
    if isinstance(given, tuple) and len(given) == 2 and isinstance(given[1], str):
        values, unit = numbers_of(given[0]), given[1]
        if values is not None:
            return scaled(values, ratio_of(owner, what, unit, own))
    if isinstance(given, list | tuple) and any(isinstance(value, str | tuple) for value in given):
        return np.array([number_in(owner, what, value, own) for value in given])
    return numbers_of(given)


def number_or_quantity(text: str) -> float | str:
    """A text as a number, or the text itself if it is a number with a unit. Other texts raise ValueError."""
    match = _QUANTITY.fullmatch(text)
    return text if match and match[2] else float(text)


def units_of_parameters(parameters: object) -> Mapping[str, str]:
    """Units of parameters by name. Parameters without a unit are left out."""
    return getattr(parameters, "_units", {})


def with_units(values: Mapping[str, str], parameters: object) -> list[str]:
    """Texts such as "arm = 235 mm" for the values of some parameters."""
    units = units_of_parameters(parameters)
    return [f"{name} = {value} {typeset(units.get(name, ''))}".rstrip() for name, value in values.items()]


def values_text(names: Iterable[str], values: Iterable[float], units: Mapping[str, str], equals: str = " = ") -> str:
    """Values of parameters as text for messages, with their units by name."""
    pairs = zip(names, values, strict=True)
    return ", ".join(f"{name}{equals}{value:.6g} {typeset(units.get(name, ''))}".rstrip() for name, value in pairs)


def label(name: str, unit: str) -> str:
    """A name, followed by its unit in brackets if there is a unit."""
    return f"{name} [{typeset(unit)}]" if unit else name


def typeset(unit: str) -> str:
    """A unit as printed: m/s² for m/s^2, ° for deg, µm for um."""
    raised = re.sub(r"\^(-?\d+)", lambda power: power[1].translate(_SUPERSCRIPTS), unit)
    return re.sub(r"\bu(?=(m|s|g|N|rad)\b)", "µ", re.sub(r"\bdeg\b", "°", raised))


def told_units(units: Sequence[str], n: int, parameters: object = None) -> Sequence[str]:
    """Units of n outputs for texts and .csv files. Units are printed only if an output has a unit outside the SI, or a
    parameter has a unit."""
    is_si = all(map(_is_si, units)) and not units_of_parameters(parameters)
    return ("",) * n if is_si or not units else units


def told_names(names: Sequence[str], units: Sequence[str], parameters: object = None) -> Sequence[str]:
    """Names of outputs, with their units if units are printed."""
    return [*map(label, names, told_units(units, len(names), parameters))]


def _is_si(text: str) -> bool:
    try:
        return unit_of("", text)[:2] == NO_UNIT[:2]
    except DeclarationError:  # a unit of an FMU
        return False


TIME_HEADINGS = "t", "t [s]"
"""The first column of .csv files without units, and with units."""


def headings(names: Sequence[str], units: Sequence[str], parameters: object = None) -> list[str]:
    """Headings of the time and of outputs in a .csv file. The time has a unit if a unit of an output is printed."""
    told = told_units(units, len(names), parameters)
    both = zip(names, told, strict=True)
    own = [f"{name} [{unit}]" if unit or _parted(name)[1] else name for name, unit in both]
    return [TIME_HEADINGS[1], *own] if any(told) else [TIME_HEADINGS[0], *names]


def read_headings(first: str, others: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of outputs from headings, and units if t has a unit. DeclarationError if the first heading is not t."""
    if first not in TIME_HEADINGS:
        raise DeclarationError("the first column must be t.")
    names, units = zip(*map(_parted, others), strict=True) if others else ((), ())
    return (names, units) if first == TIME_HEADINGS[1] else (tuple(others), ())


def _parted(text: str) -> tuple[str, str]:
    """The name and the unit of a label such as "x [m]"; the unit is empty if there is none."""
    name, _, unit = text.removesuffix("]").rpartition(" [")
    return (name, unit) if name and text.endswith("]") else (text, "")
