"""Texts such as "pce:2:paper" that select an object on the command line."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from symmb._errors import DeclarationError
from symmb._names import did_you_mean
from symmb._options import shown

_WHOLE = {"ORDER", "BOXES", "SAMPLES", "POINTS", "RUNS", "PARTS", "PARTICLES", "STEPS"}
"""Names of numbers that must be integers. All other numbers in forms are real."""


@dataclass(frozen=True)
class Spec:
    """One way to write an object as text.

    Attributes
    ----------
    form : str      words, and names of numbers in capitals, separated by colons; parts in brackets are optional
    text : str      the constructor that the text selects
    build           function that makes the object; its arguments are the given numbers
    """

    form: str
    text: str
    build: Callable[..., Any]

    @property
    def word(self) -> str:
        """The text before the first colon."""
        return re.split(r"[:\[]", self.form)[0]

    def matches(self, spec: str) -> re.Match[str] | None:
        """Whether the text has this form. The numbers in the text are not checked."""
        pattern = self.form.replace("[", "(?:").replace("]", ")?")
        return re.fullmatch(re.sub(r"[A-Z]+", "([^:=]*)", pattern), spec)

    def read(self, match: re.Match[str]) -> Any:
        """The object that a matching text selects."""
        names = re.findall(r"[A-Z]+", self.form)
        numbers = [(name, text) for name, text in zip(names, match.groups(), strict=True) if text is not None]
        return self.build(*(_number(name, text, match.string) for name, text in numbers))


def read_spec(text: str, specs: Sequence[Spec], what: str) -> Any:
    """The object that a text selects. `specs` are the known forms of such texts.

    DeclarationError is raised if the text does not match a form, or its numbers are out of range.
    """
    for spec in specs:
        match = spec.matches(text)
        if match is not None:
            return spec.read(match)
    word = text.split(":")[0]
    forms = [spec.form for spec in specs if spec.word == word]
    if forms:
        raise DeclarationError(f"The {what} {text!r} has an unknown form. Write {' or '.join(forms)}.")
    known = dict.fromkeys(spec.word for spec in specs)
    raise DeclarationError(f"There is no {what} {word!r}.{did_you_mean(word, known)}")


def _number(name: str, text: str, spec: str) -> float:
    whole = name in _WHOLE
    try:
        return int(text) if whole else float(text)
    except ValueError:
        kind = "a whole number" if whole else "a number"
        raise DeclarationError(f"{spec}: {name} must be {kind}, got {shown(text)}.") from None
