"""Intervals from the tolerances in drawings and tables."""

import io
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, SupportsFloat

from symmb._errors import DeclarationError, FileError, faults_of, text_of
from symmb._magnitudes import SAME
from symmb._names import did_you_mean, normal
from symmb._options import is_finite_number, numbers_of, shown
from symmb._units import NUMBER, number_in, numbers_in, quantity, ratio_of, scaled, unit_of
from symmb.equations import model
from symmb.equations.model.iso_grades import sizes_of_grade
from symmb.results import files

Interval = tuple[float, float]
_SEPARATORS = {";": "semicolons", "\t": "tabs"}
_SIGNS = str.maketrans(
    {"\N{MINUS SIGN}": "-", "\N{EN DASH}": "-", "\N{NO-BREAK SPACE}": " "} | dict.fromkeys("Øø⌀", "")
)
"""Characters that word processors write, and the diameter sign, which does not change the tolerance."""
_DEGREE = "\N{DEGREE SIGN}"
_LENGTH, _ANGLE = {"m": 1e-3, "mm": 1.0}, {"rad": math.pi / 180, "deg": 1.0}
"""Unit of a nominal value divided by the unit of the size in a text."""
_DIGITS = r"(?:\d+(?:\.\d+)?|\.\d+)"
_PLAIN = rf"{_DIGITS}(?:[eE][+-]?\d+)?+"
"""A number without a sign, such as 0.1, .1 or 1e-1."""
_NO_GRADE = rf"{_DIGITS}(?:[eE][+-]\d+)?+"
"""A number with a signed exponent, if any, because 25e8 is a size with the grade e8."""
_UNIT, _DEVIATION = r" *((?:[^\W\d_]|1/|\N{DEGREE SIGN})[^±+%]*?|) *", rf"([+-] *{_PLAIN}|0(?:\.0+)?)"
_SIZE = rf" *(?:({NUMBER}){_UNIT})?"
_BOTH_SIDES = re.compile(_SIZE + rf"(?:±|\+ */ *-|\+-) *({_PLAIN})(?: *(%) *|{_UNIT})")
_EACH_SIDE = re.compile(
    _SIZE + r"(?:(?<= )|(?=[+-]))" + _DEVIATION + _UNIT + r"(?:/ *|(?<= )|(?=[+-]))" + _DEVIATION + _UNIT
)
_SIGN = re.compile(r"^ *(?:±|\+ */ *-|\+-)")
_BARE = re.compile(rf" *({_NO_GRADE}) *")
_DEVIATION_WITH_UNIT = re.compile(rf" *({_NO_GRADE}) *" + r"((?:[^\W\d_]|1/|\N{DEGREE SIGN})[^±+%]*?) *")
_LIKE_DEVIATIONS = re.compile(r" *-?\d.*[±+/]")
"""Texts that start with a digit and contain a sign of deviations, but have none of the valid forms."""
_COLUMNS = "name", "nominal", "plus", "minus", "tolerance"


class _Told(NamedTuple):
    """The content of a text: size, limits of size (deviations if the size is None), unit, and percentage if any."""

    size: float | None
    ends: Interval
    unit: str
    percent: float | None = None


def _told(owner: str, name: str, text: str) -> _Told | None:
    """The content of a text with deviations, None for other texts. Examples are "235 mm ±0.5 mm", "2.5 N/mm ±10%",
    "±0.1 mm" or "40 +0.1/-0.2 mm"."""
    plain, percent = text.translate(_SIGNS), None
    if match := _BOTH_SIDES.fullmatch(plain):
        size, unit, deviation, mark, other = match.groups()
        deviations, percent = [(f"-{deviation}", other), (deviation, other)], float(deviation) if mark else None
    elif match := _EACH_SIDE.fullmatch(plain):
        size, unit, first, first_unit, second, other = match.groups()
        deviations = [(first, first_unit or other), (second, other)]
    elif match := _DEVIATION_WITH_UNIT.fullmatch(plain):
        try:
            unit_of(owner, match[2])
        except DeclarationError:  # a grade
            return None
        size, unit, deviations = None, match[2], [(f"-{match[1]}", match[2]), (match[1], match[2])]
    else:
        return None
    begin, own = None if size is None else float(size.replace(" ", "")), unit or deviations[1][1] or ""
    if percent is not None:
        return None if begin is None else _Told(begin, _share(owner, name, begin, text, percent), own, percent)
    what = f"the size of {name!r}"
    numbers = [
        number_in(owner, what, (float(n.replace(" ", "")), u or ""), own) + (begin or 0.0) for n, u in deviations
    ]
    return _Told(begin, (min(numbers), max(numbers)), own)


