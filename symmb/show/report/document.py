"""The file of a report: head, sections, and their contents. All texts are escaped here or by `_html`."""

import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import date
from html import escape
from importlib.metadata import version
from pathlib import Path

import numpy as np

from symmb import _html as html
from symmb._errors import DeclarationError
from symmb._options import is_real, require_names
from symmb._units import label, units_of_parameters
from symmb.bound.methods import METHODS
from symmb.equations.model import Box
from symmb.results.files import replacement

_PACKAGES = "symmb", "numpy", "casadi"
ANNEX = '<h1 class="annex" id="annex">Annex: methods, warnings and details</h1>'
BLOCK = "company", "author", "date", "drawing", "revision"
"""Parts of the title block."""
_CALL = re.compile(r"(?<![\w.'\"])([A-Z]\w*(?:\.\w+)?\()")
"""Pattern for a call of a class in the text of a method, a box or a solver."""


def write(path: str | Path, title: str, parts: Iterable[str], block: Mapping[str, object]) -> None:
    """Write a file with a title block, a title and parts."""
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    style = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    head += f"<title>{escape(title)}</title><style>{style}</style>"
    require_names("report", "part of the title block", [*block], BLOCK)
    for name, part in block.items():
        if not (part is None or isinstance(part, str | date) or is_real(part)):
            raise DeclarationError(f"report: {name} must be a text, a number or a date, got {part!r}.")
    texts = {name: escape(str(block[name])) for name in BLOCK if block.get(name) is not None}
    cells = [f"<div><dt>{name}</dt><dd>{text}</dd></div>" for name, text in texts.items() if text]
    body = f'<dl class="block">{"".join(cells)}</dl>' if cells else ""
    body += f"<h1>{escape(title)}</h1>\n" + "\n".join(parts)
    text = f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n'
    with replacement(path) as file:
        file.write(text.encode(errors="replace"))


def sentences(texts: Iterable[tuple[str, str]]) -> str:
    """A list of sentences, each with a style."""
    items = "".join(f'<li class="{style}">{_prose(text)}</li>' for style, text in texts)
    return f"<ul>{items}</ul>"


def _prose(text: str) -> str:
    """A text with code between backticks."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def section(heading: str, *parts: str, style: str = "") -> str:
    """Parts below a heading; empty if there are no parts."""
    return f'<section class="{style}"><h2>{escape(heading)}</h2>{"".join(parts)}</section>' if any(parts) else ""


def warnings(doubts: Sequence[str], remarks: Sequence[str] = ()) -> str:
    """Warnings and remarks, each in a box."""
    boxes = [("doubt", f"Warning: {doubt}") for doubt in doubts]
    boxes += [("remark", f"Remark: {remark}") for remark in remarks]
    return "".join(f'<p class="{kind}">{escape(text)}</p>' for kind, text in boxes)


def note(text: str) -> str:
    """A note about a part of the report."""
    return f'<p class="note">{_prose(text)}</p>'


def pictures(files: Iterable[tuple[str, bytes]]) -> str:
    """PNG files, each with a description. They are side by side if they stay legible."""
    figures = "".join(f"<figure>{html.picture(png, shown)}</figure>" for shown, png in files)
    return f'<div class="pictures">{figures}</div>'


def moving(page: str, png: bytes, labels: Iterable[tuple[str, str]]) -> str:
    """A page inside the report. Printed reports contain a picture instead, below the colours and their labels.

    The page runs its own scripts, and cannot access the report.
    """
    frame = f'<iframe sandbox="allow-scripts" title="the mechanism, to play" srcdoc="{escape(page)}"></iframe>'
    texts = (f'<p class="note"><b style="color: {tint}">■</b> {escape(text)}</p>' for tint, text in labels)
    return f'{frame}<div class="printed still">{"".join(texts)}{html.picture(png)}</div>'


def equations(text: str, page: int = 100) -> str:
    """Equations that readers can unfold. Printed reports contain as many complete matrices as fit on one page."""
    blocks = text.split("\n\n")
    lengths = np.cumsum([block.count("\n") + 2 for block in blocks])
    printed = [html.text(block) for block in blocks[: int((lengths <= page).sum())]]
    if len(printed) < len(blocks):
        printed.append(note(f"These are some of {lengths[-1]} lines: `print(scene.system.equations())` shows all."))
    folded = f"<details><summary>Equations</summary>{html.text(text)}</details>"
    return folded + section("Equations", *printed, style="printed equations")


def assumed(box: Box, nominal: Mapping[str, float]) -> str:
    """The intervals of the box, and the values of other parameters."""
    cut = [note(repr(box))] if box.is_cut else []
    return section("Assumptions", html.page(html.table(_intervals(box, nominal))), *cut)


def settings_table(settings: Sequence[tuple[str, str]], is_own: bool = False) -> str:
    """Settings by name. Empty settings are left out.

    The table shows the versions of packages at the time of the report. If `is_own`, the result was not read from a
    file, and has the same versions.
    """
    versions = "versions" if is_own else "versions (of this report)"
    packages = [f"{name} {version(name)}" for name in _PACKAGES]
    own = versions, ", ".join([*packages, f"Python {platform.python_version()}"])
    known = [[name, text] for name, text in (*settings, own) if text]
    return section("Settings", html.page(html.table([["setting", "value"], *known], (0, 1))), style="settings")


def _intervals(box: Box, nominal: Mapping[str, float]) -> list[list[str]]:
    rows = [["parameter", "lower", "upper", *(["nominal"] if nominal else [])]]
    for name, text, ends in zip(box.names, box.labels, box.bounds, strict=True):
        rows.append([text, *(_number(x) for x in (*ends, *([nominal[name]] if name in nominal else [])))])
    units = units_of_parameters(nominal)
    fixed = [
        [label(name, units.get(name, "")), "", "", _number(value)]
        for name, value in nominal.items()
        if name not in box.names
    ]
    return [[*row, *[""] * (len(rows[0]) - len(row))] for row in (*rows, *fixed)]


def _number(value: float) -> str:
    """A number with at most 12 digits. A large number is written with a power of ten if this is shorter."""
    plain = f"{value:.12g}"
    short = np.format_float_scientific(value, precision=11, trim="-", exp_digits=1).replace("e+", "e")
    return short if abs(value) >= 1e6 and len(short) < len(plain) else plain


def seed(method: str) -> str:
    """The seed in the text of a method; '' if the method has no seed."""
    kinds = {type(example).__name__: type(example) for entry in METHODS for example in entry.examples}
    match = re.search(r"\bseed=(\d+)", method)
    return match[1] if match else str(getattr(kinds.get(method.partition("(")[0]), "seed", ""))


def called(*texts: str) -> str:
    """Arguments of a call in Python, from the texts of methods, boxes and solvers. Empty texts are left out."""
    return ", ".join(_CALL.sub(r"mb.\1", text) for text in texts if text)
