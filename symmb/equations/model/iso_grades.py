"""Deviations of sizes by the tolerance grades of ISO 286 and ISO 2768.

Sources: ISO 286-1:2010, tables 1 to 5, and ISO 2768-1:1989, table 1. Sizes are in mm and deviations in micrometres, as
in the tables.
"""

import re
from bisect import bisect_left

from symmb._errors import DeclarationError


def _row(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split()))


_SIZES = _row("3 6 10 18 30 50 80 120 180 250 315 400 500")
"""Upper ends of the ranges of sizes [mm]: a size at the upper end belongs to the range."""
_FINE_SIZES = _row("3 6 10 14 18 24 30 40 50 65 80 100 120 140 160 180 200 225 250 280 315 355 400 450 500")
_GRADES = {
    1: _row("0.8 1 1 1.2 1.5 1.5 2 2.5 3.5 4.5 6 7 8"),
    2: _row("1.2 1.5 1.5 2 2.5 2.5 3 4 5 7 8 9 10"),
    3: _row("2 2.5 2.5 3 4 4 5 6 8 10 12 13 15"),
    4: _row("3 4 4 5 6 7 8 10 12 14 16 18 20"),
    5: _row("4 5 6 8 9 11 13 15 18 20 23 25 27"),
    6: _row("6 8 9 11 13 16 19 22 25 29 32 36 40"),
    7: _row("10 12 15 18 21 25 30 35 40 46 52 57 63"),
    8: _row("14 18 22 27 33 39 46 54 63 72 81 89 97"),
    9: _row("25 30 36 43 52 62 74 87 100 115 130 140 155"),
    10: _row("40 48 58 70 84 100 120 140 160 185 210 230 250"),
    11: _row("60 75 90 110 130 160 190 220 250 290 320 360 400"),
    12: _row("100 120 150 180 210 250 300 350 400 460 520 570 630"),
    13: _row("140 180 220 270 330 390 460 540 630 720 810 890 970"),
    14: _row("250 300 360 430 520 620 740 870 1000 1150 1300 1400 1550"),
    15: _row("400 480 580 700 840 1000 1200 1400 1600 1850 2100 2300 2500"),
    16: _row("600 750 900 1100 1300 1600 1900 2200 2500 2900 3200 3600 4000"),
}
"""Widths of the zones IT1 to IT16, one for each range of sizes."""
_ABOVE = {
    "c": _row("60 70 80 95 95 110 110 120 130 140 150 170 180 200 210 230 240 260 280 300 330 360 400 440 480"),
    "d": _row("20 30 40 50 65 80 100 120 145 170 190 210 230"),
    "e": _row("14 20 25 32 40 50 60 72 85 100 110 125 135"),
    "f": _row("6 10 13 16 20 25 30 36 43 50 56 62 68"),
    "g": _row("2 4 5 6 7 9 10 12 14 15 17 18 20"),
    "h": 13 * (0.0,),
}
"""Distance from the nominal size down to the upper end of a shaft's zone, or up to the lower end of a hole's zone."""
_BELOW = {
    "k": _row("0 1 1 1 2 2 2 3 3 4 4 4 5"),
    "m": _row("2 4 6 7 8 9 11 13 15 17 20 21 23"),
    "n": _row("4 8 10 12 15 17 20 23 27 31 34 37 40"),
    "p": _row("6 12 15 18 22 26 32 37 43 50 56 62 68"),
    "r": _row("10 15 19 23 23 28 28 34 34 41 43 51 54 63 65 68 77 80 84 94 98 108 114 126 132"),
    "s": _row("14 19 23 28 28 35 35 43 43 53 59 71 79 92 100 108 122 130 140 158 170 190 208 232 252"),
}
"""Distance from the nominal size up to the lower end of the zone of a shaft. The values of k are for grades 4 to 7."""
_LEAST_GENERAL_SIZE = 0.5
_GENERAL_SIZES = _row("3 6 30 120 400 1000 2000 4000")
_GENERAL: dict[str, tuple[float | None, ...]] = {
    "f": (50, 50, 100, 150, 200, 300, 500, None),
    "m": (100, 100, 200, 300, 500, 800, 1200, 2000),
    "c": (200, 300, 500, 800, 1200, 2000, 3000, 4000),
    "v": (None, 500, 1000, 1500, 2500, 4000, 6000, 8000),
}
"""Deviations above and below the size, for sizes without an individual tolerance."""
_FIT = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(js|JS|[A-Za-z])(\d+)\s*")
_GENERAL_CLASS = re.compile(r"\s*(\d+(?:\.\d+)?)\s+(?:(?i:ISO)\s*)?2768\s*-?\s*([a-z])[A-Z]?\s*")


