"""Choices and constraints of a box. Choices are finite sets of numbers, and words with the values of parameters."""

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import islice
from types import SimpleNamespace
from typing import Any

import numpy as np

from symmb._errors import DeclarationError
from symmb._magnitudes import SAME
from symmb._names import normal_keys
from symmb._options import is_finite_number, shown
from symmb._types import Array
from symmb._units import number_in, quantity, scaled

Choices = Set[Any] | range | list[str] | Mapping[str, Any]
"""A finite set of values, a list of words, or values by words."""
_MOST = 10_000
"""Largest number of values of a choice. Studies make runs for each value."""
Constraint = Callable[[Any], Any]
"""A function of the parameters p, such as p.a. The result is True, or a number of at most 0, if they are allowed."""


@dataclass(frozen=True, repr=False)
class Choice:
    """One of several values of a parameter, or one of several words with values of one or more parameters.

    Attributes
    ----------
    name : str
    labels : n words; empty for a set of numbers
    parameters : d names
    values : n tuples of d numbers
    units : d units of the values, '' for numbers without units
    numbered : whether the values are the numbers 0, 1, ... of a list of words
    """

    name: str
    labels: tuple[str, ...]
    parameters: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    units: tuple[str, ...]
    numbered: bool = False

    @classmethod
    def of(cls, name: str, given: Any) -> "Choice":
        """The choice of a set, a range, a list of words, or a mapping of words to numbers or to numbers by name."""
        if any(True for _ in islice(given, _MOST, None)):
            raise DeclarationError(f"Box: {name!r} has more than {_MOST} values. Give an interval, or fewer values.")
        if numbered := isinstance(given, list):
            given, words = {word: k for k, word in enumerate(given)}, given
            if len(given) < len(words):
                raise DeclarationError(f"Box: the words of {name!r} must be different, got {shown(words)}.")
        labels = tuple(given) if isinstance(given, Mapping) else ()
        if not given or not all(isinstance(label, str) and label.isprintable() for label in labels):
            raise DeclarationError(f"Box: {name!r} must have at least one value, and words as names of its values.")
        options = [given[label] for label in labels] if labels else list(given)
        if isinstance(given, Set) and any(map(_is_word, given)):
            raise DeclarationError(f"Box: the words of {name!r} have no order. Use a list of words.")
        options = [normal_keys("Box", own if isinstance(own, Mapping) else {name: own}) for own in options]
        parameters = tuple(options[0])
        if not parameters or any(own.keys() != options[0].keys() for own in options):
            raise DeclarationError(f"Box: the words of {name!r} must give values of the same parameters.")
        pairs = [[quantity(f"Box: {name!r}:", own[n]) for own in options] for n in parameters]
        if any(len({bool(unit) for _, unit in own}) > 1 for own in pairs):
            raise DeclarationError(f"Box: {name!r} must have units for all values of a parameter, or for none.")
        units = tuple(own[0][1] for own in pairs)
        columns = (
            [number_in(f"Box: {name!r}", n, x, unit) if unit else x[0] for x in own]
            for n, unit, own in zip(parameters, units, pairs, strict=True)
        )
        values = [*zip(*columns, strict=True)]
        return cls(name, labels, parameters, tuple(values if labels else sorted(set(values))), units, numbered)

    def intervals(self, *ks: int) -> dict[str, Any]:
        """The smallest intervals, with their units, that contain the values with the numbers `ks`; default: all."""
        columns = zip(*(self.values[k] for k in ks or range(len(self.values))), strict=True)
        triples = zip(self.parameters, columns, self.units, strict=True)
        return {n: (min(x), max(x), unit) if unit else (min(x), max(x)) for n, x, unit in triples}

    def scaled(self, ratios: Mapping[str, Any], units: Mapping[str, str]) -> "Choice":
        """The choice with values in other units, by the ratios of the units."""
        own = [tuple(scaled(x, ratios[n]) for n, x in zip(self.parameters, row, strict=True)) for row in self.values]
        return replace(self, values=tuple(own), units=tuple(units.get(n, "") for n in self.parameters))

    def has(self, values: Sequence[float]) -> bool:
        """Whether values (d,) are one of the choices, up to rounding."""
        return bool(np.isclose(self.values, values, rtol=SAME, atol=0.0).all(axis=1).any())

    def chosen(self, values: Mapping[str, float]) -> str:
        """The choice in words, as "spring: hard", for values of all parameters."""
        own = np.array([values[name] for name in self.parameters])
        k = int(np.abs(np.array(self.values) - own).sum(axis=1).argmin())
        return f"{self.name}: {self.labels[k] if self.labels else f'{self.values[k][0]:.12g}'}"

    def __repr__(self) -> str:
        units = [f", {unit!r}" if unit else "" for unit in self.units]
        rows = [
            [f"({x:.12g}{u})" if u else f"{x:.12g}" for x, u in zip(own, units, strict=True)] for own in self.values
        ]
        if self.parameters == (self.name,):
            texts = [row[0] for row in rows]
        else:
            pairs = ([f"{n!r}: {x}" for n, x in zip(self.parameters, row, strict=True)] for row in rows)
            texts = [f"{{{', '.join(own)}}}" for own in pairs]
        words = [f"{label!r}: " for label in self.labels] or [""] * len(texts)
        return f"{{{', '.join(map(str.__add__, words, texts))}}}"


