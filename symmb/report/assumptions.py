"""What a result assumes, what it cost, and how it is found again."""

import platform
import re
from collections.abc import Mapping, Sequence
from importlib.metadata import version

import numpy as np

from symmb import _html as html
from symmb.bounds import METHODS
from symmb.model import Box
from symmb.report.document import section

_PACKAGES = "symmb", "numpy", "casadi"
_LARGE = 1e6
_CALL = re.compile(r"(?<![\w.'\"])([A-Z]\w*(?:\.\w+)?\()")
"""A call of a class in the text of a method, a box or a solver."""


def assumed(
    box: Box | None, nominal: Mapping[str, float], settings: Sequence[tuple[str, str]], is_own: bool = False
) -> str:
    """The box, and settings by name; those that are empty are left out.

    Versions are those of the report. They are those of the result too if it `is_own`, and was not read from a file.
    """
    versions = "versions" if is_own else "versions (of this report)"
    packages = [f"{name} {version(name)}" for name in _PACKAGES]
    own = versions, ", ".join([*packages, f"Python {platform.python_version()}"])
    known = [[name, text] for name, text in (*settings, own) if text]
    intervals = [] if box is None else [html.page(html.table(_intervals(box, nominal)))]
    return section("What is assumed", *intervals, html.page(html.table([["setting", "value"], *known], (0, 1))))


def _intervals(box: Box, nominal: Mapping[str, float]) -> list[list[str]]:
    rows = [["parameter", "lower", "upper", *(["nominal"] if nominal else [])]]
    for name, ends in zip(box.names, box.bounds, strict=True):
        rows.append([name, *(_number(x) for x in (*ends, *([nominal[name]] if name in nominal else [])))])
    fixed = [[name, "", "", _number(value)] for name, value in nominal.items() if name not in box.names]
    return [[*row, *[""] * (len(rows[0]) - len(row))] for row in (*rows, *fixed)]


def _number(value: float) -> str:
    """A number with 12 digits at most, in powers of ten where that is shorter and it is large."""
    plain = f"{value:.12g}"
    short = np.format_float_scientific(value, precision=11, trim="-", exp_digits=1).replace("e+", "e")
    return short if abs(value) >= _LARGE and len(short) < len(plain) else plain


def seed(method: str) -> str:
    """The seed of the method that has this text, '' if it takes none."""
    kinds = {type(example).__name__: type(example) for entry in METHODS for example in entry.examples}
    match = re.search(r"\bseed=(\d+)", method)
    return match[1] if match else str(getattr(kinds.get(method.partition("(")[0]), "seed", ""))


def called(*texts: str) -> str:
    """Arguments of a call in Python from the texts of methods, boxes and solvers; empty ones are left out."""
    return ", ".join(_CALL.sub(r"mb.\1", text) for text in texts if text)


def again(lines: str) -> str:
    """How to find a result again: lines of Python, or a command."""
    return section("To repeat it", html.text(lines))