def interval_with_unit(name: str, given: Any) -> tuple[Any, str]:
    """An interval of a Box as its two ends and their unit ('' without a unit)."""
    owner = f"Box: {name!r}"
    if isinstance(given, str):
        told = _told("Box", name, given)
        if told is None or told.size is None:
            raise DeclarationError(
                f"{owner}: {shown(given)} is not an interval. Write '235 mm ±0.5 mm', '2.5 N/mm ±10%' or (lower, "
                f"upper). For deviations from nominal values, use Box.plus_minus(parameters, ...).{_comma(given)}"
            )
        given = [(end, told.unit) for end in told.ends]
    elif isinstance(given, tuple | list) and len(given) == 3 and isinstance(given[2], str):
        given = [(end, given[2]) for end in given[:2]]
    if not isinstance(given, tuple | list) or not any(isinstance(end, str | tuple) for end in given):
        return given, ""
    ends = [quantity(f"{owner}:", end) for end in given]
    unit = ends[0][1]
    if len({bool(other) for _, other in ends}) > 1:
        raise DeclarationError(f"{owner}: give both ends a unit, or neither end, got {shown(given)}.")
    return [number_in(owner, "the other end", end, unit) for end in ends], unit


def interval_of(owner: str, name: str, nominal: float, tolerance: object, unit: str = "") -> Interval:
    """The interval around a nominal value in the unit `unit`. The tolerance is an argument of `Box.plus_minus`."""
    if isinstance(tolerance, str):
        return _of_text(owner, name, nominal, tolerance, unit)
    if isinstance(tolerance, tuple | list) and any(isinstance(part, str | tuple) for part in tolerance):
        is_one = len(tolerance) == 2 and is_finite_number(tolerance[0])
        ends, given = (tolerance[0], tolerance[1]) if is_one else interval_with_unit(name, tolerance)
        numbers = numbers_in(owner, f"parameter {name!r}", (ends, given), unit)
        tolerance = numbers if numbers is None or not is_one else float(numbers)
    if is_finite_number(tolerance):
        if tolerance < 0:
            raise DeclarationError(f"{owner}: the tolerance of {name!r} must be at least 0, got {shown(tolerance)}.")
        return nominal - float(tolerance), nominal + float(tolerance)
    ends = numbers_of(tolerance)
    if ends is None or ends.shape != (2,) or not ends[0] <= ends[1] or not all(map(is_finite_number, ends)):
        raise DeclarationError(
            f"{owner}: the tolerance of {name!r} cannot be {shown(tolerance)}. Give a number, a pair of deviations "
            "(-1e-5, 3e-5), a percentage such as '1%', or a size with its tolerance such as '40 ±0.1' or '40 H7'."
        )
    lower, upper = ends.tolist()
    return nominal + lower, nominal + upper


def _of_text(owner: str, name: str, nominal: float, text: str, own: str) -> Interval:
    told = _told(owner, name, text)
    if told is None and text.strip().endswith("%"):
        percent = _percent(text)
        if isinstance(percent, str):
            raise DeclarationError(
                f"{owner}: {text!r} of {name!r} is not a percentage. Write '1%' or '±1%'; both mean ±1 %.{_comma(text)}"
            )
        return _share(owner, name, nominal, text, percent)
    if told is None or not (own or told.size is not None or told.unit):
        _require_kind(owner, name, text, told, own)
        told = _of_grade(owner, name, text, "mm" if own else "")
    if own:
        return _in_unit(owner, name, nominal, text, told, own)
    if told.size is None or told.unit not in ("", _DEGREE):
        own = told.unit or "mm"
        raise DeclarationError(f"{owner}: {name!r} has no unit, but {text!r} has. Declare {name}=(..., {own!r}).")
    unit = _unit(owner, name, nominal, text, told.size)
    if told.percent is not None:
        return _share(owner, name, nominal, text, told.percent)
    return unit * told.ends[0], unit * told.ends[1]