def sizes_of_grade(text: str) -> tuple[float, float, float]:
    """The nominal, smallest and largest size [mm] of a text such as "40 H7", "25 js6" or "120 ISO 2768-m"."""
    if match := _FIT.fullmatch(text):
        size, letters, grade = float(match[1]), match[2], int(match[3])
        lower, upper = _deviations(text, size, letters, grade)
    elif match := _GENERAL_CLASS.fullmatch(text):
        size = float(match[1])
        width = _general_deviation(text, size, match[2])
        lower, upper = -width, width
    else:
        raise DeclarationError(
            f"{text!r} is not a tolerance. Write a number, a percentage such as '1%', or a size in mm with its "
            "deviations or grade, such as '40 ±0.1', '40 H7' or '120 ISO 2768-m'."
        )
    return size, size + 1e-3 * lower, size + 1e-3 * upper


def _general_deviation(text: str, size: float, letter: str) -> float:
    """Deviation above and below the size [um] by ISO 2768."""
    if letter not in _GENERAL:
        raise DeclarationError(f"{text!r}: ISO 2768 has the classes f, m, c and v.")
    widths, k = _GENERAL[letter], bisect_left(_GENERAL_SIZES, size)
    inside = [i for i, width in enumerate(widths) if width is not None]
    width = widths[k] if size >= _LEAST_GENERAL_SIZE and k in inside else None
    if width is None:
        begin = f"above {_GENERAL_SIZES[inside[0] - 1]:g}" if inside[0] else f"from {_LEAST_GENERAL_SIZE}"
        end = _GENERAL_SIZES[inside[-1]]
        raise DeclarationError(f"{text!r}: class {letter} of ISO 2768 is for sizes {begin} to {end:g} mm.")
    return width


def _deviations(text: str, size: float, letters: str, grade: int) -> tuple[float, float]:
    """Lower and upper deviation [um] by ISO 286."""
    if not 0 < size <= _SIZES[-1]:
        raise DeclarationError(f"{text!r}: the size must be above 0 and up to 500 mm, as in ISO 286.")
    if grade not in _GRADES:
        raise DeclarationError(f"{text!r}: the grade must be from IT1 to IT16, as in ISO 286.")
    k, letter, is_hole = bisect_left(_SIZES, size), letters.lower(), letters[0].isupper()
    width = _GRADES[grade][k]
    if letter == "js":
        return -width / 2, width / 2
    if letter in _ABOVE:
        end = _entry(_ABOVE[letter], size)
        return (end, end + width) if is_hole else (-end - width, -end)
    if letter not in _BELOW:
        known = ", ".join([*_ABOVE, "js", *_BELOW])
        raise DeclarationError(f"{text!r}: the letters of ISO 286 are {known}. Use capitals for holes.")
    begin = _entry(_BELOW[letter], size)
    if is_hole:
        upper = _upper_end_of_hole(text, size, letter, grade, begin)
        return upper - width, upper
    begin = begin if letter != "k" or 4 <= grade <= 7 else 0.0
    return begin, begin + width


def _upper_end_of_hole(text: str, size: float, letter: str, grade: int, begin: float) -> float:
    """The upper deviation of holes K to S [um]. `begin` is the lower deviation of the shaft with the same letter."""
    k = bisect_left(_SIZES, size)
    if size > _SIZES[0] and grade > 8 and letter in "kn":
        if letter == "n":
            return 0.0
        raise DeclarationError(f"{text!r}: ISO 286 defines K up to the grade K8.")
    if (letter, grade) == ("m", 6) and 250 < size <= 315:
        return -9.0  # the standard's only exception
    # If the letters of hole and shaft are exchanged, a hole has the same fit with a shaft of the next finer grade.
    finer = size > _SIZES[0] and 2 < grade <= (8 if letter in "kmn" else 7)
    return -begin + (_GRADES[grade][k] - _GRADES[grade - 1][k] if finer else 0.0)


def _entry(values: tuple[float, ...], size: float) -> float:
    """The value of a table for a size. Tables have the main ranges of sizes, or the finer ranges."""
    return values[bisect_left(_SIZES if len(values) == len(_SIZES) else _FINE_SIZES, size)]