def chosen_words(choices: Sequence[Choice], values: Mapping[str, float]) -> tuple[str, ...]:
    """The chosen words, as "spring: hard", for values of all parameters."""
    return tuple(choice.chosen(values) for choice in choices if choice.labels)


def require_numbers_of_words(choices: Sequence[Choice], nominal: Mapping[str, float]) -> None:
    """Raise a DeclarationError if a list of words belongs to a quantity, whose nominal value is no number of a word."""
    for choice in choices:
        if choice.numbered and not choice.has([nominal[choice.name]]):
            n, own = len(choice.labels), nominal[choice.name]
            raise DeclarationError(
                f"Box: the words of {choice.name!r} have the numbers 0 to {n - 1}, but its nominal value is {own:g}."
                f"{hint(choices, choice.name)}"
            )


def hint(choices: Sequence[Choice], name: str) -> str:
    """A sentence with the values of words, for parameters that have words; empty for other parameters."""
    words = [label for choice in choices if choice.name == name for label in choice.labels]
    if not words:
        return ""
    return (
        f" Give the values of each word, as {name}={{{words[0]!r}: 100, ...}} or {{{words[0]!r}: {{'k': 100}}, ...}}."
    )


def excess(constraints: Sequence[Constraint], names: Sequence[str], values: Array) -> Array:
    """Measure (N,) by which values (N, d) of parameters miss the constraints: 0 if they satisfy all constraints.

    It is the number of constraints after the first one that is not satisfied, plus e / (1 + e), where e is the number
    that this constraint returns. For False, e is infinite. See `Box.allowed`.
    """
    missed = np.zeros(len(values))
    for after, constraint in zip(range(len(constraints) - 1, -1, -1), constraints, strict=True):
        for i in np.flatnonzero(missed == 0):
            p = SimpleNamespace(**dict(zip(names, values[i].tolist(), strict=True)))
            try:
                result = constraint(p)
            except Exception as error:
                if isinstance(error, AttributeError) and error.obj is p:
                    known = ", ".join(names)
                    raise DeclarationError(
                        f"Box: a constraint uses {error.name!r}, which has no interval in the box. Known are: {known}."
                    ) from error
                raise DeclarationError(
                    f"Box: a constraint raises {type(error).__name__} at {_point(p)}: {error}"
                ) from error
            if isinstance(result, bool | np.bool_):
                missed[i] = 0 if result else after + 1
            elif is_finite_number(result):
                missed[i] = 0 if result <= 0 else after + result / (1 + result)
            else:
                raise DeclarationError(
                    f"Box: a constraint must return True, False or a number, got {shown(result)} at {_point(p)}."
                )
    return missed


def intervals_and_choices(given: Mapping[str, Any]) -> tuple[tuple[Choice, ...], dict[str, Any]]:
    """The choices, and the intervals of all parameters in the given order."""
    choices, intervals = list[Choice](), dict[str, Any]()
    for name, own in given.items():
        part = {name: own}
        if isinstance(own, Choice | Set | range | Mapping) or (
            isinstance(own, list) and own and all(map(_is_word, own))
        ):
            choices.append(choice := own if isinstance(own, Choice) else Choice.of(name, own))
            part = choice.intervals()
        if twice := intervals.keys() & part.keys():
            raise DeclarationError(f"Box: {min(twice)!r} has two intervals or choices.")
        intervals |= part
    return tuple(choices), intervals


def _is_word(text: object) -> bool:
    """Whether a text begins with a letter, unlike a number with a unit."""
    return isinstance(text, str) and text[:1].isalpha()


def _point(p: SimpleNamespace) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in vars(p).items())