def _require_kind(owner: str, name: str, text: str, told: _Told | None, own: str) -> None:
    """Raise a DeclarationError if a text has only numbers, and their unit or their meaning is unclear."""
    bare = _BARE.fullmatch(text.translate(_SIGNS))
    if bare and own:
        raise DeclarationError(
            f"{owner}: {text!r} of {name!r} may be a nominal value or a tolerance. Write '±{bare[1]}' for a tolerance."
        )
    if bare or told is not None:
        low, high = told.ends if told is not None else (0.0, float(bare[1] if bare else 0.0))
        numbers = f"the number {high:g}" if bare or low == -high else f"the pair of numbers ({low:g}, {high:g})"
        raise DeclarationError(
            f"{owner}: {text!r} of {name!r} may be in the unit of the parameter or in mm. Write {numbers} in the unit "
            f"of the parameter, or a size in mm with its deviations, such as '40 ±0.1'."
        )


def _in_unit(owner: str, name: str, nominal: float, text: str, told: _Told, own: str) -> Interval:
    """The interval around a nominal value in the parameter's unit. The text may use another unit of the same kind."""
    ratio = ratio_of(owner, f"parameter {name!r}", told.unit or own, own)
    low, high = (scaled(end, ratio) for end in told.ends)
    if told.size is None:
        if nominal and high == -low and abs(high - abs(nominal)) <= SAME * abs(nominal) and not _SIGN.match(text):
            raise DeclarationError(f"{owner}: {text!r} is the nominal value of {name!r}. Write a tolerance like '±1%'.")
        return nominal + low, nominal + high
    if abs(nominal - scaled(told.size, ratio)) > SAME * abs(nominal):
        raise DeclarationError(f"{owner}: {name!r} is {nominal:g} {own}, which is not the size in {text!r}.")
    return low, high


def _of_grade(owner: str, name: str, text: str, unit: str) -> _Told:
    """The size in a text with a tolerance grade, and the limits of size [mm]."""
    plain = text.translate(_SIGNS)
    if _LIKE_DEVIATIONS.match(plain):
        raise DeclarationError(
            f"{owner}: {text!r} of {name!r} is not a tolerance. Write a size with its deviations, such as '40 ±0.1', "
            f"'40 ±1%' or '40 +0.1/-0.2'.{_comma(text)}"
        )
    if _DEGREE in text:
        raise DeclarationError(f"{owner}: {text!r} of {name!r}: only lengths have tolerance grades. Write '30° ±0.5°'.")
    with faults_of(f"{owner}: {name!r}"):
        size, lower, upper = sizes_of_grade(plain)
    return _Told(size, (lower, upper), unit)


def share_of(text: str) -> float | str:
    """The number 0.05 for a text such as "5%" or "±5%". Other texts are returned unchanged."""
    percent = _percent(text)
    return percent / 100 if text.strip().endswith("%") and not isinstance(percent, str) else text


def _percent(text: str) -> Any:
    """The percentage in a text without its sign, as a number. A text that is not a number is returned as a text."""
    return _number_or_text(_SIGN.sub("", text.translate(_SIGNS)).strip().removesuffix("%"))


def _comma(text: str) -> str:
    return " Use a point as decimal separator." if "," in text else ""


def _share(owner: str, name: str, nominal: float, text: str, percent: float) -> Interval:
    share = percent / 100
    if not 0 <= share < 1 or not nominal:
        raise DeclarationError(
            f"{owner}: the percentage {text!r} of {name!r} must be at least 0 % and below 100 %, and the nominal value "
            "must not be 0."
        )
    return nominal - abs(nominal) * share, nominal + abs(nominal) * share


