"""Choices and constraints of a box. Choices are finite sets of numbers, and words with the values of parameters."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import SAME
from symmb._names import normal, normal_keys
from symmb._options import is_finite_number, shown
from symmb._types import Array, Mask
from symmb._units import number_in, quantity

Choices = Set[Any] | range | Mapping[str, Any]
"""A finite set of values, or values by words."""
Constraint = Callable[[Any], Any]
"""A function of the parameters p, such as p.a. The result is True, or a number of at most 0, if they are allowed."""
_MOST_STUDIED, _MOST_STUDIES = 8, 200
"""Largest number of values of a set with a study for each value, and of all studies. Larger sets are in each study."""


@dataclass(frozen=True)
class Choice:
    """One of several values of a parameter, or one of several words with values of one or more parameters.

    Attributes
    ----------
    name : str
    labels : n words; empty for a set of numbers
    parameters : d names
    values : n tuples of d numbers
    units : d units of the values, '' for numbers without units
    """

    name: str
    labels: tuple[str, ...]
    parameters: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    units: tuple[str, ...]

    @classmethod
    def of(cls, name: str, given: Any) -> "Choice":
        """The choice of a set, a range, or a mapping of words to numbers or to numbers by name."""
        labels = tuple(given) if isinstance(given, Mapping) else ()
        if not given or not all(isinstance(label, str) and label.isprintable() for label in labels):
            raise DeclarationError(f"Box: {name!r} must have at least one value, and words as names of its values.")
        options = [given[label] for label in labels] if labels else list(given)
        if not all(isinstance(own, Mapping) for own in options):
            options = [{name: own} for own in options]
        parameters = tuple(map(normal, options[0]))
        for label, own in zip(labels, options, strict=False):
            if {*map(normal, own)} != {*parameters} or not parameters:
                raise DeclarationError(
                    f"Box: {name!r} must give values of the same parameters for {label!r} as before."
                )
        pairs = [[quantity(f"Box: {name!r}:", normal_keys("Box", own)[n]) for own in options] for n in parameters]
        if any(len({bool(unit) for _, unit in own}) > 1 for own in pairs):
            raise DeclarationError(f"Box: {name!r} must have units for all values of a parameter, or for none.")
        units = tuple(own[0][1] for own in pairs)
        columns = (
            [number_in(f"Box: {name!r}", n, x, unit) if unit else x[0] for x in own]
            for n, unit, own in zip(parameters, units, pairs, strict=True)
        )
        values = [*zip(*columns, strict=True)]
        return cls(name, labels, parameters, tuple(values if labels else sorted(set(values))), units)

    @property
    def is_studied(self) -> bool:
        """Whether each value has a study of its own."""
        return bool(self.labels) or len(self.values) <= _MOST_STUDIED

    def given(self, of: Callable[[str, float], Any]) -> Any:
        """The choice as an argument of Box. `of` returns a value from the name of the parameter and a number."""
        options = [{n: of(n, x) for n, x in zip(self.parameters, own, strict=True)} for own in self.values]
        if not self.labels:
            return {own[self.name] for own in options}
        if self.parameters == (self.name,):
            options = [own[self.name] for own in options]
        return dict(zip(self.labels, options, strict=True))

    def closest(self, x: Array) -> Array:
        """The values of a set that are closest to numbers x (...)."""
        values = np.array(self.values)[:, 0]
        return values[np.abs(x[..., None] - values).argmin(axis=-1)]

    def has(self, values: Sequence[float]) -> bool:
        """Whether values (d,) are one of the choices, up to rounding."""
        return bool(np.isclose(self.values, values, rtol=SAME, atol=0.0).all(axis=1).any())

    def chosen(self, values: Mapping[str, float]) -> str:
        """The choice in words, as "spring: hard", for values of all parameters."""
        own = np.array([values[name] for name in self.parameters])
        k = int(np.abs(np.array(self.values) - own).sum(axis=1).argmin())
        return f"{self.name}: {self.labels[k] if self.labels else f'{self.values[k][0]:.12g}'}"


def combined(choices: Sequence[Choice]) -> Iterator[dict[str, float]]:
    """The values of each combination of the choices that have a study for each value, by parameter."""
    studied = [choice for choice in choices if choice.is_studied]
    if (n := math.prod(len(choice.values) for choice in studied)) > _MOST_STUDIES:
        raise DeclarationError(
            f"Box: {n} combinations of choices need as many studies, but at most {_MOST_STUDIES} are made. Give "
            "intervals instead of some choices."
        )
    for values in product(*(choice.values for choice in studied)):
        pairs = zip(studied, values, strict=True)
        yield {n: x for choice, own in pairs for n, x in zip(choice.parameters, own, strict=True)}


def allowed(constraints: Sequence[Constraint], names: Sequence[str], values: Array) -> Mask:
    """Mask (N,) of the values (N, d) of parameters that satisfy all constraints; see `Box.allowed`."""
    mask = np.ones(len(values), dtype=bool)
    for constraint in constraints:
        for i in np.flatnonzero(mask):
            p = SimpleNamespace(**dict(zip(names, values[i].tolist(), strict=True)))
            try:
                result = constraint(p)
            except Exception as error:
                raise DeclarationError(f"Box: a constraint raises {type(error).__name__} at {p}: {error}") from error
            if isinstance(result, bool | np.bool_):
                mask[i] = result
            elif is_finite_number(result):
                mask[i] = result <= 0
            else:
                raise DeclarationError(
                    f"Box: a constraint must return True, False or a number, got {shown(result)} at {p}."
                )
    return mask


def intervals_and_choices(given: Mapping[str, Any]) -> tuple[tuple[Choice, ...], dict[str, Any]]:
    """The choices, and the intervals of all parameters in the given order."""
    choices, intervals = list[Choice](), dict[str, Any]()
    for name, own in given.items():
        if isinstance(own, list | Set) and own and all(map(_is_word, own)):
            raise DeclarationError(
                f"Box: the words of {name!r} need the values of parameters, such as "
                f"{name}={{{next(iter(own))!r}: {{'k': 100}}, ...}}."
            )
        part = {name: own}
        if isinstance(own, Set | range | Mapping):
            choices.append(choice := Choice.of(name, own))
            columns = zip(choice.parameters, zip(*choice.values, strict=True), choice.units, strict=True)
            part = {n: (min(x), max(x), unit) if unit else (min(x), max(x)) for n, x, unit in columns}
        if twice := intervals.keys() & part.keys():
            raise DeclarationError(f"Box: {min(twice)!r} has two intervals or choices.")
        intervals |= part
    return tuple(choices), intervals


def _is_word(text: object) -> bool:
    return isinstance(text, str) and text[:1].isalpha() and not any(map(str.isdigit, text))


class Short(float):
    """A number that is printed with at most 12 digits."""

    def __repr__(self) -> str:
        return f"{self:.12g}"


def with_unit(name: str, value: float, unit: str) -> Any:
    """A number of a parameter, or a pair of the number and its unit."""
    del name
    return (value, unit) if unit else value
