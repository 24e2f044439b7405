"""Names: which ones are allowed, and what a user may have meant by an unknown one."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from difflib import get_close_matches

LONGEST = 100
"""Most characters of a name: longer ones do not fit into tables and pictures."""


def public_names() -> dict[str, list[str]]:
    """The public names by subject, as `__init__.pyi` lists them."""
    with open(f"{__file__.removesuffix('_names.py')}__init__.pyi", encoding="utf-8") as file:
        _, *parts = re.split(r"^# (.*)$", file.read(), flags=re.MULTILINE)
    lists = [re.findall(r" as (\w+)", text) for text in parts[1::2]]
    return dict(zip(parts[::2], lists, strict=True))


def shown(value: object) -> str:
    """A value in one line of a message."""
    try:
        text = f"the class {value.__name__}" if isinstance(value, type) else repr(value)
    except Exception:  # of the user's class
        text = f"an object of {type(value).__name__}"
    text = " ".join(text.encode("utf-8", "backslashreplace").decode().split())
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


LONGEST_SHOWN = 200
"""Most characters of a value in a message."""


def counted(number: int, noun: str) -> str:
    """A number with its noun, as '1 run' or '2 runs'."""
    return f"{number} {noun}{'s' * (number != 1)}"


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """' Did you mean 'x'?' or a list of what is known, for the end of an error message."""
    known = [*map(str, known)]
    close = get_close_matches(name, known, n=1) if isinstance(name, str) else ()
    if close:
        return f" Did you mean {close[0]!r}?"
    shown = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
    return f" Known are: {shown}." if known else ""


def name_fault(name: object, without: str = "") -> str:
    """Why a name is not allowed, as a sentence; empty if it is.

    Names are printed in tables, pictures, LaTeX and C, where a line break or a control character would do harm.
    A name must not contain the characters `without` either.
    """
    if not isinstance(name, str):
        return f"a name is a text, got {shown(name)}."
    if not name.isprintable() or name != name.strip() or not 1 <= len(name) <= LONGEST:
        return f"a name has 1 to {LONGEST} printable characters, without spaces at its ends."
    if any(c in name for c in without):
        return f"a name is a text without {' '.join(without.replace(' ', '␣'))}."
    return ""


def name_faults(names: Sequence[object]) -> list[str]:
    """Why some of the names are not allowed: each with its fault, and those that are given twice."""
    faults = [f"{shown(name)}: {fault}" for name in names if (fault := name_fault(name))]
    texts = [name for name in names if isinstance(name, str)]
    return faults + [f"{name!r}: the name is used twice." for name, count in Counter(texts).items() if count > 1]