def _unit(owner: str, name: str, nominal: float, text: str, size: float) -> float:
    """Factor that converts the size in a text [mm or °] to the nominal value [m or mm, rad or °]."""
    units = _ANGLE if _DEGREE in text else _LENGTH
    own, other = units
    if size == 0:
        raise DeclarationError(
            f"{owner}: {text!r} of {name!r}: the unit of deviations from 0 may be {own} or {other}. Write a number, or "
            "a pair of numbers."
        )
    for unit in units.values():
        if abs(nominal - unit * size) <= SAME * unit * abs(size):
            return unit
    signed = f" For a value below 0, write '-{size:g} ±0.5'." if nominal < 0 < size else ""
    raise DeclarationError(
        f"{owner}: {name!r} is {nominal:g}, but {text!r} is a tolerance of {size:g} {other}. The nominal value must be "
        f"{units[own] * size:g} (in {own}) or {size:g} (in {other}).{signed}"
    )


def intervals_in_file(
    path: Path, parameters: Mapping[str, SupportsFloat] | None, units: Mapping[str, str]
) -> dict[str, Interval]:
    """The intervals of a CSV or TOML table, an SSV file or an FMU, in the units of the parameters. If nominal values
    are given, the nominal values in the file must agree."""
    import csv

    owner = f"Box.read: {path.name}"
    readers = {".csv": _rows_of_csv, ".toml": _rows_of_toml}
    kind = path.suffix.lower()
    if kind not in (*readers, ".ssv", ".fmu"):
        raise DeclarationError(f"{owner} must be a .csv, .toml, .ssv or .fmu file.")
    try:
        if kind in readers:
            with files.told(path, "read"):
                text = path.read_text(encoding="utf-8-sig")
            rows = list(readers[kind](owner, text))
        else:
            with files.told(path, "read"):
                path.open("rb").close()  # a missing file is a FileError, as for tables
                records = list(model.records_in_file(path))
            rows = [_row_of_record(owner, name, record, units.get(name, "")) for name, record in records]
    except (FileError, DeclarationError):
        raise
    except (ValueError, RecursionError, csv.Error) as error:  # text that is not UTF-8, long numbers, deep brackets
        raise DeclarationError(f"{owner} is not a table: {text_of(error)}.") from None
    intervals: dict[str, Interval] = {}
    for row in rows:
        name = normal(row.get("name"))
        if not isinstance(name, str) or not name:
            raise DeclarationError(f"{owner}: each row needs the name of a parameter.")
        if name in intervals:
            raise DeclarationError(f"{owner}: the name {name!r} appears twice.")
        intervals[name] = _of_row(owner, name, row, parameters, units.get(name, ""))
    if not intervals:
        raise DeclarationError(f"{owner} has no rows.")
    return intervals


def _rows_of_csv(owner: str, text: str) -> Iterator[dict[str, Any]]:
    import csv

    lines = [line for line in csv.reader(io.StringIO(text, newline="")) if any(cell.strip() for cell in line)]
    if comment := next((line for line in lines if line[0].lstrip().startswith("#")), None):
        raise DeclarationError(f"{owner}: comments cannot be read. Remove the line {shown(','.join(comment))}.")
    head = [cell.strip().lower() for cell in lines[0]] if lines else []
    for mark, word in _SEPARATORS.items():
        if len(head) == 1 and mark in head[0]:
            raise DeclarationError(f"{owner}: the cells are separated by {word}. Separate them by commas.")
    if twice := [name for name, count in Counter(head).items() if name and count > 1]:
        raise DeclarationError(f"{owner}: the column {twice[0]!r} appears twice.")
    for line in lines[1:]:
        if len(line) > len(head):
            raise DeclarationError(
                f"{owner}: a row has {len(line)} cells, but the head has {len(head)}. The row is {', '.join(line)}."
            )
        yield {key: cell.strip() for key, cell in zip(head, line, strict=False) if cell.strip()}


