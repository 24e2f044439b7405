"""The box of interval parameters and its map to the unit box [-1, 1]^d."""

import math
import pickle
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any, SupportsFloat

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError
from symmb._limits import windows
from symmb._names import did_you_mean, normal, normal_keys
from symmb._options import is_finite_number, numbers_of, require_instance, require_numbers, shown
from symmb._types import Array, Mask
from symmb._units import NO_UNIT, label, ratio_of, scaled, units_of_parameters
from symmb.equations.model import choices as finite
from symmb.equations.model.choices import Choice, Choices, Constraint
from symmb.equations.model.tolerance_list import interval_of, interval_with_unit, intervals_in_file, share_of

Interval = tuple[float, float] | tuple[float, float, str] | tuple[str, str] | str
"""The ends of an interval, in the unit of the parameter or in another unit."""
_MOST_STUDIES = 200
"""Largest number of combinations of choices."""


@dataclass(frozen=True, init=False, repr=False)
class Box:
    """Independent intervals of parameters, x in [lower, upper], in the parameters' own units.

    Parameters
    ----------
    **intervals : (lower, upper)
        One pair for each parameter, by name. ``lower == upper`` is allowed and means a fixed value. Other units of the
        same kind are converted: (0.234, 0.236, "m"), ("234 mm", "236 mm"), "235 mm ±0.5 mm", "2.5 N/mm ±10%".
        Instead of a pair, a finite set or range of values: {17, 18, 19}, or words with the values of one or more
        parameters: spring={"soft": {"k": 100, "c": 2}, "hard": {"k": 200, "c": 3}}. The words of a list ["soft",
        "hard"] have the values 0, 1, ...
    constraints : list of functions
        Each function has an argument p with the parameters of the box as numbers, such as p.a. The parameters are
        allowed if the function returns True, or a number of at most 0. `lambda p: p.a < p.b` is an example

    Attributes
    ----------
    names : tuple of d names
    bounds : tuple of d pairs (lower, upper); of choices, the lowest and the highest value
    units : tuple of d units, '' for parameters without a unit; empty if no parameter has a unit. Studies convert a box
    to the units of their parameters
    percents : names of the parameters whose tolerance was given as a percentage

    Raises
    ------
    DeclarationError
        If there is no interval, if an interval is reversed, not finite or not a pair, if a unit is not known, or if a
        choice has no values.

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Box(arm="235 mm ±0.5 mm")
    Box(arm=(234.5, 235.5, 'mm'))
    >>> box = mb.Box(l1=(0.95, 1.05), m=(2.0, 4.0))
    >>> box.center
    array([1., 3.])
    >>> box.from_unit([[-1.0, 1.0]])
    array([[0.95, 4.  ]])
    >>> mb.Box(teeth={17, 18, 19}, spring={"soft": {"k": 100.0}, "hard": {"k": 200.0}}).names
    ('teeth', 'k')
    """

    names: tuple[str, ...]
    bounds: tuple[tuple[float, float], ...]
    units: tuple[str, ...] = ()
    percents: frozenset[str] = field(default=frozenset(), compare=False)
    choices: tuple[Choice, ...] = ()
    constraints: tuple[Constraint, ...] = ()

    def __init__(self, **intervals: Interval | Choices | Sequence[Constraint]):
        constraints = intervals.pop("constraints", ())  # no argument of its own: all names are names of the user
        if not intervals:
            raise DeclarationError("A Box needs at least one interval, e.g. Box(l1=(0.95, 1.05)).")
        choices, intervals = finite.intervals_and_choices(normal_keys("Box", intervals))
        if not isinstance(constraints, list | tuple) or not all(map(callable, constraints)):
            raise DeclarationError(f"Box: constraints must be a list of functions, got {shown(constraints)}.")
        parts = {name: interval_with_unit(name, given) for name, given in intervals.items()}
        object.__setattr__(self, "names", tuple(intervals))
        object.__setattr__(self, "bounds", tuple(_interval(name, pair) for name, (pair, _) in parts.items()))
        units = tuple(unit for _, unit in parts.values())
        object.__setattr__(self, "units", units if any(units) else ())
        object.__setattr__(self, "choices", choices)
        object.__setattr__(self, "constraints", tuple(constraints))
        self._set_percents(name for name, given in intervals.items() if _has_percent(given))

    def _set_percents(self, names: Iterable[str]) -> "Box":
        object.__setattr__(self, "percents", frozenset(names))
        return self

    def with_units(self, units: Mapping[str, str]) -> "Box":
        """A copy in the given units, by name of the parameter. Numbers of a box without units are not changed.

        Raises
        ------
        DeclarationError
            If a unit does not fit the parameter, or if the units are not texts by name.
        """
        if not isinstance(units, Mapping) or not all(isinstance(unit, str) for unit in units.values()):
            raise DeclarationError(f"Box: units must be texts by name of the parameter, got {shown(units)}.")
        if not (self.units or any(name in units for name in self.names)):
            return self

        before = dict(zip(self.names, self.units or ("",) * len(self), strict=True))
        ratios = {
            name: ratio_of("Box", f"parameter {name!r}", unit, units.get(name, "")) if unit else NO_UNIT
            for name, unit in before.items()
        }
        given = {
            name: own.scaled(ratios, units)
            if isinstance(own, Choice)
            else (*(scaled(end, ratios[name]) for end in own[:2]), units.get(name, ""))
            for name, own in self._given().items()
        }
        return self._like(given)

    def _given(self) -> dict[str, Any]:
        """The intervals and choices as arguments."""
        chosen = {name: choice for choice in self.choices for name in choice.parameters}
        return {chosen[n].name if n in chosen else n: chosen.get(n, own) for n, own in self.intervals.items()}

    def _like(self, given: Mapping[str, Any]) -> "Box":
        """A box of other intervals and choices with the same constraints and percentages."""
        box = Box(constraints=self.constraints, **given)
        return box._set_percents(self.percents & {*box.names})

    def __getstate__(self) -> dict[str, Any]:
        for constraint in self.constraints:
            try:
                pickle.dumps(constraint)
            except Exception as error:  # also of the constraint's own code
                name = getattr(constraint, "__name__", repr(constraint))
                raise DeclarationError(
                    f"Box: the constraint {name} cannot be pickled. Use functions of a module, not lambdas or "
                    "functions inside other functions."
                ) from error
        return vars(self)

    def __copy__(self) -> "Box":
        return self

    def __deepcopy__(self, memo: object) -> "Box":
        return self

    @property
    def hull(self) -> "Box":
        """The smallest box of intervals that contains all choices, without constraints."""
        return Box(**self.intervals)

    @property
    def is_cut(self) -> bool:
        """Whether some points of the hull are not allowed."""
        return bool(self.choices or self.constraints)

    def combinations(self) -> list["Box"]:
        """A box with fixed values for each combination of the choices.

        DeclarationError is raised if there are more than 200 combinations.
        """
        if (n := math.prod(len(choice.values) for choice in self.choices)) > _MOST_STUDIES:
            raise DeclarationError(
                f"Box: {n} combinations of choices need as many studies, but at most {_MOST_STUDIES} are made. Give "
                "intervals instead of some choices."
            )
        boxes = []
        for numbers in product(*(range(len(choice.values)) for choice in self.choices)):
            fixed = {choice.name: choice.intervals(k) for choice, k in zip(self.choices, numbers, strict=True)}
            parts = (fixed.get(name, {name: own}) for name, own in self._given().items())
            boxes.append(self._like({name: own for part in parts for name, own in part.items()}))
        return boxes

    def allowed(self, values: Array) -> Mask:
        """Mask (N,) of the parameter values (N, d) that satisfy all constraints.

        DeclarationError is raised if a constraint fails, or returns neither True, False nor a finite number.
        """
        return finite.excess(self.constraints, self.names, self._finite_points("values", values)) == 0

    @classmethod
    def around(
        cls, parameters: Mapping[str, SupportsFloat], spread: float | str, names: Iterable[str] | None = None
    ) -> "Box":
        """Intervals nominal (1 ± spread) around nominal values.

        Parameters
        ----------
        parameters : mapping of name to nominal value
        spread : fraction or percentage of the nominal value, 0.05 or "5%" for ± 5 %
        names : the parameters with intervals; default: all parameters

        Raises
        ------
        DeclarationError
            If a name is unknown, if a nominal value is 0 (its interval would have no width), or if the spread is not
            above 0 and below 1.

        Examples
        --------
        >>> import symmb as mb
        >>> mb.Box.around({"l1": 1.0, "m": -2.0}, 0.05)
        Box(l1=(0.95, 1.05), m=(-2.1, -1.9))
        """
        units, nominal = units_of_parameters(parameters), _nominal("Box.around", parameters)
        if isinstance(spread, str):
            spread = share_of(spread)
        if not is_finite_number(spread) or not 0 < spread < 1:
            raise DeclarationError(
                f"Box.around: spread must be above 0 and below 1, such as 0.05 or '5%', got {shown(spread)}. Declare "
                "wider intervals by their ends: Box(name=(lower, upper))."
            )
        intervals = {}
        names = nominal if names is None else names
        if not isinstance(names, list | tuple | set | frozenset | Mapping) or not names:
            raise DeclarationError(f"Box.around: names must be a list of parameters, got {shown(names)}.")
        for name in map(normal, names):
            if not isinstance(name, str) or name not in nominal:
                raise DeclarationError(f"Box.around: unknown parameter '{name}'.{did_you_mean(name, nominal)}")
            if nominal[name] == 0.0:
                raise DeclarationError(
                    f"Box.around: the nominal value of '{name}' is 0, so its interval would have no width. "
                    f"Declare its interval: Box({name}=(lower, upper))."
                )
            ends = nominal[name] * (1.0 - spread), nominal[name] * (1.0 + spread)
            intervals[name] = min(ends), max(ends)
        return cls(**intervals)._set_percents(intervals).with_units(units)

    @classmethod
    def plus_minus(cls, parameters: Mapping[str, SupportsFloat], /, **tolerances: object) -> "Box":
        """Intervals around nominal values by the tolerances of a drawing.

        Parameters
        ----------
        parameters : mapping of name to nominal value
        **tolerances : by name, a number (for both sides), a pair (lower, upper) of signed deviations, or a percentage
            such as "1%". A size in mm may also have deviations, such as "40 ±0.1", "40 +/- 0.1", "40 ±1%" or
            "40 +0.1/-0.2", or a grade by ISO 286 or ISO 2768, such as "40 H7" or "120 ISO 2768-m". The nominal value
            must be equal to the size in the text, in m or mm. For an angle such as "30° ±0.5°", the nominal value is in
            rad or degrees. For a parameter with a unit, sizes and deviations may have other units of the same kind, as
            in "±0.1 mm" and "23.5 cm +1/-2 mm". Sizes and deviations without a unit are in the unit of the parameter.
            Sizes with a grade are in mm

        Raises
        ------
        DeclarationError
            If a name is unknown, a tolerance is not valid, or a grade does not exist for the size.

        Examples
        --------
        >>> import symmb as mb
        >>> mb.Box.plus_minus({"crank": 0.05, "pin": 0.01, "bore": 0.04}, crank="1%", pin=(-1e-5, 3e-5), bore="40 H7")
        Box(crank=(0.0495, 0.0505), pin=(0.00999, 0.01003), bore=(0.04, 0.040025))
        """
        owner, units = "Box.plus_minus", units_of_parameters(parameters)
        nominal, intervals, tolerances = _nominal(owner, parameters), {}, normal_keys(owner, tolerances)
        for name, tolerance in tolerances.items():
            if name not in nominal:
                raise DeclarationError(f"{owner}: unknown parameter '{name}'.{did_you_mean(name, nominal)}")
            intervals[name] = interval_of(owner, name, nominal[name], tolerance, units.get(name, ""))
        percents = [name for name, tolerance in tolerances.items() if _has_percent(tolerance)]
        return cls(**intervals)._set_percents(percents).with_units(units)

    @classmethod
    def read(cls, path: str | PathLike[str], parameters: Mapping[str, SupportsFloat] | None = None) -> "Box":
        """The intervals of a table of tolerances.

        A CSV file has the columns `name`, `nominal`, `plus` and `minus`. `plus` and `minus` are the distances of the
        ends from the nominal value. Without `minus`, `plus` is used for both sides. Instead of `plus` and `minus`, a
        column `tolerance` may contain texts for `plus_minus`, such as 1%, 40 ±0.1 or 40 H7. In a TOML file, each
        parameter is a table with the names of the columns as keys. Numbers are in the unit of the parameter, or have a
        unit of the same kind, such as 0.5 mm.

        An SSV file (SSP) or an FMU contains the records of DLR's Credibility library. The parameter `arm` has
        `arm.value` or `arm.uncertainty.nominal`, and `arm.uncertainty.lower` and `.upper`, or `.relTol` and `.absTol`.
        Components before the name, such as `data.arm`, are left out. Tables are not read.

        Parameters
        ----------
        path : path of the file
        parameters : mapping of name to nominal value; the nominal values of the table must agree with these values

        Raises
        ------
        DeclarationError
            If the file is not a table of tolerances, or if its nominal values differ from `parameters`.
        FileError
            If the file cannot be read.
        """
        if not isinstance(path, str | PathLike):
            raise DeclarationError(f"Box.read: path must be the path of a file, got {shown(path)}.")
        units = units_of_parameters(parameters)
        nominal = None if parameters is None else _nominal("Box.read", parameters)
        return cls(**intervals_in_file(Path(path), nominal, units)).with_units(units)

    def __or__(self, other: "Box") -> "Box":
        """The intervals of both boxes. A common parameter must have the same interval in both boxes."""
        if not isinstance(other, Box):
            return NotImplemented
        mine, theirs = (box._given() for box in (self, other))
        for name in mine.keys() & theirs.keys():
            if mine[name] != theirs[name]:
                raise DeclarationError(f"Box: '{name}' is {mine[name]} in one box and {theirs[name]} in the other.")
        both = Box(constraints=[*dict.fromkeys(self.constraints + other.constraints)], **(mine | theirs))
        return both._set_percents(self.percents | other.percents)

    @property
    def intervals(self) -> dict[str, Interval]:
        """The intervals by name: (lower, upper), or (lower, upper, unit) for a parameter with a unit."""
        return {
            name: (*ends, unit) if unit else ends
            for name, ends, unit in zip(self.names, self.bounds, self.units or ("",) * len(self), strict=True)
        }

    @property
    def labels(self) -> tuple[str, ...]:
        """The names with their units, for tables."""
        return tuple(map(label, self.names, self.units or ("",) * len(self)))

    @property
    def _ends(self) -> Array:
        """Lower ends, upper ends, midpoints and half widths (4, d)."""
        lower, upper = np.array(self.bounds, dtype=float).reshape(-1, 2).T
        with np.errstate(over="ignore"):
            radius = 0.5 * (upper - lower)
        return np.array([lower, upper, lower + radius, radius])

    @property
    def lower(self) -> Array:
        """Lower ends (d,)."""
        return self._ends[0]

    @property
    def upper(self) -> Array:
        """Upper ends (d,)."""
        return self._ends[1]

    @property
    def center(self) -> Array:
        """Midpoints (d,)."""
        return self._ends[2]

    @property
    def radius(self) -> Array:
        """Half widths (d,)."""
        return self._ends[3]

    def from_unit(self, unit: Array) -> Array:
        """Points (N, d) of [-1, 1]^d as parameter values (N, d); -1 and 1 give the ends exactly."""
        unit = self._finite_points("points", unit)
        points, values = unit.reshape(-1, len(self)), np.empty((unit.size // len(self), len(self)))
        lower, upper, center, radius = self._ends[..., None]
        for rows in windows(len(points), 16 * len(self)):  # 1e8 points of few numbers take a tenth of the time
            own = np.ascontiguousarray(points[rows].T)
            inside = np.clip(center + own * radius, lower, upper)
            values[rows] = np.where(own == -1.0, lower, np.where(own == 1.0, upper, inside)).T
        return values.reshape(unit.shape)

    def to_unit(self, values: Array) -> Array:
        """Parameter values (N, d) as points (N, d) of [-1, 1]^d. The coordinate of an interval without width is 0."""
        radius, values = self.radius, self._finite_points("values", values)
        return (values - self.center) / np.where(radius > 0, radius, np.inf)

    def _finite_points(self, name: str, values: object) -> Array:
        """Numbers (N, d). Raises DeclarationError if a number is not finite or if the shape is not (N, d)."""
        points = require_numbers(repr(self), name, values, len(self), leading=True)
        if not np.isfinite(points).all():
            raise DeclarationError(f"{self!r}: {name} must be finite numbers, got {shown(values)}.")
        return points

    def part(self, which: Mask) -> "Box":
        """The intervals of some parameters (mask, (d,)), at least one."""
        if (mask := np.asarray(which)).dtype != bool or mask.shape != (len(self),):
            raise DeclarationError(f"{self!r}: expected truth values, one for each parameter, got {shown(which)}.")
        return Box(**{name: ends for (name, ends), own in zip(self.intervals.items(), mask, strict=True) if own})

    def without(self, name: str) -> "Box | None":
        """The box without this parameter; None if no parameter remains."""
        require_instance(repr(self), name, str, "the name of a parameter")
        require_only_intervals("Box.without", self)
        left = {other: ends for other, ends in self.intervals.items() if other != normal(name)}
        return self._like(left) if left else None

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def keys(self) -> tuple[str, ...]:
        """The names of the parameters. `dict(box)` uses these names as keys of the intervals."""
        return self.names

    def __getitem__(self, name: str) -> tuple[float, float]:
        """The interval (lower, upper) of a parameter."""
        name = normal(name)
        if not isinstance(name, str) or name not in self.names:
            raise DeclarationError(f"Box: no interval of {shown(name)}.{did_you_mean(name, self.names)}")
        return self.bounds[self.names.index(name)]

    def __repr__(self) -> str:
        return self._text

    @cached_property
    def _text(self) -> str:
        chosen = {name for choice in self.choices for name in choice.parameters}
        inside = [
            f"{name}=({low:.12g}, {high:.12g}{''.join(f', {text!r}' for text in unit)})"
            for name, (low, high, *unit) in self.intervals.items()
            if name not in chosen
        ]
        inside += [f"{choice.name}={choice!r}" for choice in self.choices]
        if self.constraints:
            inside.append(f"constraints=[{', '.join(getattr(f, '__name__', repr(f)) for f in self.constraints)}]")
        return f"Box({', '.join(inside)})"

    def _repr_html_(self) -> str:
        ends = zip(self.labels, self.bounds, self.center.tolist(), self.radius.tolist(), strict=True)
        rows = [
            [name, *(f"{x:.12g}" for x in pair), f"{middle:.12g} ± {half:.6g}"] for name, pair, middle, half in ends
        ]
        cut = [html.text(repr(self))] if self.is_cut else []
        return html.page(html.table([["parameter", "lower", "upper", "middle"], *rows]), *cut)


def require_only_intervals(owner: str, box: Box) -> None:
    """Raise DeclarationError if a box has choices or constraints."""
    if box.is_cut:
        raise DeclarationError(
            f"{owner}: the box must have intervals only, without choices and constraints. Use box.hull, which "
            "contains all of them, or one of box.combinations()."
        )


def _has_percent(tolerance: object) -> bool:
    return isinstance(tolerance, str) and "%" in tolerance


def _nominal(owner: str, parameters: object) -> dict[str, float]:
    """Nominal values by the normal forms of their names. Raises DeclarationError if they are not valid."""
    if not isinstance(parameters, Mapping) or not all(map(is_finite_number, parameters.values())):
        raise DeclarationError(f"{owner}: parameters must be nominal values by name, got {shown(parameters)}.")
    return {name: float(value) for name, value in normal_keys(owner, parameters).items()}


def _interval(name: str, pair: tuple[float, float]) -> tuple[float, float]:
    ends = numbers_of(pair)
    if ends is None or ends.shape != (2,):
        raise DeclarationError(f"Box: '{name}' must be a pair (lower, upper), got {shown(pair)}.")
    low, high = ends.tolist()
    if not (math.isfinite(low) and math.isfinite(high)):
        raise DeclarationError(f"Box: the ends of '{name}' must be finite, got ({low}, {high}).")
    if low > high:
        raise DeclarationError(f"Box: '{name}' has lower {low} above upper {high}. Exchange them.")
    if not math.isfinite(high - low):
        raise DeclarationError(f"Box: the interval of '{name}' from {low} to {high} is wider than the largest number.")
    return low, high
