"""Names: which names are allowed, and suggestions for unknown names."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar
from unicodedata import normalize

from symmb._errors import DeclarationError

T = TypeVar("T")

LONGEST = 100
"""Maximum number of characters of a name. Longer names do not fit into tables and pictures."""


def public_names() -> dict[str, list[str]]:
    """The public names by subject, as listed in `__init__.pyi`."""
    with open(f"{__file__.removesuffix('_names.py')}__init__.pyi", encoding="utf-8") as file:
        _, *parts = re.split(r"^# (.*)$", file.read(), flags=re.MULTILINE)
    lists = [re.findall(r" as (\w+)", text) for text in parts[1::2]]
    return dict(zip(parts[::2], lists, strict=True))


def shown(value: object) -> str:
    """A value as text for one line of a message."""
    try:
        text = f"the class {value.__name__}" if isinstance(value, type) else repr(value)
    except Exception:  # an exception of the user's class
        text = f"an object of {type(value).__name__}"
    text = " ".join(text.encode("utf-8", "backslashreplace").decode().split())
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


LONGEST_SHOWN = 200
"""Maximum number of characters of a value in a message."""


def counted(number: int, noun: str) -> str:
    """A number with its noun, as '1 run' or '2 runs'."""
    return f"{number} {noun}{'s' * (number != 1)}"


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """The end of an error message: ' Did you mean 'x'?', or a list of the known names."""
    from difflib import get_close_matches

    known = [*map(str, known)]
    text = name if isinstance(name, str) else ""
    close = [own for own in known if own.casefold() == text.casefold()] or get_close_matches(text, known, n=1)
    if close:
        return f" Did you mean {close[0]!r}?"
    shown = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
    return f" Known are: {shown}." if known else ""


def normal(name: T) -> T:
    """A name in normal form. Letters are normalised as in Python's identifiers (NFKC): µ equals μ, but v² stays v²."""
    if not isinstance(name, str) or name.isascii():
        return name
    return normalize("NFC", "".join(normalize("NFKC", c) if f"_{c}".isidentifier() else c for c in name))  # pyright: ignore


def normal_keys(owner: str, named: T) -> T:
    """A mapping with names in normal form. Values of other types are unchanged.

    DeclarationError is raised if a name is not a text, or if two names become equal.
    """
    if not isinstance(named, Mapping):
        return named
    for name in named:
        if not isinstance(name, str):
            raise DeclarationError(f"{owner}: a name must be a text, got {shown(name)}.")
    if all(map(str.isascii, named)):
        return named
    result = {normal(name): value for name, value in named.items()}
    if len(result) < len(named):
        twice = [name for name, count in Counter(map(normal, named)).items() if count > 1]
        raise DeclarationError(f"{owner}: the name {shown(twice[0])} is given twice, in two Unicode forms.")
    return result  # pyright: ignore[reportReturnType]


class ByName(dict[str, T]):
    """Values by names in normal form, and the units of the values that have a unit. Look-ups accept all forms."""

    _units: Mapping[str, str] = {}

    def __init__(self, values: Mapping[str, T] | Iterable[tuple[str, T]] = (), units: Mapping[str, str] | None = None):
        super().__init__(values)
        if units := getattr(values, "_units", {}) if units is None else units:
            self._units = {name: unit for name, unit in units.items() if name in self}

    def __missing__(self, name: str) -> T:
        if (own := normal(name)) == name:
            raise KeyError(name)
        return self[own]

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or super().__contains__(normal(name))

    def get(self, name: str, default: Any = None) -> Any:
        return self[name] if name in self else default


def look_up_by_name(result: Any) -> None:
    """Convert the dictionaries of a frozen dataclass to `ByName`. Dataclasses use this function as `__post_init__`."""
    for own in fields(result):
        if type(value := getattr(result, own.name)) is dict:
            object.__setattr__(result, own.name, ByName(value))


def name_fault(name: object, without: str = "") -> str:
    """A sentence that says why a name is not allowed; empty if the name is allowed.

    Names are printed in tables, pictures, LaTeX and C. Line breaks and control characters would damage such texts.
    The characters in `without` are not allowed either.
    """
    if not isinstance(name, str):
        return f"a name must be a text, got {shown(name)}."
    if not name.isprintable() or name != name.strip() or not 1 <= len(name) <= LONGEST:
        return f"a name must have 1 to {LONGEST} printable characters, without spaces at its ends."
    if any(c in name for c in without):
        return f"a name must not contain {' '.join(without.replace(' ', ''))}{' or spaces' * (' ' in without)}."
    return ""


def name_faults(names: Sequence[object]) -> list[str]:
    """Sentences that say why names are not allowed: the fault of each name, and the names that are used twice."""
    faults = [f"{shown(name)}: {fault}" for name in names if (fault := name_fault(name))]
    texts = [normal(name) for name in names if isinstance(name, str)]
    return faults + [f"{name!r}: the name is used twice." for name, count in Counter(texts).items() if count > 1]