def _rows_of_toml(owner: str, text: str) -> Iterator[dict[str, Any]]:
    import tomllib

    for name, row in tomllib.loads(text).items():
        if not isinstance(row, Mapping):
            raise DeclarationError(f"{owner}: {name!r} must be a table with nominal, plus and minus, got {shown(row)}.")
        yield {"name": name, **row}


def _row_of_record(owner: str, name: str, record: Mapping[str, str], unit: str) -> dict[str, Any]:
    """The row of a table with the interval of a record of the Credibility library."""
    numbers = {key: _number(owner, name, key, value, "" if key == "relTol" else unit) for key, value in record.items()}
    if "nominal" not in numbers:
        raise DeclarationError(f"{owner}: {name!r} has no nominal value. Give {name}.uncertainty.nominal.")
    nominal = numbers["nominal"]
    if ("lower" in numbers) != ("upper" in numbers) or not numbers.keys() & {"lower", "relTol", "absTol"}:
        raise DeclarationError(f"{owner}: {name!r} needs lower and upper, or relTol or absTol.")
    if min(numbers.get("absTol", 0.0), numbers.get("relTol", 0.0)) < 0:
        raise DeclarationError(f"{owner}: relTol and absTol of {name!r} must be at least 0.")
    half = max(numbers.get("absTol", 0.0), numbers.get("relTol", 0.0) * abs(nominal))
    lower, upper = numbers.get("lower", nominal - half), numbers.get("upper", nominal + half)
    if not lower <= nominal <= upper:
        raise DeclarationError(
            f"{owner}: the nominal value {nominal:g} of {name!r} must be between lower {lower:g} and upper {upper:g}."
        )
    return {"name": name, "nominal": nominal, "plus": upper - nominal, "minus": nominal - lower}


def _of_row(
    owner: str, name: str, row: Mapping[str, Any], parameters: Mapping[str, SupportsFloat] | None, unit: str
) -> Interval:
    for key in row:
        if key not in _COLUMNS:
            raise DeclarationError(f"{owner}: unknown column {key!r}.{did_you_mean(key, _COLUMNS)}")
    nominal = _number(owner, name, "nominal", row.get("nominal"), unit)
    if parameters is not None:
        if name not in parameters:
            raise DeclarationError(f"{owner}: unknown parameter {name!r}.{did_you_mean(name, parameters)}")
        own = float(parameters[name])
        if not abs(own - nominal) <= SAME * abs(nominal):
            raise DeclarationError(
                f"{owner}: the nominal value of {name!r} is {nominal:.12g} in the table, but {own:.12g} in the model."
            )
    if "tolerance" in row:
        if "plus" in row or "minus" in row:
            raise DeclarationError(f"{owner}: {name!r} has a tolerance, and plus or minus. Remove one of the two.")
        return interval_of(owner, name, nominal, _number_or_text(row["tolerance"]), unit)
    if "plus" not in row:
        raise DeclarationError(f"{owner}: {name!r} needs plus and minus, or a tolerance.")
    plus = _number(owner, name, "plus", row["plus"], unit)
    minus = _number(owner, name, "minus", row.get("minus", plus), unit)
    if plus < 0 or minus < 0:
        raise DeclarationError(
            f"{owner}: plus and minus of {name!r} are distances from the nominal value and must be at least 0. If both "
            "ends are on one side of the nominal value, choose another nominal value between the ends."
        )
    return interval_of(owner, name, nominal, (-minus, plus))


def _number(owner: str, name: str, column: str, value: Any, unit: str) -> float:
    value = _number_or_text(value)
    if unit and isinstance(value, str):
        return number_in(f"{owner}: {column} of {name!r}", f"parameter {name!r}", value, unit)
    if not is_finite_number(value):
        raise DeclarationError(f"{owner}: {column} of {name!r} must be a number, got {shown(value)}.")
    return float(value)


def _number_or_text(value: Any) -> Any:
    try:
        return float(value) if isinstance(value, str) and "_" not in value else value
    except ValueError:
        return value
