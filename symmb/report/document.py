"""The file of a report: its head, its sections, and what stands in them. All texts are escaped here or by `_html`."""

import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path

import numpy as np

from symmb import _html as html
from symmb.bounds import METHODS
from symmb.files import replacement
from symmb.model import Box

_PACKAGES = "symmb", "numpy", "casadi"
_LARGE = 1e6
_CALL = re.compile(r"(?<![\w.'\"])([A-Z]\w*(?:\.\w+)?\()")
"""A call of a class in the text of a method, a box or a solver."""
_STYLE = """
:root { color-scheme: light dark; --ink: #20262d; --soft: #5d6773; --line: #d5dbe1; --paper: #fff; --warn: #fff4dc;
  --edge: #c98a00; --even: #64748b12; --shade: #0003; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e8ec; --soft: #a3adb8; --line: #3b444e; --paper: #171b20;
  --warn: #3a2d0c; --edge: #d9a227; --even: #94a3b814; --shade: #fff3; } }
@media print { :root { color-scheme: light; --ink: #000; --soft: #444; --line: #bbb; --paper: #fff; --warn: #fff4dc;
  --edge: #c98a00; --even: #64748b12; --shade: #0000; } }
@page { size: A4; margin: 14mm 13mm; }
* { box-sizing: border-box; }
body { max-width: 1100px; margin: 0 auto; padding: 20px 24px 48px; font: 15px/1.5 system-ui, sans-serif;
  color: var(--ink); background: var(--paper); overflow-wrap: anywhere; }
h1 { font-size: 25px; line-height: 1.25; margin: 8px 0 12px; }
h2 { font-size: 18px; margin: 32px 0 8px; padding-bottom: 3px; border-bottom: 1px solid var(--line); }
pre { font-size: 13px; line-height: 1.45; }
table { border-collapse: collapse; margin: 8px 0; font-size: 13.5px; font-variant-numeric: tabular-nums; }
th, td { padding: 4px 10px; border-bottom: 1px solid var(--line); vertical-align: top; overflow-wrap: normal; }
[style*="right"] { white-space: nowrap; } thead [style*="right"] { white-space: normal; }
th { color: var(--soft); font-weight: 600; vertical-align: bottom; }
tbody tr:nth-child(even) { background: var(--even); }
div[style*="overflow-x"] { background: linear-gradient(90deg, var(--paper) 30%, #0000) 0 / 30px 100% local,
  linear-gradient(270deg, var(--paper) 30%, #0000) 100% / 30px 100% local,
  linear-gradient(90deg, var(--shade), #0000) 0 / 10px 100%,
  linear-gradient(270deg, var(--shade), #0000) 100% / 10px 100%; background-repeat: no-repeat; }
img { display: block; height: auto; margin: 8px 0; background: #fff; border-radius: 4px; }
iframe { display: block; width: 100%; height: 560px; margin: 8px 0; border: 1px solid var(--line); border-radius: 4px;
  background: #fff; color-scheme: light; }
.note { color: var(--soft); font-size: 13.5px; margin: 4px 0; }
.doubt, .remark { margin: 8px 0; padding: 8px 12px; border-left: 4px solid var(--edge); background: var(--warn); }
.remark { border-color: var(--line); background: var(--even); }
details { margin: 28px 0 0; } summary { cursor: pointer; font-weight: 600; font-size: 18px; }
.printed { display: none; } .limits pre { font-weight: 600; font-size: 15px; }
.still img { max-height: 440px; width: auto !important; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 330px), 1fr)); gap: 6px 14px; }
figure { margin: 0; break-inside: avoid; } figure img { width: 100% !important; max-width: 560px !important; }
.contributions table { display: inline-table; margin-right: 28px; vertical-align: top; }
@media (max-width: 640px) { body { padding: 12px 14px 32px; } th, td { padding: 3px 6px; } iframe { height: 640px; }
  .methods img { max-width: none !important; } .limits td:first-child { min-width: 9em; }
  .limits td:nth-child(3) { min-width: 16em; } }
@media print { body { max-width: none; padding: 0; font-size: 10pt; print-color-adjust: exact; }
  h1 { font-size: 17pt; } h2 { font-size: 12.5pt; margin-top: 14pt; }
  h2, .note:not(:last-child), pre:not(:last-child) { break-after: avoid; }
  pre { font-size: 7.5pt; } table { font-size: 6.8pt; } th, td { padding: 2pt 3pt; }
  tr, img, .still, .contributions table, .contributions pre, .doubt { break-inside: avoid; }
  .contributions table { font-size: 6.2pt; margin-right: 8pt; }
  .note { font-size: 8.5pt; } details { display: none; }
  .limits pre { font-size: 10pt; } .still img { max-height: 105mm; }
  div { overflow: visible !important; } iframe { display: none; } .printed { display: block; } }
"""


def write(path: str | Path, title: str, parts: Iterable[str]) -> None:
    """Write a file with a title above parts."""
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<title>{escape(title)}</title><style>{_STYLE}</style>"
    body = f"<h1>{escape(title)}</h1>\n" + "\n".join(parts)
    text = f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n'
    with replacement(path) as file:
        file.write(text.encode(errors="replace"))


def section(heading: str, *parts: str, style: str = "") -> str:
    """Parts under a heading; nothing if there are none."""
    return f'<section class="{style}"><h2>{escape(heading)}</h2>{"".join(parts)}</section>' if any(parts) else ""


def warnings(doubts: Sequence[str], remarks: Sequence[str] = ()) -> str:
    """Doubts and remarks, each in a box."""
    boxes = [("doubt", f"Doubtful: {doubt}") for doubt in doubts]
    boxes += [("remark", f"Remark: {remark}") for remark in remarks]
    return "".join(f'<p class="{kind}">{escape(text)}</p>' for kind, text in boxes)


def note(text: str) -> str:
    """A sentence about what stands beside it."""
    return f'<p class="note">{escape(text)}</p>'


def pictures(files: Iterable[tuple[str, bytes]]) -> str:
    """PNG files with what they show in words, as many beside each other as are legible."""
    figures = "".join(f"<figure>{html.picture(png, shown)}</figure>" for shown, png in files)
    return f'<div class="pictures">{figures}</div>'


def moving(page: str, png: bytes, labels: Sequence[str]) -> str:
    """A page inside the report, in whose place a picture with the labels of the page is printed.

    The page runs its own scripts, and reaches nothing of the report.
    """
    frame = f'<iframe sandbox="allow-scripts" title="the mechanism, to play" srcdoc="{escape(page)}"></iframe>'
    return f'{frame}<div class="printed still">{"".join(map(note, labels))}{html.picture(png)}</div>'


def folded(heading: str, text: str) -> str:
    """A text that shows on demand, and is not printed."""
    return f"<details><summary>{escape(heading)}</summary>{html.text(text)}</details>" if text else ""


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
